"""The summary's figures that are counted from the truth, of the fleet and of each aMussel: uptime, samples, charge."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import fsum
from statistics import fmean
from typing import Any

from apad_bridge.events.fleet_events import Presence
from apad_bridge.records.field_types import BOOLEAN, INTEGER, NUMBER, LineField
from apad_bridge.records.uptime import AgentUptime, UptimeMeter
from firmware_model.power.charge import fraction

_KEYS = (
    *("counted_s", "counted_at_end"),
    *("uptime_paper", "uptime_submerged", "active_mean", "amussels_lost", "emptied"),
    *("samples_taken", "dead_time_s", "final_charge_mean", "charge_gain_mean", "uptime_equal_charge"),
)
NO_TRUTH = "no truth was recorded: real aMussels, or another's fleet"
AMUSSEL: tuple[LineField, ...] = (
    LineField("uptime_paper", NUMBER, "its uptime, as above", "%"),
    LineField("uptime_submerged", NUMBER, "its other uptime", "%"),
    LineField("services", INTEGER, "number of times that it left a dock of this aPad full"),
    LineField("samples_taken", INTEGER, "samples that its sensors took; null for boards without a log"),
    LineField("final_charge", NUMBER, "charge of its primary battery at the end", "0 to 1"),
    LineField("emptied", BOOLEAN, "its primary battery was empty at some time"),
    LineField("lost", BOOLEAN, "both batteries were empty at some time"),
)
"""The figures of one aMussel; all but `services` are null where nothing of it was counted here."""


def amussel_figures(
    meter: UptimeMeter,
    services: Mapping[int, int],
    agent_ids: Iterable[int],
    now_ms: int,
    *,
    takes_samples: bool,
) -> dict[str, dict[str, Any]]:
    """The figures of each aMussel by its id, which is a text in JSON.

    `services` also has the aMussels of other aPads' fleets that this one served.
    """
    uptimes, ticks = {it.agent_id: it for it in meter.at(now_ms)}, meter.ticks(now_ms)
    unknown = {} if takes_samples else {"samples_taken": None}
    return {
        str(agent_id): _figures_of(uptimes.get(agent_id), ticks)
        | {"services": services.get(agent_id, 0)}
        | unknown
        for agent_id in sorted({*agent_ids, *services})
    }


def _figures_of(uptime: AgentUptime | None, ticks: int) -> dict[str, Any]:
    span = 0 if uptime is None else ticks - uptime.beside_real - uptime.retired
    if uptime is None or not span:
        return {field.name: None for field in AMUSSEL}
    is_left = uptime.presence is Presence.SIMULATED
    return {
        "uptime_paper": 100 * uptime.paper / span,
        "uptime_submerged": 100 * uptime.submerged / span,
        "services": 0,
        "samples_taken": uptime.samples,
        "final_charge": fraction(uptime.charge) if is_left else None,
        "emptied": uptime.emptied,
        "lost": uptime.lost,
    }


def uptime_figures(
    meter: UptimeMeter, now_ms: int, tick_ms: int = 1000, battery_min: float | None = None
) -> dict[str, Any]:
    """The keys of summary.json that come from the truth; without a truth they are None, and `uptime_missing` is the reason.

    `battery_min` is the number of active agent minutes that a whole battery more is worth; without it,
    `uptime_equal_charge` is None.

    An aMussel counts while it is simulated and in the water: `counted_s` is that time, summed over all aMussels. `excluded`
    holds what is left out.
    """
    uptimes, ticks = meter.at(now_ms), meter.ticks(now_ms)
    spans = {uptime.agent_id: ticks - uptime.beside_real - uptime.retired for uptime in uptimes}
    apart = {"excluded": _apart(uptimes, tick_ms)}
    if not any(spans.values()):
        reason = (
            NO_TRUTH
            if not uptimes
            else "the run ended before its first tick"
            if ticks == 0
            else "no aMussel was simulated in the water"
        )
        return {**dict.fromkeys(_KEYS), **apart, "uptime_missing": reason}
    left = [uptime for uptime in uptimes if uptime.presence is Presence.SIMULATED]
    # One that was a real aMussel's twin for a while, or out of the water, may have got any charge there.
    gains = [fraction(it.charge - it.charge_at_begin) for it in left if not it.beside_real and not it.retired]
    paper = _spread([(it.paper, spans[it.agent_id]) for it in uptimes])
    worth = (
        None if battery_min is None else 100 * battery_min * meter.ticks_per_agent_min / sum(spans.values())
    )
    return {
        "counted_s": sum(spans.values()) * tick_ms / 1000,
        "counted_at_end": len(left),
        "uptime_paper": paper,
        "uptime_submerged": _spread([(it.submerged, spans[it.agent_id]) for it in uptimes]),
        "active_mean": sum(uptime.paper for uptime in uptimes) / ticks,
        "amussels_lost": sum(uptime.lost for uptime in uptimes),
        "emptied": sum(uptime.emptied for uptime in uptimes),
        "samples_taken": sum(uptime.samples for uptime in uptimes),
        "dead_time_s": sum(uptime.dead for uptime in uptimes) * tick_ms / 1000,
        "final_charge_mean": fraction(sum(uptime.charge for uptime in left)) / len(left) if left else None,
        "charge_gain_mean": fmean(gains) if gains else None,
        "uptime_equal_charge": None if worth is None or not gains else paper["mean"] + worth * fsum(gains),
        **apart,
    }


def _apart(uptimes: Sequence[AgentUptime], tick_ms: int) -> dict[str, Any] | None:
    """The part that the figures leave out, or None. Seconds are summed over aMussels."""
    if not (others := [it for it in uptimes if it.beside_real or it.retired]):
        return None
    return {
        "amussels": len(others),
        "beside_real_s": sum(it.beside_real for it in others) * tick_ms / 1000,
        "retired_s": sum(it.retired for it in others) * tick_ms / 1000,
        "samples_taken": sum(len(span) for it in others for span in it.apart),
    }


def _spread(counts: Sequence[tuple[int, int]]) -> dict[str, float]:
    """Mean, maximum and minimum in percent, from each aMussel's (ticks counted, ticks in the water).

    The mean is over all ticks of all aMussels.
    """
    shares = [100 * counted / ticks for counted, ticks in counts if ticks]
    return {
        "mean": 100 * sum(counted for counted, _ in counts) / sum(ticks for _, ticks in counts),
        "max": max(shares),
        "min": min(shares),
    }

"""What a run comes to: the figures of summary.json that are counted from the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

from apad_bridge.records.uptime import AgentUptime, UptimeMeter
from firmware_model.charge import fraction

NO_TRUTH = "no truth was recorded: real aMussels, or another's fleet"


@dataclass(frozen=True, slots=True)
class Ending:
    """What the flight knows at its end and the records do not. Metres; `apad_energy_fraction` is of its battery, used."""

    ended_by: str
    cost_m: float
    services: int
    apad_energy_fraction: float | None
    dropped: Mapping[str, int]
    """Counts of what was dropped, by reason."""
    first_cause: str | None = None
    """Of a run in which something failed: what failed first."""
    samples_gone: Mapping[int, Set[int]] = field(default_factory=dict)
    """By aMussel, the sequences of samples that never will come."""


def uptime_figures(meter: UptimeMeter, now_ms: int, tick_ms: int = 1000) -> dict[str, Any]:
    """The keys of summary.json that come from the truth; None, and `uptime_missing` why, where there is none."""
    uptimes, ticks = meter.at(now_ms), meter.ticks(now_ms)
    if not uptimes or ticks == 0:
        reason = NO_TRUTH if not uptimes else "the run ended before its first tick"
        names = (
            "uptime_paper",
            "uptime_submerged",
            "active_mean",
            "amussels_lost",
            "emptied",
            "samples_taken",
            "dead_time_s",
        )
        return {**dict.fromkeys((*names, "final_charge_mean")), "uptime_missing": reason}
    return {
        "uptime_paper": _spread([uptime.paper for uptime in uptimes], ticks),
        "uptime_submerged": _spread([uptime.submerged for uptime in uptimes], ticks),
        "active_mean": sum(uptime.paper for uptime in uptimes) / ticks,
        "amussels_lost": sum(uptime.lost for uptime in uptimes),
        "emptied": sum(uptime.emptied for uptime in uptimes),
        "samples_taken": sum(uptime.samples for uptime in uptimes),
        "dead_time_s": sum(uptime.dead for uptime in uptimes) * tick_ms / 1000,
        "final_charge_mean": _mean_charge(uptimes),
    }


def _spread(counts: Sequence[int], ticks: int) -> dict[str, float]:
    """In percent of `ticks`."""
    return {
        "mean": 100 * sum(counts) / (ticks * len(counts)),
        "max": 100 * max(counts) / ticks,
        "min": 100 * min(counts) / ticks,
    }


def _mean_charge(uptimes: Sequence[AgentUptime]) -> float:
    return fraction(sum(uptime.charge for uptime in uptimes)) / len(uptimes)

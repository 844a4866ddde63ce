"""The fields of summary.json, and the figures in it that are counted from the truth."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from math import fsum
from statistics import fmean
from typing import Any

from agents.time_scale import TimeScale
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import Presence
from apad_bridge.events.guard_events import DangerOver, GuardReacted, OrderRefused
from apad_bridge.events.mission_events import (
    PRE_EMPTED,
    BeyondReach,
    DockSwitched,
    InReach,
    LeftAlone,
    MissionEnd,
    PrimitiveChanged,
    PrimitivePhase,
    StepGivenUp,
)
from apad_bridge.events.person_events import Overridden, PersonOrdered
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.records.field_types import BOOLEAN, INTEGER, NUMBER, TEXT, LineField, Type
from apad_bridge.records.uptime import AgentUptime, UptimeMeter
from firmware_model.power.charge import fraction

_KEYS = (
    *("counted_s", "counted_at_end"),
    *("uptime_paper", "uptime_submerged", "active_mean", "amussels_lost", "emptied"),
    *("samples_taken", "dead_time_s", "final_charge_mean", "charge_gain_mean", "uptime_equal_charge"),
)
NO_TRUTH = "no truth was recorded: real aMussels, or another's fleet"
_TRIES_OF_A_DOCK = 2
"""Failed dockings of a dock that never closed, after which it counts as failed: a single one is a missed aMussel."""
_NUMBER = re.compile(r"\d+(\.\d+)?")
_STOP, _TAKEN, _UNCONFIRMED = "a stop", "an override", "no confirmation"


@dataclass(frozen=True, slots=True)
class Ending:
    """Facts about the end of a flight that the records do not hold.

    `apad_energy_fraction` is the used fraction of the aPad's battery.
    """

    ended_by: MissionEnd
    cost_m: float
    """Metres driven on go-tos."""
    planned_m: float
    """Metres of the go-tos' straight legs, as the paper counts its cost."""
    services: int
    apad_energy_fraction: float | None
    dropped: Mapping[str, int]
    """Counts of what was dropped, by reason."""
    first_cause: str | None = None
    """The first failure of a run in which something failed."""
    samples_gone: Mapping[int, Set[int]] = field(default_factory=dict)
    """The sequence numbers of samples that can no longer be uploaded, by aMussel."""
    latest_tick_s: float | None = None
    """The largest lateness of a tick, in seconds of the clock that it follows; None in virtual time."""


class FailureCounts:
    """Counts the failures of a run from the journal's events.

    A step that is given up because its primitive failed has one cause with it. Causes that differ in their numbers alone,
    such as the metres left to go, are one, under the text that came first.
    """

    def __init__(self) -> None:
        self.steps_given_up = 0
        self.left_alone: set[int] = set()
        """The aMussels that the mission has left alone."""
        self.beyond_reach: set[int] = set()
        """The aMussels that the mission does not serve for the present, because of the way to them."""
        self._causes: Counter[str] = Counter()
        self._texts: dict[str, str] = {}
        self._newest: tuple[int, str] | None = None
        self._failed_dockings: Counter[int] = Counter()
        """Number of failed dockings by dock, of docks that have not closed around any aMussel."""
        self._closed: set[int] = set()

    @property
    def causes(self) -> dict[str, int]:
        """Number of failures by cause, the most frequent first."""
        return {self._texts[cause]: count for cause, count in self._causes.most_common()}

    def take(self, at_ms: int, event: Event) -> None:
        match event:
            case PrimitiveChanged(phase=PrimitivePhase.FAILED, reason=str() as reason) if (
                reason != PRE_EMPTED
            ):
                self._count(reason)
                self._newest = (at_ms, reason)
                if event.name == "dock" and event.dock is not None:
                    self._failed_dockings[event.dock] += 1
            case DockSwitched(closed=True):
                self._closed.add(event.dock)
            case StepGivenUp():
                self.steps_given_up += 1
                if self._newest != (at_ms, event.reason):
                    self._count(event.reason)
            case GuardReacted() if self._newest != (at_ms, event.reason):
                self._count(event.reason)  # unless it ended a primitive, whose line has counted it
            case DocksDisagree():
                self._count(event.reason)
            case OrderRefused(order="permit to surface"):
                self._count(event.reason)  # a refused command fails its primitive, whose line is counted
            case LeftAlone():
                self.left_alone.add(event.agent)
            case BeyondReach():
                self.beyond_reach.add(event.agent)
            case InReach():
                self.beyond_reach.discard(event.agent)
            case Overridden(taken=False):
                self.left_alone.clear()  # a person gives them another chance

    def figures(self) -> dict[str, Any]:
        """The keys of summary.json."""
        return {
            "causes": self.causes,
            "steps_given_up": self.steps_given_up,
            "left_alone": sorted(self.left_alone),
            "beyond_reach": sorted(self.beyond_reach),
            "failed_docks": sorted(
                dock_index
                for dock_index, tries in self._failed_dockings.items()
                if tries >= _TRIES_OF_A_DOCK and dock_index not in self._closed
            ),
        }

    def _count(self, reason: str) -> None:
        cause = _NUMBER.sub("#", reason)
        self._texts.setdefault(cause, reason)
        self._causes[cause] += 1


class Interruptions:
    """The spans in which a person or a guard kept the mission from the aPad, from the journal's events.

    A span begins with a person's stop, with an override, with a guard's reaction, or with an order that is refused until
    a person confirms it. It ends when the last of these is over: a person continues, the aPad is given back, the danger
    has passed.
    """

    def __init__(self) -> None:
        self._causes: set[str] = set()
        self._since_ms = 0
        self._spans_ms: list[tuple[int, int]] = []

    def take(self, at_ms: int, event: Event) -> None:
        match event:
            case PersonOrdered(order="stop" | "motors off"):
                self._begin(at_ms, _STOP)
            case PersonOrdered(order="continue"):
                self._end(at_ms, *(it for it in self._causes if it != _TAKEN))
            case Overridden(taken=True):
                self._begin(at_ms, _TAKEN)
            case Overridden(taken=False):
                self._end(at_ms, *self._causes)
            case GuardReacted():
                self._begin(at_ms, event.cause)
            case DangerOver():
                self._end(at_ms, event.cause)
            case OrderRefused(guard="person"):
                self._begin(at_ms, _UNCONFIRMED)

    @property
    def is_one(self) -> bool:
        """True while the mission is kept from the aPad, as of the newest event."""
        return bool(self._causes)

    def spans_ms(self, until_ms: int) -> list[tuple[int, int]]:
        """(begin, end) of each span up to a mission time, in order."""
        last = [(self._since_ms, until_ms)] if self._causes else []
        return [*self._spans_ms, *last]

    def stopped_s(self, until_ms: int) -> float:
        return sum(end_ms - begin_ms for begin_ms, end_ms in self.spans_ms(until_ms)) / 1000

    def _begin(self, at_ms: int, cause: str) -> None:
        if not self._causes:
            self._since_ms = at_ms
        self._causes.add(cause)

    def _end(self, at_ms: int, *causes: str) -> None:
        if not self._causes:
            return
        self._causes.difference_update(causes)
        if not self._causes and at_ms > self._since_ms:
            self._spans_ms.append((self._since_ms, at_ms))


_WHOLE = frozenset({EndReason.MISSION_TIME, EndReason.APAD_BATTERY, EndReason.END_BY, EndReason.SCRIPT_ENDED})


def interruption(summary: Mapping[str, Any]) -> str | None:
    """Why the figures of a run, or of several aPads, are not those of a whole flight; None if they are.

    A summary of an older version has no `stopped_s`, and counts as not stopped.
    """
    flights = summary.get("apads", {"": summary}).values()
    stopped_s = max(it.get("stopped_s") or 0 for it in flights)
    ends = [it["ended_by"] for it in flights if EndReason(it["end_reason"]) not in _WHOLE]
    parts = [f"stopped for {stopped_s:g} s of {summary['mission_s']:g} s"] if stopped_s else []
    return "; ".join([*parts, *(f"ended by {it}" for it in dict.fromkeys(ends))]) or None


_SPREAD, _OBJECT = Type(dict, "{mean, max, min}"), Type(dict, "object")

SUMMARY: tuple[LineField, ...] = (
    LineField("name", TEXT, "the scenario's name"),
    LineField("theta", INTEGER, "agent time per mission time"),
    LineField("seed", INTEGER, "of all that is random"),
    LineField("agents", INTEGER, "number of aMussels of the fleet"),
    LineField("mission_s", NUMBER, "mission time at the end", "s"),
    LineField(
        "stopped_s",
        NUMBER,
        "of it, the time in which a person or a guard kept the mission from the aPad",
        "s",
    ),
    LineField("ended_by", TEXT, "why the mission ended, for people"),
    LineField("end_reason", TEXT, "the same, one of a fixed set"),
    LineField("first_cause", TEXT, "the first failure of the aPad that was not overcome"),
    LineField("causes", _OBJECT, "number of failures, by cause"),
    LineField("steps_given_up", INTEGER, "steps of plans that the mission gave up"),
    LineField(
        "left_alone", Type(list, "list of integer"), "aMussels that the mission no longer tries to serve"
    ),
    LineField(
        "beyond_reach",
        Type(list, "list of integer"),
        "aMussels that it does not serve because of the way, at the end",
    ),
    LineField(
        "failed_docks",
        Type(list, "list of integer"),
        "docks in which each docking failed, twice or more; from 0",
    ),
    LineField("counted_s", NUMBER, "time in the water as simulated ones, over all aMussels", "s"),
    LineField("counted_at_end", INTEGER, "aMussels that count at the end"),
    LineField("uptime_paper", _SPREAD, "share of ticks undocked with charge in the primary battery", "%"),
    LineField("uptime_submerged", _SPREAD, "share of ticks under water on the primary battery", "%"),
    LineField("active_mean", NUMBER, "aMussels that were active at a tick, in the paper's meaning"),
    LineField("amussels_lost", INTEGER, "aMussels whose batteries were both empty at some time"),
    LineField("emptied", INTEGER, "aMussels whose primary battery was empty at some time"),
    LineField("samples_taken", INTEGER, "samples that the sensors took"),
    LineField("dead_time_s", NUMBER, "time with an empty primary battery, over all aMussels", "s"),
    LineField("final_charge_mean", NUMBER, "charge of the primary batteries at the end", "0 to 1"),
    LineField(
        "charge_gain_mean",
        NUMBER,
        "charge of the primary batteries at the end minus at the begin: below 0 for a flight that lives on its store",
        "-1 to 1",
    ),
    LineField(
        "uptime_equal_charge",
        NUMBER,
        "mean uptime_paper, with the charge that is left over or missing at the end valued at the boards' own rates",
        "%",
    ),
    LineField(
        "excluded", _OBJECT, "time that the figures exclude: twins of real aMussels, and retired ones", "s"
    ),
    LineField("uptime_missing", TEXT, "why there are no uptimes; only where there are none", optional=True),
    LineField("cost_m", NUMBER, "the way that the aPad drove on its legs, by its reported positions", "m"),
    LineField("planned_m", NUMBER, "the straight ways of its orders, as the paper counts them", "m"),
    LineField("services", INTEGER, "aMussels that left a dock full, by two witnesses of the dock"),
    LineField("apad_energy_fraction", NUMBER, "used part of the aPad's battery; at theta 1 alone", "0 to 1"),
    LineField("apad_energy_missing", TEXT, "why there is no such part"),
    LineField("samples_uploaded", INTEGER, "samples on disk"),
    LineField("samples_lost", INTEGER, "samples that can no longer be uploaded"),
    LineField("samples_waiting", INTEGER, "samples still aboard"),
    LineField(
        "latest_tick_s",
        NUMBER,
        "the largest lateness of a tick, by the clock that the flight follows, since this supervisor began; "
        "null in virtual time",
        "s",
    ),
    LineField("gave_up", INTEGER, "aMussels whose process stayed dead"),
    LineField("amussels", _OBJECT, "each aMussel's own figures, by its id"),
    LineField("dropped", _OBJECT, "number of dropped inputs, by reason"),
    LineField(
        "digest", TEXT, "of the decisions and happenings: equal runs have equal ones, on every machine"
    ),
)
"""In order. A figure that nobody knows is null."""

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


def apad_energy(ending: Ending, scale: TimeScale) -> dict[str, Any]:
    """The keys of summary.json of the aPad's energy; None where it compares with nothing, and then the reason."""
    reason = None
    if not scale.is_real:
        theta = scale.theta
        reason = f"it compares at theta 1 alone: at {theta} the aMussels charge {theta} times as fast as the aPad spends"
    elif ending.apad_energy_fraction is None:
        reason = "the aPad did not report its battery"
    used = ending.apad_energy_fraction if reason is None else None
    return {"apad_energy_fraction": used, "apad_energy_missing": reason}


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
        "uptime_equal_charge": None if worth is None else paper["mean"] + worth * fsum(gains),
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

"""The fields of summary.json, with the rule by which several aPads' figures become one."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Any

from agents.time_scale import TimeScale
from apad_bridge.events.mission_events import (
    MissionEnd,
)
from apad_bridge.events.run_events import EndReason
from apad_bridge.records import combining
from apad_bridge.records.field_types import INTEGER, NUMBER, TEXT, LineField, Type


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


_FIGURES: tuple[tuple[LineField, combining.CombiningRule | None], ...] = (
    (LineField("name", TEXT, "the scenario's name"), None),
    (LineField("theta", INTEGER, "agent time per mission time"), combining.shared),
    (LineField("seed", INTEGER, "of all that is random"), combining.shared),
    (LineField("agents", INTEGER, "number of aMussels of the fleet"), combining.total),
    (LineField("mission_s", NUMBER, "mission time at the end", "s"), combining.largest),
    (
        LineField(
            "stopped_s",
            NUMBER,
            "of it, the time in which a person or a guard kept the mission from the aPad",
            "s",
        ),
        combining.total,
    ),
    (LineField("ended_by", TEXT, "why the mission ended, for people"), combining.texts),
    (LineField("end_reason", TEXT, "the same, one of a fixed set"), combining.shared),
    (LineField("first_cause", TEXT, "the first failure of the aPad that was not overcome"), combining.texts),
    (LineField("causes", _OBJECT, "number of failures, by cause"), combining.counts),
    (LineField("steps_given_up", INTEGER, "steps of plans that the mission gave up"), combining.total),
    (
        LineField(
            "left_alone", Type(list, "list of integer"), "aMussels that the mission no longer tries to serve"
        ),
        combining.ids,
    ),
    (
        LineField(
            "beyond_reach",
            Type(list, "list of integer"),
            "aMussels that it does not serve because of the way, at the end",
        ),
        combining.ids,
    ),
    (
        LineField(
            "failed_docks",
            Type(list, "list of integer"),
            "docks in which each docking failed, twice or more; from 0",
        ),
        combining.one_after_another,
    ),
    (
        LineField("counted_s", NUMBER, "time in the water as simulated ones, over all aMussels", "s"),
        combining.total,
    ),
    (LineField("counted_at_end", INTEGER, "aMussels that count at the end"), combining.total),
    (
        LineField("uptime_paper", _SPREAD, "share of ticks undocked with charge in the primary battery", "%"),
        combining.spread,
    ),
    (
        LineField("uptime_submerged", _SPREAD, "share of ticks under water on the primary battery", "%"),
        combining.spread,
    ),
    (
        LineField("active_mean", NUMBER, "aMussels that were active at a tick, in the paper's meaning"),
        combining.total,
    ),
    (
        LineField("amussels_lost", INTEGER, "aMussels whose batteries were both empty at some time"),
        combining.total,
    ),
    (LineField("emptied", INTEGER, "aMussels whose primary battery was empty at some time"), combining.total),
    (LineField("samples_taken", INTEGER, "samples that the sensors took"), combining.total),
    (
        LineField("dead_time_s", NUMBER, "time with an empty primary battery, over all aMussels", "s"),
        combining.total,
    ),
    (
        LineField("final_charge_mean", NUMBER, "charge of the primary batteries at the end", "0 to 1"),
        combining.mean_by("counted_at_end"),
    ),
    (
        LineField(
            "charge_gain_mean",
            NUMBER,
            "charge of the primary batteries at the end minus at the begin: below 0 for a flight that lives on its store",
            "-1 to 1",
        ),
        combining.mean_by("counted_at_end"),
    ),
    (
        LineField(
            "uptime_equal_charge",
            NUMBER,
            "mean uptime_paper, with the charge that is left over or missing at the end valued at the boards' own rates",
            "%",
        ),
        combining.mean_by("counted_s"),
    ),
    (
        LineField(
            "excluded",
            _OBJECT,
            "time that the figures exclude: twins of real aMussels, and retired ones",
            "s",
        ),
        combining.counts,
    ),
    (
        LineField(
            "uptime_missing", TEXT, "why there are no uptimes; only where there are none", optional=True
        ),
        None,
    ),
    (
        LineField(
            "cost_m", NUMBER, "the way that the aPad drove on its legs, by its reported positions", "m"
        ),
        combining.total,
    ),
    (
        LineField("planned_m", NUMBER, "the straight ways of its orders, as the paper counts them", "m"),
        combining.total,
    ),
    (
        LineField("services", INTEGER, "aMussels that left a dock full, by two witnesses of the dock"),
        combining.total,
    ),
    (
        LineField(
            "apad_energy_fraction", NUMBER, "used part of the aPad's battery; at theta 1 alone", "0 to 1"
        ),
        combining.mean_of_apads,
    ),
    (LineField("apad_energy_missing", TEXT, "why there is no such part"), combining.first_known),
    (LineField("samples_uploaded", INTEGER, "samples on disk"), combining.total),
    (LineField("samples_lost", INTEGER, "samples that can no longer be uploaded"), combining.total),
    (LineField("samples_waiting", INTEGER, "samples still aboard"), combining.total),
    (
        LineField(
            "latest_tick_s",
            NUMBER,
            "the largest lateness of a tick, by the clock that the flight follows, since this supervisor began; "
            "null in virtual time",
            "s",
        ),
        combining.largest,
    ),
    (LineField("gave_up", INTEGER, "aMussels whose process stayed dead"), combining.total),
    (LineField("amussels", _OBJECT, "each aMussel's own figures, by its id"), combining.amussels),
    (LineField("dropped", _OBJECT, "number of dropped inputs, by reason"), combining.counts_by_name),
    (
        LineField(
            "digest", TEXT, "of the decisions and happenings: equal runs have equal ones, on every machine"
        ),
        combining.digest,
    ),
)
"""In order, each with the rule by which the figures of several aPads become one. A figure that nobody knows is null."""
SUMMARY = tuple(field for field, _ in _FIGURES)
COMBINED = {field.name: rule for field, rule in _FIGURES if rule is not None}


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

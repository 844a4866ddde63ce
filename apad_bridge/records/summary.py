"""The fields of summary.json, with the rule by which several aPads' figures become one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from agents.time_scale import TimeScale
from apad_bridge.events.mission_events import MissionEnd, StepGivenUp
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.facts import SampleSource
from apad_bridge.records import combining
from apad_bridge.records.field_types import INTEGER, NUMBER, TEXT, LineField, Type

if TYPE_CHECKING:
    from apad_bridge.records.run_state import RunState
    from apad_bridge.scenario.schema import Scenario


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
    samples_gone: Mapping[SampleSource, Set[int]] = field(default_factory=dict)
    """The sequence numbers of samples that can no longer be uploaded."""
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


@dataclass(frozen=True, slots=True)
class RunAtEnd:
    """All that a figure of the summary is made of."""

    scenario: Scenario
    agent_ids: Set[int]
    at_ms: int
    state: RunState
    ending: Ending


class SummaryFigure(NamedTuple):
    """A key of summary.json."""

    field: LineField
    combined: combining.CombiningRule | None
    """The rule by which the figures of several aPads become one; None for a key that is not theirs."""
    of: Callable[[RunAtEnd], object] | None = None
    """None for a figure that the recorder computes together with others."""


_FIGURES = (
    SummaryFigure(LineField("name", TEXT, "the scenario's name"), None, lambda it: it.scenario.name),
    SummaryFigure(
        LineField("theta", INTEGER, "agent time per mission time"),
        combining.shared,
        lambda it: it.scenario.theta,
    ),
    SummaryFigure(
        LineField("seed", INTEGER, "of all that is random"), combining.shared, lambda it: it.scenario.seed
    ),
    SummaryFigure(
        LineField("agents", INTEGER, "number of aMussels of the fleet"),
        combining.total,
        lambda it: len(it.agent_ids),
    ),
    SummaryFigure(
        LineField("mission_s", NUMBER, "mission time at the end", "s"),
        combining.largest,
        lambda it: it.at_ms / 1000,
    ),
    SummaryFigure(
        LineField(
            "stopped_s",
            NUMBER,
            "of it, the time in which a person or a guard kept the mission from the aPad",
            "s",
        ),
        combining.total,
        lambda it: it.state.interruptions.stopped_s(it.at_ms),
    ),
    SummaryFigure(
        LineField("ended_by", TEXT, "why the mission ended, for people"),
        combining.texts,
        lambda it: str(it.ending.ended_by),
    ),
    SummaryFigure(
        LineField("end_reason", TEXT, "the same, one of a fixed set"),
        combining.shared,
        lambda it: it.ending.ended_by.reason.value,
    ),
    SummaryFigure(
        LineField("first_cause", TEXT, "the first failure of the aPad that was not overcome"),
        combining.texts,
        lambda it: it.ending.first_cause,
    ),
    SummaryFigure(LineField("causes", _OBJECT, "number of failures, by cause"), combining.counts),
    SummaryFigure(
        LineField("steps_given_up", INTEGER, "steps of plans that the mission gave up"),
        combining.total,
        lambda it: it.state.counts[StepGivenUp],
    ),
    SummaryFigure(
        LineField(
            "left_alone", Type(list, "list of integer"), "aMussels that the mission no longer tries to serve"
        ),
        combining.ids,
    ),
    SummaryFigure(
        LineField(
            "beyond_reach",
            Type(list, "list of integer"),
            "aMussels that it does not serve because of the way, at the end",
        ),
        combining.ids,
    ),
    SummaryFigure(
        LineField(
            "failed_docks",
            Type(list, "list of integer"),
            "docks in which each docking failed, twice or more; from 0",
        ),
        combining.one_after_another,
    ),
    SummaryFigure(
        LineField("counted_s", NUMBER, "time in the water as simulated ones, over all aMussels", "s"),
        combining.total,
    ),
    SummaryFigure(LineField("counted_at_end", INTEGER, "aMussels that count at the end"), combining.total),
    SummaryFigure(
        LineField("uptime_paper", _SPREAD, "share of ticks undocked with charge in the primary battery", "%"),
        combining.spread,
    ),
    SummaryFigure(
        LineField("uptime_submerged", _SPREAD, "share of ticks under water on the primary battery", "%"),
        combining.spread,
    ),
    SummaryFigure(
        LineField("active_mean", NUMBER, "aMussels that were active at a tick, in the paper's meaning"),
        combining.total,
    ),
    SummaryFigure(
        LineField("amussels_lost", INTEGER, "aMussels whose batteries were both empty at some time"),
        combining.total,
    ),
    SummaryFigure(
        LineField("emptied", INTEGER, "aMussels whose primary battery was empty at some time"),
        combining.total,
    ),
    SummaryFigure(LineField("samples_taken", INTEGER, "samples that the sensors took"), combining.total),
    SummaryFigure(
        LineField("dead_time_s", NUMBER, "time with an empty primary battery, over all aMussels", "s"),
        combining.total,
    ),
    SummaryFigure(
        LineField("final_charge_mean", NUMBER, "charge of the primary batteries at the end", "0 to 1"),
        combining.mean_by("counted_at_end"),
    ),
    SummaryFigure(
        LineField(
            "charge_gain_mean",
            NUMBER,
            "charge of the primary batteries at the end minus at the begin: below 0 for a flight that lives on its store",
            "-1 to 1",
        ),
        combining.mean_by("counted_at_end"),
    ),
    SummaryFigure(
        LineField(
            "uptime_equal_charge",
            NUMBER,
            "mean uptime_paper, with the charge that is left over or missing at the end valued at the boards' own rates",
            "%",
        ),
        combining.mean_by("counted_s"),
    ),
    SummaryFigure(
        LineField(
            "excluded",
            _OBJECT,
            "time that the figures exclude: twins of real aMussels, and retired ones",
            "s",
        ),
        combining.counts,
    ),
    SummaryFigure(
        LineField(
            "uptime_missing", TEXT, "why there are no uptimes; only where there are none", optional=True
        ),
        None,
    ),
    SummaryFigure(
        LineField(
            "cost_m", NUMBER, "the way that the aPad drove on its legs, by its reported positions", "m"
        ),
        combining.total,
        lambda it: it.ending.cost_m,
    ),
    SummaryFigure(
        LineField("planned_m", NUMBER, "the straight ways of its orders, as the paper counts them", "m"),
        combining.total,
        lambda it: it.ending.planned_m,
    ),
    SummaryFigure(
        LineField("services", INTEGER, "aMussels that left a dock full, by two witnesses of the dock"),
        combining.total,
        lambda it: it.ending.services,
    ),
    SummaryFigure(
        LineField(
            "apad_energy_fraction", NUMBER, "used part of the aPad's battery; at theta 1 alone", "0 to 1"
        ),
        combining.mean_of_apads,
    ),
    SummaryFigure(LineField("apad_energy_missing", TEXT, "why there is no such part"), combining.first_known),
    SummaryFigure(LineField("samples_uploaded", INTEGER, "samples on disk"), combining.total),
    SummaryFigure(
        LineField("samples_lost", INTEGER, "samples that can no longer be uploaded"), combining.total
    ),
    SummaryFigure(LineField("samples_waiting", INTEGER, "samples still aboard"), combining.total),
    SummaryFigure(
        LineField(
            "latest_tick_s",
            NUMBER,
            "the largest lateness of a tick, by the clock that the flight follows, since this supervisor began; "
            "null in virtual time",
            "s",
        ),
        combining.largest,
        lambda it: it.ending.latest_tick_s,
    ),
    SummaryFigure(
        LineField("gave_up", INTEGER, "aMussels whose process stayed dead"),
        combining.total,
        lambda it: len(it.state.gone),
    ),
    SummaryFigure(
        LineField("amussels", _OBJECT, "each aMussel's own figures, by its id"), combining.amussels
    ),
    SummaryFigure(
        LineField("dropped", _OBJECT, "number of dropped inputs, by reason"), combining.counts_by_name
    ),
    SummaryFigure(
        LineField(
            "digest", TEXT, "of the decisions and happenings: equal runs have equal ones, on every machine"
        ),
        combining.digest,
    ),
)
"""In order. A figure that nobody knows is null."""
SUMMARY = tuple(it.field for it in _FIGURES)
COMBINED = {it.field.name: it.combined for it in _FIGURES if it.combined is not None}


def summary_of(end: RunAtEnd, together: Mapping[str, Any]) -> dict[str, Any]:
    """The whole summary; `together` has the figures that are computed in groups. KeyError for one that is missing."""
    return {
        it.field.name: together[it.field.name] if it.of is None else it.of(end)
        for it in _FIGURES
        if it.field.name in together or not it.field.optional
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

"""Samples a history for the page on one grid of mission times, so that the page of a long run stays small too.

Charges come from the anchors in closed form, not from samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any

from agents.time_scale import TICK_MS, MissionMs, TimeScale
from agents.water.places import place_of
from apad_bridge.analysis.replay.history import History
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.stacks import stack_of
from apad_bridge.assembly.water import true_water
from apad_bridge.beliefs.belief import NUMBERS
from apad_bridge.events.run_events import RunBegan
from apad_bridge.planning.registry import label
from apad_bridge.records.journal import Entry, JournalContents
from apad_bridge.records.run_state import PlanView, RunState
from apad_bridge.records.sample_file import KeptSample
from apad_bridge.records.uptime import AgentUptime
from apad_bridge.scenario.area.chart import chart_of
from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.firmware_config import sinking_of, takes_samples
from apad_bridge.scenario.schema import Area, Scenario
from apad_bridge.scenario.text.key_mistakes import unit_of
from apad_bridge.vehicle.guards.stops import StopRecord
from firmware_model.power.charge import fraction
from firmware_model.power.rails import Rail
from firmware_model.sampling.sensors import SENSORS
from firmware_model.states import State

MAX_SAMPLES = 600
MAX_VALUES = 60_000
"""The most samples times aMussels: a large fleet is sampled more coarsely."""
MAX_TRACE = 5000
MAX_PACKETS = 20_000
"""The newest packets of a page; those before them are counted."""
MAX_MEASURED = 20_000
"""The newest samples of aMussels on a page."""
Counts = tuple[int, int, int, int, int]
"""The lengths of the track, of the events, of the plans, of the packets and of the uploaded samples."""
_EMPTY = 0.0005
"""A charge below it is written as 0.0 %."""
_OFTEN_EMPTY = ("believed", "low", "high", "taken", "acknowledged", "heard", "capacity", "reported", "water")


class ColourStatus(IntEnum):
    """The meaning of an aMussel's colour."""

    ABOVE = 0
    """Above the pool's threshold."""
    CANDIDATE = 1
    """At or below the pool's threshold."""
    CHARGING = 2
    """In a dock."""
    LOST = 3
    """Both batteries empty, or its simulation has ended."""
    UNKNOWN = 4
    """It never reported."""
    EMPTY = 5
    """Its primary battery is empty; the other one keeps it for a while."""


def sample_times(end_ms: int, agents: int) -> list[MissionMs]:
    """The times of the samples: whole ticks from 0 on, always with the last one."""
    last_ms = end_ms // TICK_MS * TICK_MS
    samples = min(MAX_SAMPLES, max(60, MAX_VALUES // max(1, agents)))
    step_ms = max(1, -(-last_ms // TICK_MS // (samples - 1))) * TICK_MS
    return [MissionMs(ms) for ms in (*range(0, last_ms, step_ms), last_ms)]


def whole_view(scenario: Scenario, journal: JournalContents, samples: Iterable[KeptSample] = ()) -> RunView:
    """The view of a whole run, with what its aMussels measured. ValueError when the journal has no line `run`."""
    view = RunView(scenario, journal)
    view.take_samples(samples)
    for now_ms in sample_times(view.end_ms, view.agent_count):
        view.sample(now_ms)
    return view


def add_rails(data: dict[str, Any], rails: Mapping[int, Sequence[tuple[int, int]]]) -> None:
    """Adds each aMussel's column `rails`: the set of its board's rails that were on at any moment since the sample before.

    `rails` has (agent ms, set of rails) after each switch; an aMussel without has no such column.
    """
    scale = TimeScale(data["theta"])
    for agent in data["agents"]:
        if agent["id"] not in rails:
            continue
        switches, column, at, on = rails[agent["id"]], [], 0, 0
        for now_ms in data["times_ms"]:
            seen = on
            while at < len(switches) and switches[at][0] <= scale.agent_ms(now_ms):
                on = switches[at][1]
                seen |= on
                at += 1
            column.append(seen)
        agent["rails"] = column


class RunView:
    """A run as the page shows it: columns of samples, taken at rising mission times from the journal so far."""

    def __init__(self, scenario: Scenario, journal: JournalContents, run_ms: int | None = None) -> None:
        """`run_ms` is the time of which uptimes are a share; None: that of the newest line.

        ValueError when the journal has no line `run`.
        """
        if (start := next((it for _, it in journal.events(RunBegan)), None)) is None:
            raise ValueError("the journal has no line `run`: the flight never began")
        self._scenario = scenario
        self._starts = start.agents
        self._dropped = journal.dropped
        self._history = History(journal, scenario)
        ids = [agent["id"] for agent in self._starts]
        self.times_ms: list[int] = []
        self._ticks = max(1, (run_ms or self._history.end_ms) // TICK_MS)
        self._uploaded: list[list[Any]] = []
        self._measured: list[list[Any]] = []
        """Those of the uploaded samples that the newest sample of the view has."""
        self._water = true_water(scenario) if takes_samples(scenario.board) else None
        self._sinking = sinking_of(scenario)
        self._agents: dict[int, dict[str, list[Any]]] = {it: {name: [] for name in COLUMNS} for it in ids}
        self._active: list[int] = []
        self._cost: list[float] = []
        self._apad: list[list[float | None] | None] = []
        self._docks: list[list[int | None]] = []
        self._stages: list[dict[str, Any]] = []
        self._stage: list[int] = []

    @property
    def agent_count(self) -> int:
        return len(self._starts)

    @property
    def end_ms(self) -> int:
        """The newest mission time of a line."""
        return self._history.end_ms

    @property
    def state(self) -> RunState:
        """The run's state at the newest sample."""
        return self._history.now

    @property
    def ended_by(self) -> str | None:
        return self.state.ended_by

    def add(self, journal: JournalContents) -> None:
        """Adds further lines."""
        self._dropped += journal.dropped
        self._history.add(journal)

    def take_samples(self, samples: Iterable[KeptSample]) -> None:
        """Adds samples that aMussels uploaded. The next sample of the view has them."""
        keys = ("mission_ms", *(it.key for it in SENSORS))
        for it in samples:
            at_ms, *values = (_finite(it.columns.get(key)) for key in keys)
            if at_ms is not None:
                self._uploaded.append([at_ms, it.agent_id, *values])

    @property
    def has_late_lines(self) -> bool:
        """True when lines were added since the newest sample that belong into it, as the run's end after its last tick."""
        return self._history.has_events_until(self.times_ms[-1])

    def newest(self, since: Counts) -> dict[str, Any]:
        """The newest sample, with what was added to the lists since these `counts`."""
        traced, events, plans, packets, measured = since
        return {
            **self._newest_sample(),
            "trace": _thinned(self._history.trace[traced:]),
            "events": [list(it) for it in self._history.events[events:]],
            "plans": [_reasons(it) for it in self._history.plans[plans:]],
            "packets": self._history.packets[packets:][-MAX_PACKETS:],
            "measured": self._measured[measured:][-MAX_MEASURED:],
            "suspects": self._history.suspects,
            "counts": self.counts,
        }

    @property
    def counts(self) -> Counts:
        """Lengths of the lists at the newest sample."""
        of = self._history
        return len(of.trace), len(of.events), len(of.plans), len(of.packets), len(self._measured)

    def data(self, summary: dict[str, Any] | None) -> dict[str, Any]:
        """All that the page needs, as plain data."""
        scenario = self._scenario
        places = stack_of(scenario.apad.generation).capabilities(scenario.apad.docks).docks
        return {
            "name": scenario.name,
            "description": scenario.description,
            "theta": scenario.theta,
            "seed": scenario.seed,
            "collection": label(scenario.mission.collection),
            "redeployment": label(scenario.mission.redeployment),
            "pool_threshold": scenario.mission.pool_threshold,
            "silence_s": scenario.mission.silence_timeout_s,
            "polygon": [list(corner) for corner in scenario.area.polygon_m],
            **_place_data(scenario.area),
            "dock_bearings": [round(it, 4) for it in places.bearings_rad],
            "docks_turn": places.turn_with_hull,
            "homes": {agent["id"]: [agent["north_m"], agent["east_m"]] for agent in self._starts},
            "ended_by": self.ended_by,
            "dropped_lines": self._dropped,
            "summary": summary,
            "trace": _thinned(self._history.trace),
            "thinned": {"track_m": round(_left_out_m(self._history.trace), 2)},
            "events": [list(it) for it in self._history.events],
            "plans": [_reasons(it) for it in self._history.plans],
            "packets": self._history.packets[-MAX_PACKETS:],
            "measured": self._measured[-MAX_MEASURED:],
            "suspects": self._history.suspects,
            "earlier_packets": max(0, len(self._history.packets) - MAX_PACKETS),
            "states": [state.name.lower().replace("_", " ") for state in State],
            "sensors": [[it.name, unit_of(it.key) or it.unit] for it in SENSORS],
            "quantities": [[name, it.quantity.text, it.quantity.unit] for name, it in NUMBERS.items()],
            "rails": [rail.name.lower().replace("_", " ") for rail in Rail],
            "timeslots": _timeslots(scenario),
            **self._columns(),
        }

    def sample(self, now_ms: MissionMs) -> None:
        """Takes a sample at this time, which is not before the last one. One of the same time replaces the last one."""
        history, now = self._history, self._history.now
        history.advance(now_ms)
        if self.times_ms and self.times_ms[-1] == now_ms:
            for column in self._all_columns():
                column.pop()
        self.times_ms.append(now_ms)
        self._measured += self._uploaded
        self._uploaded = []
        uptimes = {uptime.agent_id: uptime for uptime in now.meter.at(now_ms)}
        for agent_id, columns in self._agents.items():
            for name, value in self._sample_agent(agent_id, now_ms, uptimes.get(agent_id)).items():
                columns[name].append(value)
        self._active.append(now.meter.active_now(now_ms))
        self._cost.append(round(now.mission.cost_m, 2))
        apad = now.apad
        self._apad.append(
            None if apad is None else [apad.north_m, apad.east_m, apad.heading_rad, apad.battery]
        )
        self._docks.append(list(now.docks))
        stage = {
            "phase": now.phase,
            "primitive": now.primitive,
            "plan": _plan_data(now.plan),
            "stop": _stop_data(now.stops.in_force),
            "refused": _stop_data(now.refused_stop),
            "drift": None if now.drift is None else now.drift.line,
            "interrupted": now.interruptions.is_one,
        }
        if not self._stages or stage != self._stages[-1]:
            self._stages.append(stage)
        self._stage.append(len(self._stages) - 1)

    def _sample_agent(self, agent_id: int, now_ms: MissionMs, uptime: AgentUptime | None) -> dict[str, Any]:
        """An aMussel's value in each of `COLUMNS`, from the truth, or from the belief where there is no truth."""
        now = self._history.now
        truth, belief = now.truths.get(agent_id), now.beliefs.get(agent_id)
        docked, water = agent_id in now.docks, None
        if truth is not None:
            physical, model = truth.physical, now.meter.charge_of(agent_id)
            at_ms = max(self._scenario.time_scale.agent_ms(now_ms), truth.at_ms)
            left: float | None = fraction(model.charge_at(physical.primary, at_ms))
            other: float | None = fraction(model.charge_at(physical.secondary, at_ms))
            state: int | None = int(truth.state)
            place: tuple[float | None, float | None] = (physical.north_um / 1e6, physical.east_um / 1e6)
            docked = physical.docked
            depth_um = place_of(physical, self._sinking).depth_at_um(at_ms)
            if self._water is not None and depth_um > 0:
                found = self._water.values_at(physical.north_um, physical.east_um, depth_um, at_ms)
                water = [round(it, 4) for it in found]
        elif belief is not None:
            left, place = belief.charge, (belief.north_m, belief.east_m)
            other, state = belief.secondary, int(belief.state)
        else:
            left, place, other, state = None, (None, None), None, None
        if docked and now.apad is not None:
            place = (now.apad.north_m, now.apad.east_m)
        charge, low, high = (None,) * 3 if belief is None else (belief.charge, belief.low, belief.high)
        reported, left_of = None if belief is None else belief.reported, now.capacities.get(agent_id)
        log = None if truth is None or truth.physical.samples == 0 else truth.physical
        lost = agent_id in now.gone or (uptime is not None and uptime.lost)
        return {
            "north": _rounded(place[0], 2),
            "east": _rounded(place[1], 2),
            "charge": _rounded(left, 4),
            "secondary": _rounded(other, 3),
            "state": state,
            "status": self._status(left, docked, lost),
            "uptime": 0.0 if uptime is None else round(100 * uptime.paper / self._ticks, 2),
            "believed": None if truth is None else _rounded(charge, 4),
            "low": _rounded(low, 4),
            "high": _rounded(high, 4),
            "taken": None if log is None else log.samples,
            "acknowledged": None if log is None else log.acknowledged,
            "heard": None if belief is None else belief.heard // 1000,
            "capacity": None if left_of is None else [round(it, 2) for it in left_of],
            "reported": None if reported is None else [reported.get(it) for it in NUMBERS],
            "water": water,
        }

    def _status(self, charge: float | None, docked: bool, lost: bool) -> int:
        if charge is None:
            return ColourStatus.UNKNOWN
        if docked:
            return ColourStatus.CHARGING
        if lost:
            return ColourStatus.LOST
        if charge < _EMPTY:
            return ColourStatus.EMPTY
        return (
            ColourStatus.CANDIDATE if charge <= self._scenario.mission.pool_threshold else ColourStatus.ABOVE
        )

    def thin(self) -> None:
        """Drops every second sample, and never the newest."""
        for column in self._all_columns():
            del column[-2::-2]

    def _all_columns(self) -> list[list[Any]]:
        """The columns that have one value for each sample."""
        shared: list[list[Any]] = [
            self.times_ms,
            self._active,
            self._cost,
            self._apad,
            self._docks,
            self._stage,
        ]
        return [*shared, *(column for agent in self._agents.values() for column in agent.values())]

    def _newest_sample(self) -> dict[str, Any]:
        """The newest sample alone; each aMussel's values are in the order of `COLUMNS`."""
        return {
            "t": self.times_ms[-1],
            "has_truth": bool(self._history.now.meter.agent_ids),
            "agents": [[column[-1] for column in agent.values()] for agent in self._agents.values()],
            "active": self._active[-1],
            "cost": self._cost[-1],
            "apad": self._apad[-1],
            "docks": self._docks[-1],
            "stage": self._stages[self._stage[-1]],
        }

    def _columns(self) -> dict[str, Any]:
        return {
            "times_ms": self.times_ms,
            "has_truth": bool(self._history.now.meter.agent_ids),
            "agents": [
                {"id": agent_id, **agent, **{name: _unless_empty(agent[name]) for name in _OFTEN_EMPTY}}
                for agent_id, agent in self._agents.items()
            ],
            "active": self._active,
            "cost": self._cost,
            "apad": self._apad,
            "docks": self._docks,
            "stages": self._stages,
            "stage": self._stage,
        }


COLUMNS = ("north", "east", "charge", "status", "uptime", *_OFTEN_EMPTY, "secondary", "state")
"""An aMussel's columns, by their names on the page. Places in metres, charges in [0, 1], uptime in percent of the whole
run's ticks, `heard` in mission seconds; `believed` beside a truth alone; `low` and `high` with 95 %; `taken` and
`acknowledged` are samples of its log; `capacity` is the interval of its share that is left, where a twin learns it;
`reported` is in the order of `NUMBERS`, and `water`, the true values where it is, in that of `SENSORS`."""


def _plan_data(plan: PlanView | None) -> dict[str, Any] | None:
    if plan is None:
        return None
    return {
        "what": plan.what,
        "strategy": plan.strategy,
        "steps": [list(step) for step in plan.steps],
        "places": [None if it is None else [round(it[0], 2), round(it[1], 2)] for it in plan.places_m],
        "done": len(plan.steps) - plan.left,
    }


def _stop_data(stop: StopRecord | None) -> dict[str, Any] | None:
    if stop is None:
        return None
    return {
        "number": stop.number,
        "mode": stop.kind,
        "by": stop.by,
        "states": stop.states,
        "reason": stop.newest_reason or None,
    }


def _place_data(area: Area) -> dict[str, Any]:
    """The chart, the fence and its keep-out zones, in local metres."""

    def rounded(points: Iterable[tuple[float, float]]) -> list[list[float]]:
        return [[round(north, 2), round(east, 2)] for north, east in points]

    fence, chart = fence_of(area), () if area.chart is None else chart_of(area.chart, area.origin)
    return {
        "chart": [{"depth": line.depth_m, "points": rounded(line.points)} for line in chart],
        "fence": None if fence is None else rounded(fence.corners),
        "keep_out": [] if fence is None else [rounded(zone) for zone in fence.keep_out],
    }


def _reasons(plan: Entry) -> dict[str, Any]:
    """A plan with its reasons: candidates, costs, other plans that were weighed."""
    return {"t": plan.at_ms, **plan.event.data}


def _thinned(trace: list[tuple[int, float, float]]) -> list[list[float]]:
    every = _every(trace)
    kept = trace[::every] if (len(trace) - 1) % every == 0 else [*trace[::every], trace[-1]]
    return [[t, round(north, 2), round(east, 2)] for t, north, east in kept]


def _every(trace: Sequence[object]) -> int:
    return -(-len(trace) // MAX_TRACE) or 1


def _left_out_m(trace: list[tuple[int, float, float]]) -> float:
    """The greatest distance of a point that `_thinned` leaves out from the straight way between its neighbours."""
    every, farthest = _every(trace), 0.0
    for first in range(0, len(trace) - 1, every):
        last = min(first + every, len(trace) - 1)
        (begun_ms, *begin), (end_ms, *end) = trace[first], trace[last]
        for at_ms, north, east in trace[first + 1 : last]:
            share = (at_ms - begun_ms) / max(1, end_ms - begun_ms)
            there = [a + share * (b - a) for a, b in zip(begin, end, strict=True)]
            farthest = max(farthest, math.dist(there, (north, east)))
    return farthest


def _timeslots(scenario: Scenario) -> dict[str, int] | None:
    """The boards' timeslots in ms of agent time; None for boards without any."""
    found = flight_config(scenario).timeslots
    return None if found is None else {"frame_ms": found.frame_ms, "slot_ms": found.slot_ms}


def _unless_empty(column: list[Any]) -> list[Any] | None:
    return None if all(value is None for value in column) else column


def _finite(value: object) -> float | None:
    return value if isinstance(value, int | float) and math.isfinite(value) else None


def _rounded(number: float | None, digits: int) -> float | None:
    return None if number is None else round(number, digits)

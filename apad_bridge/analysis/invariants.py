"""Rules that hold in every run's journal. An event that breaks one shows a defect of musselbed, not of the mission.

The checker takes the events in order and knows nothing of the flight but these and the scenario.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.mussel.stimuli import ChargeLost, ContactClosed, ContactOpened, Placed, from_json
from agents.time_scale import TICK_MS
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import BeliefChanged, FaultBegan, FaultEnded, Stimulated, TruthChanged
from apad_bridge.events.mission_events import DockSwitched, LegBegan
from apad_bridge.events.run_events import RunBegan, RunResumed
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.mission.facts import SampleSource
from apad_bridge.records.journal import Entry, read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.sample_file import read_samples
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.records.truth_lines import truth_of
from apad_bridge.scenario.firmware_config import board_config
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.timed_faults import TimedFault
from firmware_model.actions import MOTORS
from firmware_model.power.active_battery import after_motor_run, without
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow

NEAR_M = 5.0
"""A docked aMussel is nearer to the aPad than this, beside the way of the aPad since its last line."""
WAY_FRACTION, WAY_M = 0.05, 2.0
"""The counted way exceeds the way between the journal's places by no more than this fraction, and these metres."""
_KEPT = 4
"""The newest events of an aMussel that are shown with a broken rule."""


@dataclass(frozen=True, slots=True)
class Broken:
    """A rule that an event breaks, with the events that show it."""

    rule: str
    reason: str
    entries: tuple[Entry, ...]


class Invariants:
    """Checks the events of one journal as they come.

    After a kill of the supervisor, events that were not on disk are missing. So contacts and docks are not checked again
    until the next event of them, and a battery may differ once by what a tick takes.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._charge_of = TruthExtrapolator(scenario).charge_of
        board = board_config(scenario.board, scenario.seed)
        self._motor_run = board.motor_run if board.whole is None else 0
        """Grains that a run of the motors takes at once; a whole board's motors are a load."""
        charge = board.charge
        draws = charge.discharge if board.whole is None else board.whole.power.loads.total(-1)
        gives = max(rate for _, rate in (*charge.segments, *charge.segments_by_two))
        self._most_unseen = (draws + gives) * scenario.time_scale.agent_span(TICK_MS) + 2 * self._motor_run
        """Grains that may come or go in a tick without a truth."""
        self._resumed: set[int] = set()
        """aMussels without a truth since the supervisor resumed: a kill loses the truths of the tick under way."""
        self._now_ms = 0
        self._ids: frozenset[int] = frozenset()
        self._truths: dict[int, Truth] = {}
        self._docks: dict[int, int] = {}
        """aMussels by dock index."""
        self._opened_ms: dict[int, int] = {}
        """The agent time at which the newest contact opened, of each aMussel that no contact closed around since.

        A killed aMussel boots before that time, docked still: the opening waited for its window.
        """
        self._placed: set[int] = set()
        """aMussels that were put somewhere since their last truth."""
        self._lost: dict[int, list[tuple[int, ChargeLost]]] = {}
        """Charges that a fault took from batteries, with its agent time, until a truth has them."""
        self._lie_m, self._lie_until_ms = 0.0, -1
        """The aPad reports its place so far off the true one until then."""
        self._apad_m: tuple[int, float, float] | None = None
        self._way_m = 0.0
        self._legs_m = 0.0
        self._shown: dict[int | None, deque[Entry]] = {}

    def take(self, entry: Entry) -> list[Broken]:
        """The rules that this event breaks."""
        shown = self._shown.setdefault(entry.event.amussel, deque(maxlen=_KEPT))
        shown.append(entry)
        return [Broken(rule, reason, tuple(shown)) for rule, reason in self._rules(*entry)]

    def end(self, summary: Mapping[str, Any], kept: Mapping[SampleSource, Counter[int]]) -> list[Broken]:
        """The rules of a whole run. `kept` counts the lines of samples.jsonl, by board and sequence number."""
        return [Broken(rule, reason, ()) for rule, reason in self._last_rules(summary, kept)]

    def _rules(self, at_ms: int, event: Event) -> Iterator[tuple[str, str]]:
        if at_ms < self._now_ms:
            yield "time never falls", f"{at_ms} ms after {self._now_ms} ms"
        self._now_ms = max(self._now_ms, at_ms)
        match event:
            case RunBegan():
                ids = [it["id"] for it in event.agents]
                self._ids = frozenset(ids)
                if len(ids) != len(self._ids):
                    yield "ids are unique", f"{ids}"
            case TruthChanged():
                yield from self._of_truth(truth_of(event))
            case BeliefChanged():
                yield from _of_belief(at_ms, event)
            case Stimulated():
                self._take_stimulus(event)
            case DockSwitched():
                yield from self._of_dock(event.dock, event.agent, closed=event.closed)
            case APadMoved():
                yield from self._of_apad(at_ms, event)
            case LegBegan():
                self._legs_m += event.metres
            case FaultBegan(fault=TimedFault.APAD_LIES, refused=None, value=float() | int() as lie_m):
                self._lie_m, self._lie_until_ms = abs(lie_m), 1 << 62
            case FaultEnded(fault=TimedFault.APAD_LIES):
                self._lie_until_ms = at_ms + 2000  # the place of that tick came before
            case RunResumed():
                self._docks, self._opened_ms = {}, {}
                self._resumed = set(self._truths)

    def _of_truth(self, truth: Truth) -> Iterator[tuple[str, str]]:
        agent_id, before, physical = truth.agent_id, self._truths.get(truth.agent_id), truth.physical
        self._truths[agent_id] = truth
        if self._ids and agent_id not in self._ids:
            yield "every aMussel is of the fleet", f"aMussel {agent_id} is not in the line `run`"
        for name, battery in (("primary", physical.primary), ("secondary", physical.secondary)):
            if not 0 <= battery.charge <= FULL:
                yield "a charge lies in 0 to 1", f"aMussel {agent_id}, {name}: {battery.charge / FULL}"
        if physical.acknowledged > physical.samples:
            yield (
                "a sample is taken before it is acknowledged",
                f"{physical.acknowledged} of {physical.samples}",
            )
        if physical.docked and truth.at_ms > self._opened_ms.get(agent_id, truth.at_ms):
            yield "a dock that closed holds the aMussel", f"aMussel {agent_id} is docked, and its dock opened"
        # Another aPad may hold it, and then no dock of this one closed around it.
        if physical.docked and agent_id in self._docks.values():
            yield from self._of_docked(truth)
        was_placed = agent_id in self._placed
        self._placed.discard(agent_id)
        resumed = agent_id in self._resumed
        self._resumed.discard(agent_id)
        if before is not None and not was_placed:
            yield from self._of_change(before, truth, resumed=resumed)

    def _of_docked(self, truth: Truth) -> Iterator[tuple[str, str]]:
        if self._apad_m is None:
            return
        at_ms, north_m, east_m = self._apad_m
        there_m = truth.physical.north_um / 1e6, truth.physical.east_um / 1e6
        lie_m = self._lie_m if self._now_ms <= self._lie_until_ms else 0.0
        most_m = NEAR_M + lie_m + self._scenario.apad.max_speed_m_s * (self._now_ms - at_ms) / 1000
        if (away_m := math.dist(there_m, (north_m, east_m))) > most_m:
            yield (
                "a docked aMussel is at the aPad",
                f"aMussel {truth.agent_id} is docked {away_m:.1f} m from the aPad",
            )

    def _of_change(self, before: Truth, truth: Truth, *, resumed: bool) -> Iterator[tuple[str, str]]:
        agent_id, was, now = truth.agent_id, before.physical, truth.physical
        if truth.at_ms < before.at_ms:
            yield "time never falls", f"aMussel {agent_id}: {truth.at_ms} ms after {before.at_ms} ms"
            return
        if now.samples < was.samples or now.acknowledged < was.acknowledged:
            yield (
                "a log forgets nothing",
                f"aMussel {agent_id}: {was.samples}, {was.acknowledged} became {now.samples}, {now.acknowledged}",
            )
        batteries = (("primary", was.primary, now.primary), ("secondary", was.secondary, now.secondary))
        if fallen := [name for name, old, new in batteries if new.anchor_ms < old.anchor_ms]:
            yield from (("time never falls", f"aMussel {agent_id}, {name} battery") for name in fallen)
            return
        losses = self._lost.get(agent_id, [])
        # A fault of this very time may come after the event that this truth follows.
        fewest = sum(at_ms < truth.at_ms for at_ms, _ in losses)
        most = sum(at_ms <= truth.at_ms for at_ms, _ in losses)
        possible_runs = self._motor_runs(before, truth)
        for count, runs in product(range(fewest, most + 1), possible_runs):
            expected = self._charges_after(agent_id, was, now, losses[:count], runs)
            if expected == [new.charge for _, _, new in batteries]:
                del losses[:count]
                return
        expected = self._charges_after(agent_id, was, now, losses[:fewest], possible_runs[0])
        unseen = self._most_unseen if resumed else 0
        for follows, (name, _, new) in zip(expected, batteries, strict=True):
            if abs(follows - new.charge) > unseen:
                yield (
                    "energy is neither made nor lost",
                    f"aMussel {agent_id}, {name}: {new.charge / FULL:.9f}, and {follows / FULL:.9f} follows from before",
                )
        del losses[:most]

    def _motor_runs(self, before: Truth, truth: Truth) -> range:
        """The most runs of the motors that may have cost charge between two truths; a state may end as it is entered."""
        if not self._motor_run:
            return range(1)
        if truth.state is not before.state:
            return range(1, 3) if truth.state in MOTORS else range(2)
        return range(2) if truth.state in MOTORS else range(1)

    def _charges_after(
        self, agent_id: int, was: Physical, now: Physical, losses: list[tuple[int, ChargeLost]], runs: int
    ) -> list[int]:
        """The charges at the anchors of `now` that follow from `was`, less what faults and motor runs took, in grains."""
        model = self._charge_of(agent_id)
        primary, secondary = was.primary, was.secondary
        for at_ms, lost in losses:
            primary = without(primary, lost.primary, model, at_ms)
            secondary = without(secondary, lost.secondary, model, at_ms)
        primary = _held_at(primary, now.primary.anchor_ms, model)
        secondary = _held_at(secondary, now.secondary.anchor_ms, model)
        for _ in range(runs if self._motor_run else 0):
            # What they hold is settled: the runs come one after the other at one time.
            left = after_motor_run(primary, secondary, self._motor_run, model, primary.anchor_ms)
            primary, secondary = left or (primary, secondary)
        return [primary.charge, secondary.charge]

    def _take_stimulus(self, event: Stimulated) -> None:
        agent_id, at_ms = event.id, event.agent_ms
        match from_json(event.wire):
            case ContactClosed():
                self._opened_ms.pop(agent_id, None)
            case ContactOpened():
                self._opened_ms[agent_id] = at_ms
            case ChargeLost() as lost:
                self._lost.setdefault(agent_id, []).append((at_ms, lost))
            case Placed():
                self._placed.add(agent_id)
                self._lost.pop(agent_id, None)
                self._opened_ms[agent_id] = at_ms

    def _of_dock(self, dock_index: int, agent_id: int, *, closed: bool) -> Iterator[tuple[str, str]]:
        holder = self._docks.get(dock_index)
        if closed:
            others = [
                index for index, held in self._docks.items() if held == agent_id and index != dock_index
            ]
            if holder not in (None, agent_id):
                yield (
                    "a dock holds one aMussel",
                    f"dock {dock_index} closed around {agent_id} and holds {holder}",
                )
            if others:
                yield (
                    "an aMussel is in one dock",
                    f"dock {dock_index} closed around {agent_id}, which is in dock {others[0]}",
                )
        self._docks = {index: held for index, held in self._docks.items() if held != agent_id}
        if closed:
            self._docks[dock_index] = agent_id

    def _of_apad(self, at_ms: int, apad: APadMoved) -> Iterator[tuple[str, str]]:
        held = [it for it in apad.docks if it >= 0]
        if len(held) != len(set(held)):
            yield "an aMussel is in one dock", f"the aPad holds {held}"
        here = apad.north_m, apad.east_m
        if not all(map(math.isfinite, here)):
            yield "a place is a number", f"the aPad is at {here}"
            return
        if self._apad_m is not None:
            self._way_m += math.dist(self._apad_m[1:], here)
        self._apad_m = (at_ms, *here)

    def _last_rules(
        self, summary: Mapping[str, Any], kept: Mapping[SampleSource, Counter[int]]
    ) -> Iterator[tuple[str, str]]:
        cost_m, planned_m = summary["cost_m"], summary["planned_m"]
        if cost_m > self._way_m * (1 + WAY_FRACTION) + WAY_M:
            yield "the cost is the way driven", f"{cost_m:.2f} m, and the aPad drove {self._way_m:.2f} m"
        if planned_m > self._legs_m + WAY_M:
            yield (
                "the planned way is that of the legs",
                f"{planned_m:.2f} m, and the legs are {self._legs_m:.2f} m",
            )
        for (agent_id, real_since_ms), counts in kept.items():
            if doubled := sorted(sequence for sequence, count in counts.items() if count > 1):
                yield "a sample is kept once", f"aMussel {agent_id}: {doubled[:10]}"
            truth = self._truths.get(agent_id)
            if real_since_ms is None and truth is not None and max(counts) >= truth.physical.samples:
                yield (
                    "a sample is taken before it is kept",
                    f"aMussel {agent_id}: {max(counts)} of {truth.physical.samples}",
                )


def _held_at(battery: Battery, at_ms: int, model: ChargeModel) -> Battery:
    """The battery at rest with its charge of `at_ms`, or of its anchor if that is later."""
    at_ms = max(battery.anchor_ms, at_ms)
    return Battery(at_ms, model.charge_at(battery, at_ms), Flow.RESTING)


def _of_belief(at_ms: int, belief: BeliefChanged) -> Iterator[tuple[str, str]]:
    name, low, high = f"aMussel {belief.id}", belief.low, belief.high
    numbers = belief.charge, belief.secondary, belief.north_m, belief.east_m
    if not all(map(math.isfinite, numbers)):
        yield "a belief is finite", f"{name}: {numbers}"
    if belief.heard > at_ms:
        yield "a packet is older than the belief of it", f"{name}: {belief.heard} ms at {at_ms} ms"
    # The mean of a skewed mixture may lie outside its central interval; the interval itself has an order.
    if low is not None and high is not None and not 0 <= low <= high <= 1:
        yield "an interval has an order", f"{name}: {low} to {high}"


def check_run(directory: RunDirectory) -> list[Broken]:
    """The rules that an aPad's run broke.

    OSError, RunDirectoryError, JournalDamaged or ScenarioError for a directory that cannot be read.

    A run that has not ended yet is checked as far as its journal goes.
    """
    checker = Invariants(load(directory.scenario))
    broken = [it for entry in read_journal(directory.journal).entries for it in checker.take(entry)]
    if (summary := directory.read_summary()) is not None:
        kept = kept_samples(directory.samples)
        try:
            broken += checker.end(summary, kept)
        except (KeyError, TypeError) as error:
            raise RunDirectoryError(
                f"{directory.summary} is damaged, or of another version: {error}"
            ) from error
    return broken


def kept_samples(path: Path) -> dict[SampleSource, Counter[int]]:
    """Number of lines of samples.jsonl for each sequence number, by board; empty without such a file."""
    kept: dict[SampleSource, Counter[int]] = {}
    for sample in read_samples(path):
        kept.setdefault(sample.board, Counter())[sample.sequence] += 1
    return kept

"""Each fault of a stack as docs/failures.md describes it: port, core and simulated aPad in one loop without ROS."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from scenario_files import POOL_FILE
from stack_benches import START_M, Bench
from wire_observer import Place

from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import (
    CloseDock,
    CommandedByOthers,
    GoTo,
    Hold,
    OpenDock,
    Primitive,
)
from apad_bridge.vehicle.generation_a.messages import (
    GO_TO,
    GoalOrder,
)
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
)
from apad_bridge.vehicle.guards.gate import plain_safety
from apad_bridge.vehicle.outcomes import Outcome, PrimitiveFailed, PrimitiveSucceeded
from apad_bridge.vehicle.vehicle_link import Carried, LinkFact
from apad_bridge.world.apad.motion import Coast
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle

ROOT = Path(__file__).parents[4]
POOL = load(POOL_FILE)
NORTH_M, EAST_M = START_M
ROWS = dict(
    re.findall(r"^\| `(\w+)` \| [AB, ]+ \| (.*) \|$", (ROOT / "docs/failures.md").read_text(), re.MULTILINE)
)
AWAY = GoTo(1, NORTH_M + 10.0, EAST_M, 0.5, 0.5)


class Faulty(Bench):
    """Without guards, a vehicle with a fault; a docks' service of generation A answers."""

    def __init__(
        self,
        generation: Generation,
        fault: Fault = Fault.NONE,
        drift_m_s: Place = (0.0, 0.0),
        *,
        takes_back: bool = True,
    ) -> None:
        super().__init__(generation, drift_m_s, is_real=not takes_back, fault=fault, safety=plain_safety())
        self.link.tells_docks = True

    def done(self, primitive: Primitive) -> Outcome:
        """Orders a primitive, and returns its end."""
        self.give(primitive)
        return self.outcome(primitive.command_id)

    def refused(self, primitive: Primitive) -> str:
        """The reason why a primitive failed."""
        outcome = self.done(primitive)
        assert isinstance(outcome, PrimitiveFailed)
        return outcome.reason

    def outcome(self, primitive_id: int) -> Outcome:
        """The end of a primitive. Waits up to five minutes for it."""
        for _ in range(300):
            for it in self.outcomes:
                if isinstance(it, PrimitiveSucceeded | PrimitiveFailed) and it.primitive_id == primitive_id:
                    return it
            self.run(1)
        raise AssertionError("it waits for ever")


def carried(facts: list[LinkFact], agent_id: int) -> list[tuple[float, float]]:
    return [(it.north_m, it.east_m) for it in facts if isinstance(it, Carried) and it.agent_id == agent_id]


def documented(fault: Fault) -> str:
    """The reason on the page."""
    (reason,) = re.findall(r'"(.+)"', ROWS[fault.value])
    return reason


def test_every_fault_has_its_row_and_its_test() -> None:
    assert set(ROWS) == {fault.value for fault in Fault} - {"none"}


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_without_a_fault_all_primitives_succeed(generation: Generation) -> None:
    bench = Faulty(generation)
    for primitive in (
        AWAY,
        CloseDock(2, 0, 7),
        Hold(3, NORTH_M + 10, EAST_M),
        OpenDock(4, 0, 7),
    ):
        bench.give(primitive)
        if primitive.command_id != 3:
            assert isinstance(bench.outcome(primitive.command_id), PrimitiveSucceeded)
    assert bench.link.core.dropped == {}


def test_of_a_silent_release_the_dock_is_open_after_two_seconds() -> None:
    bench = Faulty(Generation.A, Fault.RELEASE_SILENT)
    bench.done(CloseDock(1, 0, 7))
    bench.give(OpenDock(2, 0, 7))
    begun_ms = bench.now_ms + 5_000  # the virtual profile's time
    outcome = bench.outcome(2)
    assert isinstance(outcome, PrimitiveSucceeded) and outcome.at_ms == begun_ms + 2_000
    assert "2 s of silence" in ROWS["release_silent"]


def test_after_a_release_that_crashes_the_server_the_next_order_fails() -> None:
    bench = Faulty(Generation.A, Fault.RELEASE_CRASHES)
    bench.done(CloseDock(1, 0, 7))
    assert isinstance(bench.done(OpenDock(2, 0, 7)), PrimitiveSucceeded)
    bench.give(replace(AWAY, command_id=3))
    begun_ms = bench.now_ms
    outcome = bench.outcome(3)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(Fault.RELEASE_CRASHES)
    assert outcome.at_ms == begun_ms + 5_000


def test_a_go_to_whose_server_died_arrives_by_its_position_and_the_next_order_fails() -> None:
    loud, silent = Faulty(Generation.A), Faulty(Generation.A, Fault.SERVER_DIES)
    for bench in (loud, silent):
        bench.give(AWAY)
    outcome, loud_ms = silent.outcome(1), loud.outcome(1).at_ms
    assert isinstance(outcome, PrimitiveSucceeded)
    assert loud_ms < outcome.at_ms <= loud_ms + 4_000 and ROWS["server_dies"].startswith("3 s within")
    assert silent.link.core.dropped["the action server fell silent"] == 1
    assert silent.refused(CloseDock(2, 0, 7)) == documented(Fault.SERVER_DIES)


def test_a_go_to_of_a_dead_server_that_comes_no_nearer_has_failed() -> None:
    bench = Faulty(Generation.A, Fault.SERVER_DIES)
    bench.give(AWAY)
    bench.run(4)
    bench.link.vehicle._apad.receive(Coast(), bench.link.vehicle.now_ms)  # the water stops it
    outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed)
    assert outcome.reason == "the aPad's action server fell silent after it took the goal"
    assert outcome.at_ms < 20_000


@pytest.mark.parametrize("answers", [True, False])
def test_a_higher_dock_that_falls_silent_with_a_lower_ones_release_is_still_closed(answers: bool) -> None:
    bench = Faulty(Generation.A, Fault.COUNTS_DOCKS)
    stack = bench.link
    stack.tells_docks = answers
    for n, agent_id in enumerate((7, 8, 9), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(4, 0, 7))
    bench.done(replace(AWAY, command_id=5))
    bench.run(20)
    assert bench.port.docked == ((1, 8), (2, 9))
    assert carried(bench.facts, 9)[-1] == pytest.approx(stack.vehicle._apad.dock_position(2), abs=1e-6)
    assert isinstance(bench.done(OpenDock(6, 2, 9)), PrimitiveSucceeded)
    assert stack.vehicle.held == ["amussel8"]
    assert (
        stack.core.dropped["silence on position_static of an aMussel that the aPad holds: dead reckoning"]
        == 1
    )
    assert "the bench asks" in ROWS["counts_docks"]


def test_what_a_crashed_server_held_is_let_go_after_a_silence() -> None:
    bench = Faulty(Generation.A, Fault.RELEASE_CRASHES)
    for n, agent_id in enumerate((7, 8), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(3, 0, 7))
    assert bench.port.docked == ((1, 8),)
    bench.run(16)
    assert not bench.port.docked
    assert bench.link.core.dropped["silence on position_static, taken for a release without an order"] == 1


def foreign(north_m: float) -> GoalOrder:
    return GoalOrder("another's-1", GO_TO, north_m, EAST_M)


def test_anothers_go_to_during_a_hold_is_let_end_and_then_the_hold_goes_on() -> None:
    bench = Faulty(Generation.A)
    bench.give(Hold(1, NORTH_M, EAST_M))
    bench.run(5)
    bench.link.take(foreign(NORTH_M + 6.0), bench.now_ms)
    north_m = []
    for _ in range(60):
        bench.run(1)
        north_m.append(bench.link.vehicle.pose.north_m - NORTH_M)
    assert max(north_m) > 5.5, "the other's go-to was cut short"
    assert north_m[-1] == pytest.approx(0.0, abs=0.5)
    assert bench.link.core.dropped == {"another client sent the aPad away from its hold": 1}
    assert isinstance(bench.port.running, Hold)


def test_a_real_apad_stays_where_another_sent_it_until_the_next_order() -> None:
    bench = Faulty(Generation.A, takes_back=False)
    bench.give(Hold(2, NORTH_M, EAST_M))
    bench.run(5)
    bench.link.take(foreign(NORTH_M + 6.0), bench.now_ms)
    bench.run(90)
    assert bench.link.vehicle.pose.north_m == pytest.approx(NORTH_M + 6.0, abs=0.5)
    assert bench.link.core.dropped == {"another client sent the aPad away from its hold": 1}
    assert [type(it) for it in bench.facts if isinstance(it, CommandedByOthers)] == [CommandedByOthers]
    assert isinstance(bench.done(AWAY), PrimitiveSucceeded)


def test_a_hold_does_not_stop_what_another_ordered_of_a_real_apad() -> None:
    """A mission that stands aside orders a hold first."""
    bench = Faulty(Generation.A, takes_back=False)
    bench.give(AWAY)
    bench.run(3)
    bench.link.take(foreign(NORTH_M - 8.0), bench.now_ms)
    bench.run(2)
    assert any(isinstance(it, CommandedByOthers) for it in bench.facts)
    bench.give(Hold(2, bench.link.vehicle.pose.north_m, EAST_M))
    bench.run(90)
    assert bench.link.vehicle.pose.north_m == pytest.approx(NORTH_M - 8.0, abs=0.5)
    assert isinstance(bench.port.running, Hold)


def test_a_go_to_that_anothers_pre_empted_fails_when_the_others_has_ended() -> None:
    bench = Faulty(Generation.A)
    bench.give(AWAY)
    bench.run(3)
    bench.link.take(foreign(NORTH_M - 8.0), bench.now_ms)
    outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed)
    assert outcome.reason == "the aPad's action server reports PREEMPTED: another client's goal replaced it"
    assert bench.link.vehicle.pose.north_m == pytest.approx(NORTH_M - 8.0, abs=0.6), (
        "the other's was cut short"
    )


def test_anothers_goal_that_never_ends_is_left_alone_for_a_minute() -> None:
    bench = Faulty(Generation.A)
    stack = bench.link
    bench.give(Hold(1, NORTH_M, EAST_M))
    bench.run(5)
    stack.take(GoalOrder("another's-1", 7), bench.now_ms)  # of no known kind: active for ever
    bench.run(59)
    assert stack.vehicle._goal is not None and stack.vehicle._goal.key == "another's-1"
    bench.run(3)
    assert stack.vehicle._goal is None or stack.vehicle._goal.key != "another's-1"


def test_a_perch_that_holds_nothing_fails() -> None:
    bench = Faulty(Generation.A, Fault.PERCHES_NOTHING)
    reason = bench.refused(CloseDock(1, 0, 7))
    assert reason == documented(Fault.PERCHES_NOTHING) == bench.port.first_failure.reason


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_a_vehicle_that_is_stuck_stalls(generation: Generation) -> None:
    bench = Faulty(generation, Fault.STUCK)
    bench.give(AWAY)
    begun_ms = bench.now_ms
    outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason.startswith(documented(Fault.STUCK))
    assert outcome.at_ms == begun_ms + 60_000


def test_a_silent_vehicle_arrives_by_its_position() -> None:
    loud, silent = Faulty(Generation.B), Faulty(Generation.B, Fault.SILENT)
    for bench in (loud, silent):
        bench.give(AWAY)
    outcome, loud_ms = silent.outcome(1), loud.outcome(1).at_ms
    assert isinstance(outcome, PrimitiveSucceeded)
    assert loud_ms < outcome.at_ms <= loud_ms + 4_000 and ROWS["silent"].startswith("3 s within")


@pytest.mark.parametrize(
    ("fault", "after_ms"),
    [(Fault.REFUSES, 3_000), (Fault.HANGS, 18_000), (Fault.DROPS, 3_000), (Fault.LIES, 3_000)],
)
def test_a_vehicle_that_does_otherwise_than_it_was_told(fault: Fault, after_ms: int) -> None:
    bench = Faulty(Generation.B, fault)
    bench.give(AWAY)
    begun_ms = bench.now_ms
    outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(fault)
    assert outcome.at_ms == pytest.approx(begun_ms + after_ms, abs=1_000)


def test_a_vehicle_that_blocks_takes_no_call_for_the_27_s_in_which_its_servo_turns() -> None:
    """By the row it is the call that waits: the vehicle itself would take the order."""
    vehicle = GenerationBVehicle(SimulatedAPad(POOL.apad), 0, Fault.BLOCKS)
    dock = DockingOrder(True, 0, 0.1, 0.3, 0.2, 0.2)
    assert not vehicle.blocks
    vehicle.receive(dock, 0)
    blocked = []
    for now_ms in range(0, 60_000, 1_000):
        vehicle.advance(now_ms)
        blocked.append(vehicle.blocks)
    assert blocked == [True] * 27 + [False] * 33
    assert documented(Fault.BLOCKS) == documented(Fault.HANGS)


def test_a_vehicle_that_wanders_is_told_again() -> None:
    bench = Faulty(Generation.B, Fault.WANDERS, drift_m_s=(0.3, 0.0))
    bench.give(Hold(1, NORTH_M, EAST_M))
    farthest_m = 0.0
    for _ in range(120):
        bench.run(1)
        farthest_m = max(farthest_m, bench.link.vehicle.pose.north_m - NORTH_M)
    # 10 s at most at 0.3 m/s beyond the 3 m.
    assert 3.0 < farthest_m < 6.5
    assert bench.link.core.dropped["the aPad did not hold its position, and got the hold again"] >= 3


def test_a_fault_of_the_other_generation_is_refused() -> None:
    assert {Fault.NONE, Fault.STUCK} == OF_A & OF_B and set(Fault) == OF_A | OF_B
    with pytest.raises(ValueError, match="of another generation"):
        replace(POOL.apad, fault=Fault.LIES)

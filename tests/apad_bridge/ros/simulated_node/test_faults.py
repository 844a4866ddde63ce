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

    def refused_at(self, primitive_id: int) -> str:
        """The reason why a primitive failed."""
        outcome = self.outcome(primitive_id)
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


CLOSE, OPEN = CloseDock(1, 0, 7), OpenDock(2, 0, 7)
ALL = [AWAY, CloseDock(2, 0, 7), Hold(3, NORTH_M + 10, EAST_M), OpenDock(4, 0, 7)]
PERCHED, FELL_SILENT = "silence on position_static, taken for a release", "the action server fell silent"
BY_POSITION = "the action server was silent: arrival by position"
OF_A_ALONE, OF_B_ALONE = [Generation.A], [Generation.B]
ENDS: dict[Fault, list[tuple[list[Generation], list[Primitive], str | None, int, list[str]]]] = {
    # Who shows the fault; the primitives; what the page says of the last one's success, or None where it fails with the
    # reason there; the time to its end; what was dropped.
    Fault.NONE: [
        ([Generation.A, Generation.B], [AWAY], "", 21_000, []),
        ([Generation.A, Generation.B], ALL, "", 5_000, []),
    ],
    Fault.PERCHES_NOTHING: [(OF_A_ALONE, [CLOSE], None, 16_000, [])],
    Fault.RELEASE_SILENT: [(OF_A_ALONE, [CLOSE, OPEN], "2 s of silence", 5_000 + 2_000, [PERCHED])],
    Fault.RELEASE_CRASHES: [
        (OF_A_ALONE, [CLOSE, OPEN], "", 5_000 + 2_000, [PERCHED]),
        (OF_A_ALONE, [CLOSE, OPEN, replace(AWAY, command_id=3)], None, 5_000, [PERCHED, FELL_SILENT]),
    ],
    Fault.STUCK: [([Generation.A, Generation.B], [AWAY], None, 60_000, [])],
    Fault.REFUSES: [(OF_B_ALONE, [AWAY], None, 3_000, [])],
    Fault.HANGS: [(OF_B_ALONE, [AWAY], None, 18_000, [])],
    Fault.DROPS: [(OF_B_ALONE, [AWAY], None, 4_000, [])],
    Fault.LIES: [(OF_B_ALONE, [AWAY], None, 4_000, [])],
    Fault.SILENT: [
        (OF_B_ALONE, [AWAY], "3 s within", 23_000, ["goto_status was silent: arrival by position"])
    ],
    Fault.SERVER_DIES: [
        (OF_A_ALONE, [AWAY], "3 s within", 23_000, [FELL_SILENT, BY_POSITION]),
        (OF_A_ALONE, [AWAY, CloseDock(2, 0, 7)], None, 20_000, [FELL_SILENT, BY_POSITION]),
    ],
}


@pytest.mark.parametrize(
    ("fault", "generation", "primitives", "page", "after_ms", "dropped"),
    [
        pytest.param(fault, generation, *row, id=f"{fault} of {generation}: {len(row[0])} primitives")
        for fault, rows in ENDS.items()
        for generations, *row in rows
        for generation in generations
    ],
)
def test_the_last_primitive_ends_as_the_page_says(
    fault: Fault,
    generation: Generation,
    primitives: list[Primitive],
    page: str | None,
    after_ms: int,
    dropped: list[str],
) -> None:
    bench = Faulty(generation, fault)
    for primitive in primitives:
        begun_ms = bench.now_ms
        bench.give(primitive)
        if not isinstance(primitive, Hold):
            outcome = bench.outcome(primitive.command_id)
    if page is None:
        assert isinstance(outcome, PrimitiveFailed) and outcome.reason.removesuffix(
            ", 10.0 m to go"
        ) == documented(fault)
        assert bench.port.first_failure == outcome
    else:
        assert isinstance(outcome, PrimitiveSucceeded) and page in ROWS.get(fault.value, "")
    assert outcome.at_ms - begun_ms == after_ms and sorted(bench.link.core.dropped.elements()) == sorted(
        dropped
    )


def test_a_go_to_of_a_dead_server_that_comes_no_nearer_has_failed() -> None:
    bench = Faulty(Generation.A, Fault.SERVER_DIES)
    bench.give(AWAY)
    bench.run(4)
    bench.link.push(Coast())  # the water stops it
    assert bench.refused_at(1) == "the aPad's action server fell silent after it took the goal"
    assert bench.outcome(1).at_ms < 20_000


@pytest.mark.parametrize("answers", [True, False])
def test_a_higher_dock_that_falls_silent_with_a_lower_ones_release_is_still_closed(answers: bool) -> None:
    bench = Faulty(Generation.A, Fault.COUNTS_DOCKS)
    bench.link.tells_docks = answers
    for n, agent_id in enumerate((7, 8, 9), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(4, 0, 7))
    bench.done(replace(AWAY, command_id=5))
    bench.run(20)
    vehicle = bench.link.vehicle
    assert bench.port.docked == ((1, 8), (2, 9)) and "the bench asks" in ROWS["counts_docks"]
    assert carried(bench.facts, 9)[-1] == pytest.approx(vehicle._apad.dock_position(2), abs=1e-6)
    assert isinstance(bench.done(OpenDock(6, 2, 9)), PrimitiveSucceeded) and vehicle.held == ["amussel8"]
    silent = "silence on position_static of an aMussel that the aPad holds: dead reckoning"
    assert bench.link.core.dropped[silent] == 1


def test_what_a_crashed_server_held_is_let_go_after_a_silence() -> None:
    bench = Faulty(Generation.A, Fault.RELEASE_CRASHES)
    for n, agent_id in enumerate((7, 8), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(3, 0, 7))
    assert bench.port.docked == ((1, 8),)
    bench.run(16)
    assert not bench.port.docked
    assert bench.link.core.dropped["silence on position_static, taken for a release without an order"] == 1


def crossed(ours: Primitive, others_m: float, *, is_real: bool, then_s: int = 90) -> tuple[Faulty, float]:
    """The bench `then_s` after another client's go-to, by so much to the north, crossed our order; and how far it went."""
    bench = Faulty(Generation.A, takes_back=not is_real)
    bench.give(ours)
    bench.run(3)
    bench.link.take(GoalOrder("another's-1", GO_TO, NORTH_M + others_m, EAST_M), bench.now_ms)
    north_m = [bench.run(1) or bench.link.vehicle.pose.north_m - NORTH_M for _ in range(then_s)]
    return bench, max(north_m, key=abs, default=0.0)


SENT_AWAY = "another client sent the aPad away from its hold"


@pytest.mark.parametrize(
    ("is_real", "ends_m", "told"), [(False, 0.0, 0), (True, 6.0, 1)], ids=["simulated", "real"]
)
def test_anothers_go_to_during_a_hold_is_let_end_and_a_simulated_apad_holds_again(
    is_real: bool, ends_m: float, told: int
) -> None:
    bench, farthest_m = crossed(Hold(2, NORTH_M, EAST_M), 6.0, is_real=is_real)
    assert farthest_m > 5.5, "the other's go-to was cut short"
    assert bench.link.vehicle.pose.north_m - NORTH_M == pytest.approx(ends_m, abs=0.5)
    assert bench.link.core.dropped == {SENT_AWAY: 1} and isinstance(bench.port.running, Hold)
    assert sum(isinstance(it, CommandedByOthers) for it in bench.facts) == told
    assert isinstance(bench.done(AWAY), PrimitiveSucceeded)


def test_a_hold_does_not_stop_what_another_ordered_of_a_real_apad() -> None:
    """A mission that stands aside orders a hold first."""
    bench, _ = crossed(AWAY, -8.0, is_real=True, then_s=2)
    assert any(isinstance(it, CommandedByOthers) for it in bench.facts)
    bench.give(Hold(2, bench.link.vehicle.pose.north_m, EAST_M))
    bench.run(90)
    assert bench.link.vehicle.pose.north_m == pytest.approx(NORTH_M - 8.0, abs=0.5)
    assert isinstance(bench.port.running, Hold)


def test_a_go_to_that_anothers_pre_empted_fails_when_the_others_has_ended() -> None:
    bench, _ = crossed(AWAY, -8.0, is_real=False, then_s=0)
    assert (
        bench.refused_at(1) == "the aPad's action server reports PREEMPTED: another client's goal replaced it"
    )
    north_m = bench.link.vehicle.pose.north_m
    assert north_m == pytest.approx(NORTH_M - 8.0, abs=0.6), "the other's was cut short"


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
    ways_m = [bench.run(1) or bench.link.vehicle.pose.north_m - NORTH_M for _ in range(120)]
    # 10 s at most at 0.3 m/s beyond the 3 m.
    assert 3.0 < max(ways_m) < 6.5
    assert bench.link.core.dropped["the aPad did not hold its position, and got the hold again"] >= 3


def test_a_fault_of_the_other_generation_is_refused() -> None:
    assert {Fault.NONE, Fault.STUCK} == OF_A & OF_B and set(Fault) == OF_A | OF_B
    with pytest.raises(ValueError, match="of another generation"):
        replace(POOL.apad, fault=Fault.LIES)

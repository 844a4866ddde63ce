"""The gate at the end of every road: what reaches the vehicle, by an observer that shares no code with the guards."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stack_benches import FAULTS, ROOT, Bench, LinkToA, is_safe, place_of, truly
from wire_observer import SIDE_M, TICK_MS

from apad_bridge.events.guard_events import (
    DangerOver,
    Drifting,
    GuardReacted,
    OrderRefused,
    OthersCommanded,
    PilotTold,
    Reaction,
    StopChanged,
    StopKind,
    StopState,
)
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    GoalOfOthers,
    GoTo,
    Hold,
    MoveArm,
    PilotLeft,
    PilotReported,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.fenced_waters import FencedWaters
from apad_bridge.vehicle.guards.gate import Gate, Safety
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.guards import (
    BatteryForHome,
    InWaters,
    unlimited_guards,
)
from apad_bridge.vehicle.guards.monitor import (
    CanStopInWaters,
    EndsInTime,
    IsInWaters,
    MakesProgress,
    Monitor,
    PositionIsGood,
    SpeedIsAllowed,
    Stopping,
)
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch
from apad_bridge.vehicle.guards.stops import StopsEnded
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.apad.motion import Coast, Steer
from tests.apad_bridge.vehicle.guards.test_guards import WATERS

LIMITS = PositionLimits(age_ms=5_000, jump_m=10.0, speed_m_s=2.0)
REAL_LIMITS = replace(LIMITS, clock_step_ms=1_000, settled_ms=None)


class Wire:
    """A link that keeps what goes out, and reports acceptance, and the positions that it is told to report."""

    def __init__(self) -> None:
        self.takes = True
        """The vehicle takes what goes out."""
        self.out: list[VehicleCommand] = []
        self.facts: list[LinkFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts, self.facts = self.facts, []
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        self.out.append(command)
        if isinstance(command, GoTo | Hold | Stop) and self.takes:
            self.facts.append(CommandAccepted(now_ms, command.command_id))

    def close(self) -> None:
        pass


class Guarded:
    """A vehicle in the U of the guards' tests, which is wherever it is put."""

    def __init__(
        self,
        *,
        is_real: bool = False,
        outside: Reaction = Reaction.HOLD,
        obeys_speed: bool = True,
        most_m_s: float = 2.0,
        place: tuple[float, float] | None = (5.0, 5.0),
    ) -> None:
        guards = [*unlimited_guards(), InWaters(WATERS, outside is Reaction.RETURN)]
        checks = [
            PositionIsGood(),
            IsInWaters(WATERS, outside),
            CanStopInWaters(WATERS, Stopping(0.5)),
            SpeedIsAllowed(most_m_s),
            EndsInTime(100.0),
            MakesProgress(),
        ]
        self.wire = Wire()
        watch = PositionWatch(REAL_LIMITS if is_real else LIMITS)
        safety = Safety(
            Gate(guards, watch, WATERS), Monitor(checks), WATERS, 0.5, is_real, lambda place, now: (0.1, 0.0)
        )
        self.vehicle = GuardedVehicle(self.wire, safety, obeys_speed=obeys_speed)
        self.now_ms = 0
        if place is not None:
            self.at(*place)

    def at(
        self, north_m: float, east_m: float, *heard: LinkFact, ticks: int = 1, after_ms: int = 1_000
    ) -> list[LinkFact]:
        """The facts of ticks at which the vehicle is there, and was heard to tell of the others before."""
        self.wire.facts += heard
        facts: list[LinkFact] = []
        for _ in range(ticks):
            self.now_ms += after_ms
            self.wire.facts.append(PoseReported(self.now_ms, north_m, east_m, 0.0, self.now_ms))
            facts += self.vehicle.advance(self.now_ms)
            self.note()
        return facts

    def silent(self, ticks: int) -> list[LinkFact]:
        facts: list[LinkFact] = []
        for _ in range(ticks):
            self.now_ms += 1_000
            facts += self.vehicle.advance(self.now_ms)
            self.note()
        return facts

    def note(self) -> None:
        """Nothing, after each tick and each stop: a bench that keeps a journal has more to do."""

    def command(self, command: VehicleCommand) -> list[VehicleCommand]:
        """What goes out because of it."""
        self.wire.out = []
        self.vehicle.command(command, self.now_ms)
        return self.wire.out

    def stop(self, *, off: bool = False, hands: bool = False) -> list[VehicleCommand]:
        """What goes out because a person stops the vehicle."""
        self.wire.out = []
        self.vehicle.stop("Anna", self.now_ms, off=off, hands=hands)
        self.note()
        return self.wire.out

    def events(self) -> list[tuple[str, str]]:
        return [
            (it.kind, it.guard if isinstance(it, OrderRefused) else str(it.cause))
            for it in self.vehicle.gate.take_events()
            if isinstance(it, GuardReacted | DangerOver | OrderRefused)
        ]

    def states(self) -> list[str]:
        """The states of stops since the last call, with number and mode."""
        return [
            f"{it.number} {it.mode} {it.state}"
            for it in self.vehicle.gate.take_events()
            if isinstance(it, StopChanged)
        ]


@pytest.fixture
def simulated() -> Guarded:
    return Guarded()


def test_a_refused_order_fails_with_its_reason_and_does_not_go_out(simulated: Guarded) -> None:
    assert simulated.command(GoTo(1, 45.0, 5.0, 0.5, 0.5)) == []
    (failed,) = (it for it in simulated.at(5.0, 5.0) if isinstance(it, CommandFailed))
    assert (
        failed.command_id == 1
        and "refused: the goal (45.0 m north, 5.0 m east) lies 5.0 m outside" in failed.reason
    )
    assert simulated.events() == [("refused", "fence")]


def test_a_refused_order_holds_a_vehicle_that_is_under_way(simulated: Guarded) -> None:
    go = GoTo(1, 30.0, 5.0, 0.5, 0.5)
    assert simulated.command(go) == [go]
    simulated.at(5.5, 5.0)
    (hold,) = simulated.command(GoTo(2, 45.0, 5.0, 0.5, 0.5))
    assert isinstance(hold, Hold) and (hold.north_m, hold.east_m) == (5.5, 5.0)
    assert simulated.command(GoTo(3, 45.0, 5.0, 0.5, 0.5)) == []  # it holds already


@pytest.mark.parametrize(("place", "kind"), [((5.0, 5.0), Hold), ((-3.0, 5.0), Stop), ((0.5, 5.0), Hold)])
def test_a_persons_stop_holds_inside_the_waters_and_is_off_outside(
    place: tuple[float, float], kind: type
) -> None:
    bench = Guarded(is_real=True, place=place)
    bench.at(*place)
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    (sent,) = bench.stop()
    assert isinstance(sent, kind)
    assert not isinstance(sent, Hold) or ((sent.north_m, sent.east_m) == place and sent.pre_empts)


@pytest.fixture
def bench() -> Guarded:
    return Guarded(is_real=True)


def test_a_stop_goes_through_its_states_and_only_then_is_the_vehicle_at_rest(bench: Guarded) -> None:
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    bench.at(6.0, 5.0)
    bench.vehicle.gate.take_events()
    bench.stop()
    assert bench.states() == ["1 hold ordered", "1 hold sent"]
    facts = bench.at(6.8, 5.0)
    assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
    assert bench.states() == ["1 hold taken"]
    bench.at(7.0, 5.0, ticks=3)
    assert bench.states() == ["1 hold obeyed", "1 hold at rest"]


def test_a_second_stop_is_off_and_nothing_goes_out_until_a_person_continues(bench: Guarded) -> None:
    bench.stop()
    bench.at(5.0, 5.0)
    assert [type(it) for it in bench.stop()] == [Stop]
    bench.at(5.0, 5.0)
    for order in (GoTo(1, 6.0, 5.0, 0.5, 0.5), Hold(2, 5.0, 5.0), MoveArm(3, 0, False)):
        assert bench.command(order) == []
    gate = bench.vehicle.gate
    assert "stop 1 is not in force: stop 2 (off, by Anna)" in gate.why_not_continue(1, bench.now_ms)
    assert gate.why_not_continue(2, bench.now_ms) == gate.why_not_continue(None, bench.now_ms) == ""
    assert "name the stop: stop 2 (off, by Anna)" in gate.why_not_continue(0, bench.now_ms)
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    assert [type(it) for it in bench.command(GoTo(4, 6.0, 5.0, 0.5, 0.5))] == [GoTo]


def test_hands_at_the_docks_latch_off_and_no_other_word_than_continue_ends_that(bench: Guarded) -> None:
    assert [type(it) for it in bench.stop(hands=True)] == [Stop]
    bench.vehicle.allow_motion("Anna", bench.now_ms, ends=StopsEnded.PERSONS_HOLD)
    bench.at(5.0, 5.0)
    assert bench.command(MoveArm(1, 0, True)) == [] and bench.vehicle.gate.awaits_person
    assert [type(it) for it in bench.stop()] == [Stop]
    assert bench.vehicle.gate.stops.in_force is not None and bench.vehicle.gate.stops.in_force.stills_arms


def test_a_hold_that_the_vehicle_does_not_take_becomes_off_and_the_operator_is_told(bench: Guarded) -> None:
    bench.wire.takes = False
    bench.vehicle.gate.take_events()
    bench.stop()
    bench.at(5.0, 5.0, ticks=6)
    assert [type(it) for it in bench.wire.out] == [Hold, Stop, Stop]
    assert bench.states() == [
        "1 hold ordered",
        "1 hold sent",
        "1 hold not taken",
        "1 off ordered",
        "1 off sent",
        "1 off not taken",
    ]
    bench.at(5.0, 5.0, CommandAccepted(bench.now_ms, bench.wire.out[-1].command_id))
    assert bench.states() == ["1 off taken", "1 off obeyed", "1 off at rest"]


def test_while_a_pilot_steers_nothing_goes_out_and_a_stop_is_refused(bench: Guarded) -> None:
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    facts = bench.at(5.5, 5.0, PilotReported(bench.now_ms, True))
    assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
    bench.wire.out = []
    assert PilotTold(True) in bench.vehicle.gate.take_events()
    assert bench.stop() == [] and bench.states() == ["1 hold refused"]
    assert bench.stop(off=True) == [] and bench.states() == ["2 off refused"]
    bench.at(-3.0, 5.0)
    bench.silent(6)
    assert bench.wire.out == []
    assert "the pilot has it" in bench.vehicle.gate.why_not_continue(None, bench.now_ms)
    bench.at(5.0, 5.0, PilotReported(bench.now_ms, False))
    assert bench.command(GoTo(2, 6.0, 5.0, 0.5, 0.5)) == []  # a pilot who lets go gives no word


def test_the_vehicle_hears_of_a_pilot_who_left_only_by_the_word_of_a_person_who_says_so(
    bench: Guarded,
) -> None:
    bench.at(5.0, 5.0, PilotReported(bench.now_ms, True))
    bench.wire.out = []
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    assert bench.wire.out == []
    bench.vehicle.allow_motion("Anna", bench.now_ms, pilot_left=True)
    assert [type(it) for it in bench.wire.out] == [PilotLeft]


def test_where_nobody_can_tell_of_a_pilot_nothing_moves_and_off_still_goes_out(bench: Guarded) -> None:
    for _ in range(2):
        bench.at(5.0, 5.0, PilotReported(bench.now_ms, None))
    assert bench.vehicle.gate.take_events().count(PilotTold(None)) == 1
    assert bench.command(GoTo(1, 6.0, 5.0, 0.5, 0.5)) == []
    assert [type(it) for it in bench.stop(off=True)] == [Stop]


def test_a_bad_position_is_off_and_nothing_moves_when_it_is_back(bench: Guarded) -> None:
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    bench.wire.out = []
    facts = bench.silent(6)
    assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
    assert [type(it) for it in bench.wire.out] == [Stop]
    bench.wire.out = []
    bench.at(5.0, 5.0, ticks=30)
    assert bench.wire.out == []
    assert bench.command(Hold(2, 5.0, 5.0)) == [] and bench.command(GoTo(3, 6.0, 5.0, 0.5, 0.5)) == []


def test_a_jump_is_believed_on_a_persons_word_alone(bench: Guarded) -> None:
    bench.at(5.0, 25.0)
    bench.at(5.0, 25.0, ticks=60)
    assert "has jumped by 20 m" in bench.vehicle.gate.situation(bench.now_ms).position_fault
    assert [type(it) for it in bench.stop()] == [Stop]
    assert bench.vehicle.gate.why_not_continue(None, bench.now_ms) == ""
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    assert bench.vehicle.gate.situation(bench.now_ms).position_fault == ""


def test_a_simulated_vehicle_goes_on_when_its_position_is_back(simulated: Guarded) -> None:
    simulated.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    simulated.wire.out = []
    simulated.silent(6)
    assert [type(it) for it in simulated.wire.out] == [Stop]
    simulated.wire.out = []
    simulated.at(5.0, 5.0)
    (held,) = simulated.wire.out  # the position is back
    assert isinstance(held, Hold) and (held.north_m, held.east_m) == (5.0, 5.0)


def test_outside_the_fence_it_is_off_and_a_pilot_is_called_and_both_ends_are_told() -> None:
    bench = Guarded(place=(1.0, 5.0))
    bench.at(-1.0, 5.0)
    assert bench.events() == [("guard", "outside the fence")] and bench.wire.out == [Stop(-1)]
    assert bench.command(GoTo(1, 5.0, 5.0, 0.5, 0.5)) == []
    bench.at(-1.0, 5.0)
    bench.at(1.0, 5.0)
    assert bench.events() == [("refused", "fence"), ("guard_over", "outside the fence")]


def test_just_outside_a_person_with_a_lookout_sends_it_back_in_where_it_holds() -> None:
    bench = Guarded(is_real=True, place=(1.0, 5.0))
    bench.at(-0.03, 5.0)
    gate = bench.vehicle.gate
    assert "bring it back first" in gate.why_not_continue(None, bench.now_ms)
    goal_m, why_not = gate.way_back(bench.now_ms)
    assert why_not == "" and math.dist(goal_m, (-0.03, 5.0)) <= 5.0 and WATERS.fault_of_place(goal_m) == ""
    bench.wire.out = []
    bench.vehicle.go_back_in("Anna", "Bo", bench.now_ms)
    (back,) = bench.wire.out
    assert isinstance(back, GoTo) and (back.north_m, back.east_m) == goal_m
    bench.at(0.4, 5.0)
    bench.at(*goal_m, Arrived(bench.now_ms, back.command_id))
    assert [type(it) for it in bench.wire.out] == [GoTo, Stop]  # the stop that was in force
    assert gate.why_not_continue(None, bench.now_ms) == "" and gate.awaits_person


def test_an_aPad_far_outside_or_without_a_speed_is_brought_back_by_hand() -> None:
    far = Guarded(is_real=True, place=(-7.0, 5.0))
    fast = Guarded(is_real=True, obeys_speed=False, place=(-0.1, 5.0))
    assert "the longest is 5 m" in far.vehicle.gate.way_back(far.now_ms)[1]
    assert "by joystick" in fast.vehicle.gate.way_back(fast.now_ms)[1]
    for bench in (far, fast):
        bench.wire.out = []
        bench.vehicle.go_back_in("Anna", "Bo", bench.now_ms)
        assert bench.wire.out == []


def test_the_way_back_in_crosses_no_keep_out_zone() -> None:
    """A zone along the fence lies between the aPad and all that is inside; beside it the way is free."""
    waters = FencedWaters(
        Fence(((0, 0), (40, 0), (40, 40), (0, 40)), (((0, 10), (2, 10), (2, 20), (0, 20)),)), 1.0
    )
    assert "crosses a keep-out zone" in waters.way_back((-1.0, 15.0), 5.0)[1]
    (north_m, east_m), why_not = waters.way_back((-1.0, 5.0), 5.0)
    assert why_not == "" and north_m > 0 and math.isclose(east_m, 5.0)


def test_a_charge_that_was_told_more_than_30_s_ago_is_not_known(simulated: Guarded) -> None:
    simulated.at(5.0, 5.0, BatteryReported(0, 15.0, 0.9))
    assert simulated.vehicle.gate.situation(30_000).battery_fraction == 0.9
    assert simulated.vehicle.gate.situation(30_001).battery_fraction is None


def test_a_sensor_that_says_nothing_is_left_once_refuses_no_leg() -> None:
    gate = Gate(
        [BatteryForHome((0.0, 0.0), 0.2, lambda begin, end, at_ms: 0.001 * math.dist(begin, end))],
        PositionWatch(LIMITS),
    )
    leg = GoTo(1, 10.0, 0.0, 0.5, 1.0)
    refused = []
    for at_s, fraction in enumerate((0.9, 0.0, 0.89, 0.0, 0.0, 0.0, 0.0), start=1):
        gate.observe([PoseReported(1000 * at_s, 0.0, 0.0, 0.0), BatteryReported(1000 * at_s, 12.0, fraction)])
        refused.append(gate.refusal(leg, 1000 * at_s) is not None)
    assert refused == [False] * 6 + [True]


def test_off_tells_at_once_and_every_ten_seconds_where_the_vehicle_drifts(bench: Guarded) -> None:
    bench.at(5.0, 5.5)
    bench.stop(off=True)
    for n in range(22):
        bench.at(5.0, 5.5 + 0.5 * n)
    _, second, _ = (it for it in bench.vehicle.gate.take_events() if isinstance(it, Drifting))
    assert (second.speed_m_s, second.towards_rad) == pytest.approx((0.5, math.pi / 2), abs=1e-3)


def test_a_go_to_that_comes_no_nearer_is_held_and_not_switched_off(bench: Guarded) -> None:
    """A tether or weed: the position is good."""
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    noise = random.Random(1)
    begun_ms = bench.now_ms
    while bench.vehicle.gate.stops.in_force is None:
        bench.at(5.2 + noise.gauss(0.0, 0.1), 5.0 + noise.gauss(0.0, 0.1))
        assert bench.now_ms - begun_ms <= 12_000
    assert bench.now_ms - begun_ms >= 10_000 and [type(it) for it in bench.wire.out] == [GoTo, Hold]
    assert "no 0.5 m nearer" in bench.vehicle.gate.awaits_person


def test_another_clients_goal_outside_the_fence_is_ended_and_its_node_named(bench: Guarded) -> None:
    others = CommandedByOthers(bench.now_ms, "/planner"), GoalOfOthers(bench.now_ms, "/planner", 90.0, 5.0)
    bench.at(5.0, 5.0, *others)
    (held,) = bench.wire.out
    assert isinstance(held, Hold) and held.pre_empts
    assert "/planner ordered a go-to that leaves the waters" in bench.vehicle.gate.awaits_person
    assert OthersCommanded("/planner") in bench.vehicle.gate.take_events()


def test_a_goal_that_nobody_heard_is_ended_because_nobody_can_tell_where_it_leads() -> None:
    bench, simulated = Guarded(is_real=True), Guarded()
    for it in (bench, simulated):
        it.at(5.0, 5.0, GoalOfOthers(it.now_ms, "/planner", None, None))
    (held,) = bench.wire.out
    assert isinstance(held, Hold) and held.pre_empts
    assert "/planner sent a goal that was not heard" in bench.vehicle.gate.awaits_person
    assert simulated.wire.out == []


def test_a_client_that_orders_again_after_a_persons_stop_is_stopped_again_and_named(bench: Guarded) -> None:
    bench.stop()
    bench.wire.out = []
    bench.at(5.0, 5.0, CommandedByOthers(bench.now_ms, "/planner"))
    assert [type(it) for it in bench.wire.out] == [Hold]


def test_where_the_scenario_wants_it_it_returns_to_the_nearest_place_inside() -> None:
    bench = Guarded(outside=Reaction.RETURN, place=(1.0, 5.0))
    bench.at(-1.0, 5.0)
    (back,) = bench.wire.out
    assert isinstance(back, GoTo) and (back.north_m, back.east_m) == pytest.approx((1.0, 5.0))


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@pytest.mark.parametrize("fault", ["NaN position", "silent position", "jumping position", "frozen position"])
def test_by_the_real_apad_s_limits_a_bad_position_ends_in_a_safe_state_within_3_s(
    generation: Generation, fault: str
) -> None:
    guards = load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml").guards
    assert guards is not None
    guards = replace(guards, clearance_m=2.0)  # its own is for wider waters than the bench's 60 m
    inflict = FAULTS[fault].inflict
    for seed in range(10):
        rng = random.Random(seed)
        bench = Bench(generation, guards=guards)
        bench.go(rng.uniform(40.0, 55.0), rng.uniform(40.0, 55.0))
        bench.run(rng.randint(4, 12))
        begun_ms = bench.now_ms
        inflict(bench, rng)
        while not is_safe(bench, begun_ms):
            bench.run(1)
            assert bench.now_ms <= begun_ms + 3_000
        assert bench.vehicle.gate.awaits_person


def test_a_stop_that_was_lost_on_the_way_is_given_again_until_it_is_taken(bench: Guarded) -> None:
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    bench.wire.out, bench.wire.takes = [], False
    bench.silent(6)
    for _ in range(3):
        (off,) = bench.wire.out
        assert isinstance(off, Stop)
        bench.wire.out = []
        bench.at(5.0, 5.0, CommandFailed(bench.now_ms, off.command_id, "its service did not answer"))
    (off,) = bench.wire.out
    bench.wire.out = []
    assert isinstance(off, Stop)
    bench.at(5.0, 5.3, CommandAccepted(bench.now_ms, off.command_id))
    bench.at(5.0, 5.3, ticks=4)
    assert bench.states()[-3:] == ["1 off taken", "1 off obeyed", "1 off at rest"]


def test_a_real_vehicle_that_had_to_be_stopped_waits_for_a_person() -> None:
    bench = Guarded(is_real=True, place=(1.0, 5.0))
    bench.at(-1.0, 5.0)
    bench.at(1.0, 5.0)
    bench.at(5.0, 5.0)
    assert bench.command(GoTo(1, 6.0, 5.0, 0.5, 0.5)) == []
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    assert bench.command(GoTo(2, 6.0, 5.0, 0.5, 0.5)) == [GoTo(2, 6.0, 5.0, 0.5, 0.5)]


@pytest.mark.parametrize(("north_m", "is_held"), [(2.2, False), (1.9, True)])
def test_it_is_held_before_it_would_come_to_rest_outside(north_m: float, is_held: bool) -> None:
    """At 1 m/s it makes a metre before the order acts, and another while it brakes with 0.5 m/s^2."""
    bench = Guarded(place=None)
    for way_m in (2.0, 1.0, 0.0):
        bench.at(north_m + way_m, 5.0)
    assert bench.events() == ([("guard", "fence ahead")] if is_held else [])


def test_a_vehicle_that_obeys_no_speed_is_held_when_it_is_too_fast(simulated: Guarded) -> None:
    for east_m in (7.5, 10.0):
        simulated.at(5.0, east_m)
    assert ("guard", "speed") in simulated.events()


def test_a_leg_that_lasts_too_long_is_ended(simulated: Guarded) -> None:
    simulated.command(GoTo(1, 5.0, 30.0, 0.5, 0.5))
    facts: list[LinkFact] = []
    for n in range(101):
        facts += simulated.at(5.0, 5.0 + n / 5)
    assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
    assert simulated.events() == [("guard", "late")]


def frozen_at(bench: Bench) -> Callable[..., PoseReported]:
    last = bench.link.pose
    return lambda pose, at_ms: PoseReported(at_ms, last.north_m, last.east_m, last.heading_rad)


# Every road, both generations: the port's, the cores' own repeats, the monitor's.

ACTS: dict[str, Callable[[Bench, float, float], None]] = {
    "go": lambda it, x, y: it.go(x, y),
    "hold": lambda it, x, y: it.hold(x, y),
    "dock": lambda it, x, y: it.dock(int(abs(x)) % 4, 1 + int(abs(y)) % 9),
    "undock": lambda it, x, y: it.undock(int(abs(x)) % 4, 1 + int(abs(y)) % 9),
    "wait": lambda it, x, y: it.run(1 + int(abs(x))),
    "silent": lambda it, x, y: setattr(it.link, "shift", lambda pose, at_ms: None),
    "heard": lambda it, x, y: setattr(it.link, "shift", truly),
    "frozen": lambda it, x, y: setattr(it.link, "shift", frozen_at(it)),
    "pilot": lambda it, x, y: it.link.set_pilot(steers=True),
    "no pilot": lambda it, x, y: it.link.set_pilot(steers=False),
}


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@settings(max_examples=60, deadline=None)
@given(
    acts=st.lists(
        st.tuples(st.sampled_from(sorted(ACTS)), st.floats(-20, SIDE_M + 20), st.floats(-20, SIDE_M + 20)),
        max_size=25,
    ),
    is_real=st.booleans(),
)
def test_no_sequence_of_orders_puts_on_the_wire_what_a_guard_refuses(
    generation: Generation, acts: list[tuple[str, float, float]], is_real: bool
) -> None:
    bench = Bench(generation, is_real=is_real)
    for name, x, y in acts:
        if generation is Generation.A and "pilot" in name:
            continue  # nobody tells a bench of a pilot there
        ACTS[name](bench, x, y)
        bench.run(1)
    bench.run(5)
    observer = bench.observer
    assert (observer.outside, observer.blind, observer.against_pilot) == ([], [], [])


TOLD_MS = 3_000


def nan_at(it: Bench) -> Callable[..., PoseReported]:
    return lambda pose, at_ms: PoseReported(at_ms, math.nan, pose.east_m, pose.heading_rad)


def jumped(it: Bench, north_m: float, east_m: float) -> Callable[..., PoseReported]:
    return lambda pose, at_ms: PoseReported(
        at_ms, pose.north_m + north_m, pose.east_m + east_m, pose.heading_rad
    )


STOP_ACTS = ACTS | {
    "others": lambda it, x, y: it.link.others_go(x, y),
    "lost": lambda it, x, y: setattr(it.link, "is_lost", True),
    "found": lambda it, x, y: setattr(it.link, "is_lost", False),
    "mute": lambda it, x, y: setattr(it.link, "is_mute", True),
    "answers": lambda it, x, y: setattr(it.link, "is_mute", False),
    "nan": lambda it, x, y: setattr(it.link, "shift", nan_at(it)),
    "jump": lambda it, x, y: setattr(it.link, "shift", jumped(it, x, y)),
}


class Watched(Bench):
    """A bench with a journal of each tick: what was on the wire, and how the newest stop stands for the operator."""

    def __init__(self, generation: Generation) -> None:
        self.ticks: list[tuple[int, int, int, StopState | None]] = []
        """(time, stops on the wire, other orders on the wire, state of the newest stop)."""
        self.wanted: list[tuple[int, int, bool]] = []
        """(time, stops on the wire before, orders are lost) of each stop that a person wants, or that another client's
        order makes due; of that one the time at which the bench hears of the order, at the next tick."""
        super().__init__(generation)

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            super().run(1)
            newest, seen = self.vehicle.gate.stops.newest, self.observer
            state = None if newest is None else newest.state
            self.ticks.append((self.now_ms, seen.stops, seen.orders - seen.stops, state))

    def act(self, name: str, x: float, y: float) -> None:
        if "pilot" in name and (isinstance(self.link, LinkToA) or self.link.is_mute):
            return  # nobody tells the bench of that pilot
        is_stopped = self.vehicle.gate.stops.in_force is not None
        if name == "others" and is_stopped and not (self.observer.pilot_steers or self.link.is_mute):
            self.wanted.append((self.now_ms + TICK_MS, self.observer.stops, self.link.is_lost))
        STOP_ACTS[name](self, x, y)
        self.run(1)

    def stop(self, *, off: bool) -> None:
        """A person stops the vehicle, in place of a stop that is still on its way."""
        self.wanted = [it for it in self.wanted if it[0] + TOLD_MS <= self.now_ms]
        self.wanted.append((self.now_ms, self.observer.stops, self.link.is_lost))
        self.vehicle.stop("Anna", self.now_ms, off=off)

    def is_stopped_or_told(self, at_ms: int, stops: int, is_lost: bool) -> bool:
        """After a stop was wanted at a time at which so many had been on the wire.

        Where orders arrive it is on the wire within a tick. Where they were lost it is there after three seconds, or the
        operator is told by then.
        """
        limit_ms = at_ms + (TOLD_MS if is_lost else TICK_MS)
        if any(count > stops for now_ms, count, _, _ in self.ticks if at_ms <= now_ms <= limit_ms):
            return True
        told = (
            at_ms < told_ms <= at_ms + TOLD_MS and kind == "stop" and data["state"] == "not taken"
            for told_ms, kind, data in self.events
        )
        # Of a stop that fails on and on the operator was told before.
        (state,) = (state for now_ms, _, _, state in self.ticks if now_ms == at_ms + TOLD_MS)
        return is_lost and (any(told) or state is StopState.NOT_TAKEN)


acts_of_a_sea = st.lists(
    st.tuples(st.sampled_from(sorted(STOP_ACTS)), st.floats(-20, SIDE_M + 20), st.floats(-20, SIDE_M + 20)),
    max_size=15,
)


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@settings(max_examples=100, deadline=None)
@given(before=acts_of_a_sea, after=acts_of_a_sea, off=st.booleans())
def test_a_persons_stop_is_on_the_wire_within_a_tick_or_the_person_is_told_within_three_seconds(
    generation: Generation,
    before: list[tuple[str, float, float]],
    after: list[tuple[str, float, float]],
    off: bool,
) -> None:
    """Whatever went before, and whatever comes after: losses of orders and of answers, bad positions, silences, others.

    Nothing that moves the vehicle follows until a person continues, another client's order has the stop go out again, and
    nobody is told that the vehicle has taken what was not on the wire.
    """
    bench = Watched(generation)
    for act in before:
        bench.act(*act)
    since_ms, stops, moving = bench.now_ms, bench.observer.stops, bench.observer.orders - bench.observer.stops
    pilot_had_it = bench.observer.pilot_steers
    bench.stop(off=off)
    for act in after:
        bench.act(*act)
    bench.run(TOLD_MS // TICK_MS + 1)
    assert bench.observer.against_pilot == []
    if pilot_had_it:
        stop = next(data for _, kind, data in bench.events if kind == "stop" and data["by"] == "Anna")
        assert stop["state"] == "refused" and "the pilot has it" in stop["reason"]
        return
    for wanted in bench.wanted:
        assert bench.is_stopped_or_told(*wanted), wanted
    later = [it for it in bench.ticks if it[0] > since_ms]
    assert all(others == moving for _, _, others, _ in later)
    assert all(count > stops for _, count, _, state in later if state in (StopState.TAKEN, StopState.AT_REST))


@pytest.mark.parametrize("goes", ["inside", "outside"])
@pytest.mark.parametrize("kind", [StopKind.HOLD, StopKind.OFF])
@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_after_a_guards_stop_no_other_client_moves_the_vehicle(
    generation: Generation, kind: StopKind, goes: str
) -> None:
    bench = Watched(generation)
    bench.go(20.0, 45.0)
    bench.run(5)
    if kind is StopKind.OFF:
        bench.act("nan", 0.0, 0.0)
        bench.run(4)
        bench.act("heard", 0.0, 0.0)
    else:
        bench.act("others", SIDE_M + 15.0, 30.0)
    bench.run(10)
    stop, here_m = bench.vehicle.gate.stops.in_force, place_of(bench.link.pose)
    assert stop is not None and not stop.is_persons and stop.kind is kind
    bench.act("others", 10.0 if goes == "inside" else SIDE_M + 15.0, 30.0)
    bench.run(60)
    assert all(bench.is_stopped_or_told(*it) for it in bench.wanted)
    assert math.dist(place_of(bench.link.pose), here_m) < 2.0


def test_a_stop_that_was_taken_and_is_sent_again_in_vain_is_told_and_so_is_its_end() -> None:
    """The vehicle had come to rest; another client sends it away, and no order of ours arrives any more."""
    bench = Watched(Generation.B)
    bench.stop(off=False)
    bench.run(8)
    assert bench.ticks[-1][3] is StopState.AT_REST
    bench.act("lost", 0.0, 0.0)
    bench.act("others", 50.0, 50.0)
    bench.run(4)
    assert bench.is_stopped_or_told(*bench.wanted[-1]) and bench.ticks[-1][3] is StopState.NOT_TAKEN
    bench.act("found", 0.0, 0.0)
    bench.run(15)
    assert bench.ticks[-1][3] is StopState.AT_REST


def test_when_a_pilot_puts_the_vehicle_down_no_hold_turns_its_thrusters_on() -> None:
    bench = Watched(Generation.B)
    bench.stop(off=False)
    bench.run(8)
    bench.act("pilot", 0.0, 0.0)
    bench.link.push(Steer(0.5, 1.0, 0.0))
    bench.run(10)
    bench.link.push(Coast())
    orders = bench.observer.orders
    bench.act("no pilot", 0.0, 0.0)
    bench.run(60)
    assert bench.observer.orders == orders
    assert "stop 1 (hold, by Anna)" in bench.vehicle.gate.awaits_person


def test_anothers_goal_that_the_vehicle_does_not_show_is_held_before_the_fence() -> None:
    bench = Bench(Generation.B)
    bench.link.shows_goals = False
    bench.hold(30.0, 30.0)
    bench.run(8)
    bench.link.others_go(SIDE_M + 15.0, SIDE_M / 2)
    bench.run(100)
    pose = bench.link.pose
    assert max(pose.north_m, pose.east_m) < SIDE_M and bench.link.is_at_rest


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_the_observer_sees_what_the_guards_are_there_for(generation: Generation) -> None:
    """With its guards taken out, the same vehicle is sent outside, blind."""
    bench = Bench(generation)
    bench.vehicle.gate._guards = ()
    bench.go(SIDE_M + 10, 5.0)
    assert len(bench.observer.outside) == 1
    bench.link.shift = lambda pose, at_ms: None
    bench.run(7)
    bench.go(10.0, 5.0)
    assert len(bench.observer.blind) == 1


def test_a_real_vehicle_whose_position_goes_silent_is_stopped_between_two_ticks(bench: Guarded) -> None:
    bench.command(GoTo(1, 5.0, 8.0, 0.5, 0.5))
    bench.at(5.0, 5.5)
    bench.wire.out = []
    limit_ms = bench.now_ms + REAL_LIMITS.age_ms
    looks = range(bench.now_ms, limit_ms + 400, 50)
    stopped_ms = 0
    for now_ms in looks:
        bench.vehicle.look_between(now_ms)
        if bench.wire.out and not stopped_ms:
            stopped_ms = now_ms
    assert [type(it) for it in bench.wire.out] == [Stop]
    assert limit_ms < stopped_ms <= limit_ms + 250


def test_facts_from_between_two_ticks_wait_for_the_next_and_of_positions_the_newest_counts(
    bench: Guarded,
) -> None:
    for number in (1, 2):
        now_ms = bench.now_ms + 250 * number
        bench.wire.facts += [
            PoseReported(now_ms, 5.0, 5.0 + number, 0.0, now_ms),
            CommandAccepted(now_ms, 10 + number),
        ]
        bench.vehicle.look_between(now_ms)
    facts = bench.silent(1)
    assert [it.command_id for it in facts if isinstance(it, CommandAccepted)] == [11, 12]
    assert [it.east_m for it in facts if isinstance(it, PoseReported)] == [7.0]


def test_a_simulated_vehicle_is_not_looked_at_between_two_ticks(simulated: Guarded) -> None:
    simulated.wire.facts.append(CommandAccepted(simulated.now_ms + 500, 11))
    simulated.vehicle.look_between(simulated.now_ms + 500)
    assert simulated.wire.facts

"""The gate at the end of every road: what reaches the vehicle, by an observer that shares no code with the guards."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import (
    Arrived,
    CommandAccepted,
    CommandFailed,
    GoTo,
    Hold,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.gate import Gate, GuardedVehicle, Safety
from apad_bridge.vehicle.guards.guards import GoodPosition, InWaters, PersonsWord, SoundNumbers
from apad_bridge.vehicle.guards.monitor import (
    CanStopInWaters,
    EndsInTime,
    IsInWaters,
    Monitor,
    PositionIsGood,
    Reaction,
    SpeedIsAllowed,
)
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.primitives import PrimitiveFailed
from apad_bridge.vehicle.stack_messages import PoseReceived
from benchmarks.safety import FAULTS, ROOT, Bench, _is_safe, truly
from benchmarks.safety_study.observer import SIDE_M
from tests.apad_bridge.vehicle.guards.test_guards import WATERS

LIMITS = PositionLimits(age_ms=5_000, jump_m=10.0, speed_m_s=2.0)


class Wire:
    """A link that keeps what goes out, and reports acceptance, and the positions that it is told to report."""

    def __init__(self) -> None:
        self.out: list[VehicleCommand] = []
        self.facts: list[LinkFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts, self.facts = self.facts, []
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self.out.append(command)
        if isinstance(command, GoTo | Hold):
            self.facts.append(CommandAccepted(now_ms, command.command_id))

    def close(self) -> None:
        pass


class Guarded:
    """A vehicle in the U of the guards' tests, which is wherever it is put."""

    def __init__(
        self, *, can_stop: bool = True, is_real: bool = False, outside: Reaction = Reaction.HOLD
    ) -> None:
        guards = [SoundNumbers(), PersonsWord(), GoodPosition(), InWaters(WATERS, outside is Reaction.RETURN)]
        checks = [
            PositionIsGood(),
            IsInWaters(WATERS, outside),
            CanStopInWaters(WATERS, 0.5),
            SpeedIsAllowed(2.0),
            EndsInTime(100.0),
        ]
        self.wire = Wire()
        safety = Safety(Gate(guards, PositionWatch(LIMITS)), Monitor(checks), WATERS, 0.5, is_real)
        self.vehicle = GuardedVehicle(self.wire, safety, can_stop=can_stop)
        self.now_ms = 0

    def at(self, north_m: float, east_m: float, *, after_ms: int = 1_000) -> list[LinkFact]:
        """The facts of a tick at which the vehicle is there."""
        self.now_ms += after_ms
        self.wire.facts.append(PoseReported(self.now_ms, north_m, east_m, 0.0, self.now_ms))
        return self.vehicle.advance(self.now_ms)

    def silent(self, ticks: int) -> list[LinkFact]:
        facts: list[LinkFact] = []
        for _ in range(ticks):
            self.now_ms += 1_000
            facts += self.vehicle.advance(self.now_ms)
        return facts

    def command(self, command: VehicleCommand) -> list[VehicleCommand]:
        """What goes out because of it."""
        self.wire.out = []
        self.vehicle.command(command, self.now_ms)
        return self.wire.out

    def events(self) -> list[tuple[str, str]]:
        return [
            (kind, str(data.get("cause", data.get("guard"))))
            for kind, data in self.vehicle.gate.take_events()
        ]


def test_a_refused_order_fails_with_its_reason_and_does_not_go_out() -> None:
    bench = Guarded()
    bench.at(5.0, 5.0)
    assert bench.command(GoTo(1, 45.0, 5.0, 0.5, 0.5)) == []
    (failed,) = (it for it in bench.at(5.0, 5.0) if isinstance(it, CommandFailed))
    assert (
        failed.command_id == 1
        and "refused: the goal (45.0 m north, 5.0 m east) lies 5.0 m outside" in failed.reason
    )
    assert bench.events() == [("refused", "fence")]


def test_a_refused_order_holds_a_vehicle_that_is_under_way() -> None:
    bench = Guarded()
    bench.at(5.0, 5.0)
    go = GoTo(1, 30.0, 5.0, 0.5, 0.5)
    assert bench.command(go) == [go]
    bench.at(5.5, 5.0)
    (hold,) = bench.command(GoTo(2, 45.0, 5.0, 0.5, 0.5))
    assert isinstance(hold, Hold) and (hold.north_m, hold.east_m) == (5.5, 5.0)
    assert bench.command(GoTo(3, 45.0, 5.0, 0.5, 0.5)) == []  # it holds already


@pytest.mark.parametrize("place", [(5.0, 5.0), (-3.0, 5.0), (0.5, 5.0)])
def test_a_stop_goes_out_wherever_the_vehicle_is(place: tuple[float, float]) -> None:
    bench = Guarded(is_real=True)
    bench.at(*place)
    bench.at(*place)
    assert bench.command(Hold(1, *place)) == [Hold(1, *place)]
    near = Hold(2, place[0] - 1.0, place[1])  # meant as a stop: it does not lead out, or farther out
    (sent,) = bench.command(near)
    assert sent in (near, Hold(2, *place))
    assert place[0] > 2.0 or sent == Hold(2, *place)


def test_on_a_bad_position_a_stop_switches_the_controllers_off_or_calls_a_pilot() -> None:
    able, unable = Guarded(can_stop=True), Guarded(can_stop=False)
    for bench in (able, unable):
        bench.at(5.0, 5.0)
        bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
        bench.wire.out = []
        facts = bench.silent(6)
        assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
        assert [data["calls_pilot"] for _, data in bench.vehicle.gate.events] == [bench is unable]
    assert able.wire.out == [Stop(-1)] and unable.wire.out == []
    assert able.command(Hold(2, 5.0, 5.0)) == [Stop(2)] and unable.command(Hold(2, 5.0, 5.0)) == []
    for bench in (able, unable):
        bench.wire.out = []
        bench.at(5.0, 5.0)
        (held,) = bench.wire.out  # the position is back
        assert isinstance(held, Hold) and (held.north_m, held.east_m) == (5.0, 5.0)


def test_outside_the_fence_it_holds_and_a_pilot_is_called_and_both_ends_are_told() -> None:
    bench = Guarded()
    bench.at(1.0, 5.0)
    bench.at(-1.0, 5.0)
    assert bench.events() == [("guard", "outside the fence")]
    assert bench.wire.out == [Hold(-1, -1.0, 5.0)]
    assert bench.command(GoTo(1, 5.0, 5.0, 0.5, 0.5)) == []
    bench.at(-1.0, 5.0)
    bench.at(1.0, 5.0)
    assert bench.events() == [("refused", "fence"), ("guard_over", "outside the fence")]


def test_where_the_scenario_wants_it_it_returns_to_the_nearest_place_inside() -> None:
    bench = Guarded(outside=Reaction.RETURN)
    bench.at(1.0, 5.0)
    bench.at(-1.0, 5.0)
    (back,) = bench.wire.out
    assert isinstance(back, GoTo) and (back.north_m, back.east_m) == pytest.approx((1.0, 5.0))


def test_a_real_vehicle_that_was_sent_back_inside_then_waits_for_a_person() -> None:
    bench = Guarded(is_real=True, outside=Reaction.RETURN)
    bench.at(1.0, 5.0)
    bench.at(-1.0, 5.0)
    (back,) = bench.wire.out
    # What the mission orders meanwhile neither ends the way back nor goes out.
    assert bench.command(GoTo(1, 5.0, 5.0, 0.5, 0.5)) == []
    assert [it.command_id for it in bench.at(-0.5, 5.0) if isinstance(it, CommandFailed)] == [1]
    assert isinstance(back, GoTo)
    bench.wire.facts.append(Arrived(bench.now_ms, back.command_id))
    bench.at(1.0, 5.0)
    assert bench.command(GoTo(2, 6.0, 5.0, 0.5, 0.5)) == []
    bench.vehicle.allow_motion()
    assert bench.command(GoTo(3, 6.0, 5.0, 0.5, 0.5)) == [GoTo(3, 6.0, 5.0, 0.5, 0.5)]


@pytest.mark.parametrize("ends", ["a stop", "a silence"])
def test_whatever_ends_the_way_back_a_person_is_awaited(ends: str) -> None:
    bench = Guarded(is_real=True, outside=Reaction.RETURN)
    bench.at(1.0, 5.0)
    bench.at(-1.0, 5.0)
    if ends == "a stop":
        assert bench.command(Hold(1, -1.0, 5.0)) == [Hold(1, -1.0, 5.0)]
    else:
        bench.silent(6)
    bench.at(-0.9, 5.0)
    assert "may continue" in bench.vehicle.gate.awaits_person


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@pytest.mark.parametrize("fault", ["NaN position", "silent position", "jumping position", "frozen position"])
def test_by_the_real_apad_s_limits_a_bad_position_ends_in_a_safe_state_within_3_s(
    generation: Generation, fault: str
) -> None:
    guards = load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml").guards
    assert guards is not None
    inflict = FAULTS[fault].inflict
    for seed in range(10):
        rng = random.Random(seed)
        bench = Bench(generation, guards=guards)
        bench.go(rng.uniform(40.0, 55.0), rng.uniform(40.0, 55.0))
        bench.run(rng.randint(4, 12))
        begun_ms = bench.now_ms
        inflict(bench, rng)
        while not _is_safe(bench, begun_ms):
            bench.run(1)
            assert bench.now_ms <= begun_ms + 3_000
        assert bench.vehicle.gate.awaits_person


def test_a_stop_that_was_lost_on_the_way_is_given_again_until_it_is_taken() -> None:
    bench = Guarded(is_real=True)
    bench.at(5.0, 5.0)
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    bench.silent(6)
    bench.wire.out = []
    bench.at(5.0, 5.0)  # the link is back
    for lost in range(3):
        (hold,) = bench.wire.out
        assert isinstance(hold, Hold)
        bench.wire.out = []
        bench.wire.facts.append(
            CommandFailed(bench.now_ms, hold.command_id, "no action server took the goal")
        )
        bench.at(5.0, 5.0 + lost)
    (hold,) = bench.wire.out
    bench.wire.out = []
    bench.wire.facts.append(Arrived(bench.now_ms, hold.command_id))
    bench.at(5.0, 8.0)
    assert bench.wire.out == []


def test_a_real_vehicle_that_had_to_be_stopped_waits_for_a_person() -> None:
    bench = Guarded(is_real=True)
    bench.at(1.0, 5.0)
    bench.at(-1.0, 5.0)
    bench.at(1.0, 5.0)
    bench.at(5.0, 5.0)
    assert bench.command(GoTo(1, 6.0, 5.0, 0.5, 0.5)) == []
    bench.vehicle.gate.awaits_person = ""
    assert bench.command(GoTo(2, 6.0, 5.0, 0.5, 0.5)) == [GoTo(2, 6.0, 5.0, 0.5, 0.5)]


@pytest.mark.parametrize(("north_m", "is_held"), [(2.2, False), (1.9, True)])
def test_it_is_held_before_it_would_come_to_rest_outside(north_m: float, is_held: bool) -> None:
    """At 1 m/s it makes a metre before the order acts, and another while it brakes with 0.5 m/s^2."""
    bench = Guarded()
    for way_m in (2.0, 1.0, 0.0):
        bench.at(north_m + way_m, 5.0)
    assert bench.events() == ([("guard", "fence ahead")] if is_held else [])


def test_a_vehicle_that_obeys_no_speed_is_held_when_it_is_too_fast() -> None:
    bench = Guarded()
    for east_m in (5.0, 7.5, 10.0):
        bench.at(5.0, east_m)
    assert ("guard", "speed") in bench.events()


def test_a_leg_that_lasts_too_long_is_ended() -> None:
    bench = Guarded()
    bench.at(5.0, 5.0)
    bench.command(GoTo(1, 5.0, 30.0, 0.5, 0.5))
    facts: list[LinkFact] = []
    for n in range(101):
        facts += bench.at(5.0, 5.0 + n / 100)
    assert [it.command_id for it in facts if isinstance(it, CommandFailed)] == [1]
    assert bench.events() == [("guard", "late")]


def frozen_at(bench: Bench) -> Callable[..., PoseReceived]:
    last = bench.link.pose
    return lambda pose, at_ms: PoseReceived(at_ms, last.north_m, last.east_m, last.heading_rad)


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


def test_a_go_to_that_is_refused_fails_its_primitive_with_the_reason() -> None:
    bench = Bench(Generation.B)
    bench.go(math.nextafter(SIDE_M, 0.0), 5.0)
    bench.run(1)
    (failed,) = (it for it in bench.outcomes if isinstance(it, PrimitiveFailed))
    assert "refused: the goal" in failed.reason and "the least is 2.0 m" in failed.reason
    assert len(bench.refusals()) == 1 and bench.observer.orders == 0

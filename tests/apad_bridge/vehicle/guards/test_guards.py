"""Each guard alone: what it refuses, what it lets pass, and that none refuses a stop."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.scenario.area.fence import Fence
from apad_bridge.vehicle.commands import (
    BatteryReported,
    CloseDock,
    DockClosed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PoseReported,
    Stop,
)
from apad_bridge.vehicle.guards.fenced_waters import FencedWaters
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.guarded_orders import (
    BodyInWater,
    GuardedOrder,
    Point,
    Surfacing,
    VehicleSituation,
)
from apad_bridge.vehicle.guards.guards import (
    BatteryForHome,
    ClearOfBodies,
    GoodPosition,
    Guard,
    InWaters,
    LegLimits,
    PersonsWord,
    RoomToDock,
    SoundNumbers,
)
from apad_bridge.vehicle.guards.monitor import CanStopInWaters, KeepsClearOfAPads, Stopping
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch

# A U, open to the north, of 40 x 40 m with a gap of 20 x 20 m; and a zone of 4 x 4 m in its southern bar.
U = (
    (0.0, 0.0),
    (40.0, 0.0),
    (40.0, 10.0),
    (20.0, 10.0),
    (20.0, 30.0),
    (40.0, 30.0),
    (40.0, 40.0),
    (0.0, 40.0),
)
ZONE = ((8.0, 18.0), (12.0, 18.0), (12.0, 22.0), (8.0, 22.0))
WATERS = FencedWaters(Fence(U, (ZONE,)), clearance_m=1.0)
AT = VehicleSituation((5.0, 5.0), battery_fraction=1.0)
AT_THE_DOCKS = (CloseDock(1, 0, 7), OpenDock(1, 0, 7), MoveArm(1, 0, True))


def going(north_m: float, east_m: float, speed_m_s: float = 0.5, radius_m: float = 0.5) -> GoTo:
    return GoTo(1, north_m, east_m, speed_m_s, radius_m)


def is_allowed(point: Point) -> bool:
    """By hand, and without a polygon: inside the U and outside the zone."""
    north, east = point
    in_square, in_gap = 0 <= north <= 40 and 0 <= east <= 40, north > 20 and 10 < east < 30
    return in_square and not in_gap and not (8 < north < 12 and 18 < east < 22)


@pytest.mark.parametrize(
    ("start", "goal", "why"),
    [
        ((5.0, 5.0), (5.0, 35.0), ""),
        ((5.0, 5.0), (30.0, 5.0), ""),
        ((30.0, 5.0), (30.0, 35.0), "crosses the fence at (30.0 m north, 10.0 m east)"),
        ((10.0, 5.0), (10.0, 35.0), "crosses a keep-out zone at (10.0 m north, 18.0 m east)"),
        ((5.0, 5.0), (10.0, 20.0), "lies in a keep-out zone"),
        ((5.0, 5.0), (45.0, 5.0), "5.0 m outside the fence"),
        ((5.0, 5.0), (0.5, 5.0), "0.5 m from the fence"),
        ((5.0, 5.0), (12.5, 36.0), "crosses a keep-out zone at (8.1 m north, 18.0 m east)"),
        ((5.0, 5.0), (7.9, 30.0), ""),
        ((7.5, 5.0), (7.5, 35.0), "passes 0.5 m from"),
        ((0.5, 5.0), (5.0, 5.0), ""),  # away from an edge that it is too near to
        ((0.5, 5.0), (0.4, 20.0), "0.4 m from the fence"),
        ((-1.0, 5.0), (5.0, 5.0), "begins where the aPad may not be"),
    ],
)
def test_the_whole_way_stays_in_the_waters(start: Point, goal: Point, why: str) -> None:
    refusal = InWaters(WATERS).refusal(going(*goal), replace(AT, place_m=start))
    assert (why in refusal) if why else refusal == ""


@given(st.tuples(*[st.floats(-10, 50)] * 4))
def test_no_point_of_a_way_that_passes_is_outside(ends: tuple[float, float, float, float]) -> None:
    start, goal = (ends[0], ends[1]), (ends[2], ends[3])
    if InWaters(WATERS).refusal(going(*goal), replace(AT, place_m=start)) == "":
        for n in range(101):
            way = [start[k] + n / 100 * (goal[k] - start[k]) for k in (0, 1)]
            assert is_allowed((way[0], way[1]))


OUTSIDE = replace(AT, place_m=(-3.0, 5.0))
VISUALLY_7 = RoomToDock(WATERS, 27 * 0.2 + 2.0 + 2.4, lambda agent_id: agent_id == 7)
WIDE = FencedWaters(Fence(((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)), ()), 1.0)
LEGS = LegLimits(length_m=20.0, speed_m_s=1.0, duration_s=30.0)
HOME = BatteryForHome((0.0, 0.0), 0.2, lambda begin, end, at_ms: 0.01 * math.dist(begin, end))
HALF = VehicleSituation((0.0, 10.0), battery_fraction=0.5)


def among(*bodies: BodyInWater) -> VehicleSituation:
    return VehicleSituation((0.0, 0.0), bodies=bodies)


WANTED, BESIDE = BodyInWater("a", (0.0, 20.0), 1), BodyInWater("d", (1.0, 0.0), 4)


@pytest.mark.parametrize(
    ("guard", "order", "situation", "why"),
    [
        # Nothing moves on a bad position or without the word of a person.
        *(
            (guard, order, replace(AT, **fault), *fault.values()) if fault else (guard, order, AT, "")
            for order in (going(1.0, 1.0), Hold(1, 1.0, 1.0), *AT_THE_DOCKS)
            for guard, fault in (
                (GoodPosition(), {"position_fault": "old"}),
                (GoodPosition(), {}),
                (PersonsWord(), {"awaits_person": "after a breach"}),
                (PersonsWord(), {}),
            )
        ),
        # From outside only the way straight back passes, and only where the scenario wants it.
        (InWaters(WATERS, returns=True), going(1.0, 5.0), OUTSIDE, ""),
        (InWaters(WATERS, returns=True), going(5.0, 5.0), OUTSIDE, "begins where the aPad may not be"),
        (InWaters(WATERS), going(1.0, 5.0), OUTSIDE, "begins where the aPad may not be"),
        # Docks, arms, and aMussels that are called up stay in the waters.
        *((InWaters(WATERS), order, OUTSIDE, "3.0 m outside") for order in AT_THE_DOCKS),
        *((InWaters(WATERS), order, AT, "") for order in AT_THE_DOCKS),
        (InWaters(WATERS), Surfacing(7, (30.0, 20.0)), AT, "aMussel 7 would surface where no aPad may go"),
        (InWaters(WATERS), Surfacing(7, (30.0, 5.0)), AT, ""),
        (InWaters(WATERS), Surfacing(7, None), AT, ""),
        # A visual docking needs room for drift, search and pulling back.
        (VISUALLY_7, CloseDock(1, 0, 7), AT, "5.0 m from the fence"),
        (VISUALLY_7, OpenDock(1, 0, 7), AT, "the least is 9.8 m"),
        (VISUALLY_7, CloseDock(1, 0, 8), AT, ""),
        (replace(VISUALLY_7, waters=WIDE), CloseDock(1, 0, 7), replace(AT, place_m=(20.0, 20.0)), ""),
        # A leg is neither too long nor too fast nor too slow.
        (LEGS, going(5.0, 20.0), AT, ""),
        (LEGS, going(5.0, 30.0), AT, "25.0 m long"),
        (LEGS, going(5.0, 20.0, speed_m_s=1.5), AT, "its speed is 1.5 m/s"),
        (LEGS, going(5.0, 20.0, speed_m_s=0.4), AT, "takes 38 s"),
        # The battery suffices for the leg and the way home: 10 m there and 20 m home are exactly half.
        (HOME, going(0.0, 20.0), HALF, ""),
        (HOME, going(0.0, 20.5), HALF, "holds 50.0 %, and the leg and the way home need 51.0 %"),
        (HOME, going(0.0, 5.0), replace(HALF, battery_fraction=0.01), ""),  # towards home
        (HOME, going(0.0, 20.0), replace(HALF, battery_fraction=None), "not known"),
        # A way keeps clear of bodies, except of the aMussel that it goes to, and may lead away from one.
        (ClearOfBodies(3.0), going(0.0, 20.0), among(WANTED), ""),
        (
            ClearOfBodies(3.0),
            going(0.0, 20.0),
            among(WANTED, BodyInWater("b", (2.0, 10.0), 2)),
            "passes b at 2.0 m",
        ),
        (
            ClearOfBodies(3.0),
            going(0.0, 20.0),
            among(WANTED, BodyInWater("c", (0.0, 21.0), None)),
            "passes c at 1.0 m",
        ),
        (ClearOfBodies(3.0), going(-10.0, 0.0), among(BESIDE), ""),
    ],
)
def test_each_guard_refuses_with_its_reason(
    guard: Guard, order: GuardedOrder, situation: VehicleSituation, why: str
) -> None:
    refusal = guard.refusal(order, situation)
    assert (why in refusal) if why else refusal == ""


@pytest.mark.parametrize(
    "order",
    [
        going(math.nan, 1.0),
        going(1.0, math.inf),
        going(60_000.0, 0.0),
        Hold(1, math.nan, 0.0),
        going(1.0, 1.0, speed_m_s=0.0),
        going(1.0, 1.0, speed_m_s=math.nan),
        going(1.0, 1.0, radius_m=-1.0),
    ],
)
def test_numbers_that_no_vehicle_should_get_are_refused(order: GuardedOrder) -> None:
    assert SoundNumbers().refusal(order, AT) != ""
    assert SoundNumbers().refusal(going(1.0, 1.0), AT) == ""


def test_the_nearest_place_inside_keeps_the_clearance() -> None:
    assert WATERS.nearest_inside((-4.0, 5.0)) == pytest.approx((1.0, 5.0))


def test_the_next_way_may_begin_at_the_aMussel_that_a_dock_has_just_taken() -> None:
    gate = Gate([ClearOfBodies(3.0)], PositionWatch(PositionLimits()))
    gate.observe([PoseReported(0, 0.03, 0.0, 0.0)])
    gate.see_bodies((BodyInWater("aMussel 7", (0.0, 0.0), 7), BodyInWater("aMussel 8", (-4.0, 0.0), 8)))
    away = going(-8.0, 0.0)
    assert "passes aMussel 7 at 0.0 m" in _reason(gate, away)
    gate.observe([DockClosed(0, 2, 7)])
    assert "passes aMussel 8 at 0.0 m" in _reason(gate, away)
    assert _reason(gate, going(8.0, 0.0)) == ""


def _reason(gate: Gate, order: GoTo) -> str:
    refusal = gate.refusal(order, 0)
    return "" if refusal is None else refusal.reason


ALL: list[Guard] = [
    SoundNumbers(),
    PersonsWord(),
    GoodPosition(),
    InWaters(WATERS),
    RoomToDock(WATERS, 50.0, lambda agent_id: True),
    LegLimits(0.1, 0.1, 0.1),
    ClearOfBodies(100.0),
    BatteryForHome((0.0, 0.0), 1.0, lambda begin, end, at_ms: 1.0),
]


@given(
    st.tuples(st.floats(-50, 90), st.floats(-50, 90)),
    st.sampled_from(["", "a person must look"]),
    st.sampled_from([None, 0.0, 1.0]),
)
def test_no_guard_refuses_a_stop_and_an_arm_that_closes_is_none(
    place_m: Point, awaits: str, battery: float | None
) -> None:
    """A hold where the vehicle is stops it inside the waters alone."""
    gate = Gate(ALL, PositionWatch(PositionLimits()), WATERS)
    gate.note_others(awaits)
    gate.see_bodies((BodyInWater("beside", place_m, None),))
    gate.observe(_pose_and_battery(place_m, battery))
    assert gate.refusal(Stop(1), 0) is None
    is_inside = WATERS.fault_of_place(place_m) == ""
    assert (gate.refusal(Hold(1, *place_m), 0) is None) is is_inside
    assert not awaits or gate.refusal(MoveArm(1, 2, False), 0) is not None


def test_a_hold_on_a_position_that_cannot_be_used_is_no_stop() -> None:
    gate = Gate(ALL, PositionWatch(PositionLimits(age_ms=1000)))
    gate.observe(_pose_and_battery((5.0, 5.0), 1.0))
    assert gate.refusal(Hold(1, 5.0, 5.0), 1000) is None
    late = gate.refusal(Hold(1, 5.0, 5.0), 1001)
    assert late is not None and late.guard == "position"
    assert gate.refusal(Stop(1), 1001) is None


def _pose_and_battery(place_m: Point, fraction: float | None) -> list[PoseReported | BatteryReported]:
    facts: list[PoseReported | BatteryReported] = [PoseReported(0, *place_m, 0.0)]
    return facts if fraction is None else [*facts, BatteryReported(0, 12.0, fraction)]


@pytest.mark.parametrize(
    ("place", "velocity", "is_held"),
    [
        ((0.0, 0.0), (1.0, 0.0), False),  # it comes to rest 2 m on, 3 m before the other
        ((0.5, 0.0), (1.0, 0.0), True),
        ((4.0, 0.0), (-1.0, 0.0), False),  # it leaves the other
        ((4.0, 0.0), (0.0, 0.0), False),
        ((0.0, 4.0), (1.0, 0.0), False),  # it passes beside
    ],
)
def test_a_vehicle_comes_to_rest_before_it_is_too_near_to_another_apad(
    place: Point, velocity: Point, is_held: bool
) -> None:
    """At 1 m/s it makes a metre before an order acts, and another while it brakes with 0.5 m/s^2."""
    check = KeepsClearOfAPads(3.0, Stopping(0.5))
    other = BodyInWater("apad2", (5.0, 0.0), agent_id=None)
    situation = VehicleSituation(place, velocity, bodies=(other,))
    assert bool(check.look(situation, None, 0)) is is_held
    assert not check.look(replace(situation, bodies=(replace(other, agent_id=7),)), None, 0)


STOPPING = Stopping(0.1, coasting_m=4.2, coasting_speed_m_s=0.6)
"""Generation B's simulated hull, as launch_scripts/scenarios/real-apad.yaml has it."""


def test_a_noisy_receiver_lets_no_healthy_vehicle_see_the_fence_ahead() -> None:
    """Ten hours at 0.5 m/s, 11.5 m from a fence and from another aPad, with white noise of 0.5 m on each axis."""
    waters = FencedWaters(Fence(((0.0, 0.0), (20_000.0, 0.0), (20_000.0, 23.0), (0.0, 23.0)), ()), 11.4)
    noise, watch = random.Random(11), PositionWatch(PositionLimits())
    ahead, others = CanStopInWaters(waters, STOPPING, 0.8), KeepsClearOfAPads(1.0, STOPPING, 0.8)
    for n in range(36_000):
        north_m = 1_000.0 + 0.5 * n
        watch.take(
            PoseReported(
                1_000 * n, north_m + noise.gauss(0.0, 0.5), 11.5 + noise.gauss(0.0, 0.5), 0.0, 1_000 * n
            )
        )
        situation = VehicleSituation(
            watch.place_m,
            watch.velocity_m_s,
            watch.least_speed_m_s,
            bodies=(BodyInWater("another aPad", (north_m, 0.0), None),),
        )
        assert not ahead.look(situation, None, 1_000 * n)
        assert not others.look(situation, None, 1_000 * n)


@pytest.mark.parametrize(
    ("away_m", "speed_m_s", "least_m_s", "is_seen"),
    [
        # At 0.8 m/s: 0.8 m in the tick, and 4.2 m x (0.8 / 0.6)^2 = 7.47 m of coasting, 8.27 m in all.
        (8.2, 0.8, 0.7, True),
        (8.4, 0.8, 0.7, False),
        # More is believed as far as it is sure: at 1.2 m/s 1.2 m and 16.8 m.
        (8.4, 1.5, 0.7, False),
        (17.9, 1.5, 1.2, True),
        (18.1, 1.5, 1.2, False),
        # What was sure some seconds ago is not faster than what is measured now: 0.4 m and 2.8 m.
        (3.1, 0.4, 1.2, True),
        (3.3, 0.4, 1.2, False),
    ],
)
def test_a_stop_s_way_ahead_is_that_of_the_allowed_speed_and_of_more_where_it_is_sure(
    away_m: float, speed_m_s: float, least_m_s: float, is_seen: bool
) -> None:
    waters = FencedWaters(Fence(((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)), ()), 1.0)
    situation = VehicleSituation((50.0, 100.0 - away_m), (0.0, speed_m_s), least_m_s)
    assert bool(CanStopInWaters(waters, STOPPING, 0.8).look(situation, None, 0)) is is_seen

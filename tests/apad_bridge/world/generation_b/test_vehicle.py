"""Our simulated aPad shows the behaviour that was read from generation B's published stack."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.generation_b.messages import DockingOrder, PrimitiveStatus
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_b import messages
from apad_bridge.world.generation_b.messages import (
    ArmPublished,
    CameraTurned,
    Finished,
    GoToBegun,
    GoToEnded,
    GoToLeft,
    Published,
    StatusPublished,
)
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle, Stage

POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m
DOCK = DockingOrder(True, 0, 0.3, 0.3, 0.2, 0.2)
UNDOCK = replace(DOCK, docks=False)


def vehicle(drift_m_s: tuple[float, float] = (0.0, 0.0), start_ms: int = 0) -> GenerationBVehicle:
    made = GenerationBVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)), start_ms)
    made.advance(start_ms)
    return made


def status_changes(published: list[Published], docking: bool = False) -> list[tuple[int, PrimitiveStatus]]:
    """Changes of a status, with their times."""
    told: list[tuple[int, PrimitiveStatus]] = []
    for it in published:
        if (
            isinstance(it, StatusPublished)
            and it.docking is docking
            and (not told or told[-1][1] is not it.status)
        ):
            told.append((it.at_ms, it.status))
    return told


@pytest.fixture
def apad() -> GenerationBVehicle:
    return vehicle()


def test_a_go_to_is_taken_at_once_and_its_end_told_by_topics(apad: GenerationBVehicle) -> None:
    published = apad.receive(GoTo(0, NORTH_M + 5, EAST_M, 0.5, 0.5), 0)
    assert status_changes(published) == [(0, PrimitiveStatus.RUNNING)]
    published = apad.advance(30_000)
    (_, running), (done_ms, done) = status_changes(published)
    assert (running, done) == (PrimitiveStatus.RUNNING, PrimitiveStatus.DONE)
    # 5 m at 0.5 m/s, half a metre early, half a second for the mean, and the start from rest.
    assert 9_000 < done_ms < 12_500
    assert [it.at_ms for it in published if isinstance(it, Finished)] == [done_ms]


def test_after_the_end_of_a_primitive_the_water_takes_the_boat() -> None:
    apad = vehicle(drift_m_s=(0.1, -0.2))
    apad.receive(GoTo(0, NORTH_M + 1, EAST_M, 0.5, 0.5), 0)
    assert status_changes(apad.advance(30_000))[-1][0] < 20_000
    before = apad.pose
    apad.advance(40_000)
    assert apad.stage is Stage.OFF
    moved_m = (apad.pose.north_m - before.north_m, apad.pose.east_m - before.east_m)
    assert moved_m == pytest.approx((1.0, -2.0), abs=0.05)  # a little of its own way is left


def test_dynamic_positioning_holds_against_the_water_and_never_ends() -> None:
    apad = vehicle(drift_m_s=(0.1, -0.2))
    apad.receive(Hold(0, NORTH_M, EAST_M + 1, 1.0), 0)
    published = apad.advance(600_000)
    assert (apad.pose.north_m, apad.pose.east_m, apad.pose.heading_rad) == pytest.approx(
        (NORTH_M, EAST_M + 1, 1.0)
    )
    assert not [it for it in published if isinstance(it, Finished)]


@pytest.mark.parametrize(("speed_m_s", "radius_m"), [(0.0, 0.5), (0.5, 0.0), (0.5, -1.0)])
def test_without_a_speed_or_a_radius_a_go_to_aborts(
    apad: GenerationBVehicle, speed_m_s: float, radius_m: float
) -> None:
    published = apad.receive(GoTo(0, NORTH_M + 5, EAST_M, speed_m_s, radius_m), 0)
    assert status_changes(published) == [(0, PrimitiveStatus.RUNNING), (0, PrimitiveStatus.IDLE)]
    apad.advance(10_000)
    assert apad.pose.north_m == NORTH_M


def test_a_new_order_pre_empts(apad: GenerationBVehicle) -> None:
    apad.receive(GoTo(0, NORTH_M + 5, EAST_M, 0.5, 0.5), 0)
    published = apad.receive(Hold(0, NORTH_M, EAST_M), 2_000)
    assert status_changes(published)[-1] == (2_000, PrimitiveStatus.PREEMPTED)


def test_docking_stands_still_for_27_s_and_then_searches_for_ever(apad: GenerationBVehicle) -> None:
    published = apad.receive(replace(DOCK, dock_index=2), 0)
    assert CameraTurned(0, 0.75) in published
    assert [it.arm.is_open for it in published if isinstance(it, ArmPublished)] == [
        (False, False, True, False)
    ]
    apad.advance(27_000)
    assert apad.pose.heading_rad == 0.0
    apad.advance(37_000)
    assert apad.pose.heading_rad == pytest.approx(3.0)  # 0.3 rad/s for 10 s
    published = apad.advance(1_000_000)
    assert status_changes(published, docking=True) == [(38_000, PrimitiveStatus.RUNNING)]


def test_docking_follows_its_law_and_ends_when_the_target_is_low_in_the_image(
    apad: GenerationBVehicle,
) -> None:
    """Yaw rate max * tanh(h), surge max * exp(-h^2 / (2 * 0.2^2)) towards the dock: here dock 1, to starboard."""
    apad.receive(replace(DOCK, dock_index=1), 0)
    for at_ms in range(26_950, 37_000, 100):
        apad.detect(0.1, 0.5, at_ms)
    apad.advance(37_000)
    yaw_rate, surge = 0.3 * math.tanh(0.1), 0.2 * math.exp(-0.125)
    assert apad.pose.heading_rad == pytest.approx(10 * yaw_rate, abs=0.1 * yaw_rate * 2)
    assert apad.pose.speed_m_s == pytest.approx(surge, rel=0.02)
    bearing_rad = math.atan2(apad.pose.east_m_s, apad.pose.north_m_s)
    assert bearing_rad == pytest.approx(apad.pose.heading_rad + math.pi / 2, abs=0.05)
    apad.detect(0.0, 0.8, 37_000)
    assert apad.stage is Stage.SERVOING  # (0.8, 0.9) is open
    apad.detect(0.0, 0.85, 37_000)
    published = apad.advance(37_100)
    assert status_changes(published, docking=True)[-1][1] is PrimitiveStatus.DONE
    assert [it.arm.is_open for it in published if isinstance(it, ArmPublished)] == [(False,) * 4]


def test_a_detection_older_than_a_second_is_none(apad: GenerationBVehicle) -> None:
    apad.receive(DOCK, 0)
    apad.detect(0.0, 0.5, 26_950)
    apad.advance(27_950)
    assert apad.pose.heading_rad == pytest.approx(0.0, abs=1e-9)
    apad.advance(30_000)
    assert apad.pose.heading_rad > 0.3


def test_undocking_pulls_back_for_8_s(apad: GenerationBVehicle) -> None:
    apad.receive(UNDOCK, 0)
    published = apad.advance(35_000)
    assert status_changes(published, docking=True)[-1] == (35_000, PrimitiveStatus.DONE)
    arms = [(it.at_ms, it.arm.is_open[0]) for it in published if isinstance(it, ArmPublished)]
    assert arms == [(27_000, True), (35_000, False)]
    # 0.3 m/s for 8 s, less the start from rest.
    assert -2.4 < apad.pose.north_m - NORTH_M < -2.1


def test_a_pilot_pre_empts_and_nothing_is_begun_meanwhile(apad: GenerationBVehicle) -> None:
    apad.receive(GoTo(0, NORTH_M + 5, EAST_M, 0.5, 0.5), 0)
    assert status_changes(apad.set_manual(True, 1_000))[-1][1] is PrimitiveStatus.PREEMPTED
    assert (
        status_changes(apad.receive(GoTo(0, NORTH_M, EAST_M, 0.5, 0.5), 2_000))[-1][1]
        is PrimitiveStatus.PREEMPTED
    )
    apad.set_manual(False, 3_000)
    assert (
        status_changes(apad.receive(GoTo(0, NORTH_M, EAST_M, 0.5, 0.5), 3_000))[-1][1]
        is PrimitiveStatus.RUNNING
    )


def test_stop_mission_ends_what_is_under_way(apad: GenerationBVehicle) -> None:
    apad.receive(DOCK, 0)
    assert status_changes(apad.stop(5_000), docking=True)[-1] == (5_000, PrimitiveStatus.PREEMPTED)
    assert apad.stage is Stage.OFF


def test_a_paused_mission_goes_on_where_it_was(apad: GenerationBVehicle) -> None:
    apad.receive(GoTo(0, NORTH_M + 9, EAST_M, 0.5, 0.5), 0)
    assert status_changes(apad.pause(4_000))[-1][1] is PrimitiveStatus.PREEMPTED
    apad.advance(60_000)
    assert apad.pose.north_m < NORTH_M + 6  # coasting only
    assert status_changes(apad.go_on(60_000))[-1][1] is PrimitiveStatus.RUNNING
    assert status_changes(apad.advance(90_000))[-1][1] is PrimitiveStatus.DONE
    apad.go_on(91_000)  # nothing is paused any more
    assert apad.stage is Stage.OFF


def test_charging_what_the_bench_says_it_holds_costs_energy() -> None:
    """10 W a dock for an hour, from a battery of 230 Wh."""
    empty, laden = vehicle(), vehicle()
    for dock_index in (0, 1, 1):
        laden.load(dock_index, True, 0)
    assert empty.advance(3_600_000) and laden.advance(3_600_000)
    assert empty.battery_percent - laden.battery_percent == pytest.approx(100 * 20 / 230)
    before = laden.battery_percent
    for dock_index in (0, 1, 3):
        laden.load(dock_index, False, 3_600_000)
    laden.advance(7_200_000)
    assert before - laden.battery_percent == pytest.approx(100 * POOL.apad.battery.hotel_w / 230)


def test_what_lies_below_the_services_tells_of_each_go_to_ten_times_a_second(
    apad: GenerationBVehicle,
) -> None:
    order = GoTo(0, NORTH_M, EAST_M - 4, 0.5, 0.5)
    assert apad.receive(order, 50)[0] == GoToBegun(50, order)
    published = apad.advance(30_000)
    (ended,) = [it for it in published if isinstance(it, GoToEnded)]
    assert ended.status is PrimitiveStatus.DONE and ended.pose.east_m == pytest.approx(EAST_M - 4, abs=0.5)
    # West, and the rest of the way agrees with its own place.
    assert ended.left.bearing_rad == pytest.approx(-math.pi / 2)
    assert ended.left.distance_m == pytest.approx(ended.pose.east_m - (EAST_M - 4))
    told_ms = [it.at_ms for it in published if isinstance(it, GoToLeft)]
    assert told_ms == list(range(100, ended.left.at_ms, 100))


@pytest.mark.parametrize(
    ("fault", "ends"),
    [
        (Fault.LIES, [PrimitiveStatus.DONE]),
        (Fault.DROPS, [PrimitiveStatus.PREEMPTED]),
        (Fault.STUCK, []),
        (Fault.SILENT, []),
    ],
)
def test_a_fault_shows_below_the_services_as_it_does_on_the_topics(
    fault: Fault, ends: list[PrimitiveStatus]
) -> None:
    apad = GenerationBVehicle(SimulatedAPad(POOL.apad), 0, fault)
    published = apad.receive(GoTo(0, NORTH_M + 2, EAST_M, 0.5, 0.5), 0) + apad.advance(20_000)
    assert [it.status for it in published if isinstance(it, GoToEnded)] == ends
    assert any(isinstance(it, GoToBegun) for it in published) is (fault is not Fault.SILENT)


def test_requests_are_met_by_their_fields() -> None:
    point = SimpleNamespace(x=3.0, y=-4.0)
    assert messages.simple_go_to(SimpleNamespace(point=point, speed=0.4)) == GoTo(0, 3.0, -4.0, 0.4, 1.5)
    simple = messages.simple_docking(SimpleNamespace(action=False, slot=2))
    assert (simple.docks, simple.dock_index) == (False, 2) and simple.search_yaw_rate_rad_s > 0
    goal = SimpleNamespace(T2=SimpleNamespace(point=point), speed=0.4, victory_radius=0.7)
    assert messages.goal(goal) == GoTo(0, 3.0, -4.0, 0.4, 0.7)
    hold = SimpleNamespace(north=1.0, east=2.0, heading=0.5, heading_enable=False)
    assert messages.position(hold) == Hold(0, 1.0, 2.0, None)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 9_000), min_size=1, max_size=12))
def test_however_time_is_cut_the_same_is_shown(cuts: list[int]) -> None:
    def flown(instants: list[int]) -> tuple[list[Published], tuple[float, float]]:
        apad = vehicle(drift_m_s=(0.05, 0.02))
        published = apad.receive(GoTo(0, NORTH_M + 2, EAST_M + 1, 0.5, 0.5), 0)
        for at_ms in instants:
            published += apad.advance(at_ms)
        published += apad.receive(UNDOCK, 9_000) + apad.advance(50_000)
        return published, (apad.pose.north_m, apad.pose.east_m)

    assert flown(sorted(cuts)) == flown([])


def test_a_dock_that_it_has_not_is_ordered_in_vain() -> None:
    apad = GenerationBVehicle(SimulatedAPad(replace(POOL.apad, docks=2)), 0)
    apad.receive(DockingOrder(True, 2, 0.2, 0.3, 0.15, 0.2), 0)
    assert apad.dropped == {"docking: no such dock": 1} and apad.stage is Stage.OFF
    apad.receive(DockingOrder(True, 1, 0.2, 0.3, 0.15, 0.2), 0)
    assert apad.stage is Stage.SERVO

"""Our simulated aPad shows the behaviour that was observed of generation A's published stack."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.generation_a.messages import GO_TO, PERCH, RELEASE, GoalOrder
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a.messages import (
    BatteryAndProgressPublished,
    GoalEnded,
    GoalOutcome,
    HeldPositionPublished,
    Published,
)
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.simulated_stack import PosePublished

POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m


def vehicle(start_ms: int = 0, fault: Fault = Fault.NONE) -> GenerationAVehicle:
    made = GenerationAVehicle(SimulatedAPad(POOL.apad), 0.5, 0.5, start_ms, fault)
    made.advance(start_ms)
    return made


def go_to(key: str, north_m: float, east_m: float = EAST_M) -> GoalOrder:
    return GoalOrder(key, GO_TO, north_m, east_m, "")


def perch(name: str) -> GoalOrder:
    return GoalOrder(f"perch {name}", PERCH, 0.0, 0.0, name)


def release(name: str) -> GoalOrder:
    return GoalOrder(f"release {name}", RELEASE, 0.0, 0.0, name)


def ends(published: list[Published]) -> list[tuple[str, GoalOutcome]]:
    return [(it.key, it.outcome) for it in published if isinstance(it, GoalEnded)]


def held(published: list[Published]) -> list[HeldPositionPublished]:
    return [it for it in published if isinstance(it, HeldPositionPublished)]


@pytest.fixture
def apad() -> GenerationAVehicle:
    return vehicle()


def test_a_go_to_succeeds_once_the_mean_distance_of_a_second_is_below_the_radius(
    apad: GenerationAVehicle,
) -> None:
    apad.receive(go_to("there", NORTH_M + 5), 0)
    published = apad.advance(30_000)
    (ended,) = [it for it in published if isinstance(it, GoalEnded)]
    assert (ended.key, ended.outcome) == ("there", GoalOutcome.SUCCEEDED)
    # 5 m at 0.5 m/s, half a metre early, half a second for the mean, and the start from rest.
    assert 9_000 < ended.at_ms < 12_500


def test_feedback_is_the_percentage_covered_and_negative_farther_away(apad: GenerationAVehicle) -> None:
    apad.receive(go_to("east", NORTH_M, EAST_M + 6), 0)
    apad.advance(5_000)
    apad.receive(go_to("back", NORTH_M, EAST_M), 5_000)
    slow = [
        it
        for it in apad.advance(30_000)
        if isinstance(it, BatteryAndProgressPublished) and it.goal_key == "back"
    ]
    assert slow[0].covered_percent < 0  # it cannot turn on the spot
    assert slow[-1].covered_percent > 60


def test_a_cancelled_go_to_is_pre_empted_and_keeps_moving(apad: GenerationAVehicle) -> None:
    apad.receive(go_to("there", NORTH_M + 5), 0)
    assert ends(apad.cancel("there", 2_000)) == [("there", GoalOutcome.PREEMPTED)]
    assert ends(apad.advance(30_000)) == [] and apad.pose.north_m == pytest.approx(NORTH_M + 5)


def under_way(drift_m_s: tuple[float, float] = (0.0, 0.0)) -> GenerationAVehicle:
    """Ten seconds into a long go-to to the north, at 0.5 m/s."""
    apad = GenerationAVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)), 0.5, 0.5)
    apad.receive(go_to("far", NORTH_M + 1_000), 0)
    apad.advance(10_000)
    assert apad.pose.north_m_s == pytest.approx(0.5)
    return apad


@pytest.mark.parametrize("way", ["velocity", "position", "axes"])
def test_controllers_off_let_it_coast_by_its_drag_and_then_drift_with_the_water(way: str) -> None:
    """Quadratic drag from v to w takes m/k ln(v/w) metres; below 0.02 m/s the vehicle counts as at rest."""
    apad = under_way(drift_m_s=(0.03, -0.1))
    off = {
        "velocity": lambda: apad.enable_velocity_control(False, 10_000),
        "position": lambda: apad.enable_position_control(False, 10_000),
        "axes": lambda: apad.configure_axes([0, -1, 0, 0, 0, 0], 10_000),
    }
    begin = apad.pose
    assert ends(off[way]()) == [] and not apad.has_thrust
    apad.advance(310_000)
    coasted_m = POOL.apad.mass_kg / POOL.apad.drag_n_per_m2_s2 * math.log(0.5 / 0.02)
    assert apad.pose.north_m - begin.north_m == pytest.approx(coasted_m + 300 * 0.03, rel=0.05)
    assert apad.pose.east_m - begin.east_m == pytest.approx(-300 * 0.1, abs=1e-6)
    assert apad.pose.speed_m_s == 0.0


def test_a_goal_without_controllers_stays_active_and_the_next_go_to_turns_both_on() -> None:
    apad = under_way()
    apad.enable_velocity_control(False, 10_000)
    apad.enable_position_control(False, 10_000)
    assert ends(apad.advance(100_000)) == []
    here_m = apad.pose.north_m
    apad.enable_velocity_control(True, 100_000)  # by its source this sets no axis
    apad.advance(130_000)
    assert apad.pose.north_m == pytest.approx(here_m)
    published = apad.receive(go_to("next", here_m + 5), 130_000) + apad.advance(160_000)
    assert apad.has_thrust
    assert ends(published) == [("far", GoalOutcome.PREEMPTED), ("next", GoalOutcome.SUCCEEDED)]


def test_controllers_that_come_on_again_steer_to_the_old_reference_though_its_goal_is_cancelled() -> None:
    apad = under_way()
    apad.cancel("far", 10_000)
    apad.enable_velocity_control(False, 10_000)
    apad.advance(60_000)
    here_m = apad.pose.north_m
    apad.configure_axes([2, 2, 0, 0, 0, 0], 60_000)
    assert ends(apad.advance(80_000)) == [] and apad.pose.north_m > here_m + 5


def test_a_perch_asks_for_no_nearness_and_takes_the_first_free_dock(apad: GenerationAVehicle) -> None:
    offsets = [(-0.1, -0.1), (-0.1, 0.1), (0.1, -0.1), (0.1, 0.1)]
    for number, (north_m, east_m) in enumerate(offsets):
        published = apad.receive(perch(f"amussel{number}"), 0)
        (message,) = held(published)
        assert (message.name, message.at_ms) == (f"amussel{number}", 0)
        assert (message.north_m, message.east_m) == pytest.approx((NORTH_M + north_m, EAST_M + east_m))
        assert ends(published) == [(f"perch amussel{number}", GoalOutcome.SUCCEEDED)]
    apad.receive(release("amussel1"), 0)
    apad.receive(perch("amussel9"), 0)
    assert apad.held == ["amussel0", "amussel9", "amussel2", "amussel3"]


def test_the_same_object_perched_twice_takes_two_docks(apad: GenerationAVehicle) -> None:
    apad.receive(perch("amussel1"), 0)
    apad.receive(perch("amussel1"), 0)
    assert apad.free_docks == [2, 3]


def test_what_is_held_is_told_at_20_hz_and_follows_the_vehicle(apad: GenerationAVehicle) -> None:
    apad.receive(perch("amussel1"), 0)
    apad.receive(go_to("there", NORTH_M + 5), 0)
    told = held(apad.advance(30_000))
    assert [it.at_ms for it in told] == list(range(50, 30_050, 50))
    assert (told[-1].north_m, told[-1].east_m) == pytest.approx((NORTH_M + 4.9, EAST_M - 0.1))


def test_a_release_has_a_last_message_and_a_result(apad: GenerationAVehicle) -> None:
    apad.receive(perch("amussel1"), 0)
    published = apad.receive(release("amussel1"), 1_020)
    assert (held(published)[-1].at_ms, held(published)[-1].released) == (1_020, True)
    assert ends(published) == [("release amussel1", GoalOutcome.SUCCEEDED)]
    assert held(apad.advance(3_000)) == []


@pytest.mark.parametrize("name", ["", "amussel2"])
def test_a_release_of_what_is_not_held_is_aborted(apad: GenerationAVehicle, name: str) -> None:
    apad.receive(perch("amussel1"), 0)
    assert ends(apad.receive(release(name), 0)) == [(f"release {name}", GoalOutcome.ABORTED)]
    assert apad.held == ["amussel1"]


def test_a_silent_release_lets_go_without_a_message() -> None:
    apad = vehicle(fault=Fault.RELEASE_SILENT)
    apad.receive(perch("amussel1"), 0)
    assert apad.receive(release("amussel1"), 0) == [] and held(apad.advance(3_000)) == []
    assert ends(apad.receive(perch("amussel2"), 3_000)) == [("perch amussel2", GoalOutcome.SUCCEEDED)]


def test_a_crash_in_release_silences_all_that_is_held_but_not_the_position() -> None:
    apad = vehicle(fault=Fault.RELEASE_CRASHES)
    for number in (1, 2):
        apad.receive(perch(f"amussel{number}"), 0)
    apad.receive(release("amussel1"), 0)
    published = apad.advance(2_000)
    assert held(published) == [] and ends(published) == []
    assert [it.at_ms for it in published if isinstance(it, PosePublished)] == list(range(100, 2_100, 100))
    assert ends(apad.receive(go_to("there", NORTH_M), 2_000)) == []
    assert apad.dropped.total() == 1


def test_a_goal_of_an_unknown_kind_is_active_until_pre_empted(apad: GenerationAVehicle) -> None:
    apad.receive(GoalOrder("what", 7, 0.0, 0.0, ""), 0)
    assert ends(apad.advance(60_000)) == []
    assert ends(apad.receive(go_to("there", NORTH_M), 60_000)) == [("what", GoalOutcome.PREEMPTED)]


def test_a_person_may_open_a_dock_but_not_close_one(apad: GenerationAVehicle) -> None:
    apad.receive(perch("amussel1"), 0)
    with pytest.raises(ValueError, match="a dock closes by a perch"):
        apad.set_dock(1, True, 0)
    with pytest.raises(ValueError, match="dock 1 is open"):
        apad.set_dock(1, False, 0)
    assert [it.released for it in held(apad.set_dock(0, False, 0))] == [True]
    assert apad.free_docks == [0, 1, 2, 3]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 20_000), max_size=12))
def test_how_time_is_cut_never_shows(cuts: list[int]) -> None:
    orders = {0: perch("amussel1"), 1_730: go_to("there", NORTH_M + 3), 9_000: release("amussel1")}

    def flown(instants: set[int]) -> list[Published]:
        apad, published = vehicle(), []
        for at_ms in sorted(instants | set(orders)):
            published += apad.receive(orders[at_ms], at_ms) if at_ms in orders else apad.advance(at_ms)
        return published + apad.advance(20_000)

    assert flown(set(cuts)) == flown(set())


def test_its_battery_can_be_charged_and_drained_by_percent_points(apad: GenerationAVehicle) -> None:
    apad.change_battery(-30.0, 0)
    assert apad.battery_percent == pytest.approx(70.0)
    apad.change_battery(10.0, 0)
    assert apad.battery_percent == pytest.approx(80.0)
    apad.change_battery(50.0, 0)
    assert apad.battery_percent == 100.0
    apad.change_battery(float("nan"), 0)
    assert apad.battery_percent == 100.0 and apad.dropped.total() == 1


@pytest.mark.parametrize("docks", [1, 4, 6])
def test_it_holds_as_many_as_it_has_docks_and_one_more_perch_succeeds_and_does_nothing(docks: int) -> None:
    apad = GenerationAVehicle(SimulatedAPad(replace(POOL.apad, docks=docks)), 0.5, 0.5)
    for number in range(docks + 1):
        ended = apad.receive(GoalOrder(f"{number}", PERCH, 0.0, 0.0, f"amussel{number}"), 0)
        assert GoalEnded(0, f"{number}", GoalOutcome.SUCCEEDED) in ended
    assert apad.held == [f"amussel{number}" for number in range(docks)] and apad.free_docks == []
    assert {it.name for it in held([*ended, *apad.advance(2_000)])} == set(apad.held)
    with pytest.raises(ValueError, match=f"there is no dock {docks}"):
        apad.set_dock(docks, False, 0)

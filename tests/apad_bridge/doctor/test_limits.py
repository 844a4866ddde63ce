"""Each limit of a scenario, held against the vehicle before it moves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.doctor.finding import Finding
from apad_bridge.doctor.limits import (
    check_clearance,
    check_fence,
    check_limits,
    check_reaction,
    check_reserve,
)
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.guard_options import GuardOptions

FENCE = Fence(
    ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)), (((18.0, 18.0), (22.0, 18.0), (22.0, 22.0)),)
)


def status(finding: Finding) -> str:
    return finding.status.value


@pytest.mark.parametrize(
    ("place_m", "wanted", "told"),
    [
        ((10.0, 10.0), "OK", "10.0 m from its edge"),
        ((1.0, 10.0), "FAIL", "1.0 m from its edge"),
        ((-5.0, 10.0), "FAIL", "5.0 m outside"),
        ((21.0, 19.0), "FAIL", "outside"),  # in the zone to keep out of
        (None, "FAIL", "without a position"),
    ],
)
def test_the_apad_has_to_lie_inside_its_fence(
    place_m: tuple[float, float] | None, wanted: str, told: str
) -> None:
    (found,) = check_fence(place_m, FENCE, 2.0, [])
    assert status(found) == wanted and told in found.found


def test_amussels_outside_are_told_and_no_fence_is_red() -> None:
    _, starts = check_fence((10.0, 10.0), FENCE, 2.0, [(5.0, 5.0), (1.0, 5.0), (50.0, 5.0)])
    assert status(starts) == "WARN" and starts.found.startswith("2 aMussels")
    assert status(check_fence((10.0, 10.0), None, 2.0, [])[0]) == "FAIL"


def test_limits_that_notice_a_bad_position_too_late_are_told() -> None:
    slow = check_reaction(GuardOptions(position_age_s=5.0, frozen_s=10.0))
    assert status(slow) == "WARN" and "position_age_s is 5 s, guards.frozen_s is 10 s" in slow.found
    assert status(check_reaction(GuardOptions())) == "OK"
    assert status(check_reaction(GuardOptions(position_age_s=60.0))) == "FAIL"
    jumps = check_reaction(GuardOptions(jump_m=500.0))
    assert status(jumps) == "FAIL" and "guards.jump_m is 500 m" in jumps.found


@pytest.mark.parametrize(("reserve", "wanted"), [(None, "FAIL"), (0.0, "FAIL"), (0.2, "OK")])
def test_a_reserve_that_keeps_nothing_is_red(reserve: float | None, wanted: str) -> None:
    assert status(check_reserve(GuardOptions(battery_reserve=reserve))) == wanted


MEASURED = GuardOptions(
    clearance_m=8.0, position_error_m=0.5, hull_m=0.7, coasting_m=4.2, coasting_speed_m_s=0.6
)


def test_the_clearance_has_room_for_a_stop_and_the_greatest_speed_is_told() -> None:
    """0.5 + 0.35 + (v + 0.2) x 3 + 11.67 v^2; 8 m allow the root of 11.67 v^2 + 3 v = 6.55, 0.63 m/s."""
    fits = check_clearance(MEASURED, 0.6, "mission.speed_m_s")
    assert status(fits) == "OK" and "needs 7.5 m" in fits.found and "at most 0.63 m/s fit" in fits.found
    short = check_clearance(replace(MEASURED, clearance_m=2.0), 0.5, "mission.speed_m_s")
    assert status(short) == "FAIL" and "no speed fits" in short.found and "to 7.2" in str(short.mend)
    unknown = check_clearance(replace(MEASURED, coasting_m=None), 0.5, "mission.speed_m_s")
    assert status(unknown) == "CANNOT TELL" and "guards.coasting_m" in unknown.found


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, None),
        ({"coasting_m": 0.6}, None),
        ({"coasting_m": 0.59}, "even apad.max_acceleration_m_s2 takes 0.60 m"),
        ({"coasting_m": 0.0}, "guards.coasting_m is 0 m"),
        ({"speed_limit_m_s": 1.0}, None),
        ({"speed_limit_m_s": 8.0}, "guards.speed_limit_m_s is 8 m/s, and the aPad makes 1"),
        ({"leg_s": 1200.0}, None),
        ({"leg_s": 300_000.0}, "the longest way, 60 m, takes 120 s at 0.5 m/s"),
        ({"leg_s": 1300.0, "leg_m": None}, "the longest way, 64 m, takes 128 s"),
        ({"reaction_s": 0.5}, "guards.reaction_s is 0.5 s"),
    ],
)
def test_a_limit_that_can_never_act_or_that_no_vehicle_keeps_is_red(
    given: dict[str, float | None], told: str | None
) -> None:
    """0.6 m/s are lost on 0.6 m at 0.3 m/s2; a fence of 50 m by 40 m is 64 m across."""
    fence = Fence(((0.0, 0.0), (50.0, 0.0), (50.0, 40.0), (0.0, 40.0)), ())
    guards = replace(MEASURED, **{"leg_m": 60.0, "leg_s": 300.0, "speed_limit_m_s": 0.8, **given})  # type: ignore[arg-type]
    (found,) = check_limits(
        guards,
        greatest_m_s=1.0,
        deceleration_m_s2=0.3,
        longest_m=fence.longest_m,
        speed_m_s=0.5,
    )
    assert status(found) == ("OK" if told is None else "FAIL")
    assert (told or "") in found.found


def test_each_limit_that_is_wrong_has_a_line() -> None:
    wrong = replace(MEASURED, coasting_m=0.0, speed_limit_m_s=8.0, leg_s=300_000.0)
    found = check_limits(wrong, greatest_m_s=1.0, deceleration_m_s2=0.3, longest_m=60.0, speed_m_s=0.5)
    assert [status(it) for it in found] == ["FAIL"] * 3

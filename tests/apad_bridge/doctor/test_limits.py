"""Each limit of a scenario, held against the vehicle before it moves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.doctor.limits import (
    check_limits,
)
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.blocks.guard_options import GuardOptions

MEASURED = GuardOptions(
    clearance_m=8.0, position_error_m=0.5, hull_m=0.7, coasting_m=4.2, coasting_speed_m_s=0.6
)


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
    assert found.status.value == ("OK" if told is None else "FAIL")
    assert (told or "") in found.found


def test_each_limit_that_is_wrong_has_a_line() -> None:
    wrong = replace(MEASURED, coasting_m=0.0, speed_limit_m_s=8.0, leg_s=300_000.0)
    found = check_limits(wrong, greatest_m_s=1.0, deceleration_m_s2=0.3, longest_m=60.0, speed_m_s=0.5)
    assert [it.status.value for it in found] == ["FAIL"] * 3

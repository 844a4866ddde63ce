"""Each check of a preflight by made measurements: what is green, and each cause of red with its mend."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from apad_bridge.doctor.finding import Finding, Status, fail, ok, warn
from apad_bridge.doctor.preflight import (
    EnergyNeed,
    PositionSample,
    at_sea,
    check_delay,
    check_energy,
    check_fence,
    check_gps,
    check_lookout,
    check_loss,
    check_pilot,
    check_position,
    check_reaction,
    check_stop,
    check_watchdog,
    red_keys,
)
from apad_bridge.scenario.fence import Fence
from apad_bridge.scenario.guard_options import GuardOptions

APAD = "/apad1"
FENCE = Fence(
    ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)), (((18.0, 18.0), (22.0, 18.0), (22.0, 22.0)),)
)
STEADY = [PositionSample(n / 10, 100 + n, 10.0 + n % 2 / 100, 5.0, 3, 0.04, 0.04) for n in range(30)]
"""Three seconds at 10 Hz, at rest, by a GPS that says how good it is."""


def status(finding: Finding) -> str:
    return finding.status.value


@pytest.mark.parametrize(
    ("trips_s", "wanted"),
    [([0.004] * 20, "OK"), ([0.004] * 19 + [0.4], "WARN"), ([0.004] * 19 + [2.0], "FAIL")],
)
def test_a_slow_network_is_told_and_one_that_would_delay_a_stop_is_red(
    trips_s: list[float], wanted: str
) -> None:
    assert status(check_delay(trips_s, "http://boat:11311")) == wanted


def test_missing_and_late_positions_are_told() -> None:
    assert status(check_loss(APAD, STEADY, 3.0)) == "OK"
    one_missing = [*STEADY[:10], *STEADY[11:]]
    lossy = check_loss(APAD, one_missing, 3.0)
    assert status(lossy) == "WARN" and "1 of 30 positions missing" in lossy.found
    assert status(check_loss(APAD, STEADY[::2], 3.0)) == "FAIL"
    late = [*STEADY[:10], *(replace(it, at_s=it.at_s + 2.0) for it in STEADY[10:])]
    assert status(check_loss(APAD, late, 5.0)) == "FAIL"
    unnumbered = [replace(it, sequence=0) for it in STEADY]
    assert "not numbered" in check_loss(APAD, unnumbered, 3.0).found
    assert status(check_loss(APAD, STEADY[:1], 3.0)) == "FAIL"


@pytest.mark.parametrize(
    ("samples", "told"),
    [
        ([], "none within"),
        ([replace(it, north_m=math.nan) for it in STEADY], "not finite"),
        ([replace(STEADY[0], east_m=1e9), *STEADY[1:]], "1 of 30 are not finite"),
        (STEADY[::10], "2 a second are needed"),
        ([*STEADY[:15], *(replace(it, east_m=30.0) for it in STEADY[15:])], "it jumped by 25.0 m"),
    ],
)
def test_a_position_that_a_mission_cannot_use_is_red(samples: list[PositionSample], told: str) -> None:
    found = check_position(APAD, samples, 3.0, jump_m=10.0, speed_m_s=2.0)
    assert status(found) == "FAIL" and told in found.found and found.mend
    assert status(check_position(APAD, STEADY, 3.0, jump_m=10.0, speed_m_s=2.0)) == "OK"


@pytest.mark.parametrize(
    ("change", "wanted", "told"),
    [
        ({}, "OK", "variances 0.04"),
        (
            {"status": 0, "north_variance_m2": 0.0, "east_variance_m2": 0.0},
            "WARN",
            "neither status nor variance",
        ),
        ({"status": 0}, "FAIL", "status 0"),
        ({"north_variance_m2": 9.0}, "FAIL", "variances 9.00"),
        ({"east_variance_m2": math.nan}, "FAIL", "variances"),
    ],
)
def test_the_quality_that_the_vehicle_tells_is_judged(
    change: dict[str, float], wanted: str, told: str
) -> None:
    found = check_gps(APAD, [replace(it, **change) for it in STEADY])  # type: ignore[arg-type]
    assert status(found) == wanted and told in found.found


def test_a_place_that_scatters_is_red_whatever_the_vehicle_tells() -> None:
    wild = [replace(it, north_m=10.0 + 3.0 * (n % 2)) for n, it in enumerate(STEADY)]
    assert status(check_gps(APAD, wild)) == "FAIL"


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
    (found,) = check_fence(APAD, place_m, FENCE, 2.0, [])
    assert status(found) == wanted and told in found.found
    assert key(found) == "fence"


def key(finding: Finding) -> str:
    (found,) = red_keys([replace(finding, status=Status.FAIL, mend="mend")], [APAD])
    return found


def test_amussels_outside_are_told_and_no_fence_is_red() -> None:
    _, starts = check_fence(APAD, (10.0, 10.0), FENCE, 2.0, [(5.0, 5.0), (1.0, 5.0), (50.0, 5.0)])
    assert status(starts) == "WARN" and starts.found.startswith("2 aMussels")
    assert status(check_fence(APAD, (10.0, 10.0), None, 2.0, [])[0]) == "FAIL"


def test_limits_that_notice_a_bad_position_too_late_are_told() -> None:
    slow = check_reaction(GuardOptions(position_age_s=5.0, frozen_s=10.0), APAD)
    assert status(slow) == "WARN" and "position_age_s is 5 s, guards.frozen_s is 10 s" in slow.found
    assert status(check_reaction(GuardOptions(), APAD)) == "OK"


@pytest.mark.parametrize(
    ("hears_pilot", "steers", "wanted"),
    [
        (True, False, "OK"),
        (True, None, "WARN"),
        (True, True, "FAIL"),
        (False, None, "OK"),
        (False, True, "FAIL"),
    ],
)
def test_a_pilot_who_steers_is_red(hears_pilot: bool, steers: bool | None, wanted: str) -> None:
    assert status(check_pilot(APAD, hears_pilot=hears_pilot, steers=steers)) == wanted


@pytest.mark.parametrize(
    ("drifts", "word", "wanted"),
    [(True, None, "FAIL"), (False, None, "WARN"), (True, "WATCHING", "OK"), (False, "WAITING", "OK")],
)
def test_an_apad_that_drifts_needs_its_watchdog(drifts: bool, word: str | None, wanted: str) -> None:
    assert status(check_watchdog(APAD, drifts=drifts, word=word)) == wanted


@pytest.mark.parametrize(("charge", "wanted"), [(0.95, "OK"), (0.6, "WARN"), (0.3, "FAIL"), (None, "FAIL")])
def test_the_charge_is_held_against_the_least_and_the_most_that_the_mission_takes(
    charge: float | None, wanted: str
) -> None:
    """At rest 10 %, under way all the time 60 %, 5 % for the way home, 20 % kept: 35 to 85 %."""
    need = EnergyNeed(at_rest=0.1, under_way=0.6, way_home=0.05, reserve=0.2)
    assert status(check_energy(APAD, charge, need)) == wanted


def test_a_stop_that_failed_is_red_and_nobody_on_the_lookout_is_told() -> None:
    assert status(check_stop(APAD, "it was not at rest 20 s after the stop")) == "FAIL"
    assert status(check_stop(APAD, None, "at rest within 2 s")) == "OK"
    assert [status(check_lookout(it)) for it in ("", "Ana")] == ["WARN", "OK"]


def test_what_the_doctor_warns_of_is_red_where_a_mission_would_go_to_other_places_or_into_full_docks() -> (
    None
):
    doubts = [warn(it, "found", "mend") for it in ("origin", "/apad1 docks", "/apad1 clock", "disk")]
    assert [status(at_sea(it, APAD)) for it in doubts] == ["FAIL", "FAIL", "WARN", "WARN"]
    assert at_sea(ok("origin", "the same"), APAD) == ok("origin", "the same")


def test_red_findings_are_named_without_their_apad() -> None:
    found = [
        fail(it, "found", "mend") for it in ("/apad1 action server", "/apad1", "own address", "/apad2 fence")
    ]
    assert list(red_keys([*found, ok("disk", "room")], ["/apad1", "/apad2"])) == [
        "action-server",
        "versions",
        "own-address",
        "fence",
    ]

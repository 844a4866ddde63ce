"""Each check of a preflight by made measurements: what is green, and each cause of red with its mend."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.doctor.door import Door, NotAnnounced, TopicSeen
from apad_bridge.doctor.finding import Finding, run_checks
from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.positions import (
    PositionSample,
    check_gps,
    check_lag,
    check_loss,
    check_position,
    told_places,
)
from apad_bridge.doctor.preflight import (
    CHECKS,
    WATCHDOG_STATES,
    EnergyNeed,
    WatchdogSeen,
    WatchedAPad,
    check_bench,
    check_delay,
    check_energy,
    check_generation,
    check_lookout,
    check_off,
    check_pilot,
    check_stop,
    check_watchdog,
)
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.loader import load

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
    assert status(check_loss(STEADY, 3.0)) == "OK"
    one_missing = [*STEADY[:10], *STEADY[11:]]
    lossy = check_loss(one_missing, 3.0)
    assert status(lossy) == "WARN" and "1 of 30 positions missing" in lossy.found
    assert status(check_loss(STEADY[::2], 3.0)) == "FAIL"
    late = [*STEADY[:10], *(replace(it, at_s=it.at_s + 2.0) for it in STEADY[10:])]
    assert status(check_loss(late, 5.0)) == "FAIL"
    assert "not numbered" in check_loss([replace(it, sequence=0) for it in STEADY], 3.0).found
    assert status(check_loss(STEADY[:1], 3.0)) == "FAIL"


@pytest.mark.parametrize(
    ("samples", "told"),
    [
        ([], "none within"),
        ([replace(it, north_m=math.nan) for it in STEADY], "not finite"),
        ([replace(it, yaw_rad=math.nan) for it in STEADY], "yaw_rad is outside"),
        ([replace(it, stamp_s=50.0 - n) for n, it in enumerate(STEADY)], "its stamps went back by 1.00 s"),
        ([replace(STEADY[0], east_m=1e9), *STEADY[1:]], "1 of 30 are not finite"),
        (STEADY[::10], "2 a second are needed"),
        ([*STEADY[:15], *(replace(it, east_m=30.0) for it in STEADY[15:])], "it jumped by 25.0 m"),
    ],
)
def test_a_position_that_a_mission_cannot_use_is_red(samples: list[PositionSample], told: str) -> None:
    found = check_position(samples, 3.0, jump_m=10.0, speed_m_s=2.0)
    assert status(found) == "FAIL" and told in found.found and found.mend
    assert status(check_position(STEADY, 3.0, jump_m=10.0, speed_m_s=2.0)) == "OK"


def test_two_sources_of_one_position_are_red_and_named() -> None:
    found = check_position(STEADY, 3.0, 10.0, 2.0, ["/filter", "/simulator"])
    assert status(found) == "FAIL" and "2 nodes publish it, /filter, /simulator" in found.found
    assert status(check_position(STEADY, 3.0, 10.0, 2.0, ["/filter"])) == "OK"


@pytest.mark.parametrize(
    ("change", "wanted", "told"),
    [
        ({}, "OK", "variances 0.04"),
        (
            {"status": 0, "north_variance_m2": 0.0, "east_variance_m2": 0.0},
            "CANNOT TELL",
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
    found = check_gps([replace(it, **change) for it in STEADY])  # type: ignore[arg-type]
    assert status(found) == wanted and told in found.found


def test_a_place_that_scatters_is_red_whatever_the_vehicle_tells() -> None:
    wild = [replace(it, north_m=10.0 + 3.0 * (n % 2)) for n, it in enumerate(STEADY)]
    assert status(check_gps(wild)) == "FAIL"


@pytest.mark.parametrize(
    ("wanted", "there", "outcome", "told"),
    [
        (Generation.AUTO, [Generation.A], "OK", "a"),
        (Generation.B, [Generation.A, Generation.B], "OK", "b"),
        (Generation.B, [Generation.A], "FAIL", "it is a, and the scenario's is b"),
        (Generation.AUTO, [Generation.A, Generation.B], "FAIL", "both are there"),
        (Generation.AUTO, [], "FAIL", "no node takes orders"),
    ],
)
def test_the_vehicle_speaks_the_scenarios_generation(
    wanted: Generation, there: list[Generation], outcome: str, told: str
) -> None:
    found = check_generation(wanted, there)
    assert status(found) == outcome and told in found.found


def test_a_vehicle_that_no_order_switches_off_needs_a_declared_hardware_cut() -> None:
    offered = ["VelCon_enable", "FADP_enable"]
    can = check_off([], offered, hardware_cut=False)
    assert status(can) == "OK" and "does the joystick still work after OFF?" in can.found
    cannot = check_off(["FADP_enable"], offered, hardware_cut=False)
    assert status(cannot) == "FAIL" and "guards.hardware_cut" in str(cannot.mend)
    assert status(check_off(["FADP_enable"], offered, hardware_cut=True)) == "WARN"


@pytest.mark.parametrize(
    ("stamped_s", "clock_s", "wanted", "told"),
    [
        (-0.1, 0.0, "OK", "arrive 0.10 s old"),
        (29.9, 30.0, "OK", "clock is +30.00 s"),
        (-8.0, 0.0, "CANNOT TELL", "arrive 8.00 s old"),
        (22.0, 30.0, "CANNOT TELL", "arrive 8.00 s old"),
        (0.2, None, "OK", "+0.20 s"),
        (-60.0, None, "WARN", "-60.00 s"),
    ],
)
def test_the_clocks_offset_and_the_positions_own_lag_are_measured(
    stamped_s: float, clock_s: float | None, wanted: str, told: str
) -> None:
    samples = [replace(it, wall_s=1e9 + it.at_s, stamp_s=1e9 + it.at_s + stamped_s) for it in STEADY]
    found = check_lag(samples, clock_s)
    assert status(found) == wanted and told in found.found


def test_positions_without_stamps_cannot_tell_their_age() -> None:
    assert status(check_lag(STEADY, 0.0)) == "CANNOT TELL"


def test_a_receiver_that_is_worse_than_the_clearance_counts_with_is_red() -> None:
    """Variances of 0.04 m2 are 2.45 x 0.2 m = 0.49 m in 95 % of all cases."""
    assert status(check_gps(STEADY, 0.5)) == "OK"
    worse = check_gps(STEADY, 0.4)
    assert status(worse) == "FAIL" and "an error of 0.49 m" in worse.found


def test_the_places_in_degrees_come_from_the_newest_sound_position() -> None:
    samples = [replace(it, origin_deg=(43.9, 15.4), global_deg=(43.9001, 15.4)) for it in STEADY]
    origin, place = told_places(samples)
    assert (origin.latitude_deg, origin.north_m, origin.east_m) == (43.9, 0.0, 0.0)
    assert (place.latitude_deg, place.north_m, place.east_m) == (43.9001, 10.01, 5.0)
    assert told_places(STEADY) == []


def test_another_bench_that_flies_the_vehicle_is_red_with_its_node() -> None:
    assert status(check_bench("/musselbed/heartbeat", [])) == "OK"
    second = check_bench("/musselbed/heartbeat", ["/musselbed_1"])
    assert status(second) == "FAIL" and second.found.startswith("/musselbed_1 publishes /musselbed/heartbeat")
    assert "musselbed abort RUN" in str(second.mend)


@pytest.mark.parametrize(
    ("hears_pilot", "manual", "wanted"),
    [
        (True, TopicSeen(True, False), "OK"),
        (True, TopicSeen(False), "WARN"),
        (True, TopicSeen(True), "CANNOT TELL"),
        (True, TopicSeen(True, True), "FAIL"),
        (False, TopicSeen(False), "OK"),
        (False, TopicSeen(True), "CANNOT TELL"),
        (False, TopicSeen(True, True), "FAIL"),
    ],
)
def test_a_pilot_who_steers_is_red_and_a_flag_that_fell_silent_tells_nothing(
    hears_pilot: bool, manual: TopicSeen, wanted: str
) -> None:
    assert status(check_pilot(hears_pilot=hears_pilot, manual=manual)) == wanted


SETTINGS = TopicSeen(True, '{"heartbeat": "/musselbed/heartbeat", "silence_s": 10.0}')


def of_watchdog(
    state: TopicSeen,
    settings: TopicSeen = SETTINGS,
    *,
    nodes: Sequence[str] = ("/w",),
    drifts: bool = False,
    is_demanded: bool = False,
) -> Finding:
    seen = WatchdogSeen(state, settings, nodes)
    return check_watchdog(seen, "/musselbed/heartbeat", drifts=drifts, is_demanded=is_demanded)


@pytest.mark.parametrize(
    ("drifts", "is_demanded", "state", "wanted"),
    [
        (True, False, TopicSeen(False), "FAIL"),
        (False, False, TopicSeen(False), "WARN"),
        (False, True, TopicSeen(False), "FAIL"),
        (True, False, TopicSeen(True, "WATCHING"), "OK"),
        (False, True, TopicSeen(True, "WAITING"), "OK"),
        (False, False, TopicSeen(True), "FAIL"),
        (False, False, TopicSeen(True, "hello"), "FAIL"),
        (True, False, TopicSeen(True, ""), "FAIL"),
    ],
)
def test_a_watchdog_that_is_silent_or_says_what_none_says_is_red(
    drifts: bool, is_demanded: bool, state: TopicSeen, wanted: str
) -> None:
    assert status(of_watchdog(state, drifts=drifts, is_demanded=is_demanded)) == wanted


@pytest.mark.parametrize(
    ("settings", "wanted", "told"),
    [
        ('{"heartbeat": "/musselbed/heartbeat", "silence_s": 15}', "OK", "acts after 15 s"),
        ('{"heartbeat": "/other", "silence_s": 10.0}', "FAIL", "listens to /other"),
        ('{"heartbeat": "/musselbed/heartbeat", "silence_s": 600.0}', "FAIL", "600 s: 15 s is the most"),
        ('{"heartbeat": "/musselbed/heartbeat", "silence_s": NaN}', "FAIL", "nan"),
        ('{"heartbeat": "/musselbed/heartbeat", "silence_s": 2}', "WARN", "acts after 2 s"),
        ('{"heartbeat": "/musselbed/heartbeat"}', "CANNOT TELL", "an older one, or another node"),
        ("[]", "CANNOT TELL", "another node"),
        ("hello", "CANNOT TELL", "another node"),
        (None, "CANNOT TELL", "another node"),
    ],
)
def test_a_watchdog_that_listens_elsewhere_or_acts_too_late_is_red(
    settings: str | None, wanted: str, told: str
) -> None:
    found = of_watchdog(TopicSeen(True, "WAITING"), TopicSeen(settings is not None, settings))
    assert status(found) == wanted and told in found.found


def test_two_watchdogs_of_one_vehicle_are_red() -> None:
    both = of_watchdog(TopicSeen(True, "WATCHING"), nodes=("/w1", "/w2"))
    assert status(both) == "FAIL" and "/w1, /w2" in both.found


def test_every_state_that_the_watchdog_describes_is_known() -> None:
    script = Path(__file__).parents[3] / "launch_scripts" / "vehicle_watchdog"
    described = set(re.findall(r"^  ([A-Z]+)  ", script.read_text(), re.MULTILINE))
    assert "WATCHING" in described and described <= WATCHDOG_STATES


@pytest.mark.parametrize(
    ("charge", "wanted"),
    [
        (0.95, "OK"),
        (1.04, "OK"),
        (0.6, "WARN"),
        (0.3, "FAIL"),
        (1.5, "FAIL"),
        (-0.1, "FAIL"),
        (None, "CANNOT TELL"),
    ],
)
def test_the_charge_is_held_against_the_least_and_the_most_that_the_mission_takes(
    charge: float | None, wanted: str
) -> None:
    """At rest 10 %, under way all the time 60 %, 5 % for the way home, 20 % kept: 35 to 85 %."""
    need = EnergyNeed(at_rest=0.1, under_way=0.6, way_home=0.05, reserve=0.2)
    assert status(check_energy(charge, need)) == wanted


def test_a_stop_that_failed_is_red_and_nobody_on_the_lookout_is_told() -> None:
    assert status(check_stop("it was not at rest 20 s after the stop")) == "FAIL"
    assert status(check_stop(None, "at rest within 2 s")) == "OK"
    assert [status(check_lookout(it)) for it in ("", "Ana")] == ["WARN", "OK"]


def test_the_table_measures_by_its_door_and_names_each_finding() -> None:
    """A vehicle at rest inside the fence, whose positions come and that tells nothing else; its master is gone."""

    def silent(*_: object) -> Any:
        raise NotAnnounced("silent")

    def reader(_: Graph, topic: str, seconds: float) -> list[PositionSample]:
        assert topic == "/lab/apad1/position"
        return STEADY if seconds >= 3 else []

    door = Door(silent, silent, silent, silent, reader, silent, dict, lambda *_: False)
    nothing = Graph("http://127.0.0.1:1/", {}, {}, {}, {})
    scenario = load(Path(__file__).parents[3] / "launch_scripts" / "scenarios" / "real-apad.yaml")
    apad = WatchedAPad(door, nothing, "/lab/apad1", scenario, [], "lab")
    found = {
        it.check.removeprefix("/lab/apad1 "): it.status.value for it in run_checks(CHECKS, apad, apad.name)
    }
    assert found == {
        "generation": "FAIL",
        "position": "OK",
        "GPS": "OK",
        "loss": "OK",
        "lag": "CANNOT TELL",
        "fence": "OK",
        "clearance": "OK",
        "reaction": "OK",
        "limits": "OK",
        "reserve": "OK",
        "pilot": "OK",
        "bench": "OK",
        "watchdog": "WARN",
        "energy": "CANNOT TELL",
        "parameters": "FAIL",
        "software": "OK",
    }

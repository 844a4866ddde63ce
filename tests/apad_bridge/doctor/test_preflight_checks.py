"""Each check of a preflight by made measurements: what is green, and each cause of red with its mend."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.doctor.finding import Finding, run_checks
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.limits import check_clearance, check_fence, check_reaction, check_reserve
from apad_bridge.doctor.live_apad import Door, NotAnnounced, TopicSeen
from apad_bridge.doctor.positions import (
    PositionSample,
    check_gps,
    check_lag,
    check_loss,
    check_position,
    reported_places,
)
from apad_bridge.doctor.preflight_checks import (
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
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts_table import Start

STEADY = [PositionSample(n / 10, 100 + n, 10.0 + n % 2 / 100, 5.0, 3, 0.04, 0.04) for n in range(30)]
"""Three seconds at 10 Hz, at rest, by a GPS that says how good it is."""


BOAT, HEARTBEAT = "http://boat:11311", "/musselbed/heartbeat"


def changed(**change: Any) -> list[PositionSample]:
    return [replace(it, **change) for it in STEADY]


def place(samples: Sequence[PositionSample] = STEADY, *sources: str) -> Finding:
    return check_position(samples, 3.0, 10.0, 2.0, list(sources))


def stamped(stamped_s: float, clock_s: float | None) -> Finding:
    samples = [replace(it, wall_s=1e9 + it.at_s, stamp_s=1e9 + it.at_s + stamped_s) for it in STEADY]
    return check_lag(samples, clock_s)


def pilot(hears_pilot: bool, *manual: bool) -> Finding:
    return check_pilot(hears_pilot=hears_pilot, manual=TopicSeen(*manual))


SETTINGS = '{"heartbeat": "/musselbed/heartbeat", "silence_s": 10.0}'


def watchdog(
    *state: Any, settings: str | None = SETTINGS, nodes: Sequence[str] = ("/w",), **needs: bool
) -> Finding:
    seen = WatchdogSeen(TopicSeen(*state), TopicSeen(settings is not None, settings), nodes)
    needs = {"drifts": False, "is_demanded": False} | needs
    return check_watchdog(seen, "/musselbed/heartbeat", **needs)


def watched(settings: str | None) -> Finding:
    return watchdog(True, "WAITING", settings=settings)


def energy(charge: float | None) -> Finding:
    """At rest 10 %, under way all the time 60 %, 5 % for the way home, 20 % kept: 35 to 85 %."""
    need = EnergyNeed(at_rest=0.1, under_way=0.6, way_home=0.05, reserve=0.2)
    return check_energy(charge, need)


FENCE = Fence(
    ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)), (((18.0, 18.0), (22.0, 18.0), (22.0, 22.0)),)
)
MEASURED = GuardOptions(
    clearance_m=8.0, position_error_m=0.5, hull_m=0.7, coasting_m=4.2, coasting_speed_m_s=0.6
)


def fence(place_m: tuple[float, float] | None) -> Finding:
    return check_fence(place_m, FENCE, 2.0)


def reaction(**guards: float) -> Finding:
    return check_reaction(GuardOptions(**guards))  # type: ignore[arg-type]


def clearance(speed_m_s: float, **change: float | None) -> Finding:
    """0.5 + 0.35 + (v + 0.2) x 3 + 11.67 v^2; 8 m allow the root of 11.67 v^2 + 3 v = 6.55, 0.63 m/s."""
    return check_clearance(replace(MEASURED, **change), speed_m_s, "mission.speed_m_s")  # type: ignore[arg-type]


A, B, AUTO = Generation.A, Generation.B, Generation.AUTO
SLOW = "position_age_s is 5 s, guards.frozen_s is 10 s"
OFFERED = ["VelCon_enable", "FADP_enable"]
ONE_MISSING = [*STEADY[:10], *STEADY[11:]]
LATE = [*STEADY[:10], *(replace(it, at_s=it.at_s + 2.0) for it in STEADY[10:])]
JUMPED = [*STEADY[:15], *(replace(it, east_m=30.0) for it in STEADY[15:])]
BACKWARDS = [replace(it, stamp_s=50.0 - n) for n, it in enumerate(STEADY)]
WILD = [replace(it, north_m=10.0 + 3.0 * (n % 2)) for n, it in enumerate(STEADY)]
CHECKED: dict[str, list[tuple[Callable[[], Finding], str, str]]] = {
    "a slow network, and one that would delay a stop": [
        (lambda: check_delay([0.004] * 20, BOAT), "OK", ""),
        (lambda: check_delay([0.004] * 19 + [0.4], BOAT), "WARN", ""),
        (lambda: check_delay([0.004] * 19 + [2.0], BOAT), "FAIL", ""),
    ],
    "missing and late positions": [
        (lambda: check_loss(STEADY, 3.0), "OK", ""),
        (lambda: check_loss(ONE_MISSING, 3.0), "WARN", "1 of 30 positions missing"),
        (lambda: check_loss(STEADY[::2], 3.0), "FAIL", ""),
        (lambda: check_loss(LATE, 5.0), "FAIL", ""),
        (lambda: check_loss(changed(sequence=0), 3.0), "", "not numbered"),
        (lambda: check_loss(STEADY[:1], 3.0), "FAIL", ""),
    ],
    "a position that a mission cannot use": [
        (place, "OK", ""),
        (lambda: place([]), "FAIL", "none within"),
        (lambda: place(changed(north_m=math.nan)), "FAIL", "not finite"),
        (lambda: place(changed(yaw_rad=math.nan)), "FAIL", "yaw_rad is outside"),
        (lambda: place(BACKWARDS), "FAIL", "its stamps went back by 1.00 s"),
        (lambda: place([replace(STEADY[0], east_m=1e9), *STEADY[1:]]), "FAIL", "1 of 30 are not finite"),
        (lambda: place(STEADY[::10]), "FAIL", "2 a second are needed"),
        (lambda: place(JUMPED), "FAIL", "it jumped by 25.0 m"),
        (lambda: place(STEADY, "/a", "/b"), "FAIL", "2 nodes publish it, /a, /b"),
        (lambda: place(STEADY, "/filter"), "OK", ""),
    ],
    "the quality that the vehicle tells": [
        (lambda: check_gps(STEADY), "OK", "variances 0.04"),
        (
            lambda: check_gps(changed(status=0, north_variance_m2=0.0, east_variance_m2=0.0)),
            "CANNOT TELL",
            "neither status nor variance",
        ),
        (lambda: check_gps(changed(status=0)), "FAIL", "status 0"),
        (lambda: check_gps(changed(north_variance_m2=9.0)), "FAIL", "variances 9.00"),
        (lambda: check_gps(changed(east_variance_m2=math.nan)), "FAIL", "variances"),
        (lambda: check_gps(WILD), "FAIL", ""),  # whatever the vehicle tells
        # Variances of 0.04 m2 are 2.45 x 0.2 m = 0.49 m in 95 % of all cases: held against the clearance's allowance.
        (lambda: check_gps(STEADY, 0.5), "OK", ""),
        (lambda: check_gps(STEADY, 0.4), "FAIL", "an error of 0.49 m"),
    ],
    "the vehicle's generation and the scenario's": [
        (lambda: check_generation(AUTO, [A]), "OK", "a"),
        (lambda: check_generation(B, [A, B]), "OK", "b"),
        (lambda: check_generation(B, [A]), "FAIL", "it is a, and the scenario's is b"),
        (lambda: check_generation(AUTO, [A, B]), "FAIL", "both are there"),
        (lambda: check_generation(AUTO, []), "FAIL", "no node takes orders"),
    ],
    "a vehicle that no order switches off needs a declared hardware cut": [
        (lambda: check_off([], OFFERED, hardware_cut=False), "OK", "does the joystick still work after OFF?"),
        (lambda: check_off(["FADP_enable"], OFFERED, hardware_cut=False), "FAIL", "guards.hardware_cut"),
        (lambda: check_off(["FADP_enable"], OFFERED, hardware_cut=True), "WARN", ""),
    ],
    "the clock's offset and the position's own lag": [
        (lambda: stamped(-0.1, 0.0), "OK", "arrive 0.10 s old"),
        (lambda: stamped(29.9, 30.0), "OK", "clock is +30.00 s"),
        (lambda: stamped(-8.0, 0.0), "CANNOT TELL", "arrive 8.00 s old"),
        (lambda: stamped(22.0, 30.0), "CANNOT TELL", "arrive 8.00 s old"),
        (lambda: stamped(0.2, None), "OK", "+0.20 s"),
        (lambda: stamped(-60.0, None), "WARN", "-60.00 s"),
        (lambda: check_lag(STEADY, 0.0), "CANNOT TELL", ""),  # they bear no stamps
    ],
    "another bench that flies the vehicle": [
        (lambda: check_bench(HEARTBEAT, []), "OK", ""),
        (lambda: check_bench(HEARTBEAT, ["/mb_1"]), "FAIL", "/mb_1 publishes /musselbed/heartbeat"),
        (lambda: check_bench(HEARTBEAT, ["/mb_1"]), "FAIL", "musselbed abort RUN"),
    ],
    "a pilot who steers, and a flag that fell silent": [
        (lambda: pilot(True, True, False), "OK", ""),
        (lambda: pilot(True, False), "WARN", ""),
        (lambda: pilot(True, True), "CANNOT TELL", ""),
        (lambda: pilot(True, True, True), "FAIL", ""),
        (lambda: pilot(False, False), "OK", ""),
        (lambda: pilot(False, True), "CANNOT TELL", ""),
        (lambda: pilot(False, True, True), "FAIL", ""),
    ],
    "a watchdog that is silent, or says what none says": [
        (lambda: watchdog(False, drifts=True), "FAIL", ""),
        (lambda: watchdog(False), "WARN", ""),
        (lambda: watchdog(False, is_demanded=True), "FAIL", ""),
        (lambda: watchdog(True, "WATCHING", drifts=True), "OK", ""),
        (lambda: watchdog(True, "WAITING", is_demanded=True), "OK", ""),
        (lambda: watchdog(True), "FAIL", ""),
        (lambda: watchdog(True, "hello"), "FAIL", ""),
        (lambda: watchdog(True, "", drifts=True), "FAIL", ""),
        (lambda: watchdog(True, "WATCHING", nodes=("/w1", "/w2")), "FAIL", "/w1, /w2"),
    ],
    "a watchdog that listens elsewhere or acts too late": [
        (lambda: watched(SETTINGS.replace("10.0", "15")), "OK", "acts after 15 s"),
        (lambda: watched(SETTINGS.replace(HEARTBEAT, "/other")), "FAIL", "listens to /other"),
        (lambda: watched(SETTINGS.replace("10.0", "600.0")), "FAIL", "600 s: 15 s is the most"),
        (lambda: watched(SETTINGS.replace("10.0", "NaN")), "FAIL", "nan"),
        (lambda: watched(SETTINGS.replace("10.0", "2")), "WARN", "acts after 2 s"),
        (lambda: watched(f'{{"heartbeat": "{HEARTBEAT}"}}'), "CANNOT TELL", "an older one, or another node"),
        (lambda: watched("[]"), "CANNOT TELL", "another node"),
        (lambda: watched("hello"), "CANNOT TELL", "another node"),
        (lambda: watched(None), "CANNOT TELL", "another node"),
    ],
    "the charge, between the least and the most that the mission takes": [
        (lambda: energy(0.95), "OK", ""),
        (lambda: energy(1.04), "OK", ""),
        (lambda: energy(0.6), "WARN", ""),
        (lambda: energy(0.3), "FAIL", ""),
        (lambda: energy(1.5), "FAIL", ""),
        (lambda: energy(-0.1), "FAIL", ""),
        (lambda: energy(None), "CANNOT TELL", ""),
    ],
    "an aPad, and aMussels, inside the fence": [
        (lambda: fence((10.0, 10.0)), "OK", "10.0 m from its edge"),
        (lambda: fence((1.0, 10.0)), "FAIL", "1.0 m from its edge"),
        (lambda: fence((-5.0, 10.0)), "FAIL", "5.0 m outside"),
        (lambda: fence((21.0, 19.0)), "FAIL", "outside"),  # in the zone to keep out of
        (lambda: fence(None), "FAIL", "without a position"),
        (lambda: check_fence((10.0, 10.0), None, 2.0), "FAIL", ""),
    ],
    "limits that notice a bad position too late": [
        (lambda: reaction(position_age_s=5.0, frozen_s=10.0), "WARN", SLOW),
        (reaction, "OK", ""),
        (lambda: reaction(position_age_s=60.0), "FAIL", ""),
        (lambda: reaction(jump_m=500.0), "FAIL", "guards.jump_m is 500 m"),
    ],
    "a reserve that keeps nothing": [
        (lambda: check_reserve(GuardOptions(battery_reserve=None)), "FAIL", ""),
        (lambda: check_reserve(GuardOptions(battery_reserve=0.0)), "FAIL", ""),
        (lambda: check_reserve(GuardOptions(battery_reserve=0.2)), "OK", ""),
    ],
    "a clearance with room for a stop, and the greatest speed that fits": [
        (lambda: clearance(0.6), "OK", "needs 7.5 m"),
        (lambda: clearance(0.6), "OK", "at most 0.63 m/s fit"),
        (lambda: clearance(0.5, clearance_m=2.0), "FAIL", "no speed fits"),
        (lambda: clearance(0.5, clearance_m=2.0), "FAIL", "to 7.2"),
        (lambda: clearance(0.5, coasting_m=None), "CANNOT TELL", "guards.coasting_m"),
    ],
    "a stop that failed, and nobody on the lookout": [
        (lambda: check_stop("it was not at rest 20 s after the stop"), "FAIL", ""),
        (lambda: check_stop(None, "at rest within 2 s"), "OK", ""),
        (lambda: check_lookout(""), "WARN", ""),
        (lambda: check_lookout("Ana"), "OK", ""),
    ],
}


@pytest.mark.parametrize("checked", CHECKED.values(), ids=CHECKED)
def test_a_check_finds(checked: list[tuple[Callable[[], Finding], str, str]]) -> None:
    """A status, and words of the finding or of its mend; each one that is red has a mend."""
    for check, status, told in checked:
        found = check()
        assert status in ("", found.status.value) and told in f"{found.found} {found.mend}", found
        assert status != "FAIL" or found.mend, found


def test_every_state_that_the_watchdog_describes_is_known() -> None:
    script = Path(__file__).parents[3] / "launch_scripts" / "vehicle_watchdog"
    described = set(re.findall(r"^  ([A-Z]+)  ", script.read_text(), re.MULTILINE))
    assert "WATCHING" in described and described <= WATCHDOG_STATES


def test_the_places_in_degrees_come_from_the_newest_sound_position() -> None:
    origin, place = reported_places(changed(origin_deg=(43.9, 15.4), global_deg=(43.9001, 15.4)))
    assert (origin.latitude_deg, origin.north_m, origin.east_m) == (43.9, 0.0, 0.0)
    assert (place.latitude_deg, place.north_m, place.east_m) == (43.9001, 10.01, 5.0)
    assert reported_places(STEADY) == []


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
    starts = [Start(1, 5.0, 5.0, 0.9), Start(2, 50.0, 5.0, 0.9), Start(3, 41.0, 5.0, 0.9)]
    apad = WatchedAPad(door, nothing, "/lab/apad1", scenario, starts, "lab")
    findings = list(run_checks(CHECKS, apad, apad.name))
    found = {it.check.removeprefix("/lab/apad1 "): it.status.value for it in findings}
    unserved = [it.found for it in findings if "starts" in it.check]
    # 8 m beyond the fence, and 1 m inside it, which is nearer than the clearance.
    assert [text.split(" ")[:2] for text in unserved] == [["aMussel", "2"], ["aMussel", "3"]]
    assert "8.0 m outside the fence" in unserved[0] and "1.0 m" in unserved[1]
    assert found == {
        "generation": "FAIL",
        "position": "OK",
        "GPS": "OK",
        "loss": "OK",
        "lag": "CANNOT TELL",
        "fence": "OK",
        "starts": "WARN",
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

"""Scenario files: refused files with their messages, and overrides from the command line."""

from __future__ import annotations

import json
import math
import os
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from scenario_files import POOL_FILE, SCENARIO_FILES, WHOLE_FILE

from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.flight_readiness import check_code, problems_with_real_vehicle, warnings
from apad_bridge.scenario.loader import from_data, load, resolve, with_overrides
from apad_bridge.scenario.schema import RandomStart
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.text import text_file
from apad_bridge.scenario.text.yaml_text import parse_yaml

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"
POOL = POOL_FILE.read_text()

Refusals = Callable[..., list[str]]


@pytest.fixture
def refusals(tmp_path: Path) -> Refusals:
    """Returns the messages for the pool with some texts replaced, each without the file's name in front."""
    (tmp_path / "pool.csv").write_text((SCENARIO_FILES / "pool.csv").read_text())
    path = tmp_path / "changed.yaml"

    def edited(*changes: tuple[str, str]) -> list[str]:
        text = POOL
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path.write_text(text)
        with pytest.raises(ScenarioError) as caught:
            load(path)
        assert str(caught.value).splitlines() == list(caught.value.lines)
        assert all(line.startswith(f"{path}: ") for line in caught.value.lines)
        return [line.removeprefix(f"{path}: ") for line in caught.value.lines]

    return edited


CORNERS = re.search(r"  polygon_m: .*", POOL)[0]  # type: ignore[index]
DEPTH = "  depth_m: 3.0 # assumed: the paper does not give the pool's depth"
SQUARE = "[[-4, -4], [32, -4], [32, 25], [-4, 25]]"


FENCES = [
    ("  fence: [[0, 0], [1, 0]]", "area: fence needs three corners or more"),
    ("  fence: [[0, 0], [4, 4], [4, 0], [0, 4]]", "area: fence crosses or touches itself"),
    ("  fence: [[0, 0], [4, x], [4, 0]]", "area.fence[1][1]: must be a valid number, not 'x'"),
    ("  fence: 7", "area.fence: must be a valid string, not 7"),
    ("  fence: none.geojson", "area.fence: "),
    ("  keep_out: [[[0, 0], [1, 0], [1, 1]]]", "area: keep_out lies inside a fence: add fence"),
    (
        f"  fence: {SQUARE}\n  keep_out: [[[0, 0], [1, 0]]]",
        "area: keep_out[0] needs three corners or more",
    ),
    (
        "  fence: [[0, 0], [3, 0], [3, 3], [0, 3]]",
        "guards.clearance_m: no place inside area.fence keeps 2 m",
    ),
    (
        "  fence: [[50, 50], [90, 50], [90, 90]]",
        "apad.start_m: [14.0, 10.5] is no place inside area.fence",
    ),
    (f"  fence: {SQUARE}\n  home_m: [31, 0]", "area.home_m: [31.0, 0.0] is no place inside area.fence"),
    (
        f"  fence: {SQUARE}\n  keep_out: [[[13, 9], [16, 9], [16, 12]]]",
        "apad.start_m: [14.0, 10.5] is no place",
    ),
    ("guards: {amussel_depth_m: 2}", "area.depth_m: 3 m are more than the aMussels are rated for"),
    ("guards: {speed_limit_m_s: 0.4}", "mission.speed_m_s: is above guards.speed_limit_m_s (0.4 m/s)"),
    ("guards: {clearance_m: -1}", "guards.clearance_m: must be greater than or equal to 0, not -1"),
    ("guards: {outside: drift}", "guards.outside: must be 'hold' or 'return', not 'drift'"),
]
"""Keys behind the depth, and what is said of them."""


def test_a_fence_of_a_file_is_that_of_its_corners(tmp_path: Path) -> None:
    frame = LocalFrame(43.9330937, 15.4443468)
    corners = [(-4.0, -4.0), (32.0, -4.0), (32.0, 25.0), (-4.0, 25.0)]
    zone = [(28.0, 20.0), (30.0, 20.0), (30.0, 22.0)]
    rings = [
        [list(reversed(frame.to_geographic(*it))) for it in (*ring, ring[0])] for ring in (corners, zone)
    ]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": rings}}
    (tmp_path / "waters.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    (tmp_path / "pool.csv").write_text((SCENARIO_FILES / "pool.csv").read_text())
    path = tmp_path / "fenced.yaml"
    path.write_text(POOL.replace(DEPTH, f"{DEPTH}\n  fence: waters.geojson"))
    fence = fence_of(load(path).area)
    for found, expected in zip((fence.corners, *fence.keep_out), (corners, zone), strict=True):
        assert [pytest.approx(it, abs=1e-5) for it in expected] == list(found)


@pytest.mark.parametrize("ending", ["", ", [43.9330937, 15.4443468]"], ids=["open", "closed"])
def test_an_area_in_degrees_is_that_of_its_corners(tmp_path: Path, ending: str) -> None:
    """27 m north and 20 m east of the origin, at 111 105 and 80 291 m a degree."""
    corners = f"[[43.9330937, 15.4443468], [43.9333367, 15.4443468], [43.9333367, 15.4445959]{ending}]"
    path = tmp_path / "degrees.yaml"
    path.write_text(POOL.replace(CORNERS, f"  polygon: {corners}"))
    (tmp_path / "pool.csv").write_text((SCENARIO_FILES / "pool.csv").read_text())
    area = load(path).area
    for found, expected in zip(area.polygon_m, [(0, 0), (27, 0), (27, 20)], strict=True):
        assert found == pytest.approx(expected, abs=0.01)
    assert "polygon" not in resolve(load(path))["area"]


AREAS = [
    (
        "polygon_m: [[43.9331, 15.4443], [43.9344, 15.4443], [43.9344, 15.4463], [43.9331, 15.4463]]",
        "area: polygon_m is 0.0013 by 0.002 m, and needs 1 m north and east: these look like degrees; "
        "write them as area.polygon, in pairs [latitude, longitude]",
    ),
    (
        "polygon: [[15.4443, 43.9331], [15.4443, 43.9344], [15.4463, 43.9344]]",
        " km from area.origin: correct the origin, or the order of the degrees; a list has [latitude, longitude]",
    ),
    ("polygon: harbour.geojson", "harbour.geojson: No such file or directory"),
    (
        "polygon: [[43.9331, 15.4443], 7]",
        "area.polygon: a corner is [latitude, longitude] in degrees, not 7",
    ),
    ("polygon: 7", "area.polygon: must be a file, or a list of [latitude, longitude], not 7"),
    ("polygon: [[43.9331, 15.4443]]", "area.polygon: the polygon needs three corners or more"),
    (
        "polygon_m: [[0, 0], [9, 0], [9, 9]]\n  polygon: a.geojson",
        "area.polygon_m is there, too: leave one out",
    ),
]
"""Keys in the place of the corners, and what is said of them."""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        *((DEPTH, f"{DEPTH}\n{keys}", message) for keys, message in FENCES),
        *((CORNERS, f"  {keys}", message) for keys, message in AREAS),
    ],
)
def test_an_area_a_fence_or_a_limit_that_cannot_be_is_refused(
    refusals: Refusals, old: str, new: str, message: str
) -> None:
    (line,) = refusals((old, new))
    assert message in line


RINGS = [
    [[15.444, 43.933], [15.446, 43.933], [15.446, 43.934], [15.444, 43.933]],
    [[15.445, 43.9332], [15.4451, 43.9332], [15.4451, 43.9333], [15.445, 43.9332]],
]


@pytest.mark.parametrize(
    ("key", "text", "told"),
    [
        ("polygon", json.dumps({"type": "Polygon", "coordinates": RINGS}), "has holes, and an area has none"),
        ("fence", "{}", ""),
        ("fence", "[]", ""),
        ("fence", '{"type": "Point", "coordinates": [1, 2]}', ""),
        ("fence", '{"type": "FeatureCollection", "features": []}', ""),
        ("fence", "no", ""),
    ],
)
def test_a_file_without_one_polygon_is_no_area_and_no_fence(
    tmp_path: Path, refusals: Refusals, key: str, text: str, told: str
) -> None:
    (tmp_path / "a.geojson").write_text(text)
    old, new = (CORNERS, "") if key == "polygon" else (DEPTH, f"{DEPTH}\n")
    (line,) = refusals((old, f"{new}  {key}: a.geojson"))
    assert line.startswith(f"area.{key}: ") and f"a.geojson: {told}" in line


def test_a_real_vehicle_takes_no_fault_and_its_scenario_has_all_it_needs() -> None:
    real = load(SCENARIOS / "real-apad.yaml")
    faulty = replace(real, apad=replace(real.apad, fault=Fault.STUCK))
    (unguarded, *_) = problems_with_real_vehicle(replace(real, guards=None))
    assert unguarded.startswith("a real aPad needs guards.battery_reserve in the scenario")
    assert [*problems_with_real_vehicle(real), *problems_with_real_vehicle(faulty)] == [
        "no fault is injected into a real aPad: leave apad.fault out"
    ]


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_scenario_loads_and_is_named_after_its_file(path: Path) -> None:
    scenario = load(path)
    assert scenario.name == path.stem
    if isinstance(scenario.fleet.start, RandomStart):
        assert path.stem in ("bay-120", "published-a")
    else:
        own = path.stem if path.stem in ("bay-24", "bay-24-fitted", "pool-12-fitted") else "pool-12"
        assert scenario.fleet.start == str(path.parent / f"{own}.csv")


def test_the_shipped_variants_of_the_pool_differ_in_nothing_else() -> None:
    pool, demo, idle = (load(SCENARIOS / f"{name}.yaml") for name in ("pool-12", "demo", "no-charging"))
    assert demo.time_stands_while_stopped
    as_pool = {"name": "pool-12", "description": pool.description, "time_stands_while_stopped": False}
    assert replace(demo, **as_pool) == pool
    collected = replace(idle.mission, collection="cautious")
    assert idle.mission.collection == "none"
    assert replace(idle, name="pool-12", description=pool.description, mission=collected) == pool


@pytest.mark.parametrize("name", ["pool-12", "bay-24"])
def test_a_scenario_of_searched_starts_differs_in_its_starts_and_seed_alone(name: str) -> None:
    own, fitted = load(SCENARIOS / f"{name}.yaml"), load(SCENARIOS / f"{name}-fitted.yaml")
    fleet = replace(fitted.fleet, start=own.fleet.start)
    assert replace(fitted, name=name, description=own.description, seed=own.seed, fleet=fleet) == own


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  batch: 4", "  batch: 4\n  batsh: 3", "mission.batsh: unknown key: did you mean batch?"),
        ("theta: 30", "theta: 30.0", "theta: must be a valid integer, not 30.0"),
        ("theta: 30", "theta: 0", "theta: must be greater than or equal to 1, not 0"),
        ("theta: 30", "theta: true", "theta: must be a valid integer, not true"),
        ("seed: 1\n", "seed: '1'\n", "seed: must be a valid integer, not '1'"),
        ("mass_kg: 25", "mass_kg: '25'", "apad.mass_kg: must be a valid number, not '25'"),
        ("mass_kg: 25", "mass_kg: yes", "apad.mass_kg: must be a valid number, not 'yes'"),
        ("mass_kg: 25", "mass_kg: true", "apad.mass_kg: must be a valid number, not true"),
        ("mass_kg: 25", "mass_kg: null", "apad.mass_kg: must be a valid number, not null"),
        ("mass_kg: 25", "mass_kg: .nan", "apad.mass_kg: must be a finite number, not NaN"),
        ("mass_kg: 25", "mass_kg: -.inf", "apad.mass_kg: must be a finite number, not -Infinity"),
        ("mass_kg: 25", "mass_kg: -25", "apad.mass_kg: must be greater than 0, not -25"),
        ("duration_s: 2400", "duration_s: 40:00", "duration_s: must be a valid number, not '40:00'"),
        (
            "victory_radius_m: 0.5",
            "victory_radius_m: 0",
            "mission.victory_radius_m: must be greater than 0, not 0",
        ),
        (
            "pool_threshold: 0.8",
            "pool_threshold: 80",
            "mission.pool_threshold: must be less than or equal to 1, not 80",
        ),
        (
            "profile: virtual",
            "profile: magic",
            "mission.docking.profile: must be 'virtual', 'camera' or 'visual', not 'magic'",
        ),
        ("profile: virtual, ", "", "mission.docking.profile: this key is missing"),
        ("[28, 21]", "[28, x]", "area.polygon_m[2][1]: must be a valid number, not 'x'"),
        ("[28, 0], [28, 21]", "[28, 21], [28, 0]", "area: polygon_m crosses or touches itself"),
        ("[28, 0], [28, 21], [0, 21]]", "[28, 0]]", "area: polygon_m needs three corners or more"),
        (
            "hearing: {mode: paper, positioning: ground_truth, report_period_s: 1}",
            "hearing: 1",
            "hearing: must be a mapping, not 1",
        ),
        (
            "report_period_s: 1",
            "report_period_s: 0.0005",
            "hearing.report_period_s: must be greater than or equal to 0.001, not 0.0005",
        ),
        (
            "dock_s: 15",
            "dock_s: 15.0004",
            "mission.docking.dock_s: must be a whole number of milliseconds, not 15.0004",
        ),
        (
            "name: pool",
            "name: ../pool",
            "name: must match pattern '^[A-Za-z0-9][A-Za-z0-9._-]*$', not '../pool'",
        ),
        ("start: pool.csv", "start: {charge: [0.9, 0.2]}", "fleet.start: charge must be [low, high]"),
        (
            "start: pool.csv",
            "start: {charge: [0.9, 2]}",
            "fleet.start.charge[1]: must be less than or equal to 1, not 2",
        ),
        ("start: pool.csv", "start: 5", "fleet.start: must be a valid string, not 5"),
        (
            "mode: paper, amplitude_m",
            "mode: physical, amplitude_m",
            "fleet.drift.amplitude_m: physical drift has no random step: "
            "leave this key out, or use mode: paper",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {wind: {north_m_s: 61, east_m_s: 0}}",
            "water.wind.north_m_s: must be less than or equal to 60, not 61",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {wind: {north_m_s: 6, east_m_s: 0, leeway: 0.3}}",
            "water.wind.leeway: must be less than or equal to 0.2, not 0.3",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {wifi: {slope_db: 0}}",
            "water.wifi.slope_db: must be greater than or equal to 0.000000001, not 0",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {wifi: {transmit_db: 20}}",
            "water.wifi.transmit_db: unknown key: did you mean transmit_dbm? (it is in dBm, not dB)",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {sound: {noise_db: 50}}",
            "water.sound.noise_db: unknown key: did you mean noise_db_per_hz? (it is in dB re 1 uPa^2/Hz, not dB)",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {wifi: {transmit_dbm: '20'}}",
            "water.wifi.transmit_dbm: must be a valid number, not '20'",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {sound: {source_level_db: 301}}",
            "water.sound.source_level_db: must be less than or equal to 300, not 301",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {sound: {turnaround_s: 0.0005}}",
            "water.sound: turnaround_s must be a whole number of milliseconds",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {sound: {speed_m_s: 1500}}",
            "water.sound.speed_m_s: unknown key here: did you mean mission.speed_m_s?",
        ),
        (
            "theta: 30",
            "theta: 30\nwater: {sound: {error_curve: {snrs_db: [1, 1], sizes: [4], rates: [[0.1, 0.2]]}}}",
            "water.sound.error_curve: snrs_db must be two or more, and rise",
        ),
        ("theta: 30", "theta: 30\nwater: {modems: v4}", "water.modems: must be 'v2' or 'v3', not 'v4'"),
        (
            "amplitude_m: 0.005}",
            "amplitude_m: 3e5}",
            "fleet.drift.amplitude_m: must be less than or equal to 100, not 300000.0",
        ),
        (
            "amplitude_m: 0.005}",
            "amplitude_m: 0.005}\n  spread: {drain: 0.31}",
            "fleet.spread.drain: must be less than or equal to 0.3, not 0.31",
        ),
        (
            "amplitude_m: 0.005}",
            "amplitude_m: 0.005}\n  spread: {capacity: -0.1}",
            "fleet.spread.capacity: must be greater than or equal to 0, not -0.1",
        ),
        (
            "full_threshold: 0.99",
            "full_threshold: 0.8",
            "mission.full_threshold: must be above mission.pool_threshold (0.8), "
            "or one that was charged would be a candidate again at once",
        ),
        (
            "full_threshold: 0.99",
            "full_threshold: 0.99\n  again_threshold: 0.8",
            "mission.again_threshold: must be below mission.pool_threshold (0.8), or it changes nothing: leave it out",
        ),
        (
            "full_threshold: 0.99",
            "full_threshold: 0.99\n  charge_to: 0.9\n  charge_lead: 0.9",
            "mission.charge_lead: must be below mission.charge_to (0.9), or it changes nothing: leave it out",
        ),
        (
            "full_threshold: 0.99",
            "full_threshold: 0.99\n  charge_lead: 1",
            "mission.charge_lead: must be below mission.full_threshold (0.99), or it changes nothing: leave it out",
        ),
        (
            "speed_m_s: 0.5 ",
            "speed_m_s: 2 ",
            "mission.speed_m_s: the aPad cannot go faster than apad.max_speed_m_s (1.0)",
        ),
        ("theta: 30", "theta: 30\ntheta: 31", "line 7, column 1: the key 'theta' is given twice"),
        (
            "[28, 21]",
            "[28, 21",
            "line 10, column 3: while parsing a flow sequence expected ',' or ']', but got '<scalar>'",
        ),
        (
            "seed: 1\n",
            "seed: !!python/name:os.system 1\n",
            "line 4, column 7: could not determine a constructor for the tag "
            "'tag:yaml.org,2002:python/name:os.system'",
        ),
        ("mass_kg: 25", "? [1]\n  : 25", "line 44, column 5: a key must be a text"),
        # A key in the wrong block is told the block; one like no other, and one in an item of a list, those there are.
        (
            "theta: 30",
            "theta: 30\nspeed_m_s: 0.5",
            "speed_m_s: unknown key here: did you mean mission.speed_m_s?",
        ),
        (
            "{mode: paper, amplitude_m: 0.005}",
            "{mode: paper, zz: 1}",
            "fleet.drift.zz: unknown key; known here: mode, amplitude_m, current_file, current_m_s",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5], zz: 1}]",
            "apads[0].zz: unknown key; known here: name, start_m, battery_start_fraction, fault",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5], start_s: 1}]",
            "apads[0].start_s: unknown key: did you mean start_m? (it is in metres, not seconds)",
        ),
        # Ids have room in a packet, and a batch in the docks.
        (
            "  count: 12",
            "  count: 12\n  first_id: 65525",
            "fleet: first_id: an aMussel's id is 65535 at most, not 65536",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5]}]\nsharing: {consensus: {silences: [{apad: apad3}]}}",
            "sharing.consensus.silences[0].apad: no such aPad; there are apad1, apad2",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5]}]\n"
            "sharing: {consensus: {silences: [{apad: apad2, from_s: 9, to_s: 9}]}}",
            "sharing.consensus.silences[0].to_s: not after from_s",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5]}]\nsharing: {consensus: {lease_s: 100, delay_s: 5}}",
            "sharing.consensus.lease_s: a docking and five exchanges of messages must fit into it: at least 130",
        ),
        (
            "theta: 30",
            "theta: 30\napads: [{name: apad2, start_m: [5, 5]}]\nsharing: {transfers: false, consensus: {}}",
            "sharing.consensus: nothing is agreed on without transfers: leave one of both out",
        ),
        (
            "theta: 30",
            "theta: 30\nsharing: {consensus: {}}",
            "sharing.consensus: one aPad has nobody to agree with: leave it out, or name more `apads`",
        ),
        (
            "\napad:\n",
            "\napad:\n  docks: 2\n",
            "mission.batch: 4 aMussels do not fit into 2 docks (apad.docks): leave it out, or lower it",
        ),
        *(
            ("\napad:\n", f"\napad:\n  docks: {docks}\n", f"apad.docks: must be {what}, not {told}")
            for docks, what, told in (
                ("0", "greater than or equal to 1", "0"),
                ("17", "less than or equal to 16", "17"),
                ("2.5", "a valid integer", "2.5"),
                ("true", "a valid integer", "true"),
                ('"4"', "a valid integer", "'4'"),
            )
        ),
        (
            "\napad:\n",
            "\napad:\n  docks: 6\n  generation: b\n",
            "apad: docks: 6 are more than the 4 that an aPad of generation b can name",
        ),
    ],
)
def test_one_mistake_is_one_line_with_the_path(refusals: Refusals, old: str, new: str, message: str) -> None:
    assert refusals((old, new)) == [message]


LONG = "x" * 300
SEVERAL: dict[str, tuple[list[tuple[str, str]], list[str]]] = {
    "a key in another unit is told the unit": (
        [("speed_m_s: 0.5 ", "speed_km_h: 1.8 ")],
        [
            "mission.speed_m_s: this key is missing",
            "mission.speed_km_h: unknown key: did you mean speed_m_s? (it is in m/s, not km/h)",
        ],
    ),
    "a key without its unit is told the unit": (
        [("silence_timeout_s: 120", "silence_timeout: 120")],
        [
            "mission.silence_timeout_s: ",
            "mission.silence_timeout: unknown key: did you mean silence_timeout_s? (it is in seconds)",
        ],
    ),
    "a key with a line break or a terminal's code is told in one line": (
        [(DEPTH, DEPTH + '\n  "dep\\nth\\e[31m": 1')],
        ["area.dep\\nth\\x1b[31m: unknown key"],
    ),
    "all mistakes are listed at once": (
        [("theta: 30", "theta: no"), ("  batch: 4", "  batch: 17"), ("hotel_w: 25", "hotel_w: -1")],
        ["theta: ", "mission.batch: ", "apad.battery.hotel_w: "],
    ),
    "files that are not there are named": (
        [("start: pool.csv", "start: nix.csv"), ("0.005}", "0.005, current_file: tide.csv}")],
        [
            "fleet.start: no such file or directory: HERE/nix.csv",
            "fleet.drift.current_file: HERE/tide.csv: No such file or directory",
        ],
    ),
    "names that no file can have": (
        [("start: pool.csv", f"start: {LONG}"), ("0.005}", '0.005, current_file: "tide\\0.csv"}')],
        ["fleet.start: File name too long: '/", "fleet.drift.current_file: no name of a file: '/"],
    ),
    "a current that cannot be read is refused with its line": (
        [("0.005}", "0.005, current_file: fast.csv}")],
        ["fleet.drift.current_file: HERE/fast.csv: line 2: east_m_s: must be a number, not 'fast'"],
    ),
}
"""Changes, and how each line of what is said begins."""


@pytest.mark.parametrize(("changes", "begins"), SEVERAL.values(), ids=SEVERAL)
def test_what_is_said_of_several_changes_and_of_files(
    refusals: Refusals, tmp_path: Path, changes: list[tuple[str, str]], begins: list[str]
) -> None:
    (tmp_path / "fast.csv").write_text("north_m,east_m,north_m_s,east_m_s\n0,0,0,fast\n")
    told = [it.replace(str(tmp_path), "HERE") for it in refusals(*changes)]
    assert [line[: len(begin)] for line, begin in zip(told, begins, strict=True)] == begins


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file or directory"),
        (b"name: caf\xe9\n", "is not UTF-8 text"),
        (b"", "a scenario is a mapping of keys to values, not null"),
        (b"- 1\n", "a scenario is a mapping of keys to values, not [1]"),
        (b"a: &a [*a]\n", "Circular reference detected"),
        (b"[" * 5000, "nested too deeply"),
        (
            b"a: 1\n---\nb: 1\n",
            "line 2, column 1: expected a single document in the stream but found another document",
        ),
    ],
    ids=lambda it: repr(it)[:40],
)
def test_what_is_no_scenario_at_all(tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "x.yaml").write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path / "x.yaml")
    assert caught.value.lines == (f"{tmp_path}/x.yaml: {message}",)


def test_numbers_are_read_as_they_look(tmp_path: Path) -> None:
    text = POOL.replace("pool.csv", str(SCENARIO_FILES / "pool.csv"))
    text = text.replace("duration_s: 2400", "duration_s: 2.4e3")
    (tmp_path / "x.yaml").write_text(text.replace("amplitude_m: 0.005", "amplitude_m: 5e-3"))
    found, plain = load(tmp_path / "x.yaml"), load(POOL_FILE)
    assert replace(found, fleet=replace(found.fleet, start=plain.fleet.start)) == plain


@pytest.mark.parametrize(("file", "profile"), [(POOL_FILE, "worst-case"), (WHOLE_FILE, "mu")])
def test_a_hardware_profile_gives_the_numbers_that_a_scenario_may_write_itself(
    file: Path, profile: str, tmp_path: Path
) -> None:
    by_hand, data = load(file), yaml.safe_load(file.read_text())
    # What may fail is not of the hardware.
    data["board"] = {"profile": profile, "surfacing_failure_probability": 0}
    data["apad"] = {"profile": "paper", "start_m": data["apad"]["start_m"], "dock_miss_probability": 0}
    data["fleet"]["start"] = by_hand.fleet.start
    (tmp_path / "x.yaml").write_text(yaml.safe_dump(data))
    by_profile = load(tmp_path / "x.yaml")
    assert (by_profile.board.profile is None, by_profile.apad.profile) == (False, "paper")
    board, apad = replace(by_profile.board, profile=None), replace(by_profile.apad, profile=None)
    assert replace(by_profile, board=board, apad=apad) == by_hand


def test_a_value_beside_a_profile_wins_and_a_profile_that_is_none_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    data = yaml.safe_load(POOL_FILE.read_text()) | {"board": {"profile": "worst-case"}}
    data["fleet"]["start"] = str(SCENARIO_FILES / "pool.csv")
    data["apad"] = {"profile": "paper", "start_m": [14, 10.5], "battery": {"capacity_wh": 500}}
    path.write_text(yaml.safe_dump(data))
    battery = load(path).apad.battery
    assert (battery.capacity_wh, battery.hotel_w) == (500, 25)
    path.write_text(path.read_text().replace("worst-case", "worst"))
    with pytest.raises(ScenarioError) as caught:
        load(path)
    assert caught.value.lines == (f"{path}: board.profile: must be 'worst-case' or 'mu', not 'worst'",)


def test_aliases_that_multiply_are_refused_before_they_are_written_out(tmp_path: Path) -> None:
    levels = [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    (tmp_path / "x.yaml").write_text("\n".join(["a0: &a0 [1]", *levels]) + "\n")
    with pytest.raises(ScenarioError, match="holds more than 100000 values"):
        load(tmp_path / "x.yaml")


def test_overrides_change_what_they_name_and_nothing_else() -> None:
    pool = load(POOL_FILE)
    changed = with_overrides(pool, theta=1, agents=4, strategy="greedy", seed=7)
    found = changed.theta, changed.fleet.count, changed.mission.collection, changed.seed
    assert found == (1, 4, "greedy", 7)
    back = with_overrides(changed, theta=30, agents=12, strategy="cautious", seed=1)
    assert back == with_overrides(pool) == pool
    with pytest.raises(ScenarioError) as caught:
        with_overrides(pool, theta=0, agents=-1)
    assert caught.value.lines == (
        "command line: theta: must be greater than or equal to 1, not 0",
        "command line: fleet.count: must be greater than or equal to 0, not -1",
    )


def test_strategies_are_looked_up_by_who_flies_them_and_told_all_at_once() -> None:
    pool = load(POOL_FILE)
    mission = replace(pool.mission, collection="greedy-redeploy", redeployment="home")
    with pytest.raises(ScenarioError) as caught:
        check_code(replace(pool, mission=mission), "x", None)
    assert caught.value.lines == (
        "x: mission.collection: strategy 'greedy-redeploy' (from musselbed itself) is no collect strategy: it needs "
        "`plans = StepKind.COLLECT` and a method `plan(self, situation, batch)`",
        "x: mission.redeployment: unknown strategy 'home'; known: greedy-redeploy; one of your own is FILE.py:Class",
    )


LONG_MISSION = {"duration_s": 360_000, "mission.end_at_apad_fraction": 0.1}
HOME = {"charging_w": 200, "go_at": 0.3}


@pytest.mark.parametrize(
    ("file", "changes", "mends"),
    [
        pytest.param(
            WHOLE_FILE,
            {"hearing.mode": "paper", "water": {"links_file": "links.csv"}},
            ["use hearing.mode: physical, as sound-12 does, or the fault link_cut"],
            id="links that cut nothing",
        ),
        pytest.param(
            WHOLE_FILE,
            {"hearing.mode": "physical", "water": {"links_file": "links.csv"}},
            [],
            id="links that cut",
        ),
        pytest.param(WHOLE_FILE, {"hearing.mode": "paper", "water": {}}, [], id="no links"),
        # Without a home its battery would not last.
        *(
            pytest.param(POOL_FILE, {**LONG_MISSION, "apad.home": {**HOME, **home}}, mends, id=f"home {home}")
            for home, mends in (
                ({}, []),
                ({"charging_w": 60}, ["raise apad.home.charging_w"]),
                ({"charging_w": 60, "docked": "released"}, []),
                ({"go_at": 0.1}, ["raise apad.home.go_at"]),
            )
        ),
    ],
)
def test_what_does_not_help_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: Path, changes: dict[str, Any], mends: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("links.csv").write_text("from, to, loss, since_s, until_s\n*, apad, 1, 600, 1200\n")
    data = resolve(load(file))
    for key, value in changes.items():
        block, _, name = key.rpartition(".")
        (data[block] if block else data)[name] = value
    assert [mend for _, mend in warnings(from_data(data, "x"))] == mends


@pytest.mark.parametrize(
    ("value", "line"),
    [
        ("!!bool maybe", "not of the form of `!!bool`: 'maybe'"),
        ("!!bool yes", "not of the form of `!!bool`: 'yes'"),
        ("!!int ''", "not of the form of `!!int`: ''"),
        ("!!int 0x1", "not of the form of `!!int`: '0x1'"),
        ("!!int 1_000", "not of the form of `!!int`: '1_000'"),
        ("!!int 1:30", "not of the form of `!!int`: '1:30'"),
        ("!!int 012", "not of the form of `!!int`: '012'"),
        ("!!int [1]", "not of the form of `!!int`: a list or a mapping"),
        ("!!float x", "not of the form of `!!float`: 'x'"),
        ("!!null x", "not of the form of `!!null`: 'x'"),
        ("!!map [1]", "`!!map` is not before a mapping"),
        ("!!map 1", "`!!map` is not before a mapping"),
        ("!!seq {a: 1}", "expected a sequence node"),
        ("!!set {a}", "could not determine a constructor"),
        (5000 * "9", "not of the form of `!!int`: '9999"),
    ],
)
def test_a_tag_changes_no_values_form(refusals: Refusals, value: str, line: str) -> None:
    (found,) = refusals(("seed: 1", f"seed: {value}"))
    number = POOL[: POOL.index("seed: 1")].count("\n") + 1
    assert found.startswith(f"line {number}, column 7: {line}")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("!!int 7", 7),
        ("!!float 3", 3.0),
        ("!!bool true", True),
        ("!!null ~", None),
        ("-.inf", -math.inf),
        ("+.Inf", math.inf),
        (".5e1", 5.0),
        ("1e-3", 0.001),
        ("-0", 0),
    ],
)
def test_values_are_those_of_the_core_schema(text: str, value: object) -> None:
    found = parse_yaml(f"a: {text}")["a"]
    assert found == value and type(found) is type(value)
    assert math.isnan(parse_yaml(".nan"))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("/dev/zero", "/dev/zero: is a device"),
        ("pipe", r"is a pipe, and nobody writes into it within 0\.1 s"),
    ],
)
def test_a_device_or_a_pipe_into_which_nobody_writes_is_told_and_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, told: str
) -> None:
    monkeypatch.setattr(text_file, "PIPE_S", 0.1)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "x.yaml").write_text(POOL.replace("pool.csv", name))
    with pytest.raises(ScenarioError, match=told):
        starts_of(load(tmp_path / "x.yaml"))
    with pytest.raises(ScenarioError, match=told):
        load(tmp_path / name)


def test_a_scenario_from_a_pipe_is_read_whole(tmp_path: Path) -> None:
    text = POOL.replace("pool.csv", str(SCENARIO_FILES / "pool.csv")) + "#" * 200_000
    reader, writer = os.pipe()

    def write() -> None:
        with open(writer, "w") as file:
            file.write(text)

    writing = threading.Thread(target=write)
    writing.start()
    assert load(Path(f"/dev/fd/{reader}")).fleet.count == 12
    writing.join()
    os.close(reader)


def test_a_mission_lasts_the_whole_milliseconds_that_its_file_states() -> None:
    """In binary 1.001 s are a little less than 1001 ms."""
    lasting = [replace(load(POOL_FILE), duration_s=it).duration_ms for it in (1.001, 120.004, 9600)]
    assert lasting == [1001, 120_004, 9_600_000]

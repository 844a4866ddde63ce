"""Starts: drawn at random, read from CSVs good and bad, from a former run, and saved."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.area.polygon import contains
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve, with_overrides, write_resolved
from apad_bridge.scenario.schema import Area, Origin, RandomStart, Scenario, SpreadOptions
from apad_bridge.scenario.starts import further_columns, random_start, read_starts, save_starts, starts_of
from apad_bridge.scenario.starts_table import Start
from firmware_model.packets.wire import MAX_AGENT_ID

ORIGIN = Origin(latitude_deg=43.9330937, longitude_deg=15.4443468)
POOL = Area(origin=ORIGIN, polygon_m=((0, 0), (28, 0), (28, 21), (0, 21)), depth_m=3)
# An L of 3 quarters of a square: 40 x 40 without its north-eastern 20 x 20.
L_SHAPE = Area(origin=ORIGIN, polygon_m=((0, 0), (40, 0), (40, 20), (20, 20), (20, 40), (0, 40)), depth_m=3)
ANY_CHARGE = RandomStart(charge=(0.0, 1.0))


def refused(path: Path, area: Area = POOL, count: int = 1) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        read_starts(path, area, range(1, count + 1))
    return [line.removeprefix(str(path)) for line in caught.value.lines]


@given(st.integers(0, 2**63 - 1), st.integers(1, 20000), st.floats(0, 1), st.floats(0, 1))
def test_a_random_start_lies_inside(seed: int, agent_id: int, one: float, other: float) -> None:
    low, high = sorted((one, other))
    start = random_start(seed, agent_id, L_SHAPE, RandomStart(charge=(low, high)))
    assert contains(L_SHAPE.polygon_m, (start.north_m, start.east_m)) and low <= start.primary <= high
    assert (start.agent_id, start.secondary) == (agent_id, 1.0)


def test_random_starts_are_uniform() -> None:
    starts = [random_start(5, agent_id, L_SHAPE, ANY_CHARGE) for agent_id in range(1, 3001)]
    # The L holds 12 cells of 10 x 10 m, with 250 each. Chi-square with 11 and 9 degrees of freedom, p = 0.001.
    wanted = [(north, east) for north in range(4) for east in range(4) if not (north >= 2 and east >= 2)]
    cells = Counter((int(start.north_m // 10), int(start.east_m // 10)) for start in starts)
    tenths = Counter(int(start.primary * 10) for start in starts)
    assert set(cells) <= set(wanted) and sum((cells[it] - 250) ** 2 / 250 for it in wanted) < 31.26
    assert sum((tenths[it] - 300) ** 2 / 300 for it in range(10)) < 27.88


def test_an_agents_start_does_not_depend_on_the_others() -> None:
    pool = load(POOL_FILE)
    twelve = replace(pool, fleet=replace(pool.fleet, start=ANY_CHARGE))
    of_twelve = starts_of(twelve)
    assert starts_of(with_overrides(twelve, agents=5)) == of_twelve[:5]
    two = replace(twelve, fleet=replace(twelve.fleet, first_id=4, count=2))
    assert starts_of(two) == of_twelve[3:5]
    assert starts_of(with_overrides(twelve, seed=2))[0] != of_twelve[0]
    assert [start.agent_id for start in of_twelve] == list(range(1, 13))
    assert len({start.primary for start in of_twelve}) == 12


@pytest.mark.parametrize(
    ("text", "starts"),
    [
        (
            "# mine\n\nid, north, east, battery\n7, 1.5, 2, 0.5\n3,10,20.25,1\n",
            (Start(3, 10.0, 20.25, 1.0), Start(7, 1.5, 2.0, 0.5)),
        ),
        ("agent_id,north_m,east_m,charge\n1,2,3,0.5\n", (Start(1, 2.0, 3.0, 0.5),)),
        ("\ufeffID,North,East,primary\n1,2,3,0.5\n", (Start(1, 2.0, 3.0, 0.5),)),
        # 6.3e-6 deg at 111 105 m a degree of latitude, 5.32e-5 deg at 80 291 m a degree of longitude
        (
            "battery,Longitude,latitude,ID\n0.5,15.4444,43.9331,2\n",
            (Start(2, pytest.approx(0.700, abs=0.001), pytest.approx(4.2715, abs=0.001), 0.5),),
        ),
    ],
)
def test_a_hand_written_file(tmp_path: Path, text: str, starts: tuple[Start, ...]) -> None:
    (tmp_path / "s.csv").write_text(text, encoding="utf-8")
    assert read_starts(tmp_path / "s.csv", POOL, [it.agent_id for it in starts]) == starts


ROWS = [
    ("1,nan,3,0.5", "north: must be a finite number, not nan"),
    ("1,2,inf,0.5", "east: must be a finite number, not inf"),
    ("1,2,x,0.5", "east: must be a number, not 'x'"),
    ("1,24_0,2,0.5", "north: must be a number, not '24_0'"),
    ("1,2,\u0663,0.5", "east: must be a number, not '\u0663'"),
    ("1,2,,0.5", "east: must be a number, not ''"),
    ("1,2,3,1.01", "battery: must be a charge in [0, 1], not 1.01"),
    ("1,2,3,-0.1", "battery: must be a charge in [0, 1], not -0.1"),
    ("1,2,3,nan", "battery: must be a finite number, not nan"),
    ("1,2,3", "3 values for 4 columns"),
    ("1,2,3,0.5,9", "5 values for 4 columns"),
    ("0,2,3,0.5", "id: must be a whole number from 1 on, not '0'"),
    ("1.0,2,3,0.5", "id: must be a whole number from 1 on, not '1.0'"),
    ("-1,2,3,0.5", "id: must be a whole number from 1 on, not '-1'"),
    ("2147483648,2,3,0.5", "id: must be a whole number from 1 on, not '2147483648'"),
    ("8,2,3,0.5", "id 8 is in line 2 already"),
    ("1,2,300,0.5", "aMussel 1 lies outside of the area: north 2.0 m, east 300.0 m"),
    ("1,-40,3,0.5", "aMussel 1 lies outside of the area: north -40.0 m, east 3.0 m"),
]
"""In line 4, after one of aMussel 8, and what is said of it."""
HEADERS = [
    ("id,north,east,batery", "unknown column 'batery'; did you mean battery?"),
    ("id,north,east,battery,secondry", "unknown column 'secondry'; did you mean secondary?"),
    ("id,lattitude,longitude,battery", "unknown column 'lattitude'; did you mean latitude?"),
    ("id,north,east,battery,note,note", "column 'note': note exists already"),
    ("id,north,east", "column battery is missing"),
    ("north,east,battery", "column id is missing"),
    ("id,battery", "columns lat and lon, or north and east, are missing"),
    ("id,lat,battery", "columns lat and lon go together"),
    ("id,lat,lon,north,battery", "columns north and east go together"),
    ("id,north,east,battery,charge", "column 'charge': battery exists already"),
]
"""In line 2, and how what is said of it begins."""
WHOLE = [
    ("id,north,east,battery\n1,x,0,1\n2,0,0,1\n3,0,0,2\n", [":2: ", ":4: "]),
    ("# nothing\n\n", [": no header: "]),
    (
        "id,north,east,battery\n9,1,1,1\n4,1,1,1\n6,1,1,1\n2,1,1,1\n",
        [
            ": no row for 1, 3, 5; its ids are 2, 4, 6, 9: "
            "leave fleet.count and fleet.first_id out to take the file's ids, "
        ],
    ),
]


@pytest.mark.parametrize(
    ("text", "begins"),
    [
        *((f"id,north,east,battery\n8,1,1,1\n\n{row}\n", [f":4: {message}"]) for row, message in ROWS),
        *((f"# starts\n{header}\n1,2,3,0.5\n", [f":2: {message}"]) for header, message in HEADERS),
        *WHOLE,
    ],
)
def test_a_file_with_mistakes_is_told_each_with_its_line(
    tmp_path: Path, text: str, begins: list[str]
) -> None:
    (tmp_path / "s.csv").write_text(text)
    told = refused(tmp_path / "s.csv", count=5)
    assert [line[: len(begin)] for line, begin in zip(told, begins, strict=True)] == begins


def test_further_columns_are_kept_and_named(tmp_path: Path) -> None:
    """Altitude and note are nearly our latitude and north, which are there: nobody has misspelled a column."""
    given = tmp_path / "phone.csv"
    given.write_text(
        'id,latitude,longitude,altitude,note,battery\n4,43.9331,15.4444,12.5,"by the buoy, red",0.5\n'
    )
    starts = read_starts(given, POOL, [4])
    assert starts[0].further == (("altitude", "12.5"), ("note", "by the buoy, red"))
    assert further_columns(starts) == ["altitude", "note"]
    save_starts(tmp_path / "kept.csv", starts, ORIGIN)
    assert read_starts(tmp_path / "kept.csv", POOL, [4]) == starts


def test_where_no_starts_are(tmp_path: Path) -> None:
    assert refused(tmp_path / "none.csv") == [": No such file or directory"]
    assert refused(tmp_path) == [": no former run: it holds neither ends.csv nor starts.csv"]


def test_two_places_that_differ_are_refused(tmp_path: Path) -> None:
    save_starts(tmp_path / "s.csv", [Start(1, 5.0, 6.0, 0.5)], ORIGIN)
    assert read_starts(tmp_path / "s.csv", POOL, [1])[0].north_m == 5.0
    elsewhere = replace(POOL, origin=Origin(latitude_deg=43.94, longitude_deg=15.4443468))
    (line,) = refused(tmp_path / "s.csv", elsewhere)
    assert re.match(r":2: lat, lon and north, east are 767\.\d\d m apart: ", line)


def test_rows_of_others_are_not_taken(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("id,north,east,battery\n" + "".join(f"{k},1,1,1\n" for k in (9, 4, 6, 2)))
    taken = {ids: read_starts(tmp_path / "s.csv", POOL, ids) for ids in ((4, 6), ())}
    assert {ids: tuple(it.agent_id for it in starts) for ids, starts in taken.items()} == {
        (4, 6): (4, 6),
        (): (),
    }


charges = st.floats(0, 1)


@given(
    st.lists(
        st.builds(Start, st.integers(1, MAX_AGENT_ID), st.floats(0, 28), st.floats(0, 21), charges, charges),
        unique_by=lambda start: start.agent_id,
    )
)
def test_saved_starts_are_read_exactly(tmp_path_factory: pytest.TempPathFactory, starts: list[Start]) -> None:
    path = tmp_path_factory.mktemp("saved") / "starts.csv"
    save_starts(path, starts, ORIGIN)
    assert read_starts(path, POOL, {it.agent_id for it in starts}) == tuple(
        sorted(starts, key=lambda start: start.agent_id)
    )
    assert [entry.name for entry in path.parent.iterdir()] == ["starts.csv"]


def test_saved_starts_hold_lat_and_lon(tmp_path: Path) -> None:
    save_starts(tmp_path / "s.csv", [Start(4, 12.5, -3.25, 0.75, 0.5)], ORIGIN)
    header, row = (tmp_path / "s.csv").read_text().splitlines()
    agent_id, lat, lon, *rest = row.split(",")
    assert header == "id,lat,lon,north,east,battery,secondary"
    assert (agent_id, rest) == ("4", ["12.5", "-3.25", "0.75", "0.5"])
    assert LocalFrame.about(ORIGIN).to_local(float(lat), float(lon)) == pytest.approx((12.5, -3.25), abs=2e-4)


def test_a_former_runs_ends_come_before_its_starts_and_may_have_drifted_away(tmp_path: Path) -> None:
    for name, start in (("starts", Start(1, 5.0, 6.0, 0.5)), ("ends", Start(1, -90.0, 6.0, 0.25, 0.0))):
        save_starts(tmp_path / f"{name}.csv", [start], ORIGIN)
        assert read_starts(tmp_path, POOL, [1]) == (start,)


def test_a_failed_save_leaves_the_old_file_as_it_was(tmp_path: Path) -> None:
    save_starts(tmp_path / "s.csv", [Start(1, 5.0, 6.0, 0.5)], ORIGIN)
    before = (tmp_path / "s.csv").read_bytes()
    with pytest.raises(ValueError, match="too far from the origin"):
        save_starts(tmp_path / "s.csv", [Start(1, 1e9, 6.0, 0.5)], ORIGIN)
    assert (tmp_path / "s.csv").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


GAPS = (3, 7, 12, 24)


def with_gaps(folder: Path, ids: Iterable[int] = GAPS, **fleet: object) -> Scenario:
    """The pool with a CSV of these ids, and no count but one in `fleet`."""
    rows = "".join(f"{agent_id},1,1,0.9\n" for agent_id in ids)
    (folder / "s.csv").write_text("id,north,east,battery\n" + rows)
    data = resolve(load(POOL_FILE))
    for key in ("count", "first_id", "agent_ids"):
        del data["fleet"][key]
    data["fleet"] |= {"start": str(folder / "s.csv"), **fleet}
    return from_data(data, "gaps.yaml")


def test_a_fleet_takes_its_files_ids(tmp_path: Path) -> None:
    scenario = with_gaps(tmp_path)
    fleet = scenario.fleet
    assert (fleet.ids, fleet.all_ids, fleet.count, fleet.first_id) == (GAPS, GAPS, 4, 3)
    assert [start.agent_id for start in starts_of(scenario)] == list(GAPS)
    write_resolved(tmp_path / "scenario.yaml", scenario)
    assert load(tmp_path / "scenario.yaml") == scenario
    (tmp_path / "s.csv").rename(tmp_path / "starts.csv")
    assert with_gaps(tmp_path, GAPS, start=str(tmp_path)).fleet.ids == GAPS


@given(ids=st.sets(st.integers(1, MAX_AGENT_ID), max_size=30), agents=st.integers(0, 30))
def test_the_lowest_ids_of_any_file_fly(
    tmp_path_factory: pytest.TempPathFactory, ids: set[int], agents: int
) -> None:
    scenario = with_gaps(tmp_path_factory.mktemp("ids"), ids)
    assert list(scenario.fleet.ids) == sorted(ids)
    if agents <= len(ids):
        fewer = with_overrides(scenario, agents=agents)
        assert [start.agent_id for start in starts_of(fewer)] == sorted(ids)[:agents]


def test_ids_from_first_id_on_and_ids_with_drawn_starts(tmp_path: Path) -> None:
    assert with_gaps(tmp_path, first_id=7).fleet.ids == (7, 12, 24)
    assert list(with_gaps(tmp_path, range(4, 9), first_id=6).fleet.ids) == [6, 7, 8]
    drawn = with_gaps(tmp_path, start={"charge": [0.5, 0.9]}, agent_ids=[3, 7])
    assert [start.agent_id for start in starts_of(drawn)] == [3, 7]


@pytest.mark.parametrize(
    ("said", "agents", "told"),
    [
        *(
            (said, None, r"leave fleet\.count and fleet\.first_id out")
            for said in ({"count": 4}, {"count": 4, "first_id": 3}, {"first_id": 5}, {"count": 2})
        ),
        *(
            ({"agent_ids": ids}, None, "agent_ids")
            for ids in ([7, 3], [3, 3], [0, 2], [2, "x"], ["x"], [2, 2**31])
        ),
        ({}, 5, "--agents 5: the fleet has 4, 3, 7, 12, 24"),
    ],
    ids=str,
)
def test_a_count_or_ids_that_the_file_does_not_have_are_refused(
    tmp_path: Path, said: dict[str, object], agents: int | None, told: str
) -> None:
    with pytest.raises(ScenarioError, match=told):
        starts_of(with_overrides(with_gaps(tmp_path, **said), agents=agents))


def test_secondaries_start_below_full_where_nobody_states_their_charge(tmp_path: Path) -> None:
    (tmp_path / "unstated.csv").write_text("id,north,east,battery\n1,5,5,0.7\n2,6,6,0.8\n3,7,7,0.9\n")
    (tmp_path / "stated.csv").write_text(
        "id,north,east,battery,secondary\n1,5,5,0.7,1\n2,6,6,0.8,0.5\n3,7,7,0.9,1\n"
    )
    pool = load(POOL_FILE)
    spread = SpreadOptions(secondary_start=0.1)
    unstated, stated = (str(tmp_path / f"{it}.csv") for it in ("unstated", "stated"))
    asked = [(unstated, spread), (ANY_CHARGE, spread), (stated, spread), (unstated, SpreadOptions())]
    fleets = [replace(pool.fleet, count=3, start=start, spread=it) for start, it in asked]
    drawn, random, *others = (
        [it.secondary for it in starts_of(replace(pool, fleet=fleet))] for fleet in fleets
    )
    assert len(set(drawn)) == 3 and all(0.7 <= charge < 1 for charge in drawn)
    assert (random, others) == (drawn, [[1.0, 0.5, 1.0], [1.0, 1.0, 1.0]])

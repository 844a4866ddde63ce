"""`musselbed new` and `musselbed python`: from any folder, with nothing of the clone to name."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from apad_bridge.commands.main import main
from apad_bridge.scenario.loader import SHIPPED, load, resolve
from apad_bridge.scenario.starts import starts_of

NAMES = sorted(it.stem for it in SHIPPED.glob("*.yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_is_the_scenario_with_another_name_and_files_of_its_own(name: str, tmp_path: Path) -> None:
    copy = tmp_path / "mine.yaml"
    assert main(["new", str(copy), "--like", name]) == 0
    copied, shipped = resolve(load(copy)), resolve(load(Path(name)))
    assert copied.pop("name") == "mine" and shipped.pop("name") == name
    for starts in (copied["fleet"], shipped["fleet"]):
        if isinstance(starts["start"], str):
            starts["start"] = Path(starts["start"]).read_text()
    assert copied == shipped
    assert str(SHIPPED) not in copy.read_text()


def test_the_comments_of_a_copy_stay(tmp_path: Path) -> None:
    main(["new", str(tmp_path / "mine.yaml"), "--like", "sound-12"])
    lines = (tmp_path / "mine.yaml").read_text().splitlines()
    shipped = (SHIPPED / "sound-12.yaml").read_text().splitlines()
    assert [it for it in lines if it not in shipped] == ["name: mine"]


# A harbour of 0.001 by 0.002 degrees at 43.93 N: a degree is 111 105 m north and 80 291 m east there.
HARBOUR = [[15.444, 43.933], [15.446, 43.933], [15.446, 43.934], [15.444, 43.934], [15.444, 43.933]]


def harbour(folder: Path) -> Path:
    file = folder / "harbour.geojson"
    polygon = {"type": "Polygon", "coordinates": [HARBOUR]}
    file.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": polygon}))
    return file


def test_an_area_and_places_of_a_phone_become_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "phone.csv").write_text(
        "name,latitude,longitude\nbuoy,43.9335,15.4450\npier,43.9332,15.4455\n"
    )
    words = ["--from", str(harbour(tmp_path)), "--starts", str(tmp_path / "phone.csv")]
    assert main(["new", str(tmp_path / "mine.yaml"), *words]) == 0
    scenario = load(tmp_path / "mine.yaml")
    norths, easts = zip(*scenario.area.polygon_m, strict=True)
    assert (min(norths), max(norths)) == pytest.approx((0, 111.1), abs=0.1)
    assert (min(easts), max(easts)) == pytest.approx((0, 160.6), abs=0.1)
    assert 0 < scenario.apad.start_m[0] < 111 and 0 < scenario.apad.start_m[1] < 160
    buoy, pier = starts_of(scenario)
    names = [(it.agent_id, it.further) for it in (buoy, pier)]
    assert names == [(1, (("name", "buoy"),)), (2, (("name", "pier"),))]
    assert (buoy.north_m, buoy.east_m) == pytest.approx((55.6, 80.3), abs=0.1)
    assert all(0.6 <= it.primary <= 0.9 for it in (buoy, pier))


POINT = '{"type": "Point", "coordinates": [15.4, 43.9]}'
NEW: dict[str, tuple[dict[str, str], list[str], int, str, list[str]]] = {
    "starts that lack nothing are named as they are": (
        {"s.csv": "id,lat,lon,battery\n7,43.9335,15.445,0.5\n"},
        ["mine.yaml", "--from", "harbour.geojson", "--starts", "s.csv"],
        0,
        "",
        ["mine.yaml"],
    ),
    "two copies in a folder share their starts": (
        {"pool-12.csv": (SHIPPED / "pool-12.csv").read_text()},
        ["mine.yaml", "--like", "pool-12"],
        0,
        "",
        ["mine.yaml"],
    ),
    "a copy overwrites no other starts": (
        {"pool-12.csv": "id,north,east,battery\n1,1,1,1\n"},
        ["mine.yaml", "--like", "pool-12"],
        2,
        "is there already, and is another file",
        [],
    ),
    "a list is no area": (
        {"a.geojson": "[]"},
        ["mine.yaml", "--from", "a.geojson"],
        2,
        "a.geojson: is no GeoJSON of polygons",
        [],
    ),
    "a point is no area": (
        {"a.geojson": POINT},
        ["mine.yaml", "--from", "a.geojson"],
        2,
        "a.geojson: must hold polygons, and holds a Point",
        [],
    ),
    "nobody is copied who is not there": (
        {},
        ["mine.yaml", "--like", "sound-21"],
        2,
        "did you mean sound-12?",
        [],
    ),
    "a file that is there stays": ({"mine.yaml": "mine"}, ["mine.yaml"], 2, "is there already", []),
    "a name with a space": ({}, ["a b.yaml"], 2, "", []),
}
"""The files that are there, what is typed after `new`, the exit code, what is told, and the files that are new."""


@pytest.mark.parametrize(("files", "words", "code", "told", "new"), NEW.values(), ids=NEW)
def test_a_new_scenario_overwrites_nothing_and_is_whole_or_not_there(
    files: dict[str, str],
    words: list[str],
    code: int,
    told: str,
    new: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    files = files | {"harbour.geojson": harbour(tmp_path).read_text()}
    for name, text in files.items():
        Path(name).write_text(text)
    assert main(["new", *words]) == code
    assert told in capsys.readouterr().err
    assert {it.name for it in tmp_path.iterdir()} == {*files, *new}
    assert {name: Path(name).read_text() for name in files} == files
    assert all(starts_of(load(Path(it)))[0].agent_id == (7 if "s.csv" in files else 1) for it in new)


def python(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "apad_bridge.commands.main", "python", *words]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=120)


def test_python_runs_a_file_with_options_and_returns_its_exit_code(tmp_path: Path) -> None:
    (tmp_path / "shows.py").write_text(
        "import sys, firmware_model\nprint(sys.argv[1:], sys.executable)\nsys.exit(7)\n"
    )
    done = python(tmp_path, "shows.py", "--json", "-h", "-m", "x")
    assert done.stdout == f"['--json', '-h', '-m', 'x'] {sys.executable}\n", done.stderr
    assert done.returncode == 7


def test_python_runs_a_module_of_its_own_environment(tmp_path: Path) -> None:
    (tmp_path / "test_board.py").write_text(
        "def test_it_sleeps(mu):\n    mu.run(hours=2.5)\n    assert mu.state.name == 'SLEEPING'\n"
    )
    done = python(tmp_path, "-m", "pytest", "-q", "test_board.py")
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("words", [(), ("-m",)])
def test_python_without_a_file_says_what_to_name(words: tuple[str, ...], tmp_path: Path) -> None:
    done = python(tmp_path, *words)
    assert done.returncode == 2 and "name a file, or a module after -m" in done.stderr

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


def test_a_copy_overwrites_no_other_starts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "pool-12.csv").write_text("id,north,east,battery\n1,1,1,1\n")
    assert main(["new", str(tmp_path / "mine.yaml"), "--like", "pool-12"]) == 2
    assert "is there already, and is another file" in capsys.readouterr().err
    assert sorted(it.name for it in tmp_path.iterdir()) == ["pool-12.csv"]
    assert (tmp_path / "pool-12.csv").read_text().count("\n") == 2


def test_two_copies_in_a_folder_share_their_starts(tmp_path: Path) -> None:
    for name in ("one.yaml", "two.yaml"):
        assert main(["new", str(tmp_path / name), "--like", "pool-12"]) == 0
    assert sorted(it.name for it in tmp_path.iterdir()) == ["one.yaml", "pool-12.csv", "two.yaml"]


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
    assert (buoy.agent_id, buoy.further, pier.agent_id, pier.further) == (
        1,
        (("name", "buoy"),),
        2,
        (("name", "pier"),),
    )
    assert (buoy.north_m, buoy.east_m) == pytest.approx((55.6, 80.3), abs=0.1)
    assert all(0.6 <= it.primary <= 0.9 for it in (buoy, pier))


def test_starts_that_lack_nothing_are_named_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("id,lat,lon,battery\n7,43.9335,15.445,0.5\n")
    words = ["--from", str(harbour(tmp_path)), "--starts", str(tmp_path / "s.csv")]
    assert main(["new", str(tmp_path / "m.yaml"), *words]) == 0
    assert sorted(it.name for it in tmp_path.iterdir()) == ["harbour.geojson", "m.yaml", "s.csv"]
    assert load(tmp_path / "m.yaml").fleet.ids == range(7, 8)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[]", "is no GeoJSON of polygons"),
        ('{"type": "Point", "coordinates": [15.4, 43.9]}', "must hold polygons, and holds a Point"),
    ],
)
def test_an_area_that_is_none_writes_nothing(
    text: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.geojson").write_text(text)
    assert main(["new", str(tmp_path / "mine.yaml"), "--from", str(tmp_path / "a.geojson")]) == 2
    assert f"a.geojson: {why}" in capsys.readouterr().err
    assert [it.name for it in tmp_path.iterdir()] == ["a.geojson"]


def test_nobody_is_copied_who_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", str(tmp_path / "mine.yaml"), "--like", "sound-21"]) == 2
    assert "did you mean sound-12?" in capsys.readouterr().err


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

"""The wheel, made from the sdist and installed without the clone: alone, and beside Debian's ROS."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copy2

import pytest

pytestmark = [pytest.mark.system, pytest.mark.field_kit]
ROOT = Path(__file__).parents[2]
BUILD = "from setuptools import build_meta as it; import sys; it.build_sdist(sys.argv[1])"
NO_PACKAGES = re.compile(
    r"NewConnectionError|ConnectTimeout|Connection refused|name resolution|No matching distribution|ReadTimeout"
)
DIGEST = re.search(r"`pool-12.yaml` \| `(\w+)`", (ROOT / "docs/records.md").read_text())


def environment(place: Path) -> dict[str, str]:
    """The variables of a shell that knows neither the clone nor its .venv."""
    kept = {
        it: text for it, text in os.environ.items() if not it.startswith(("PYTHON", "ROS_", "VIRTUAL_ENV"))
    }
    return {**kept, "PATH": f"{place / 'bin'}:/usr/bin:/bin", "XDG_STATE_HOME": str(place / "state")}


def done(place: Path, *command: str | Path, timeout_s: int = 120) -> subprocess.CompletedProcess[str]:
    there = place.parent / "elsewhere"
    there.mkdir(exist_ok=True)
    return subprocess.run(
        [str(it) for it in command],
        cwd=there,
        env=environment(place),
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made from the sdist of a copy of the clone, because setuptools writes beside its sources."""
    folder = tmp_path_factory.mktemp("wheel")
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for name in filter(lambda it: it and (ROOT / it).is_file(), names):
        (folder / "clone" / name).parent.mkdir(parents=True, exist_ok=True)
        copy2(ROOT / name, folder / "clone" / name)
    subprocess.run(
        [sys.executable, "-c", BUILD, folder], cwd=folder / "clone", check=True, capture_output=True
    )
    (sdist,) = folder.glob("*.tar.gz")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        folder,
        sdist,
    ]
    subprocess.run(pip, cwd=folder, check=True, capture_output=True, timeout=300)
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    place = tmp_path_factory.mktemp("installed") / "venv"
    subprocess.run(["/usr/bin/python3", "-m", "venv", place], check=True, timeout=300)
    install = (place / "bin/python", "-m", "pip", "install", "-q", f"{wheel}[studies]")
    try:
        pip = done(place, *install, timeout_s=900)
    except subprocess.TimeoutExpired:
        pytest.skip("the packages did not come within 15 minutes")
    if pip.returncode != 0 and (reason := NO_PACKAGES.search(pip.stderr)):
        pytest.skip(f"no packages can be had here: {reason[0]}")
    assert pip.returncode == 0, pip.stderr
    yield place


def test_it_flies_without_ros_and_without_the_clone(installed: Path) -> None:
    musselbed = installed / "bin/musselbed"
    flown = done(installed, musselbed, "run", "pool-12", "--time", "asap", "--out", "run")
    assert DIGEST is not None and flown.returncode == 0 and DIGEST[1] in flown.stdout, (
        flown.stdout + flown.stderr
    )
    shipped = installed / "share/musselbed/launch_scripts"
    study = done(installed, musselbed, "study", shipped / "studies/pool.yaml", "--seeds", "2", timeout_s=300)
    assert study.returncode == 0, study.stderr
    scripted = done(installed, musselbed, "script", shipped / "examples/first_in_need.py", "--time", "asap")
    assert scripted.returncode == 0, scripted.stderr
    table = done(installed, musselbed, "mu", "table1")
    assert table.returncode == 0, table.stderr
    live = done(installed, musselbed, "run", "pool-12")
    assert live.returncode != 0 and "sees no ROS 1: fly by --time asap" in live.stderr


@pytest.mark.skipif(not Path("/usr/bin/gcc").exists(), reason="gcc compiles the board in C")
def test_its_board_in_c_compiles_and_conforms(installed: Path) -> None:
    (native,) = installed.glob("lib/*/site-packages/firmware_model/native")
    made = done(installed, "make", "-C", native, f"BUILD={installed}")
    assert made.returncode == 0, made.stderr
    judged = done(
        installed,
        installed / "bin/musselbed",
        "mu",
        "conform",
        installed / "worst_case",
        "--case",
        "missed-rise",
    )
    assert judged.returncode == 0, judged.stdout + judged.stderr


def test_beside_debians_ros_it_flies_live(wheel: Path, installed: Path, tmp_path: Path) -> None:
    place = tmp_path / "venv"
    subprocess.run(
        ["/usr/bin/python3", "-m", "venv", "--system-site-packages", place], check=True, timeout=300
    )
    (site,) = place.glob("lib/*/site-packages")
    (others,) = installed.glob("lib/*/site-packages")
    # The packages that it needs are those of the other environment; musselbed's own three are not.
    (site / "others.pth").write_text(f"{others}\n")
    python = place / "bin/python"
    if done(place, python, "-c", "import rospy").returncode != 0:
        pytest.skip("Debian's rospy is not installed")
    pip = done(
        place, python, "-m", "pip", "install", "-q", "--ignore-installed", "--no-deps", wheel, timeout_s=300
    )
    assert pip.returncode == 0, pip.stderr
    made = done(place, python, "-m", "apad_bridge.ros.types.generate", place / "share/musselbed/ros")
    assert made.returncode == 0, made.stderr
    shipped = place / "share/musselbed/launch_scripts/scenarios"
    copy2(shipped / "pool-12.csv", tmp_path)
    scenario = tmp_path / "short.yaml"
    text = (shipped / "demo.yaml").read_text()
    scenario.write_text(re.sub(r"duration_s: \d+", "duration_s: 60", text))
    flown = done(
        place, place / "bin/musselbed", "run", scenario, "--speed", "20", "--out", "live", timeout_s=300
    )
    assert flown.returncode == 0, flown.stdout + flown.stderr

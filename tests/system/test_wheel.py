"""The wheel, made from the sdist and installed without the clone: alone, and beside Debian's ROS."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from shutil import copy2

import pytest
from programs import ROOT, done

pytestmark = [pytest.mark.system, pytest.mark.field_kit]
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


def ended(
    place: Path, *command: object, code: int | None = 0, timeout_s: int = 300
) -> subprocess.CompletedProcess[str]:
    there = place.parent / "elsewhere"
    there.mkdir(exist_ok=True)
    return done(*command, code=code, cwd=there, env=environment(place), timeout=timeout_s)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made from the sdist of a copy of the clone, because setuptools writes beside its sources."""
    folder = tmp_path_factory.mktemp("wheel")
    listed = done("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard").stdout.split("\0")
    for name in filter(lambda it: it and (ROOT / it).is_file(), listed):
        (folder / "clone" / name).parent.mkdir(parents=True, exist_ok=True)
        copy2(ROOT / name, folder / "clone" / name)
    done(sys.executable, "-c", BUILD, folder, cwd=folder / "clone")
    (sdist,) = folder.glob("*.tar.gz")
    build = ("pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, sdist)
    done(sys.executable, "-m", *build, cwd=folder)
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("installed") / "venv"
    done("/usr/bin/python3", "-m", "venv", place)
    install = (place / "bin/python", "-m", "pip", "install", "-q", f"{wheel}[studies]")
    try:
        pip = ended(place, *install, code=None, timeout_s=900)
    except subprocess.TimeoutExpired:
        pytest.skip("the packages did not come within 15 minutes")
    if pip.returncode != 0 and (reason := NO_PACKAGES.search(pip.stderr)):
        pytest.skip(f"no packages can be had here: {reason[0]}")
    assert pip.returncode == 0, pip.stderr
    return place


def test_it_flies_without_ros_and_without_the_clone(installed: Path) -> None:
    musselbed, shipped = installed / "bin/musselbed", installed / "share/musselbed/launch_scripts"
    flown = ended(installed, musselbed, "run", "pool-12", "--time", "asap", "--out", "run")
    assert DIGEST is not None and DIGEST[1] in flown.stdout
    ended(installed, musselbed, "study", shipped / "studies/pool.yaml", "--seeds", 2)
    ended(installed, musselbed, "script", shipped / "examples/first_in_need.py", "--time", "asap")
    ended(installed, musselbed, "mu", "table1")
    live = ended(installed, musselbed, "run", "pool-12", code=None)
    assert live.returncode != 0 and "sees no ROS 1: fly by --time asap" in live.stderr


@pytest.mark.skipif(not Path("/usr/bin/gcc").exists(), reason="gcc compiles the board in C")
def test_its_board_in_c_compiles_and_conforms(installed: Path) -> None:
    (native,) = installed.glob("lib/*/site-packages/firmware_model/native")
    ended(installed, "make", "-C", native, f"BUILD={installed}")
    board = installed / "worst_case"
    ended(installed, installed / "bin/musselbed", "mu", "conform", board, "--case", "missed-rise")


def test_beside_debians_ros_it_flies_live(wheel: Path, installed: Path, tmp_path: Path) -> None:
    place = tmp_path / "venv"
    done("/usr/bin/python3", "-m", "venv", "--system-site-packages", place)
    (site,) = place.glob("lib/*/site-packages")
    (others,) = installed.glob("lib/*/site-packages")
    # The packages that it needs are those of the other environment; musselbed's own three are not.
    (site / "others.pth").write_text(f"{others}\n")
    python = place / "bin/python"
    if ended(place, python, "-c", "import rospy", code=None).returncode != 0:
        pytest.skip("Debian's rospy is not installed")
    ended(place, python, "-m", "pip", "install", "-q", "--ignore-installed", "--no-deps", wheel)
    ended(place, python, "-m", "apad_bridge.ros.types.generate", place / "share/musselbed/ros")
    shipped = place / "share/musselbed/launch_scripts/scenarios"
    copy2(shipped / "pool-12.csv", tmp_path)
    scenario = tmp_path / "short.yaml"
    text = (shipped / "demo.yaml").read_text()
    scenario.write_text(re.sub(r"duration_s: \d+", "duration_s: 60", text))
    ended(place, place / "bin/musselbed", "run", scenario, "--speed", 20, "--out", "live")

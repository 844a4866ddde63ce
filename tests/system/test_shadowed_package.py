"""Another `agents`: on the path, every command says so and the doctor names it; in the present folder, nobody takes it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from scenario_files import POOL_FILE

from agents.hosting.started import PYTHON

pytestmark = pytest.mark.system


def musselbed(shadow: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "apad_bridge.commands.main", *arguments],
        capture_output=True,
        text=True,
        timeout=180,
        env={**os.environ, "PYTHONPATH": str(shadow)},
        cwd=shadow,
    )


def test_it_is_named_and_no_traceback_is_shown(tmp_path: Path) -> None:
    (tmp_path / "agents.py").write_text("")
    run = musselbed(tmp_path, "run", "some.yaml", "--time", "asap")
    assert run.returncode == 2
    assert "musselbed doctor" in run.stderr
    assert "Traceback" not in run.stderr
    doctor = musselbed(tmp_path, "doctor")
    assert str(tmp_path / "agents.py") in doctor.stdout
    assert "Traceback" not in doctor.stderr


def test_a_ros_of_python_2_that_a_shell_has_sourced_is_not_used(tmp_path: Path) -> None:
    for name in ("rospy", "std_msgs", "genpy"):
        (tmp_path / f"{name}.py").write_text("print 'of Python 2'")
    lines = musselbed(tmp_path, "doctor", "--all").stdout.splitlines()
    for name in ("rospy", "std_msgs", "genpy"):
        (line,) = (it for it in lines if it.startswith(f"OK   {name}:"))
        assert str(tmp_path) not in line


@pytest.mark.parametrize("command", ["run", "study"])
def test_packages_of_ours_in_the_users_folder_are_not_taken_for_ours(tmp_path: Path, command: str) -> None:
    """Neither by the command, as it is installed, nor by the processes that it starts."""
    for name in ("agents", "apad_bridge", "firmware_model", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('this is not what it seems')")
    scenario = yaml.safe_load(POOL_FILE.read_text()) | {"duration_s": 5}
    scenario["fleet"]["start"] = str(POOL_FILE.parent / scenario["fleet"]["start"])
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(scenario))
    study = {"name": "short", "scenarios": ["short.yaml"], "strategies": ["greedy", "cautious"], "seeds": 2}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    words = {
        "run": ["run", "short.yaml", "--time", "asap"],
        "study": ["study", "study.yaml", "--workers", "2"],
    }
    done = subprocess.run(
        [*PYTHON, "-m", "apad_bridge.commands.main", *words[command], "--out", "out"],
        capture_output=True,
        text=True,
        timeout=180,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / ("summary.json" if command == "run" else "results.parquet")).exists()

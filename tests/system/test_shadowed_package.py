"""Another `agents`: on the path, every command says so and the doctor names it; in the present folder, nobody takes it."""

import os
from pathlib import Path

import pytest
from programs import done, musselbed
from scenario_files import write_scenario

from agents.hosting.started import PYTHON

pytestmark = pytest.mark.system


def beside(shadow: Path, *words: object, code: int | None = None) -> tuple[str, str]:
    """Both outputs of the command in a shell that found the folder's packages first."""
    ended = musselbed(*words, env={**os.environ, "PYTHONPATH": str(shadow)}, cwd=shadow, code=code)
    return ended.stdout, ended.stderr


def test_it_is_named_and_no_traceback_is_shown(tmp_path: Path) -> None:
    (tmp_path / "agents.py").write_text("")
    _, told = beside(tmp_path, "run", "some.yaml", "--time", "asap", code=2)
    assert "musselbed doctor" in told and "Traceback" not in told
    found, told = beside(tmp_path, "doctor")
    assert str(tmp_path / "agents.py") in found and "Traceback" not in told


def test_a_ros_of_python_2_that_a_shell_has_sourced_is_not_used(tmp_path: Path) -> None:
    names = ("rospy", "std_msgs", "genpy")
    for name in names:
        (tmp_path / f"{name}.py").write_text("print 'of Python 2'")
    found, _ = beside(tmp_path, "doctor", "--all")
    lines = [it for it in found.splitlines() if it.startswith(tuple(f"OK   {name}:" for name in names))]
    assert len(lines) == len(names) and not any(str(tmp_path) in it for it in lines)


@pytest.mark.parametrize(
    ("words", "made"),
    [
        (("run", "short.yaml", "--time", "asap"), "summary.json"),
        (("study", "study.yaml", "--workers", 2), "results.parquet"),
    ],
)
def test_packages_of_ours_in_the_users_folder_are_not_taken_for_ours(
    tmp_path: Path, words: tuple[object, ...], made: str
) -> None:
    """Neither by the command, as it is installed, nor by the processes that it starts."""
    for name in ("agents", "apad_bridge", "firmware_model", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('this is not what it seems')")
    write_scenario(tmp_path / "short.yaml", duration_s=5)
    (tmp_path / "study.yaml").write_text(
        "{name: short, scenarios: [short.yaml], strategies: [greedy, cautious], seeds: 2}"
    )
    done(*PYTHON, "-m", "apad_bridge.commands.main", *words, "--out", "out", cwd=tmp_path)
    assert (tmp_path / "out" / made).exists()

"""Another distribution's `agents` on the path: every command says so in a line, and the doctor names it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

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

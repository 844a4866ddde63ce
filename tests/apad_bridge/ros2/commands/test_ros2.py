"""`musselbed ros2`, without ROS 2."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from apad_bridge.commands.main import main
from apad_bridge.ros2.ros2_process import Ros2Gone


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment that is whole, beside a run's directory."""
    environment = tmp_path / "environment"
    environment.mkdir()
    (environment / "installed").touch()
    monkeypatch.setattr("apad_bridge.ros2.ros2_process.ENVIRONMENT", environment)
    return tmp_path


def test_without_an_installation_one_line_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also with an environment whose installation was torn."""
    for environment in (tmp_path / "none", tmp_path):
        monkeypatch.setattr("apad_bridge.ros2.ros2_process.ENVIRONMENT", environment)
        assert main(["ros2", str(tmp_path)]) == 2
        assert capsys.readouterr().err == (
            "musselbed ros2: ROS 2 is not installed for musselbed: run launch_scripts/install --ros2\n"
        )


@pytest.mark.parametrize(
    ("options", "printed"),
    [
        ([], "on ROS 2 as the node /musselbed_apad1: apad1 and 12 aMussels\n"),
        (["--json"], json.dumps({"node": "/musselbed_apad1"}) + "\n"),
    ],
)
def test_it_tells_its_node(
    options: list[str],
    printed: str,
    installed: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def serve(directory: Path, began: Callable[[Any], None], tell: Callable[[str], None]) -> None:
        assert directory == installed
        began(SimpleNamespace(node="musselbed_apad1", summary="apad1 and 12 aMussels"))
        tell("the run has ended")

    monkeypatch.setattr("apad_bridge.ros2.ros2_process.serve", serve)
    assert main(["ros2", str(installed), *options]) == 0
    told = capsys.readouterr()
    assert (told.out, told.err) == (printed, "musselbed ros2: the run has ended\n")


def test_a_process_that_is_gone_is_a_peer_that_failed(
    installed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    serve = MagicMock(side_effect=Ros2Gone("it is gone"))
    monkeypatch.setattr("apad_bridge.ros2.ros2_process.serve", serve)
    assert main(["ros2", str(installed)]) == 3
    assert capsys.readouterr().err == "musselbed ros2: it is gone\n"

"""The ROS namespace of a run: from the environment or __ns:=, kept with the run, passed to each of its nodes."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.commands import main as commands
from apad_bridge.commands.fly.run import options_of
from apad_bridge.ros.system.route import environment_for
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import RunOptions

URI = "http://127.0.0.1:11311"


def options(*words: str) -> RunOptions:
    arguments = ["run", "pool.yaml", *words]
    return options_of(commands.parser(arguments).parse_args(arguments))


@pytest.mark.parametrize(
    ("said", "kept"),
    [("basin", "basin"), ("/basin", "basin"), ("/lab/basin/", "lab/basin"), ("/", ""), ("", "")],
)
def test_it_goes_with_the_run(said: str, kept: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", said)
    given = options()
    assert given.namespace == kept
    given.save(tmp_path)
    monkeypatch.delenv("ROS_NAMESPACE")
    assert RunOptions.load(tmp_path) == given
    assert options() == replace(given, namespace="")


@pytest.mark.parametrize("said", ["a b", "1a", "a//b", "~a"])
def test_what_is_no_name_is_refused_in_a_line(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", said)
    with pytest.raises(UserError, match=f"ROS_NAMESPACE={said}: must be a name of ROS"):
        options()


def test_a_node_is_in_the_runs_namespace_and_not_in_its_callers() -> None:
    shell = {"ROS_IP": "127.0.0.1", "ROS_NAMESPACE": "elsewhere"}
    assert environment_for(URI, "basin", shell)["ROS_NAMESPACE"] == "/basin"
    assert environment_for(URI, "", shell)["ROS_NAMESPACE"] == "/"


def test_ross_own_word_on_the_command_line_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", "elsewhere")
    assert commands.main(["run", "nowhere.yaml", "__ns:=a b"]) == 2
    assert "ROS_NAMESPACE=a b" in capsys.readouterr().err
    assert commands.main(["run", "nowhere.yaml", "__ns:=basin"]) == 2
    assert "nowhere.yaml" in capsys.readouterr().err
    assert os.environ["ROS_NAMESPACE"] == "basin"


def test_virtual_time_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", "basin")
    assert options("--time", "asap").namespace == ""

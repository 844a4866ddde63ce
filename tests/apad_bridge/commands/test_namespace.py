"""What a person says of a run's names of ROS and its modems: kept with the run, for every later supervisor."""

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


REMAPPINGS = ("/apad1/position:=/boat/position", "plan:=/route")


@pytest.mark.parametrize(
    ("said", "words", "name", "kept"),
    [
        *((said, "", "namespace", "basin") for said in ("basin", "/basin")),
        ("/lab/basin/", "", "namespace", "lab/basin"),
        *((said, "", "namespace", "") for said in ("/", "")),
        ("", " ".join(f"--remap {it}" for it in REMAPPINGS), "remappings", REMAPPINGS),
        ("", "--open-modem 3 --open-modem 7", "open_modems", (3, 7)),
        ("", "--modem /dev/ttyUSB0", "modem", "/dev/ttyUSB0"),
    ],
)
def test_it_goes_with_the_run(
    said: str, words: str, name: str, kept: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", said)
    given = options(*words.split())
    assert getattr(given, name) == kept
    given.save(tmp_path)
    monkeypatch.delenv("ROS_NAMESPACE")
    assert RunOptions.load(tmp_path) == given
    assert replace(given, **{name: getattr(options(), name)}) == options()


@pytest.mark.parametrize(
    ("said", "words", "told"),
    [
        *((it, [], f"ROS_NAMESPACE={it}: must be a name of ROS") for it in ("a b", "1a", "a//b", "~a")),
        *(
            ("", ["--remap", it], "FROM:=TO")
            for it in ("/a", "/a:=", ":=/b", "/a b:=/c", "/a:=/b:=/c", "__name:=x", "/a=/b")
        ),
        ("", ["--time", "asap", "--remap", "/a:=/b"], "--time asap has none"),
    ],
)
def test_what_is_no_name_is_refused_in_a_line(
    said: str, words: list[str], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", said)
    with pytest.raises(UserError, match=told):
        options(*words)


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

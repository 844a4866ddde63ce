"""--remap: names of ROS on the command line, kept with the run so that every later supervisor has them too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.commands.fly.run import options_of
from apad_bridge.commands.main import parser
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import RunOptions


def options(*words: str) -> RunOptions:
    arguments = ["run", "pool.yaml", *words]
    return options_of(parser(arguments).parse_args(arguments))


def test_they_go_with_the_run(tmp_path: Path) -> None:
    given = options("--remap", "/apad1/position:=/boat/position", "--remap", "plan:=/route")
    assert given.remappings == ("/apad1/position:=/boat/position", "plan:=/route")
    given.save(tmp_path)
    assert RunOptions.load(tmp_path) == given
    assert options() == replace(given, remappings=())


@pytest.mark.parametrize("word", ["/a", "/a:=", ":=/b", "/a b:=/c", "/a:=/b:=/c", "__name:=x", "/a=/b"])
def test_what_is_no_remapping_is_refused_in_a_line(word: str) -> None:
    with pytest.raises(UserError, match="FROM:=TO"):
        options("--remap", word)


def test_virtual_time_has_no_names_of_ros() -> None:
    with pytest.raises(UserError, match="--time asap has none"):
        options("--time", "asap", "--remap", "/a:=/b")

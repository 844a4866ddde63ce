"""The command line loads a command's own module, and knows all commands where none is named."""

import argparse

import pytest

from apad_bridge.commands.main import parser


def commands_of(top: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    (choices,) = (it.choices for it in top._actions if isinstance(it, argparse._SubParsersAction))
    return choices


ALL = commands_of(parser())


@pytest.mark.parametrize("name", ALL)
def test_a_command_that_is_loaded_by_itself_is_as_with_all_the_others(name: str) -> None:
    alone = commands_of(parser([name, "--help"]))
    assert len(alone) < len(ALL)
    assert alone[name].format_help() == ALL[name].format_help()


@pytest.mark.parametrize("first", ["control", "nonsense", "--help"])
def test_a_word_that_is_no_command_is_told_all_of_them(first: str) -> None:
    assert commands_of(parser([first])).keys() == ALL.keys()

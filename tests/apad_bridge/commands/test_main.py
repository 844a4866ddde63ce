"""The command line loads the module of the command that is named, and lists all commands where none is."""

import argparse
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.main import all_groups, parser

ALL_COMMANDS = {name: line for commands in all_groups().values() for name, line in commands.items()}


def commands_of(top: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    (choices,) = (it.choices for it in top._actions if isinstance(it, argparse._SubParsersAction))
    return choices


@pytest.mark.parametrize("name", ALL_COMMANDS)
def test_a_command_is_loaded_without_those_of_other_modules(name: str) -> None:
    top = parser([name, "--help"])
    alone = commands_of(top)
    assert name in alone
    assert set(alone) in (
        {name},
        {"order", "stop", "hands", "continue", "give-back", "back-in", "abort", "remark", "speed"},
    )
    runs = alone[name].get_default("run") or top.get_default("run")
    assert callable(runs) or alone[name]._subparsers is not None


@pytest.mark.parametrize("words", [["--help"], ["--help", "run"], ["--version"]])
def test_a_help_without_a_command_before_it_lists_all_of_them(words: list[str]) -> None:
    listed = " ".join(parser(words).format_help().split())
    for name, line in ALL_COMMANDS.items():
        assert f"{name} {line}" in listed


def test_an_option_before_the_command_does_not_hide_it() -> None:
    assert list(commands_of(parser(["--version", "run"]))) == ["run"]


@pytest.mark.parametrize(
    "words", [["--help"], ["run", "--help"], ["run", "--speed", "x"], ["resume"], ["script"]]
)
def test_a_help_or_a_mistake_loads_neither_a_flight_nor_a_large_library(words: list[str]) -> None:
    code = (
        "import sys\n"
        "from apad_bridge.commands.main import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit:\n"
        "    heavy = {'numpy', 'pydantic', 'yaml', 'rich', 'rosbags', 'rospy', 'apad_bridge.scenario.schema'}\n"
        "    sys.exit(', '.join(heavy & sys.modules.keys()) or None)\n"
        "sys.exit('it did not end')"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def test_a_stop_loads_only_what_asks_a_supervisor(tmp_path: Path) -> None:
    """An import delays the stop, on a loaded laptop by seconds."""
    (tmp_path / "scenario.yaml").touch()
    with socket.socket(socket.AF_UNIX) as supervisor:
        supervisor.bind(str(tmp_path / "control.sock"))  # nobody listens at it
    code = (
        "import sys\n"
        "from apad_bridge.commands.main import main\n"
        "code = main(sys.argv[1:])\n"
        "heavy = {'numpy', 'pydantic', 'annotated_types', 'yaml', 'rich', 'msgpack', 'logging'}\n"
        "heavy |= {'apad_bridge.events.event'}\n"
        "sys.exit(', '.join(heavy & sys.modules.keys()) or (None if code == 2 else f'exit {code}'))"
    )
    words = ["stop", str(tmp_path)]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "takes orders" in done.stderr


@pytest.mark.parametrize(
    ("library", "words", "told"),
    [
        ("imcpy", ["imc", "RUN"], "imcpy is not installed (there is none for Python 3.14)"),
        ("imcpy", ["run", str(POOL_FILE), "--imc"], "imcpy is not installed (there is none for Python 3.14)"),
        ("foxglove", ["foxglove"], "foxglove-sdk is not installed"),
        ("pyarrow", ["study", "table-two"], "pyarrow, which writes the results, is missing"),
    ],
)
def test_a_library_that_lacks_is_told_in_one_line(library: str, words: list[str], told: str) -> None:
    """A Python for which a library has no wheel runs all other commands; `musselbed --help` lists them."""
    code = (
        f"import sys\nsys.modules[{library!r}] = None\nfrom apad_bridge.commands.main import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert told in line and "launch_scripts/install" in line
    listed = subprocess.run(
        [sys.executable, "-c", code, "--help"], capture_output=True, text=True, timeout=60
    )
    assert listed.returncode == 0, listed.stderr

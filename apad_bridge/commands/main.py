"""The command `musselbed`.

It imports little before `main` runs, so that Ctrl-C in the first second ends the command in silence.
"""

from __future__ import annotations

import gc
import os
import select
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, TextIO

from apad_bridge.events.person_orders import PERSON_ORDERS
from apad_bridge.runs.exits import (
    Exit,
    fault_of_file,
    is_for_lack_of_memory,
    is_short_of_address_space,
    memory_shortage,
    peers_may_fail,
    shortage,
)
from apad_bridge.runs.terminal import discard, show_control_characters
from apad_bridge.scenario.errors import UserError
from firmware_model.entry_points import package_to_blame

try:
    from agents.hosting.interrupts import interruptible, leave_at_once
except ImportError:
    # Another distribution's `agents` shadows ours. The doctor names it; signals act on it as Python has them.
    from contextlib import nullcontext as interruptible  # type: ignore[assignment]

    def leave_at_once() -> None:
        pass


if TYPE_CHECKING:
    import argparse

GROUPS = {
    "fly": {
        "run": "fly a scenario: a fleet, the supervisor's mission, and an aPad",
        "resume": "continue a run whose supervisor died",
        "script": "fly a Python script with the aPad's API as the mission",
        "fleet": "fly simulated aMussels on the master at ROS_MASTER_URI, without a mission",
        "mission": "fly the mission alone, for real aMussels or another fleet",
        "apad": "fly the simulated aPad alone, for any ROS 1 client",
    },
    "order": {
        "order": "a person's order to a flying run: `order stop`; short forms follow",
        **{act.command: it.line for act, it in PERSON_ORDERS.items()},
    },
    "look": {
        "console": "show a run live in a browser, and give it orders from there",
        "runs": "list the runs here with their key figures, newest first",
        "replay": "show a run, or two side by side, as one HTML page",
        "report": "one page about runs, to read or to print: table, figures, energy, beliefs, faults",
    },
    "look into a run": {
        "explain": "the reasons of the mission's plan at a time",
        "beliefs": "evaluate a run's beliefs: error, coverage and consistency",
        "check": "check that a run's records obey the rules that hold in every run",
        "export": "every series of a run as MCAP, for MATLAB, as CSV or as Parquet",
    },
    "prepare": {
        "new": "write a commented scenario to begin with",
        "doctor": "check this machine, its ROS, the network both ways, and a scenario",
        "python": "run a Python file, pytest or pip with musselbed's own Python",
    },
    "real hardware": {
        "preflight": "check a real aPad and everything around it before a mission",
        "bridge": "real aMussels by a nanomodem on a serial port, for a mission on ROS",
        "modems": "simulated nanomodems on a table, to try a bridge without hardware",
    },
    "firmware": {
        "mu": "run one MU board by itself: Table I, an energy budget, its states",
    },
}
"""The commands that always are there, by what a person wants, each with its line in the list of all."""

_FOLDERS = {"order": "fly", "look into a run": "look", "real hardware": "hardware"}
"""The folder of a group's modules where it does not have the group's name."""
_ENTRY_POINTS = "musselbed.commands"
"""The group of entry points by which a room that can leave, and a stranger's package, bring modules of commands."""
_NS = "__ns:="
_YOUNG_OBJECTS = 200_000
"""The number of new objects after which a command looks for garbage cycles: more than its imports make. Python's own 700
cost an eighth of them."""


def parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The parser of these arguments: with the command that they name, or else with a list of all.

    UserError for an unknown command.
    """
    import argparse

    from apad_bridge.commands.help_text import CommandParser, ending

    named = _named(arguments)
    module = None if named is None else _module_of(named)
    top = CommandParser(
        prog="musselbed",
        usage="musselbed [-h] [--version] COMMAND ...",
        description="A vehicle-in-the-loop test bench: a real or simulated ROS 1 aPad serves a fleet of simulated "
        "aMussels, each in its own process.",
        epilog=("" if named else _list_of_all())
        + ending(
            "musselbed run pool-12 --time asap",
            "musselbed new mine.yaml",
            "musselbed doctor",
        ),
    )

    class ShowVersion(argparse.Action):
        def __call__(self, *_: Any) -> None:
            from importlib.metadata import version  # it takes long

            print(f"musselbed {version('musselbed')}")
            top.exit()

    top.add_argument("--version", action=ShowVersion, nargs=0, help="show program's version number and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", prog="musselbed", help=argparse.SUPPRESS)
    if named is not None and module is not None:
        try:
            command = import_module(module)
            # Subcommands name a function each.
            top.set_defaults(run=vars(command).get("run"))
            command.add_parser(commands)
        except ImportError as error:
            # A package that shadows ours must not keep the doctor from reporting it.
            _add_unloadable(commands, named, error)
    return top


def _list_of_all() -> str:
    """The commands in their groups. An indented line stays as it is."""
    import shutil
    import textwrap

    width = shutil.get_terminal_size().columns - 2
    texts = []
    for group, commands in all_groups().items():
        texts.append(f"{group}:")
        for name, line in commands.items():
            first = f"  {name:<10} "
            texts += textwrap.wrap(line, width, initial_indent=first, subsequent_indent=" " * 13) or [first]
    return "\n".join([*texts, ""])


def all_groups() -> dict[str, dict[str, str]]:
    """The commands with their lines: those of this folder in their groups, then those of packages by the package's name."""
    from firmware_model.entry_points import entry_points

    groups = {title: dict(commands) for title, commands in GROUPS.items()}
    for entry in entry_points(_ENTRY_POINTS):
        groups.setdefault(entry.package, {})[entry.name] = entry.line
    return groups


def _named(arguments: Sequence[str]) -> str | None:
    """The command; None where the list of all is asked for before it."""
    first = next((it for it in arguments if it in ("-h", "--help") or not it.startswith("-")), "-")
    return None if first.startswith("-") else first


def _module_of(name: str) -> str:
    """The module of a command. UserError for an unknown one, and for one that two packages bring."""
    for group, commands in GROUPS.items():
        if name in commands:
            # One module has all orders; each other module has the command of its own name.
            module = "control" if group == "order" else name
            return f"apad_bridge.commands.{_FOLDERS.get(group, group)}.{module}"
    from firmware_model.entry_points import entry_points

    brought = entry_points(_ENTRY_POINTS)
    if not (found := [it for it in brought if it.name == name]):
        raise UserError(
            _unknown(name, [*(it for group in GROUPS.values() for it in group), *(it.name for it in brought)])
        )
    if len(found) > 1:
        packages = ", ".join(it.package for it in found)
        raise UserError(f"command {name} is in each of {packages}: remove one of these packages")
    return found[0].module


def _unknown(name: str, known: Sequence[str]) -> str:
    from difflib import get_close_matches

    near = get_close_matches(name, known, n=1)
    meant = f"did you mean `musselbed {near[0]}`?" if near else "`musselbed --help` lists all"
    return f"there is no command {name}: {meant}"


def _add_unloadable(commands: Any, name: str, error: ImportError) -> None:
    def refuse(_: argparse.Namespace) -> int:
        raise error

    stub = commands.add_parser(name)
    stub.add_argument("rest", nargs="...")
    stub.set_defaults(run=refuse)


def _in_namespace(arguments: list[str]) -> list[str]:
    """Removes ROS's own __ns:= and sets ROS_NAMESPACE from it, so that it counts for all processes started from here."""
    for argument in arguments:
        if argument.startswith(_NS):
            os.environ["ROS_NAMESPACE"] = argument.removeprefix(_NS)
    return [argument for argument in arguments if not argument.startswith(_NS)]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; without `arguments` it is the program's own, whose process ends after this."""
    if arguments is not None:
        return _run(arguments)
    leave_at_once()
    show_control_characters()
    gc.set_threshold(_YOUNG_OBJECTS)
    # numpy would start a thread for each processor, whose work is never large enough here to be worth its start.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return _run(sys.argv[1:])
    finally:
        # The interpreter looks for cycles among all that lives when it ends, though the end frees everything anyway.
        gc.freeze()
        leave_at_once()


def _run(arguments: list[str]) -> int:
    arguments = _in_namespace(arguments)
    try:
        top = parser(arguments)
    except UserError as error:
        print(f"musselbed: {error}", file=sys.stderr)
        return Exit.USER_MISTAKE
    chosen = top.parse_args(arguments)
    if chosen.command is None:
        top.print_help()
        return Exit.USER_MISTAKE
    if is_short_of_address_space():
        return _out_of_memory(chosen.command)
    try:
        with interruptible(), peers_may_fail():
            code: int = chosen.run(chosen)
            sys.stdout.flush()
    except UserError as error:
        print(f"musselbed {chosen.command}: {error}", file=sys.stderr)
        return Exit.USER_MISTAKE
    except ImportError as error:
        if is_for_lack_of_memory(error):
            return _out_of_memory(chosen.command)
        # A package is missing, or another one shadows ours.
        print(
            f"musselbed {chosen.command}: cannot be loaded ({error}); `musselbed doctor` names the cause",
            file=sys.stderr,
        )
        return Exit.USER_MISTAKE
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except BrokenPipeError:
        if not _has_lost_its_reader(sys.stdout):
            raise
        discard(sys.stdout)
        return Exit.PEER_FAILED
    except OSError as error:
        if (why := shortage(error)) is not None:
            print(f"musselbed {chosen.command}: {why}", file=sys.stderr)
            discard(sys.stdout)
            return Exit.PEER_FAILED
        if (why := fault_of_file(error)) is None:
            raise
        print(f"musselbed {chosen.command}: {why}", file=sys.stderr)
        return Exit.USER_MISTAKE
    except Exception as error:
        if is_for_lack_of_memory(error):
            return _out_of_memory(chosen.command)
        if (package := package_to_blame(error)) is None:
            raise
        traceback.print_exception(error)
        print(f"musselbed {chosen.command}: this is an error of {package}: tell its authors", file=sys.stderr)
        return Exit.PEER_FAILED
    return code


def _out_of_memory(command: str) -> int:
    print(f"musselbed {command}: {memory_shortage()}", file=sys.stderr)
    return Exit.PEER_FAILED


def _has_lost_its_reader(stream: TextIO) -> bool:
    poll = select.poll()
    poll.register(stream.fileno(), 0)
    return any(events & select.POLLERR for _, events in poll.poll(0))


if __name__ == "__main__":
    sys.exit(main())

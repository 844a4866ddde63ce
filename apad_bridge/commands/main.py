"""The command `musselbed`.

It imports little before `main` runs, so that Ctrl-C in the first second ends the command in silence.
"""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, TextIO

from apad_bridge.runs.exits import Exit, UserError, shortage

try:
    from agents.hosting.interrupts import interruptible, leave_at_once
except ImportError:
    # Another distribution's `agents` shadows ours. The doctor names it; signals act on it as Python has them.
    from contextlib import nullcontext as interruptible  # type: ignore[assignment]

    def leave_at_once() -> None:
        pass


if TYPE_CHECKING:
    import argparse

_COMMANDS = (
    "run",
    "resume",
    "control",
    "fleet",
    "mission",
    "apad",
    "script",
    "runs",
    "check",
    "replay",
    "export",
    "report",
    "logs",
    "console",
    "imc",
    "beliefs",
    "explain",
    "mu",
    "fit",
    "calibrate",
    "shadow",
    "study",
    "branch",
    "pack",
    "capacity",
    "layout",
    "preflight",
    "doctor",
)

_OF_CONTROL = ("stop", "continue", "abort", "remark")
"""The commands of the module `control`; each other module has the command of its own name."""
_NS = "__ns:="


def parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The parser of these arguments: with the command alone that they begin with, or else with all of them."""
    import argparse

    from apad_bridge.commands.help_text import CommandParser, ending

    top = CommandParser(
        prog="musselbed",
        description="A vehicle-in-the-loop test bench: a real or simulated ROS 1 aPad serves a fleet of simulated "
        "aMussels, each in its own process.",
        epilog=ending("musselbed doctor", "musselbed run launch_scripts/scenarios/pool-12.yaml --time asap"),
    )

    class ShowVersion(argparse.Action):
        def __call__(self, *_: Any) -> None:
            from importlib.metadata import version  # it takes long

            print(f"musselbed {version('musselbed')}")
            top.exit()

    top.add_argument("--version", action=ShowVersion, nargs=0, help="show program's version number and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND")
    for name in _modules(arguments[0] if arguments else ""):
        try:
            import_module(f"apad_bridge.commands.{name}").add_parser(commands)
        except ImportError as error:
            # A package that shadows ours must not keep the doctor from reporting it.
            _add_unloadable(commands, name, error)
    return top


def _modules(command: str) -> Sequence[str]:
    """The modules to load for a command: its own, or all of them for what is no command."""
    if command in _OF_CONTROL:
        return ("control",)
    return (command,) if command in _COMMANDS and command != "control" else _COMMANDS


def _add_unloadable(commands: Any, name: str, error: ImportError) -> None:
    def refuse(_: argparse.Namespace) -> int:
        raise UserError(f"cannot be loaded ({error}); `musselbed doctor` names the cause")

    stub = commands.add_parser(name, help=f"cannot be loaded: {error}")
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
    try:
        return _run(sys.argv[1:])
    finally:
        leave_at_once()


def _run(arguments: list[str]) -> int:
    arguments = _in_namespace(arguments)
    top = parser(arguments)
    chosen = top.parse_args(arguments)
    if chosen.command is None:
        top.print_help()
        return Exit.USER_MISTAKE
    try:
        with interruptible():
            code: int = chosen.run(chosen)
            sys.stdout.flush()
    except UserError as error:
        print(f"musselbed {chosen.command}: {error}", file=sys.stderr)
        return Exit.USER_MISTAKE
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except BrokenPipeError:
        if not _has_lost_its_reader(sys.stdout):
            raise
        _discard(sys.stdout)
        return Exit.PEER_FAILED
    except OSError as error:
        if (why := shortage(error)) is None:
            raise
        print(f"musselbed {chosen.command}: {why}", file=sys.stderr)
        _discard(sys.stdout)
        return Exit.PEER_FAILED
    return code


def _has_lost_its_reader(stream: TextIO) -> bool:
    poll = select.poll()
    poll.register(stream.fileno(), 0)
    return any(events & select.POLLERR for _, events in poll.poll(0))


def _discard(stream: TextIO) -> None:
    """Lets the interpreter's own flush at its exit succeed: what could not be written once is not tried again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    sys.exit(main())

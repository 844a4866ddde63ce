"""`musselbed stop`, `continue`, `abort` and `remark`: a person's orders to a flying run, from any terminal."""

from __future__ import annotations

import argparse
import getpass
import json
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit, UserError
from apad_bridge.supervisor.control import (
    LONGEST_REMARK,
    SOCKET_NAME,
    Act,
    Answer,
    NobodyListens,
    Request,
    ask,
)
from apad_bridge.vehicle.errors import PeerFailed

_NO_EMERGENCY_STOP = "This is no emergency stop: it needs a live supervisor and a link to the vehicle."
_COMMANDS: dict[Act, tuple[str, tuple[str, str]]] = {
    Act.STOP: (
        "The aPad holds its position and the mission waits. The order does not stop a moving dock half-way. "
        f"{_NO_EMERGENCY_STOP}",
        ("musselbed stop runs/pool-12-1", "musselbed stop runs/bay-120-1/apad2 --by Anna"),
    ),
    Act.CONTINUE: (
        "The mission plans anew from the aPad's place. A script, or a flight by hand, continues where it stopped.",
        ("musselbed continue runs/pool-12-1", "musselbed continue runs/bay-120-1/apad2 --by Anna"),
    ),
    Act.ABORT: (
        f"The run ends in order, with its summary, and exit code 0. {_NO_EMERGENCY_STOP}",
        ("musselbed abort runs/pool-12-1", "musselbed abort runs/pool-12-1 --motors-off"),
    ),
    Act.REMARK: (
        "The journal, the bag and the replay page show the remark at its mission time.",
        (
            'musselbed remark runs/pool-12-1 "fishing boat 200 m north"',
            'musselbed remark runs/pool-12-1 "gone" --by Anna',
        ),
    ),
}


def add_parser(commands: Any) -> None:
    for act, (description, examples) in _COMMANDS.items():
        parser = commands.add_parser(
            act.value,
            description=description,
            epilog=ending(*examples),
        )
        parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
        if act is Act.REMARK:
            parser.add_argument("text", metavar="TEXT", help=f"at most {LONGEST_REMARK} characters")
        if act is Act.ABORT:
            parser.add_argument(
                "--motors-off",
                action="store_true",
                help="then switch the aPad's controllers off, so that it drifts; generation A cannot do that",
            )
        parser.add_argument(
            "--by", default=None, metavar="NAME", help="your name for the records (default: the user's name)"
        )
        parser.add_argument("--json", action="store_true", help="print the answers by aPad as JSON on stdout")
        parser.set_defaults(run=run, act=act)


def run(arguments: argparse.Namespace) -> int:
    request = _request(arguments)
    answers: dict[str, Answer] = {}
    silent: list[str] = []
    for name, directory in _supervised(arguments.directory).items():
        try:
            answers[name] = ask(directory, request)
        except NobodyListens:
            silent.append(name)
        except PeerFailed as error:  # the other aPads of the run are asked all the same
            answers[name] = Answer(False, str(error))
    if not answers:
        raise UserError(
            f"no supervisor of {arguments.directory} takes orders: {_why_nobody(arguments.directory)}"
        )
    if arguments.json:
        print(
            json.dumps(
                {name: {"accepted": it.accepted, "message": it.message} for name, it in answers.items()}
            )
        )
    else:
        for name, answer in answers.items():
            print(f"{name}: {answer.message or 'done'}" if len(answers) > 1 else answer.message or "done")
        for name in silent:
            print(f"{name}: its supervisor takes no orders")
    return Exit.DONE if all(it.accepted for it in answers.values()) and not silent else Exit.PEER_FAILED


def _request(arguments: argparse.Namespace) -> Request:
    by = arguments.by or getpass.getuser()
    text = getattr(arguments, "text", "")
    if len(text) > LONGEST_REMARK or len(by) > 100:
        raise UserError(f"a remark has at most {LONGEST_REMARK} characters, and a name 100")
    return Request(arguments.act, by, text, getattr(arguments, "motors_off", False))


def _supervised(directory: Path) -> dict[str, Path]:
    """The directories with a supervisor of their own: the run's, or one for each of several aPads."""
    if not (directory / "scenario.yaml").exists():
        raise UserError(f"{directory} is no run: name the directory that `musselbed run` printed")
    members = {it.parent.name: it.parent for it in sorted(directory.glob("*/scenario.yaml"))}
    return members or {directory.name: directory}


def _why_nobody(directory: Path) -> str:
    if (directory / "summary.json").exists():
        return "it has ended"
    if not any(directory.rglob(SOCKET_NAME)):
        return "it flies in virtual time (--time asap), has ended, or moves no aPad"
    return f"its supervisor died; continue with: musselbed resume {directory}"

"""A person's orders to a flying run, from any terminal: `musselbed order stop` and others, each with a short form."""

from __future__ import annotations

import argparse
import getpass
import json
import sys
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.events.person_orders import PERSON_ORDERS, Act
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.supervisor.control_protocol import (
    LATE_S,
    SOCKET_NAME,
    Answer,
    NobodyListens,
    Request,
    ask,
)
from apad_bridge.vehicle.link_errors import PeerFailed


def add_parser(commands: Any) -> None:
    """Adds `order` with all orders, and the short form of each."""
    names = [it.command for it in PERSON_ORDERS]
    order = commands.add_parser(
        "order",
        description=f"Gives a person's order to a flying run: {', '.join(names[:-1])} or {names[-1]}. "
        "Each has a short form, such as `musselbed stop RUN`.",
        epilog=ending("musselbed order stop runs/pool-12-1", "musselbed order continue runs/pool-12-1"),
    )
    _add_orders(order.add_subparsers(metavar="ORDER", required=True), "musselbed order")
    _add_orders(commands, "musselbed")


def _add_orders(commands: Any, program: str) -> None:
    for act, it in PERSON_ORDERS.items():
        parser = commands.add_parser(
            act.command,
            description=it.description,
            epilog=ending(*(example.replace("musselbed", program, 1) for example in it.examples)),
        )
        parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
        for name, options in it.arguments.items():
            parser.add_argument(name, **options)
        parser.add_argument(
            "--by", default=None, metavar="NAME", help="your name for the records (default: the user's name)"
        )
        parser.add_argument("--json", action="store_true", help="print the answers by aPad as JSON on stdout")
        parser.set_defaults(act=act, motors_off=False)


def run(arguments: argparse.Namespace) -> int:
    requests = _requests(arguments)
    answers: dict[str, Answer] = {}
    silent: list[str] = []
    supervised = _supervised(arguments.directory)
    _print_note(f"asking the supervisor of {arguments.directory}")
    for name, answer in zip(supervised, _all_asked(list(supervised.values()), requests), strict=True):
        if answer is None:
            silent.append(name)
        else:
            answers[name] = answer
    if not answers:
        raise UserError(
            f"no supervisor of {arguments.directory} takes orders: {_why_nobody(arguments.directory)}"
        )
    if arguments.json:
        print(json.dumps({name: asdict(it) for name, it in answers.items()}))
    else:
        for name, answer in answers.items():
            line = _line(answer, supervised[name])
            print(f"{name}: {line}" if len(answers) > 1 else line)
        for name in silent:
            print(f"{name}: its supervisor takes no orders")
    return Exit.DONE if all(it.accepted for it in answers.values()) and not silent else Exit.PEER_FAILED


def _all_asked(directories: list[Path], requests: list[Request]) -> list[Answer | None]:
    """Asks all at once: the stop of one aPad does not wait until another has taken its own."""
    if len(directories) == 1:
        return [_asked(directories[0], requests)]
    from concurrent.futures import ThreadPoolExecutor  # it takes long, and one aPad does without

    with ThreadPoolExecutor(len(directories)) as threads:
        return list(threads.map(lambda it: _asked(it, requests), directories))


def _print_note(line: str) -> None:
    """Tells a person at once what goes on; stdout is for the answers."""
    print(line, file=sys.stderr, flush=True)


def _asked(directory: Path, requests: list[Request]) -> Answer | None:
    """The answer to the last of the requests, or the first refusal; None where no supervisor takes orders."""
    answer = None
    late = (
        f"no answer from the supervisor of {directory} within {LATE_S:g} s. It is asked on; "
        "if the aPad must stop now, use the vehicle's own switch"
    )
    for request in requests:
        try:
            answer = ask(directory, request, lambda: _print_note(late))
        except NobodyListens:
            return answer
        except PeerFailed as error:  # the other aPads of the run are asked all the same
            return Answer(False, str(error))
        if not answer.accepted:
            return answer
    return answer


def _line(answer: Answer, directory: Path) -> str:
    if answer.stop is None:
        return "; ".join(filter(None, (answer.message or "done", answer.steers)))
    states = "".join(f", {state} after {after_s:.1f} s" for state, after_s in answer.after_s.items())
    told = f"stop {answer.stop} ({answer.mode}): ordered{states}"
    if answer.accepted:
        again = f"to move it again: musselbed continue {directory}"
        return f"{told}\ndone: the aPad has taken the stop and slows; {answer.steers}; {again}"
    return f"{told}\nNOT DONE: {answer.message}"


def _requests(arguments: argparse.Namespace) -> list[Request]:
    by = arguments.by or getpass.getuser()
    given = {it.name: getattr(arguments, it.name) for it in fields(Request) if it.name in arguments}
    request = Request(**given | {"by": by})
    if request.mistake:
        raise UserError(request.mistake)
    if arguments.motors_off:
        return [Request(Act.STOP, by, off=True), request]
    return [request]


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

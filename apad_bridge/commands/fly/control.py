"""A person's orders to a flying run, from any terminal: `musselbed order stop` and others, each with a short form."""

from __future__ import annotations

import argparse
import getpass
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.supervisor.control_client import (
    LATE_S,
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
_COMMANDS: dict[Act, tuple[str, tuple[str, ...]]] = {
    Act.STOP: (
        "The aPad holds its position where it may: a position that is believed, inside the fence. Else its controllers go "
        "off, and it drifts. A second stop, a second or more after the first, switches them off. The command says `done` "
        "only when the vehicle has accepted the stop and the hull slows; nothing moves the aPad before `musselbed "
        f"continue`. {_NO_EMERGENCY_STOP}",
        ("musselbed stop runs/pool-12-1", "musselbed stop runs/bay-120-1/apad2 --off --by Anna"),
    ),
    Act.HANDS: (
        "For hands at the docks, mooring, and the crane: the controllers go off, and no arm of a dock moves, until "
        f"`musselbed continue`. {_NO_EMERGENCY_STOP}",
        ("musselbed hands runs/pool-12-1", "musselbed hands runs/bay-120-1/apad2 --by Anna"),
    ),
    Act.CONTINUE: (
        "The mission plans anew from the aPad's place. A script, or a flight by hand, continues where it stopped: an aPad "
        "that a person took over stays with that person until `musselbed give-back`. The word counts for the newest stop, "
        "and says that the position is right.",
        ("musselbed continue runs/pool-12-1", "musselbed continue runs/pool-12-1 --stop 3 --by Anna"),
    ),
    Act.GIVE_BACK: (
        "Continues, and returns the aPad to the mission from a person who took it over.",
        ("musselbed give-back runs/pool-12-1", "musselbed give-back runs/pool-12-1 --stop 3 --by Anna"),
    ),
    Act.BACK_IN: (
        "Sends an aPad that lies at most 5 m outside the fence straight back inside, across no keep-out zone, where it "
        "holds. An aPad of generation A obeys no speed: bring it back by joystick.",
        (
            "musselbed back-in runs/pool-12-1 --lookout Bo",
            "musselbed back-in runs/pool-12-1 --lookout Bo --by Anna",
        ),
    ),
    Act.ABORT: (
        f"The run ends in order, with its summary, and exit code 0. {_NO_EMERGENCY_STOP}",
        ("musselbed abort runs/pool-12-1", "musselbed abort runs/pool-12-1 --motors-off"),
    ),
    Act.SPEED: (
        "Changes the speed of a simulated flight: TIMES mission seconds in a wall second. With 0, mission time stands "
        "still, and `step` lets one more tick come. The flight is the same as without a change, and so is its digest. On a "
        "real aPad, and on somebody else's /clock, it changes nothing: there `musselbed stop RUN` stops.",
        (
            "musselbed speed runs/pool-12-1 5",
            "musselbed speed runs/pool-12-1 0",
            "musselbed speed runs/pool-12-1 step",
        ),
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
    """Adds `order` with all orders, and the short form of each."""
    order = commands.add_parser(
        "order",
        description="Gives a person's order to a flying run: stop, hands, continue, give-back, back-in, abort, "
        "speed or remark. Each has a short form, such as `musselbed stop RUN`.",
        epilog=ending("musselbed order stop runs/pool-12-1", "musselbed order continue runs/pool-12-1"),
    )
    _add_orders(order.add_subparsers(metavar="ORDER", required=True), "musselbed order")
    _add_orders(commands, "musselbed")


def _add_orders(commands: Any, program: str) -> None:
    for act, (description, examples) in _COMMANDS.items():
        parser = commands.add_parser(
            act.value.replace(" ", "-"),
            description=description,
            epilog=ending(*(it.replace("musselbed", program, 1) for it in examples)),
        )
        parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
        if act is Act.REMARK:
            parser.add_argument("text", metavar="TEXT", help=f"at most {LONGEST_REMARK} characters")
        if act is Act.SPEED:
            parser.add_argument(
                "times",
                type=_times,
                metavar="TIMES",
                help="a number, 0 to stand still, or step for one more tick",
            )
        if act is Act.STOP:
            parser.add_argument(
                "--off", action="store_true", help="switch the controllers off, so that the aPad drifts"
            )
        if act in (Act.CONTINUE, Act.GIVE_BACK):
            parser.add_argument(
                "--stop",
                type=int,
                metavar="N",
                help="the stop's number; refused for one that is not the newest",
            )
            parser.add_argument(
                "--pilot-left",
                action="store_true",
                help="you have seen that no pilot steers, though the pilot's flag was never taken back",
            )
        if act is Act.BACK_IN:
            parser.add_argument("--lookout", required=True, metavar="NAME", help="who watches the water")
        if act is Act.ABORT:
            parser.add_argument(
                "--motors-off",
                action="store_true",
                help="first switch the aPad's controllers off, so that it drifts",
            )
        parser.add_argument(
            "--by", default=None, metavar="NAME", help="your name for the records (default: the user's name)"
        )
        parser.add_argument("--json", action="store_true", help="print the answers by aPad as JSON on stdout")
        parser.set_defaults(act=act)


def _times(text: str) -> float | None:
    if text == "step":
        return None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"TIMES is a number or step, not '{text}'") from None


def run(arguments: argparse.Namespace) -> int:
    requests = _requests(arguments)
    answers: dict[str, Answer] = {}
    silent: list[str] = []
    supervised = _supervised(arguments.directory)
    _tell(f"asking the supervisor of {arguments.directory}")
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


def _tell(line: str) -> None:
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
            answer = ask(directory, request, lambda: _tell(late))
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
    request = Request(
        arguments.act,
        by,
        getattr(arguments, "text", ""),
        off=getattr(arguments, "off", False),
        stop=getattr(arguments, "stop", None),
        pilot_left=getattr(arguments, "pilot_left", False),
        lookout=getattr(arguments, "lookout", ""),
        times=getattr(arguments, "times", None),
    )
    if request.mistake:
        raise UserError(request.mistake)
    if getattr(arguments, "motors_off", False):
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

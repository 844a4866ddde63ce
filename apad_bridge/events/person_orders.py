"""A person's orders to one aPad, each declared once: its command, its ROS service and its buttons follow from here.

`supervisor/control_server.py` carries them out. The command that stops an aPad loads this module, which therefore
imports little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

LONGEST_REMARK, LONGEST_NAME = 2000, 100
"""Characters."""


class Act(StrEnum):
    STOP = "stop"
    HANDS = "hands"
    """Somebody has hands at the docks: controllers off, and no arm moves."""
    CONTINUE = "continue"
    GIVE_BACK = "give back"
    """Continue, and return the aPad to the mission from a person who took it over."""
    BACK_IN = "back in"
    """Straight back inside the fence, from at most 5 m outside."""
    ABORT = "abort"
    REMARK = "remark"
    SPEED = "speed"
    GO_TO = "go to"
    """Like HOLD, for consoles that send places: neither has a command."""
    HOLD = "hold"

    @property
    def command(self) -> str:
        return self.value.replace(" ", "-")


@dataclass(frozen=True, slots=True)
class Button:
    """A button of the live page. It names the newest stop where the order's command takes `--stop`."""

    id: str
    label: str
    in_bar: bool = False
    """True for the bar that stays in sight."""
    title: str = ""
    asks: str = ""
    """The question that the person answers first."""
    sends: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the request besides the act and the name."""


@dataclass(frozen=True, slots=True)
class PersonOrder:
    line: str
    """Its line in the list of all commands."""
    description: str
    examples: tuple[str, ...]
    arguments: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The command's own, as `argparse` takes them. Each fills the request's field of its name."""
    service: str = ""
    """The type of the service below /musselbed/NAME; empty for an order without one."""
    buttons: tuple[Button, ...] = ()


def _times(text: str) -> float | None:
    try:
        return None if text == "step" else float(text)
    except ValueError:
        from argparse import ArgumentTypeError  # a stop does without

        raise ArgumentTypeError(f"TIMES is a number or step, not '{text}'") from None


_NO_EMERGENCY_STOP = "This is no emergency stop: it needs a live supervisor and a link to the vehicle."
_AFTER_A_STOP: dict[str, dict[str, Any]] = {
    "--stop": {
        "type": int,
        "metavar": "N",
        "help": "the stop's number; refused for one that is not the newest",
    },
    "--pilot-left": {
        "action": "store_true",
        "help": "you have seen that no pilot steers, though the pilot's flag was never taken back",
    },
}
PERSON_ORDERS = {
    Act.STOP: PersonOrder(
        "hold the aPad where it is, or switch it off, until `continue`",
        "The aPad holds its position where it may: a position that is believed, inside the fence. Else its controllers go "
        "off, and it drifts. A second stop, a second or more after the first, switches them off. The command says `done` "
        "only when the vehicle has accepted the stop and the hull slows; nothing moves the aPad before `musselbed "
        f"continue`. {_NO_EMERGENCY_STOP}",
        ("musselbed stop runs/pool-12-1", "musselbed stop runs/bay-120-1/apad2 --off --by Anna"),
        {"--off": {"action": "store_true", "help": "switch the controllers off, so that the aPad drifts"}},
        service="std_srvs/Trigger",
        buttons=(
            Button("stop", "Stop: hold here", in_bar=True),
            Button("off", "OFF: no thrust", in_bar=True, sends={"off": True}),
        ),
    ),
    Act.HANDS: PersonOrder(
        "controllers off and arms still, for hands at the docks",
        "For hands at the docks, mooring, and the crane: the controllers go off, and no arm of a dock moves, until "
        f"`musselbed continue`. {_NO_EMERGENCY_STOP}",
        ("musselbed hands runs/pool-12-1", "musselbed hands runs/bay-120-1/apad2 --by Anna"),
        buttons=(Button("hands", "Hands at the vehicle"),),
    ),
    Act.CONTINUE: PersonOrder(
        "continue a run that was stopped or taken over",
        "The mission plans anew from the aPad's place. A script, or a flight by hand, continues where it stopped: an aPad "
        "that a person took over stays with that person until `musselbed give-back`. The word counts for the newest stop, "
        "and says that the position is right.",
        ("musselbed continue runs/pool-12-1", "musselbed continue runs/pool-12-1 --stop 3 --by Anna"),
        _AFTER_A_STOP,
        service="musselbed_msgs/Continue",
        buttons=(
            Button(
                "continue",
                "Continue",
                in_bar=True,
                asks="The aPad will move again. Is the water around it clear?",
            ),
        ),
    ),
    Act.GIVE_BACK: PersonOrder(
        "return the aPad to the mission from a person who took it over",
        "Continues, and returns the aPad to the mission from a person who took it over.",
        ("musselbed give-back runs/pool-12-1", "musselbed give-back runs/pool-12-1 --stop 3 --by Anna"),
        _AFTER_A_STOP,
        buttons=(
            Button(
                "give-back",
                "Give back",
                in_bar=True,
                title="Continue, and return the aPad to the mission from a person who took it over",
                asks="The mission will move the aPad. Is the water around it clear?",
            ),
        ),
    ),
    Act.BACK_IN: PersonOrder(
        "send an aPad just outside the fence back inside, with a lookout",
        "Sends an aPad that lies at most 5 m outside the fence straight back inside, across no keep-out zone, where it "
        "holds. An aPad of generation A obeys no speed: bring it back by joystick.",
        (
            "musselbed back-in runs/pool-12-1 --lookout Bo",
            "musselbed back-in runs/pool-12-1 --lookout Bo --by Anna",
        ),
        {"--lookout": {"required": True, "metavar": "NAME", "help": "who watches the water"}},
    ),
    Act.ABORT: PersonOrder(
        "end the mission of a run; the aPad holds its position",
        f"The run ends in order, with its summary, and exit code 0. {_NO_EMERGENCY_STOP}",
        ("musselbed abort runs/pool-12-1", "musselbed abort runs/pool-12-1 --motors-off"),
        {
            "--motors-off": {
                "action": "store_true",
                "help": "first switch the aPad's controllers off, so that it drifts",
            }
        },
        service="std_srvs/Trigger",
        buttons=(
            Button(
                "abort",
                "Abort the mission",
                asks="End the mission? The aPad holds its position, and nothing plans any more.",
            ),
        ),
    ),
    Act.REMARK: PersonOrder(
        "write a remark into the records of a run",
        "The journal, the bag and the replay page show the remark at its mission time.",
        (
            'musselbed remark runs/pool-12-1 "fishing boat 200 m north"',
            'musselbed remark runs/pool-12-1 "gone" --by Anna',
        ),
        {"text": {"metavar": "TEXT", "help": f"at most {LONGEST_REMARK} characters"}},
    ),
    Act.SPEED: PersonOrder(
        "change the speed of a simulated flight, or let its time stand still",
        "Changes the speed of a simulated flight: TIMES mission seconds in a wall second. With 0, mission time stands "
        "still, and `step` lets one more tick come. The flight is the same as without a change, and so is its digest. On a "
        "real aPad, and on somebody else's /clock, it changes nothing: there `musselbed stop RUN` stops.",
        (
            "musselbed speed runs/pool-12-1 5",
            "musselbed speed runs/pool-12-1 0",
            "musselbed speed runs/pool-12-1 step",
        ),
        {
            "times": {
                "type": _times,
                "metavar": "TIMES",
                "help": "a number, 0 to stand still, or step for one more tick",
            }
        },
    ),
}
"""The acts that have a command, in the order of the list of all commands."""

"""A person, or a program of theirs, at the bench's services below /musselbed/NAME: calls what it is told to.

    python caller.py NAME SOCKET    (a Python with rospy and our messages on its path)

Orders are lines of JSON to the datagram socket:
    {"call": "take_over"}                                           once
    {"call": "go_to_point", "places": [[NORTH, EAST], ...], "every_s": 0.4}    to each in turns, for ever; every_s 0: once
It prints a line of JSON for each answer: when it was asked and answered by the monotonic clock, and the answer. A line
with the call `goto_status` is what the bench tells of its go-to: 4 for one that failed.
"""

from __future__ import annotations

import itertools
import json
import threading
import time
from typing import Any

import rospy
from musselbed_msgs.srv import Continue, GoToPoint, HoldPosition
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from safety.nodes.ordered import serve

STEP_S = 0.05
KINDS = {"go_to_point": GoToPoint, "hold_position": HoldPosition, "continue": Continue}
"""Every other service is a Trigger."""


def call(name: str, request: dict[str, Any]) -> None:
    asked_s = time.monotonic()
    try:
        answer = rospy.ServiceProxy(f"/musselbed/apad1/{name}", KINDS.get(name, Trigger))(**request)
        accepted, message = getattr(answer, "accepted", getattr(answer, "success", None)), answer.message
    except rospy.ServiceException as failed:
        accepted, message = None, str(failed)
    said = {"call": name, "asked_s": asked_s, "answered_s": time.monotonic()}
    print(json.dumps({**said, "accepted": accepted, "message": message}), flush=True)


def tell(status: Any) -> None:
    said = {"call": "goto_status", "answered_s": time.monotonic(), "status": status.data}
    print(json.dumps(said), flush=True)


class Caller:
    """Each call has a thread of its own: the bench answers at its next tick, and a person does not wait for that."""

    def __init__(self) -> None:
        rospy.Subscriber("/musselbed/apad1/goto_status", Int32, tell)
        self._again: tuple[str, Any, float] | None = None
        self._due_s = 0.0

    def obey(self, order: dict[str, Any]) -> None:
        name, request = order.pop("call"), order
        if "places" in request:
            requests = itertools.cycle([{"north_m": n, "east_m": e} for n, e in request["places"]])
            self._again = (name, requests, request["every_s"])
            self._due_s = time.monotonic()
            self.step()
            self._again = self._again if request["every_s"] else None
        else:
            self._begin(name, request)

    def step(self) -> None:
        if self._again is not None and time.monotonic() >= self._due_s:
            name, requests, every_s = self._again
            self._due_s += every_s
            self._begin(name, next(requests))

    def _begin(self, name: str, request: dict[str, Any]) -> None:
        threading.Thread(target=call, args=(name, request), daemon=True).start()


if __name__ == "__main__":
    serve(Caller, STEP_S)

"""Lets a console on another machine follow the supervisor's run, and anybody on the graph give it a person's orders.

The run's directory stays where the supervisor is. `/musselbed/NAME/read_run` gives the bytes of its files from an offset
on, and `/musselbed/NAME/give_order` takes what `musselbed stop` and the others write into the socket there, by the same
rules. `/musselbed/NAME/stop`, `continue` and `abort` give these orders without a text, so that a ROS tool can. A stop
answers when the vehicle has taken it, or with the reason. A program that continues must name the stop that it has seen,
because another one may have come since. All run in rospy's threads, and the flight waits for none.
"""

from __future__ import annotations

import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import rospy

from apad_bridge.events.person_orders import LONGEST_NAME, PERSON_ORDERS, Act
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours_of_apad
from apad_bridge.supervisor.control_protocol import Request, answer_of
from apad_bridge.supervisor.control_server import answered_line

use_generated_messages()

from musselbed_msgs.srv import (  # noqa: E402
    Continue,
    ContinueResponse,
    GiveOrder,
    GiveOrderResponse,
    ReadRun,
    ReadRunResponse,
)
from std_srvs.srv import Trigger, TriggerResponse  # noqa: E402

JOURNAL, SUMMARY = "journal.jsonl", "summary.json"
FILES = ("scenario.yaml", "run.json", JOURNAL, SUMMARY)
MOST_BYTES = 65_536
"""One answer has so many: a few seconds of a poor Wi-Fi, which then does not delay an order for longer."""
_FOLLOWED_S = 5.0
"""Wall seconds: a console that has read so recently still follows."""
_END_S = 5.0
"""A run's end waits so long, at most, until a console that follows has all of it."""


class RunServices:
    """On the graph until `close`."""

    def __init__(self, run_dir: Path, apad: str) -> None:
        self._run_dir = run_dir
        self._read_s = -_FOLLOWED_S
        self._gave_summary = False
        self._all_read = threading.Event()
        orders = {
            "std_srvs/Trigger": (Trigger, self._triggered),
            "musselbed_msgs/Continue": (Continue, self._continue),
        }
        self._services = [
            rospy.Service(ours_of_apad(apad, "read_run"), ReadRun, self._read),
            rospy.Service(ours_of_apad(apad, "give_order"), GiveOrder, self._order),
            *(
                rospy.Service(
                    ours_of_apad(apad, act), orders[it.service][0], partial(orders[it.service][1], act)
                )
                for act, it in PERSON_ORDERS.items()
                if it.service
            ),
        ]

    def close(self) -> None:
        """Leaves the graph once a console that follows has the run's end, or after `_END_S`."""
        if RunDirectory(self._run_dir).summary.is_file() and time.monotonic() - self._read_s < _FOLLOWED_S:
            self._all_read.wait(_END_S)
        for service in self._services:
            service.shutdown("the flight is over")

    def _read(self, request: Any) -> Any:
        if request.file not in FILES:
            raise rospy.ServiceException(f"a run has {', '.join(FILES)} to read")
        self._read_s = time.monotonic()
        try:
            with (self._run_dir / request.file).open("rb") as file:
                file.seek(request.offset)
                data = file.read(MOST_BYTES)
        except FileNotFoundError:
            return ReadRunResponse(exists=False)
        if request.file == SUMMARY:
            self._gave_summary = True
        elif request.file == JOURNAL and self._gave_summary and not data:
            # Whoever asks beyond the journal's end has received what it was given before.
            self._all_read.set()
        return ReadRunResponse(exists=True, data=data)

    def _triggered(self, act: Act, request: Any) -> Any:
        answer = answer_of(self._run_dir, Request(act, _caller(request)))
        told = [] if answer.stop is None else [f"stop {answer.stop}: {answer.mode}, {answer.state}"]
        told += [answer.message] if answer.message else []
        return TriggerResponse(success=answer.accepted, message="; ".join(told))

    def _continue(self, act: Act, request: Any) -> Any:
        answer = answer_of(self._run_dir, Request(act, _caller(request), stop=request.stop))
        return ContinueResponse(accepted=answer.accepted, message=answer.message)

    def _order(self, request: Any) -> Any:
        return GiveOrderResponse(answered_line(self._run_dir, request.request.encode()).decode())


def _caller(request: Any) -> str:
    """The caller's node, which stands for the person because ROS names nobody else."""
    return f"node {request._connection_header['callerid']}"[:LONGEST_NAME]

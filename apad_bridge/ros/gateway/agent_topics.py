"""Publishes the aMussels' own topics, /amusselN/position and battery_level, from a thread of their own.

The legacy stack's aMussels publish their position ten times a second and their charge once. Here these are seconds of the
master's time, its /clock where it has one, as for the aPad's own topics. Between two looks at that time `LOOK_S` of wall
time pass: however fast it runs, a report is repeated at most fifty times a wall second. The newest report is repeated with
its stamp, so a reader sees its age. The flight hands over the reports at its ticks and never waits.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import rospy
from std_msgs.msg import Float64

from apad_bridge.beliefs.belief import Belief
from apad_bridge.ros.gateway.never_blocking import Stalls, never_blocking_publisher
from apad_bridge.ros.system.node import ned_frame
from apad_bridge.ros.system.ros_time import stamp, to_ms
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel
from apad_bridge.scenario.area.local_frame import LocalFrame

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

PERIOD_MS = 100
LOOK_S = 0.02
"""Wall seconds; our own /clock comes no more often than that either."""
_END_S = 5.0


@dataclass(frozen=True, slots=True)
class AgentReport:
    """The content of an aMussel's own topics and services: local NED metres, the active battery's charge in [0, 1]."""

    north_m: float
    east_m: float
    depth_m: float
    charge: float

    @classmethod
    def of_belief(cls, belief: Belief) -> AgentReport:
        return cls(belief.north_m, belief.east_m, belief.reported.depth_m or 0.0, belief.primary)


class AgentTopics:
    """`show` belongs to the flight's thread, everything else to the publishing thread until `close`."""

    def __init__(self, agent_ids: Iterable[int], frame: LocalFrame | None = None) -> None:
        ids = list(agent_ids)
        self._frame = frame
        self.published: Counter[str] = Counter()
        """Messages made, by the topics' last name. Each went to every reader but those in `stalls`."""
        self.stalls = Stalls()
        self._positions = {it: self._publisher(it, "position", NavSts) for it in ids}
        self._batteries = {it: self._publisher(it, "battery_level", Float64) for it in ids}
        self._changed = threading.Condition()
        self._newest: tuple[int, Mapping[int, AgentReport]] | None = None
        self._ended = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="aMussels' topics", daemon=True)
        self._thread.start()

    def show(self, now_ms: int, shown: Mapping[int, AgentReport]) -> None:
        """Publishes `shown`, which must not change any more, from now on. Raises the error that ended the thread."""
        with self._changed:
            if self._failure is not None:
                raise self._failure
            self._newest = now_ms, shown
            self._changed.notify()

    def close(self) -> None:
        """Ends the thread. The last reports may not have been sent."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(_END_S)

    def _publisher(self, agent_id: int, name: str, kind: Any) -> Any:
        return never_blocking_publisher(of_amussel(agent_id, name), kind, self.stalls)

    def _run(self) -> None:
        try:
            self._publish()
        except Exception as error:
            with self._changed:
                self._failure = error

    def _publish(self) -> None:
        positions: dict[int, Any] = {}
        due_ms = _now_ms()
        while True:
            newest = self._wait(due_ms)
            if self._ended:
                return
            now_ms = _now_ms()
            if newest is None:
                # A leap of the clock brings one message, and no second one to make up for it.
                due_ms += PERIOD_MS
                if not now_ms < due_ms <= now_ms + PERIOD_MS:
                    due_ms = now_ms + PERIOD_MS
            else:
                due_ms = now_ms + PERIOD_MS
                at_ms, shown = newest
                positions = {agent_id: nav_sts(it, at_ms, self._frame) for agent_id, it in shown.items()}
                charges = {agent_id: Float64(100 * it.charge) for agent_id, it in shown.items()}
                self._send("battery_level", self._batteries, charges)
            self._send("position", self._positions, positions)

    def _wait(self, due_ms: int) -> tuple[int, Mapping[int, AgentReport]] | None:
        """Waits for new reports. None when it is time to repeat the former ones, or when the master's time went back."""
        with self._changed:
            while self._newest is None and not self._ended:
                self._changed.wait(LOOK_S)
                if not due_ms - PERIOD_MS <= _now_ms() < due_ms:
                    break
            newest, self._newest = self._newest, None
            return newest

    def _send(self, name: str, publishers: Mapping[int, Any], messages: Mapping[int, Any]) -> None:
        for agent_id, message in messages.items():
            publisher = publishers.get(agent_id)
            # Without a subscriber the message is not made: a thousand aMussels cost nothing then.
            if publisher is not None and publisher.get_num_connections() > 0:
                publisher.publish(message)
                self.published[name] += 1


def _now_ms() -> int:
    """The master's time."""
    return to_ms(rospy.get_rostime())


def nav_sts(shown: AgentReport, now_ms: int, frame: LocalFrame | None) -> NavSts:
    """Leaves global_position and origin at 0, with a status to that effect, without a `frame` on the globe."""
    message = NavSts()
    message.header.stamp = stamp(now_ms)
    message.header.frame_id = ned_frame()
    message.position.north, message.position.east = shown.north_m, shown.east_m
    message.position.depth = shown.depth_m
    if frame is None:
        message.status = NavSts.STATUS_ALL_OK & ~NavSts.STATUS_GLOBAL_FRAME_OK
        return message
    message.origin.latitude, message.origin.longitude = frame.latitude_deg, frame.longitude_deg
    place = message.global_position
    place.latitude, place.longitude = frame.to_geographic(shown.north_m, shown.east_m)
    message.status = NavSts.STATUS_ALL_OK
    return message

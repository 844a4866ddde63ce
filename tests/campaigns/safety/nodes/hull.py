"""The simulated aPad as a hull whose position and battery leave it on topics of their own, for a relay in between.

    python -m safety.nodes.hull --scenario RESOLVED.yaml [--apad NAME] [--tether METRES] [--orders SOCKET] [--direct]

The place that it publishes on /hull/position is the truth, whatever a relay makes of it on /apad1/position. With
--direct its topics have their own names, and no relay is there. Orders are lines of JSON to the datagram socket; each has
one or more of these keys:

    {"hull": "obeys"}        it does what its software wants, as in the beginning
    {"hull": "tied"}         nothing takes it further than METRES from where it is
    {"hull": "deaf"}         it keeps its velocity over ground, whatever its software has taken and answered; with
                             "velocity_m_s": [NORTH, EAST] it has that one
    {"hull": "reversed"}     its thrusters push the other way
    {"answer_s": 1.5, "takes_first": true}    each service of generation B answers so late, one call after the other;
                                              it takes the order before that time, or after it
    {"busy_s": 2}            no service of generation B takes an order for so long
"""

from __future__ import annotations

import json
import math
import runpy
import socket
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import rosgraph.names

from apad_bridge.world.apad.kinematics import Pose, moved
from apad_bridge.world.apad.motion import Motion

REMAPPED = {f"/apad1/{leaf}": f"/hull/{leaf}" for leaf in ("position", "battery_level")}


def remap() -> None:
    """Does what `FROM:=TO` does on the command line of any other node."""
    known = rosgraph.names.load_mappings
    rosgraph.names.load_mappings = lambda argv: known(argv) | REMAPPED


class Hull:
    """The faults of a hull and of its services. Orders come in a thread of their own."""

    def __init__(self, tether_m: float) -> None:
        self._tether_m = tether_m
        self._kind = "obeys"
        self._tied: tuple[float, float] | None = None
        self._velocity_m_s: tuple[float, float] | None = None
        self._answer_s, self._takes_first = 0.0, False
        self._busy_until_s = 0.0

    def obey(self, order: dict[str, Any]) -> None:
        self._tied = None if "hull" in order else self._tied
        self._kind = order.get("hull", self._kind)
        self._velocity_m_s = order.get("velocity_m_s")
        self._answer_s = order.get("answer_s", self._answer_s)
        self._takes_first = order.get("takes_first", self._takes_first)
        self._busy_until_s = time.monotonic() + order.get("busy_s", 0.0)

    def spoil(self) -> None:
        """From now on each hull and each service of this process has these faults."""
        # Not before `remap`: rospy reads its names' mappings when it is imported.
        from apad_bridge.ros.generation_b import server

        end_step, offer = Motion.end_step, server.Server._offer

        def ends(motion: Motion) -> None:
            before = motion.pose
            end_step(motion)
            motion.pose = self._pose(motion, before)

        def offers(server: Any, apad: str, name: str, kind: Any, answer: Callable[[Any], Any]) -> None:
            offer(server, apad, name, kind, lambda request: self._answered(answer, request))

        Motion.end_step = ends  # type: ignore[method-assign, assignment]
        server.Server._offer = offers  # type: ignore[method-assign, assignment]

    def _pose(self, motion: Motion, before: Pose) -> Pose:
        after = motion.pose
        match self._kind:
            case "tied":
                self._tied = self._tied or (before.north_m, before.east_m)
                if math.dist(self._tied, (after.north_m, after.east_m)) > self._tether_m:
                    return replace(before, north_m_s=0.0, east_m_s=0.0)
            case "deaf":
                north_m_s, east_m_s = self._velocity_m_s or (before.north_m_s, before.east_m_s)
                return moved(before, (north_m_s, east_m_s), before.heading_rad)
            case "reversed" if motion._goal is not None or motion._steering is not None:
                north_m_s, east_m_s = (
                    2 * before.north_m_s - after.north_m_s,
                    2 * before.east_m_s - after.east_m_s,
                )
                slower = min(1.0, motion.top_speed_m_s / max(1e-9, math.hypot(north_m_s, east_m_s)))
                return moved(before, (slower * north_m_s, slower * east_m_s), after.heading_rad)
        return after

    def _answered(self, answer: Callable[[Any], Any], request: Any) -> Any:
        """The answer of a service, whose turn it has."""
        time.sleep(max(0.0, self._busy_until_s - time.monotonic()))
        late_s = self._answer_s
        if not self._takes_first:
            time.sleep(late_s)
        answered = answer(request)
        if self._takes_first:
            time.sleep(late_s)
        return answered


def listen(path: str, hull: Hull) -> None:
    orders = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    orders.bind(path)

    def obey() -> None:
        while True:
            hull.obey(json.loads(orders.recv(4096)))

    threading.Thread(target=obey, daemon=True).start()


def taken(option: str) -> str | None:
    """The option's value, which it takes off the command line."""
    if option not in sys.argv:
        return None
    at = sys.argv.index(option)
    _, value = sys.argv[at], sys.argv[at + 1]
    del sys.argv[at : at + 2]
    return value


if __name__ == "__main__":
    if "--direct" in sys.argv:
        sys.argv.remove("--direct")
    else:
        remap()
    spoiled = Hull(float(taken("--tether") or math.inf))
    if (orders_path := taken("--orders")) is not None:
        listen(orders_path, spoiled)
    spoiled.spoil()
    runpy.run_module("apad_bridge.ros.simulated_node.apad_node", run_name="__main__", alter_sys=True)

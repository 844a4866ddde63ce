"""Watches an aPad's computer: every order that arrives there, whether the vehicle took it, and where the vehicle truly is.

    python -m safety.wire APAD HULL TRUTH [APAD HULL TRUTH ...]
        (on that computer, as its root, before any node starts. APAD is a vehicle's namespace, HULL the name of its node,
        TRUTH the topic on which the hull publishes its place before anything falsifies it)

It is no node, and nobody knows of it. It prints `reading`, then a line of JSON for each fact. `apad` is the vehicle, and
`at_s` the time by the monotonic clock, which all processes of a machine share. Exit code 1: packets were lost to it, and
nothing is known from then on.

    truth   north, east, yaw, stamp           the hull's own position
    call    number, order, by, place, enable  a service's request at the vehicle; `order` is the service below APAD
    answer  number, order, took, text         its answer; `took` is False for a refusal of either kind
    goal    key, kind, by, place              a goal of generation A
    cancel  key, by                           key is empty for all goals
    status  goals                             codes of actionlib_msgs/GoalStatus by key, when they change
    pilot   steers, by
    arms    open, by                          one of the four that stand open, or -1, when it changes
    watchdog  state                           when it changes
    heartbeat  says_off                       one of the bench's, as it arrives at the watchdog

Standard library only: the judge shares no code, and no definition of a message, with what it judges.
"""

from __future__ import annotations

import json
import math
import socket
import struct
import sys
import time
from typing import Any

from safety.tcpros import Answer, Call, Heard, Message, PacketsMissed, Reader

_ALL_PACKETS = 0x0003
"""ETH_P_ALL (packet(7)): what arrives and what leaves."""
_IPV4 = 0x0800
_BUFFER_BYTES = 2**24
AT_REST_M, REPEATED_S = 0.02, 0.5
"""A truth that is told: the vehicle has moved so far, or so long has passed."""
BENCH_OFF = -1.0
"""The number of a heartbeat while an OFF of the bench is in force (docs/failures.md)."""
GO_TO = 0
"""A goal's kind in generation A; 1 perches, 2 releases."""

Fact = dict[str, Any]


class Cursor:
    """Reads a ROS message's fields (wiki.ros.org/msg): little-endian, unpadded, a text with its length before it."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def numbers(self, layout: str) -> tuple[Any, ...]:
        it = struct.Struct("<" + layout)
        values = it.unpack_from(self._data, self._at)
        self._at += it.size
        return values

    def text(self) -> str:
        (length,) = self.numbers("I")
        (text,) = self.numbers(f"{length}s")
        return str(text.decode(errors="replace"))

    def header(self) -> float:
        """std_msgs/Header; returns its stamp in seconds."""
        _, seconds, nanoseconds = self.numbers("III")
        self.text()
        return float(seconds + 1e-9 * nanoseconds)

    def goal_id(self) -> str:
        self.numbers("II")
        return self.text()


def truth_of(data: bytes) -> Fact:
    """auv_msgs/NavSts."""
    it = Cursor(data)
    stamp = it.header()
    it.numbers("4d")  # latitude and longitude of the place, and of the origin
    north, east, _ = it.numbers("3d")
    it.numbers("f6d")  # altitude, and two velocities
    _, _, yaw = it.numbers("3f")
    return {"north": north, "east": east, "yaw": yaw, "stamp": stamp}


def goal_of(data: bytes) -> Fact:
    """apad/aPadActionGoal. A perch and a release have no place."""
    it = Cursor(data)
    it.header()
    key = it.goal_id()
    kind, north, east = it.numbers("hdd")
    return {"key": key, "kind": kind, "place": [north, east] if kind == GO_TO else None}


def statuses_of(data: bytes) -> dict[str, int]:
    """actionlib_msgs/GoalStatusArray: codes by key."""
    it = Cursor(data)
    it.header()
    codes = {}
    for _ in range(it.numbers("I")[0]):
        key = it.goal_id()
        (codes[key],) = it.numbers("B")
        it.text()
    return codes


def open_arm_of(data: bytes) -> int:
    """std_msgs/Float32MultiArray of `dock_out`: the first arm that stands open, or -1."""
    it = Cursor(data)
    for _ in range(it.numbers("I")[0]):
        it.text()
        it.numbers("II")
    _, count = it.numbers("II")
    values = it.numbers(f"{count}f")
    return next((number for number, value in enumerate(values) if value > 0.5), -1)


def request_of(order: str, data: bytes) -> Fact:
    """The place or the switch that a service of the vehicle is asked for; {} where it has neither."""
    it = Cursor(data)
    match order:
        case "commander/primitive/go2point":
            _, north, east = it.numbers("B2d")
        case "commander/go2point" | "commander/primitive/dynamic_positioning":
            north, east = it.numbers("2d")
        case "VelCon_enable" | "FADP_enable":
            return {"enable": bool(it.numbers("B")[0])}
        case _:
            return {}
    return {"place": [north, east]}


class Wire:
    """Turns what nodes say to each other into facts."""

    def __init__(self, apad: str, hull: str, truth: str) -> None:
        self._apad, self._hull, self._truth = apad, hull, truth
        self._heartbeats = ("/musselbed/heartbeat", f"/musselbed{apad}/heartbeat")
        self._told: dict[str, object] = {}
        self._place, self._stamp = (math.inf, math.inf), -math.inf

    def take(self, heard: Heard) -> Fact | None:
        """None for what is no fact; {"fact": "unread"} for what the layouts do not fit."""
        try:
            match heard:
                case Message():
                    return self._message(heard)
                case Call(number, service, by, data):
                    order = self._order(service)
                    if order is None:
                        return None
                    return {"fact": "call", "number": number, "order": order, "by": by} | request_of(
                        order, data
                    )
                case Answer(number, service, _, ok, data):
                    order = self._order(service)
                    if order is None:
                        return None
                    # The published commander leaves `success` of stop_mission false, and has stopped all the same.
                    refused = order != "commander/stop_mission" and ok and len(data) > 0 and data[0] == 0
                    text = data.decode(errors="replace") if not ok else ""
                    return {
                        "fact": "answer",
                        "number": number,
                        "order": order,
                        "took": ok and not refused,
                        "text": text,
                    }
        except struct.error:
            return {"fact": "unread", "what": repr(heard)[:200]}

    def _order(self, service: str) -> str | None:
        """The service's name below the vehicle's, where it moves something."""
        leaf = service.removeprefix(f"{self._apad}/")
        moves = leaf.startswith("commander/") or leaf in (
            "VelCon_enable",
            "FADP_enable",
            "ConfigureVelocityController",
        )
        return leaf if moves and leaf != service else None

    def _message(self, it: Message) -> Fact | None:
        if it.topic == self._truth:
            return self._new_truth(it.data) if it.by == self._hull else None
        leaf = it.topic.removeprefix(f"{self._apad}/")
        match leaf:
            case "action_server/goal" if it.to == self._hull:
                return {"fact": "goal", "by": it.by} | goal_of(it.data)
            case "action_server/cancel" if it.to == self._hull:
                return {"fact": "cancel", "by": it.by, "key": Cursor(it.data).goal_id()}
            case "action_server/status" if it.by == self._hull:
                codes = statuses_of(it.data)
                return self._changed("status", codes, goals=codes)
            case "manual":
                steers = bool(it.data[0])
                return self._changed(f"pilot {it.by}", steers, fact="pilot", steers=steers, by=it.by)
            case "dock_out":
                arm = open_arm_of(it.data)
                return self._changed(f"arms {it.by}", arm, fact="arms", open=arm, by=it.by)
            case "watchdog":
                state = Cursor(it.data).text()
                return self._changed("watchdog", state, state=state)
            case _ if it.topic in self._heartbeats and "watchdog" in it.to:
                return {"fact": "heartbeat", "says_off": Cursor(it.data).numbers("f") == (BENCH_OFF,)}
        return None

    def _new_truth(self, data: bytes) -> Fact | None:
        """Each subscriber of the truth gets it, and a vehicle at rest repeats it ten times a second."""
        truth = truth_of(data)
        place, stamp = (truth["north"], truth["east"]), truth["stamp"]
        if math.dist(place, self._place) < AT_REST_M and abs(stamp - self._stamp) < REPEATED_S:
            return None
        self._place, self._stamp = place, stamp
        return {"fact": "truth"} | truth

    def _changed(self, what: str, value: object, **fact: Any) -> Fact | None:
        if self._told.get(what) == value:
            return None
        self._told[what] = value
        return {"fact": what} | fact


def main() -> int:
    reader = Reader()
    wires = {sys.argv[at]: Wire(*sys.argv[at : at + 3]) for at in range(1, len(sys.argv), 3)}
    # SOCK_DGRAM: without the link's own header, which differs between the loopback and a TUN device.
    with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL_PACKETS)) as packets:
        packets.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        print("reading", flush=True)
        while True:
            packet, (_, protocol, *_) = packets.recvfrom(2**17)
            at_s = time.monotonic()
            if protocol != _IPV4:
                continue
            try:
                said = reader.take(packet)
            except PacketsMissed as why:
                print(f"wire: {why}", file=sys.stderr)
                return 1
            for apad, wire in wires.items():
                for fact in filter(None, map(wire.take, said)):
                    print(json.dumps({"at_s": round(at_s, 4), "apad": apad, **fact}), flush=True)


if __name__ == "__main__":
    sys.exit(main())

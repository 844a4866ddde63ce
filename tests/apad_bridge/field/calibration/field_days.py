"""Days at sea of a simulated aPad whose numbers only the test knows, as its own topics tell them, GPS noise included."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from apad_bridge.records.bag import RecordedConnection, RecordedMessage
from apad_bridge.records.bag_messages import typestore
from apad_bridge.scenario.schema import APad
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.generation_a.messages import GO_TO, PERCH, RELEASE, GoalOrder
from apad_bridge.vehicle.generation_b.messages import DockingOrder, PrimitiveStatus
from apad_bridge.vehicle.stack_messages import BatteryReceived
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a import simulated_messages as of_a
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.generation_b import simulated_messages as of_b
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle
from apad_bridge.world.simulated_stack import PosePublished

EPOCH_S, RADIUS_M, NAV = 1.7e9, 0.5, "auv_msgs/msg/NavSts"
_ACTION = {
    "actionlib_msgs/msg/GoalID": "time stamp\nstring id\n",
    "actionlib_msgs/msg/GoalStatus": "GoalID goal_id\nuint8 status\nstring text\n",
    "apad/msg/aPadGoal": "int16 id\ngeometry_msgs/Pose pose\nstring object\ngeometry_msgs/Pose pose_offset\n",
    "apad/msg/aPadResult": "int16 id\nint16 status\ngeometry_msgs/Pose pose\n",
    "apad/msg/aPadActionGoal": "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\naPadGoal goal\n",
    "apad/msg/aPadActionResult": "std_msgs/Header header\nactionlib_msgs/GoalStatus status\naPadResult result\n",
}
_CODES = {of_a.GoalOutcome.SUCCEEDED: 3, of_a.GoalOutcome.ABORTED: 4, of_a.GoalOutcome.PREEMPTED: 2}


@cache
def types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    found: dict[str, Any] = dict(typestore().fielddefs)
    for name, text in _ACTION.items():
        found.update(get_types_from_msg(text, name))
    store.register({name: fields for name, fields in found.items() if name not in store.types})
    return store


@cache
def _connection(topic: str, kind: str) -> RecordedConnection:
    return RecordedConnection(topic, kind, *types().generate_msgdef(kind))


@dataclass(frozen=True)
class Vehicle:
    """The numbers that the tool is to find."""

    speed_m_s: float
    config: APad

    @property
    def stopping_m(self) -> float:
        return self.speed_m_s**2 / (2 * self.config.max_acceleration_m_s2)


def drawn(config: APad, seed: int) -> Vehicle:
    draw = np.random.default_rng(seed).uniform
    its = {"hotel_w": float(draw(15, 40)), "charging_w_per_dock": float(draw(5, 20))}
    speed_m_s = float(draw(0.5, 0.9))
    numbers = {
        "max_acceleration_m_s2": float(draw(0.15, 0.35)),
        "thruster_w_per_n": float(draw(3, 9)),
        "drift_m_s": (float(draw(-0.1, 0.1)), float(draw(-0.1, 0.1))),
        "dock_miss_probability": float(draw(0.05, 0.4)),
    }
    return Vehicle(speed_m_s, replace(config, battery=replace(config.battery, **its), **numbers))


class Recorder:
    """What `rosbag record` would have, with a GPS of this deviation and a battery read in tenths of a percent."""

    def __init__(self, apad: str, draw: np.random.Generator, deviation_m: float) -> None:
        self.messages: list[RecordedMessage] = []
        self._apad, self._draw, self._deviation_m = apad, draw, deviation_m

    def take(self, published: list[Any]) -> list[Any]:
        for it in published:
            match it:
                case PosePublished(at_ms, seen):
                    noise = self._draw.normal(0, self._deviation_m, 2)
                    place = seen.north_m + float(noise[0]), seen.east_m + float(noise[1])
                    self.put(at_ms, f"/{self._apad}/position", NAV, self.nav(at_ms, place, 0))
                case of_a.HeldPositionPublished(at_ms, name, north_m, east_m, released):
                    told = self.nav(at_ms, (north_m, east_m), int(released))
                    self.put(at_ms, f"/{name}/position_static", NAV, told)
                case of_a.BatteryAndProgressPublished(at_ms, percent):
                    self._std(at_ms, "battery_level", "Float64", round(percent, 1))
                case of_b.BatteryPublished() | BatteryReceived():
                    self._std(it.at_ms, "battery_level", "Float64", round(it.percent, 1))
                case of_a.GoalEnded(at_ms, key, outcome):
                    self._result(at_ms, key, _CODES[outcome])
                case of_b.StatusPublished(at_ms, docking, status):
                    self._std(at_ms, "docking_status" if docking else "goto_status", "Int32", int(status))
                case of_b.ArmPublished(at_ms, arm):
                    states = np.array([float(it) for it in arm.is_open], np.float32)
                    layout = made("std_msgs/MultiArrayLayout", [], 0)
                    self._std(at_ms, "dock_out", "Float32MultiArray", layout, states)
        return published

    def _std(self, at_ms: int, leaf: str, kind: str, *values: Any) -> None:
        self.put(at_ms, f"/{self._apad}/{leaf}", f"std_msgs/msg/{kind}", made(f"std_msgs/{kind}", *values))

    def put(self, at_ms: int, topic: str, kind: str, message: Any) -> None:
        connection = _connection(topic, kind)
        data = types().serialize_ros1(message, kind)
        late_s = float(self._draw.exponential(0.005))
        self.messages.append(
            RecordedMessage(connection, round(1e9 * (EPOCH_S + at_ms / 1000 + late_s)), bytes(data))
        )

    def goal(self, at_ms: int, goal: GoalOrder) -> None:
        here = pose(goal.north_m, goal.east_m)
        inner = made("apad/aPadGoal", goal.kind, here, goal.name, here)
        self._action(at_ms, goal.key, "goal", "apad/aPadActionGoal", lambda goal_id: (goal_id, inner))

    def _result(self, at_ms: int, key: str, code: int) -> None:
        result = made("apad/aPadResult", 0, 0, pose(0.0, 0.0))
        self._action(
            at_ms,
            key,
            "result",
            "apad/aPadActionResult",
            lambda goal_id: (made("actionlib_msgs/GoalStatus", goal_id, code, ""), result),
        )

    def _action(self, at_ms: int, key: str, leaf: str, kind: str, rest: Callable[[Any], Any]) -> None:
        goal_id = made("actionlib_msgs/GoalID", self._time(at_ms), key)
        message = made(kind, self._header(at_ms), *rest(goal_id))
        self.put(at_ms, f"/{self._apad}/action_server/{leaf}", kind.replace("/", "/msg/"), message)

    def _time(self, at_ms: int) -> Any:
        whole_ms = round(EPOCH_S) * 1000 + at_ms
        return made("builtin_interfaces/Time", whole_ms // 1000, whole_ms % 1000 * 1_000_000)

    def _header(self, at_ms: int) -> Any:
        return made("std_msgs/Header", 0, self._time(at_ms), "local")

    def nav(self, at_ms: int, place: tuple[float, float], status: int) -> Any:
        degrees, point = made("auv_msgs/DecimalLatLon", 0.0, 0.0), made("geometry_msgs/Point", 0.0, 0.0, 0.0)
        angles, nothing = made("auv_msgs/RPY", 0.0, 0.0, 0.0), made("auv_msgs/NED", 0.0, 0.0, 0.0)
        return made(
            "auv_msgs/NavSts", self._header(at_ms), degrees, degrees, made("auv_msgs/NED", *place, 0.0), 0.0,
            point, point, angles, angles, nothing, angles, status,
        )  # fmt: skip


def made(kind: str, *fields: Any) -> Any:
    """A message of this kind, such as std_msgs/Header."""
    return types().types[kind.replace("/", "/msg/")](*fields)


def pose(north_m: float, east_m: float) -> Any:
    there = made("geometry_msgs/Point", north_m, east_m, 0.0)
    return made("geometry_msgs/Pose", there, made("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0))


def of_generation_a(
    vehicle: Vehicle, seed: int, go_tos: int = 24, deviation_m: float = 0.05
) -> list[RecordedMessage]:
    """Go-tos over a pool; at every second one it docks an aMussel, until two are held, and then releases both."""
    draw = np.random.default_rng(seed)
    recorder = Recorder("apad1", draw, deviation_m)
    misses = Misses(seed, vehicle.config.dock_miss_probability)
    apad = GenerationAVehicle(SimulatedAPad(vehicle.config), vehicle.speed_m_s, RADIUS_M, misses=misses)
    now_ms, number = 0, 0

    def order(kind: int, north_m: float = 0.0, east_m: float = 0.0, name: str = "") -> bool:
        nonlocal number, now_ms
        number += 1
        key = f"goal {number}"
        goal = GoalOrder(key, kind, north_m, east_m, name)
        recorder.goal(now_ms, goal)
        told = recorder.take(apad.receive(goal, now_ms))
        for _ in range(6000):
            ends = [it for it in told if isinstance(it, of_a.GoalEnded) and it.key == key]
            if ends:
                return ends[0].outcome is of_a.GoalOutcome.SUCCEEDED
            now_ms += 50
            told = recorder.take(apad.advance(now_ms))
        raise AssertionError("a goal never ended")

    def wait(seconds: float) -> None:
        nonlocal now_ms
        until_ms = now_ms + round(1000 * seconds) // 50 * 50
        while now_ms < until_ms:
            now_ms += 50
            recorder.take(apad.advance(now_ms))

    for n in range(go_tos):
        order(GO_TO, *_goal(draw, apad.pose.north_m, apad.pose.east_m))
        wait(draw.uniform(10, 40))
        while len(apad.held) < 2 and n % 2 and not order(PERCH, name=f"amussel{n}"):
            wait(2)
        if len(apad.held) == 2 and n % 4 == 1:
            for name in apad.held:
                order(RELEASE, name=name)
                wait(2)
    return recorder.messages


def of_generation_b(
    vehicle: Vehicle, seed: int, go_tos: int = 24, deviation_m: float = 0.05
) -> list[RecordedMessage]:
    """Go-tos over a pool, and at every third one the vehicle's own docking, which stands still at first."""
    draw = np.random.default_rng(seed)
    recorder = Recorder("apad1", draw, deviation_m)
    apad = GenerationBVehicle(SimulatedAPad(vehicle.config))
    now_ms = 0

    def until(ended: bool | None, limit_s: float) -> None:
        """`ended`: that a docking (True) or a go-to (False) has ended; None for the time alone."""
        nonlocal now_ms
        until_ms = now_ms + round(1000 * limit_s) // 100 * 100
        while now_ms < until_ms:
            now_ms += 100
            told = recorder.take(apad.advance(now_ms))
            if ended is not None and any(
                isinstance(it, of_b.StatusPublished)
                and it.docking == ended
                and it.status != PrimitiveStatus.RUNNING
                for it in told
            ):
                return

    def hold() -> None:
        recorder.take(apad.receive(Hold(0, apad.pose.north_m, apad.pose.east_m), now_ms))

    for n in range(go_tos):
        goal = GoTo(0, *_goal(draw, apad.pose.north_m, apad.pose.east_m), vehicle.speed_m_s, RADIUS_M)
        recorder.take(apad.receive(goal, now_ms))
        until(False, 300)
        hold()
        until(None, draw.uniform(10, 40))
        if n % 3 == 0:
            recorder.take(apad.receive(DockingOrder(True, 0, 0.2, 0.3, 0.3, 0.2), now_ms))
            until(None, 27.5)
            recorder.take(apad.detect(0.0, 0.85, now_ms))
            until(True, 10)
            hold()
            until(None, 10)
    return recorder.messages


def _goal(draw: np.random.Generator, north_m: float, east_m: float) -> tuple[float, float]:
    """Some 8 to 25 m away, within 30 m of the start."""
    while True:
        bearing, metres = draw.uniform(0, math.tau), draw.uniform(8, 25)
        goal = north_m + metres * math.cos(bearing), east_m + metres * math.sin(bearing)
        if math.hypot(*goal) < 30:
            return goal


def write_bag(path: Path, messages: Iterator[RecordedMessage] | list[RecordedMessage]) -> Path:
    with Writer(path) as writer:
        connections: dict[RecordedConnection, Any] = {}
        for it in messages:
            own = it.connection
            if own not in connections:
                connections[own] = writer.add_connection(
                    own.topic, own.kind, msgdef=own.definition, md5sum=own.md5
                )
            writer.write(connections[own], it.stamp_ns, it.data)
    return path

"""The topics of a run in ROS 2: their names, types and messages, by REP 103 and REP 105.

/amusselN/battery_state, fix    sensor_msgs/BatteryState, NavSatFix: the belief
/amusselN/belief/pose           geometry_msgs/PoseWithCovarianceStamped
/amusselN/truth/pose            geometry_msgs/PoseStamped: of a simulated aMussel alone
/APAD/odometry, battery_state, fix
/APAD/path, plan                nav_msgs/Path: its track, and the way of the plan under way
/APAD/markers                   visualization_msgs/MarkerArray
/APAD/events                    std_msgs/String: the events that people read, as JSON
/diagnostics, /tf, /tf_static, /clock
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from apad_bridge.events.event import Category
from apad_bridge.records.journal import Entry
from apad_bridge.ros2.followed_run import FollowedRun, MovingAPad
from apad_bridge.ros_names.frames import (
    NED_IN_ENU,
    UPRIGHT,
    Frames,
    Quaternion,
    Vector,
    enu,
    yaw,
)
from apad_bridge.ros_names.names import AMUSSEL, in_full, plain
from apad_bridge.ros_names.shown_fleet import (
    LIPO,
    DiagnosticLevel,
    MarkerShape,
    PlaceM,
    ShownAMussel,
    SupplyStatus,
    apad_shape,
    ball_size_m,
    condition_of,
    place_matrix,
)
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario

# Makes and serializes messages of ROS 2's standard types, without ROS 2: by the definitions that rosbags brings.
_STORE = get_typestore(Stores.ROS2_JAZZY)
"""From Humble to Lyrical the types that this room publishes have the same hash."""


def make(kind: str, **fields: Any) -> Any:
    """A message of a type, as `sensor_msgs/BatteryState`; fields that are not given are 0, empty or false."""
    return replace(_zero(_full(kind)), **fields)


def serialized(kind: str, message: Any) -> bytes:
    """The message's CDR, little-endian, with its header of four bytes."""
    return bytes(_STORE.serialize_cdr(message, _full(kind)))


@cache
def hash_of(kind: str) -> str:
    """The type's hash in hexadecimal (REP 2016, version 1)."""
    return _STORE.hash_rihs01(_full(kind)).removeprefix("RIHS01_")


def _full(kind: str) -> str:
    return kind.replace("/", "/msg/")


@cache
def _zero(name: str) -> Any:
    return _STORE.types[name](**{field: _zero_of(*of) for field, of in _STORE.fielddefs[name][1]})


def _zero_of(node: Any, inner: Any) -> Any:
    if node is Nodetype.NAME:
        return _zero(inner)
    if node is Nodetype.BASE:
        return {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}.get(inner[0], 0)
    (of, name), length = inner
    if of is Nodetype.NAME or name[0] == "string":
        return []
    return np.zeros(length if node is Nodetype.ARRAY else 0, np.dtype(name[0]))


EVENTS_KEPT = 100
"""A reader that comes later gets so many events."""
_DELETE_ALL = 3
"""Marker."""
_GPS = 1
_COVARIANCE_KNOWN = 3
"""NavSatStatus and NavSatFix."""


class TopicMessage(NamedTuple):
    topic: str
    kind: str
    data: bytes
    """CDR."""
    kept: int = 0
    """The number of newest messages that a later reader gets, by `transient local`; 0: volatile."""


class RunTopics:
    """Makes the messages of one aPad's run."""

    def __init__(self, scenario: Scenario, run: FollowedRun) -> None:
        self._run = run
        self._frames = Frames(run.namespace)
        self._geographic = LocalFrame.about(scenario.area.origin)
        self._apad = scenario.apad.name
        self._ids = tuple(scenario.fleet.ids)
        self._rules = scenario.mission
        self._ball_m = ball_size_m(scenario.area)
        self._shown: dict[str, list[PlaceM]] = {}
        """The points of the two paths, as they were published last."""

    @property
    def node(self) -> str:
        """The name of the node that publishes them."""
        return f"musselbed_{plain(self._apad)}"

    @property
    def summary(self) -> str:
        """The contents and their time, for people."""
        time = (
            "stamps are the wall clock's" if self._run.has_wall_time else "stamps are mission time, by /clock"
        )
        return f"{self._apad} and {len(self._ids)} aMussels; {time}"

    def clock(self) -> TopicMessage:
        return _published("/clock", "rosgraph_msgs/Clock", make("rosgraph_msgs/Clock", clock=self._now()))

    def fixed_frames(self) -> TopicMessage:
        frames = self._frames
        ned = self._transform(frames.enu, frames.ned, (0.0, 0.0, 0.0), NED_IN_ENU)
        return _published("/tf_static", "tf2_msgs/TFMessage", _tf([ned]), kept=1)

    def events(self, entries: Iterable[Entry]) -> Iterator[TopicMessage]:
        """The events with a text for people, as the journal's lines with `text` and `category`."""
        for entry in entries:
            if (text := entry.event.text()) is not None:
                told = {**entry.line, "text": text, "category": Category(entry.event.category).value}
                data = json.dumps(told, separators=(",", ":"))
                yield _published(
                    self._of_apad("events"),
                    "std_msgs/String",
                    make("std_msgs/String", data=data),
                    EVENTS_KEPT,
                )

    def state(self) -> Iterator[TopicMessage]:
        """All else, as of now."""
        beliefs, apad = self._run.beliefs, self._run.apad
        for it in beliefs:
            yield from self._of_belief(it)
        for agent_id, place_m, depth_m in self._run.truths:
            pose = _pose(enu(*place_m, depth_m), UPRIGHT)
            stamped = make("geometry_msgs/PoseStamped", header=self._in_world(), pose=pose)
            yield _published(self._of_amussel(agent_id, "truth/pose"), "geometry_msgs/PoseStamped", stamped)
        if apad is not None:
            yield from self._of_moving_apad(apad)
        yield _published("/tf", "tf2_msgs/TFMessage", _tf(self._transforms(beliefs, apad)))
        markers = make("visualization_msgs/MarkerArray", markers=list(self._markers(beliefs, apad)))
        yield _published(self._of_apad("markers"), "visualization_msgs/MarkerArray", markers)
        diagnostics = make(
            "diagnostic_msgs/DiagnosticArray", header=self._in_world(), status=list(self._statuses(beliefs))
        )
        yield _published("/diagnostics", "diagnostic_msgs/DiagnosticArray", diagnostics)

    def _of_belief(self, it: ShownAMussel) -> Iterator[TopicMessage]:
        body = self._frames.agent(it.agent_id)
        battery = _battery(
            self._header(it.at_ms, body),
            f"{AMUSSEL}{it.agent_id}",
            it.cells_v[0],
            it.charge,
            cell_voltage=np.array(it.cells_v, np.float32),
            power_supply_status=it.supply_status,
            power_supply_health=it.health,
            power_supply_technology=LIPO,
        )
        yield _published(self._of_amussel(it.agent_id, "battery_state"), "sensor_msgs/BatteryState", battery)
        fix = self._fix(it.at_ms, body, it.place_m, it.place_cov)
        yield _published(self._of_amussel(it.agent_id, "fix"), "sensor_msgs/NavSatFix", fix)
        believed = make(
            "geometry_msgs/PoseWithCovariance",
            pose=_pose(enu(*it.place_m, it.depth_m), UPRIGHT),
            covariance=np.array(place_matrix(it.place_cov, 6)),
        )
        stamped = make(
            "geometry_msgs/PoseWithCovarianceStamped",
            header=self._header(it.at_ms, self._frames.enu),
            pose=believed,
        )
        topic = self._of_amussel(it.agent_id, "belief/pose")
        yield _published(topic, "geometry_msgs/PoseWithCovarianceStamped", stamped)

    def _of_moving_apad(self, apad: MovingAPad) -> Iterator[TopicMessage]:
        it, body, now_ms = apad.event, self._frames.apad(self._apad), self._run.now_ms
        here_m = (it.north_m, it.east_m)
        pose = _pose(enu(*here_m), yaw(it.heading_rad))
        twist = make(
            "geometry_msgs/Twist",
            linear=_vector((apad.forward_m_s, apad.left_m_s, 0.0)),
            angular=_vector((0.0, 0.0, apad.turn_rad_s)),
        )
        odometry = make(
            "nav_msgs/Odometry",
            header=self._in_world(),
            child_frame_id=body,
            pose=make("geometry_msgs/PoseWithCovariance", pose=pose),
            twist=make("geometry_msgs/TwistWithCovariance", twist=twist),
        )
        yield _published(self._of_apad("odometry"), "nav_msgs/Odometry", odometry)
        yield _published(self._of_apad("fix"), "sensor_msgs/NavSatFix", self._fix(now_ms, body, here_m, None))
        if it.battery is not None:
            volts = math.nan if it.voltage_v is None else it.voltage_v
            header = self._header(now_ms, body)
            battery = _battery(
                header, self._apad, volts, it.battery, power_supply_status=SupplyStatus.DISCHARGING
            )
            yield _published(self._of_apad("battery_state"), "sensor_msgs/BatteryState", battery)
        yield from self._path("path", [*self._run.track.points_m, here_m])
        yield from self._path("plan", [here_m, *self._run.plan_m] if self._run.plan_m else [])

    def _path(self, leaf: str, points_m: list[PlaceM]) -> Iterator[TopicMessage]:
        """The path where it is another one than before: a later reader gets the newest."""
        if self._shown.get(leaf) == points_m:
            return
        self._shown[leaf] = points_m
        header = self._in_world()
        poses = [
            make("geometry_msgs/PoseStamped", header=header, pose=_pose(enu(*it), UPRIGHT)) for it in points_m
        ]
        path = make("nav_msgs/Path", header=header, poses=poses)
        yield _published(self._of_apad(leaf), "nav_msgs/Path", path, kept=1)

    def _transforms(self, beliefs: list[ShownAMussel], apad: MovingAPad | None) -> Iterator[Any]:
        world = self._frames.enu
        for it in beliefs:
            at = enu(*it.place_m, it.depth_m)
            yield self._transform(world, self._frames.agent(it.agent_id), at, UPRIGHT)
        if apad is not None:
            at, attitude = enu(apad.event.north_m, apad.event.east_m), yaw(apad.event.heading_rad)
            yield self._transform(world, self._frames.apad(self._apad), at, attitude)

    def _transform(self, parent: str, child: str, at: Vector, attitude: Quaternion) -> Any:
        transform = make("geometry_msgs/Transform", translation=_vector(at), rotation=_quaternion(attitude))
        header = self._header(self._run.now_ms, parent)
        return make(
            "geometry_msgs/TransformStamped", header=header, child_frame_id=child, transform=transform
        )

    def _markers(self, beliefs: list[ShownAMussel], apad: MovingAPad | None) -> Iterator[Any]:
        """The whole picture: a reader that loses one array has a right picture with the next."""
        yield make(
            "visualization_msgs/Marker",
            header=self._in_world(),
            action=_DELETE_ALL,
            pose=_pose((0.0, 0.0, 0.0), UPRIGHT),
        )
        docks = self._run.state.docks
        for it in beliefs:
            row = docks.index(it.agent_id) if it.is_docked else 0
            yield from map(self._marker, it.shapes(self._ball_m, row))
        if apad is not None:
            at, attitude = enu(apad.event.north_m, apad.event.east_m), yaw(apad.event.heading_rad)
            yield self._marker(apad_shape(at, attitude, self._ball_m))

    def _marker(self, it: MarkerShape) -> Any:
        return make(
            "visualization_msgs/Marker",
            header=self._in_world(),
            ns=it.group,
            id=it.number,
            type=it.kind,
            pose=_pose(it.at, it.attitude),
            scale=_vector(it.size_m),
            color=make("std_msgs/ColorRGBA", **dict(zip("rgba", it.colour, strict=True))),
            text=it.text,
        )

    def _statuses(self, beliefs: list[ShownAMussel]) -> Iterator[Any]:
        state = self._run.state
        docks = " ".join("-" if it is None else str(it) for it in state.docks)
        values = {"services": sum(state.services.values()), "docks": docks, "primitive": state.primitive}
        failure = state.first_failure
        level, text = (
            (DiagnosticLevel.OK, state.ended_by or state.phase)
            if failure is None
            else (DiagnosticLevel.ERROR, f"first failure: {failure.reason}")
        )
        yield _status(f"aPad {self._apad}", self._apad, level, text, **values)
        heard = {it.agent_id: it for it in beliefs}
        for agent_id in self._ids:
            yield self._status_of(agent_id, heard.get(agent_id))

    def _status_of(self, agent_id: int, it: ShownAMussel | None) -> Any:
        level, text = condition_of(it, self._run.now_ms, self._rules)
        values = (
            {} if it is None else {"state": it.state.name, "primary": it.charge, "secondary": it.secondary}
        )
        return _status(f"aMussel {agent_id}", f"{AMUSSEL}{agent_id}", level, text, **values)

    def _fix(self, at_ms: int, body: str, place_m: PlaceM, place_cov: Vector | None) -> Any:
        """A place of ours has no height, for which the message wants NaN."""
        latitude_deg, longitude_deg = self._geographic.to_geographic(*place_m)
        return make(
            "sensor_msgs/NavSatFix",
            header=self._header(at_ms, body),
            status=make("sensor_msgs/NavSatStatus", service=_GPS),
            latitude=latitude_deg,
            longitude=longitude_deg,
            altitude=math.nan,
            position_covariance=np.array(place_matrix(place_cov, 3)),
            position_covariance_type=0 if place_cov is None else _COVARIANCE_KNOWN,
        )

    def _of_apad(self, leaf: str) -> str:
        return in_full(self._run.namespace, f"{plain(self._apad)}/{leaf}")

    def _of_amussel(self, agent_id: int, leaf: str) -> str:
        return in_full(self._run.namespace, f"{AMUSSEL}{agent_id}/{leaf}")

    def _in_world(self) -> Any:
        return self._header(self._run.now_ms, self._frames.enu)

    def _header(self, at_ms: int, frame: str) -> Any:
        return make("std_msgs/Header", stamp=self._stamp(at_ms), frame_id=frame)

    def _now(self) -> Any:
        return self._stamp(self._run.now_ms)

    def _stamp(self, at_ms: int) -> Any:
        stamp_ms = self._run.stamp_ms(at_ms)
        return make("builtin_interfaces/Time", sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * 1_000_000)


def _published(topic: str, kind: str, message: Any, kept: int = 0) -> TopicMessage:
    return TopicMessage(topic, kind, serialized(kind, message), kept)


def _tf(transforms: Iterable[Any]) -> Any:
    return make("tf2_msgs/TFMessage", transforms=list(transforms))


def _vector(it: Vector) -> Any:
    return make("geometry_msgs/Vector3", x=it[0], y=it[1], z=it[2])


def _quaternion(it: Quaternion) -> Any:
    return make("geometry_msgs/Quaternion", x=it[0], y=it[1], z=it[2], w=it[3])


def _pose(at: Vector, attitude: Quaternion) -> Any:
    place = make("geometry_msgs/Point", x=at[0], y=at[1], z=at[2])
    return make("geometry_msgs/Pose", position=place, orientation=_quaternion(attitude))


def _battery(header: Any, location: str, volts: float, fraction: float, **fields: Any) -> Any:
    """BatteryState demands NaN for values that are not measured."""
    unknown = dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity"), math.nan)
    return make(
        "sensor_msgs/BatteryState",
        header=header,
        voltage=volts,
        percentage=fraction,
        present=True,
        location=location,
        **unknown,
        **fields,
    )


def _status(name: str, hardware_id: str, level: int, message: str, **values: object) -> Any:
    shown = [make("diagnostic_msgs/KeyValue", key=key, value=str(value)) for key, value in values.items()]
    return make(
        "diagnostic_msgs/DiagnosticStatus",
        level=level,
        name=f"musselbed: {name}",
        message=message,
        hardware_id=hardware_id,
        values=shown,
    )

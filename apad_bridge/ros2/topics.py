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
from typing import Any, NamedTuple

import numpy as np

from apad_bridge.beliefs.modes import DOCKED, Mode, mode_of
from apad_bridge.events.event import Category
from apad_bridge.records.journal import Entry
from apad_bridge.ros2.followed_run import BelievedAMussel, FollowedRun, MovingAPad, PlaceM
from apad_bridge.ros2.typed import make, serialized
from apad_bridge.ros_names.frames import (
    NED_IN_ENU,
    UPRIGHT,
    Frames,
    Quaternion,
    Vector,
    ellipse_95,
    enu,
    yaw,
)
from apad_bridge.ros_names.names import AMUSSEL, in_full, plain
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.area.polygon import bounding_box
from apad_bridge.scenario.schema import Scenario
from firmware_model.power.charge import EMPTY_MV, FULL_MV
from firmware_model.state_groups import BEYOND_HELP, STRANDED

EVENTS_KEPT = 100
"""A reader that comes later gets so many events."""
_SMALLEST_BALL_M = 0.5
_BALLS_ACROSS = 100
_DISC_M = 0.02
_LABEL = 1.2
"""A label's height, and its distance north of its ball, in diameters of the ball."""
_OK, _WARN, _ERROR, _STALE = range(4)
"""DiagnosticStatus."""
_DISCHARGING, _CHARGING, _FULL = 2, 1, 4
_GOOD, _DEAD = 1, 3
_LIPO = 3
"""BatteryState."""
_ARROW, _SPHERE, _CYLINDER, _TEXT = 0, 2, 3, 9
_DELETE_ALL = 3
"""Marker."""
_GPS = 1
_COVARIANCE_KNOWN = 3
"""NavSatStatus and NavSatFix."""
_WHITE, _AMBER = (1.0, 1.0, 1.0, 1.0), (1.0, 0.8, 0.0, 1.0)


class Publication(NamedTuple):
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
        (south, west), (north, east) = bounding_box(scenario.area.polygon_m)
        self._ball_m = max(_SMALLEST_BALL_M, max(north - south, east - west) / _BALLS_ACROSS)
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

    def clock(self) -> Publication:
        return _published("/clock", "rosgraph_msgs/Clock", make("rosgraph_msgs/Clock", clock=self._now()))

    def fixed_frames(self) -> Publication:
        frames = self._frames
        ned = self._transform(frames.enu, frames.ned, (0.0, 0.0, 0.0), NED_IN_ENU)
        return _published("/tf_static", "tf2_msgs/TFMessage", _tf([ned]), kept=1)

    def events(self, entries: Iterable[Entry]) -> Iterator[Publication]:
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

    def state(self) -> Iterator[Publication]:
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

    def _of_belief(self, it: BelievedAMussel) -> Iterator[Publication]:
        event, body = it.event, self._frames.agent(it.event.id)
        battery = _battery(
            self._header(it.at_ms, body),
            f"{AMUSSEL}{event.id}",
            _volts(event.charge),
            event.charge,
            cell_voltage=np.array([_volts(event.charge), _volts(event.secondary)], np.float32),
            power_supply_status=_supply_status(it),
            power_supply_health=_DEAD if event.state in BEYOND_HELP or event.charge <= 0.0 else _GOOD,
            power_supply_technology=_LIPO,
        )
        yield _published(self._of_amussel(event.id, "battery_state"), "sensor_msgs/BatteryState", battery)
        fix = self._fix(it.at_ms, body, it.place_m, event.place_cov)
        yield _published(self._of_amussel(event.id, "fix"), "sensor_msgs/NavSatFix", fix)
        believed = make(
            "geometry_msgs/PoseWithCovariance",
            pose=_pose(enu(*it.place_m, it.depth_m), UPRIGHT),
            covariance=_covariance(event.place_cov, 36),
        )
        stamped = make(
            "geometry_msgs/PoseWithCovarianceStamped",
            header=self._header(it.at_ms, self._frames.enu),
            pose=believed,
        )
        yield _published(
            self._of_amussel(event.id, "belief/pose"), "geometry_msgs/PoseWithCovarianceStamped", stamped
        )

    def _of_moving_apad(self, apad: MovingAPad) -> Iterator[Publication]:
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
        fix = self._fix(now_ms, body, here_m, None)
        yield _published(self._of_apad("fix"), "sensor_msgs/NavSatFix", fix)
        if it.battery is not None:
            volts = math.nan if it.voltage_v is None else it.voltage_v
            header = self._header(now_ms, body)
            battery = _battery(header, self._apad, volts, it.battery, power_supply_status=_DISCHARGING)
            yield _published(self._of_apad("battery_state"), "sensor_msgs/BatteryState", battery)
        yield from self._path("path", [*self._run.track_m, here_m])
        yield from self._path("plan", [here_m, *self._run.plan_m] if self._run.plan_m else [])

    def _path(self, leaf: str, points_m: list[PlaceM]) -> Iterator[Publication]:
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

    def _transforms(self, beliefs: list[BelievedAMussel], apad: MovingAPad | None) -> Iterator[Any]:
        world = self._frames.enu
        for it in beliefs:
            at = enu(*it.place_m, it.depth_m)
            yield self._transform(world, self._frames.agent(it.event.id), at, UPRIGHT)
        if apad is not None:
            at, attitude = enu(apad.event.north_m, apad.event.east_m), yaw(apad.event.heading_rad)
            yield self._transform(world, self._frames.apad(self._apad), at, attitude)

    def _transform(self, parent: str, child: str, at: Vector, attitude: Quaternion) -> Any:
        transform = make("geometry_msgs/Transform", translation=_vector(at), rotation=_quaternion(attitude))
        header = self._header(self._run.now_ms, parent)
        return make(
            "geometry_msgs/TransformStamped", header=header, child_frame_id=child, transform=transform
        )

    def _markers(self, beliefs: list[BelievedAMussel], apad: MovingAPad | None) -> Iterator[Any]:
        """The whole picture: a reader that loses one array has a right picture with the next."""
        yield self._marker("", 0, _SPHERE, (0.0, 0.0, 0.0), _WHITE, action=_DELETE_ALL)
        docks = self._run.state.docks
        for it in beliefs:
            number, at, ball_m = it.event.id, enu(*it.place_m), self._ball_m
            colour = _colour(it)
            yield self._marker("amussels", number, _SPHERE, at, colour, scale=_cube(ball_m))
            row = docks.index(number) if it.is_docked else 0
            above = (at[0], at[1] + (1 + row) * _LABEL * ball_m, at[2] + _LABEL * ball_m)
            text = f"{number}: {100 * it.event.charge:.0f} %"
            yield self._marker(
                "labels", number, _TEXT, above, _WHITE, scale=_cube(_LABEL * ball_m), text=text
            )
            if it.event.place_cov is not None:
                disc = ellipse_95(it.event.place_cov)
                size = _vector((max(disc.length_m, _DISC_M), max(disc.width_m, _DISC_M), _DISC_M))
                pose = _pose(at, disc.attitude)
                yield self._marker(
                    "place_95", number, _CYLINDER, at, (*colour[:3], 0.3), pose=pose, scale=size
                )
        if apad is not None:
            at = enu(apad.event.north_m, apad.event.east_m)
            size = _vector((3 * self._ball_m, 0.6 * self._ball_m, 0.6 * self._ball_m))
            pose = _pose(at, yaw(apad.event.heading_rad))
            yield self._marker("apad", 0, _ARROW, at, _AMBER, pose=pose, scale=size)

    def _marker(
        self,
        group: str,
        number: int,
        kind: int,
        at: Vector,
        colour: tuple[float, float, float, float],
        **fields: Any,
    ) -> Any:
        fields.setdefault("pose", _pose(at, UPRIGHT))
        return make(
            "visualization_msgs/Marker",
            header=self._in_world(),
            ns=group,
            id=number,
            type=kind,
            color=make("std_msgs/ColorRGBA", **dict(zip("rgba", colour, strict=True))),
            **fields,
        )

    def _statuses(self, beliefs: list[BelievedAMussel]) -> Iterator[Any]:
        state = self._run.state
        docks = " ".join("-" if it is None else str(it) for it in state.docks)
        values = {"services": sum(state.services.values()), "docks": docks, "primitive": state.primitive}
        failure = state.first_failure
        text = state.ended_by or state.phase
        yield (
            _status(f"aPad {self._apad}", self._apad, _OK, text, **values)
            if failure is None
            else _status(
                f"aPad {self._apad}", self._apad, _ERROR, f"first failure: {failure.reason}", **values
            )
        )
        heard = {it.event.id: it for it in beliefs}
        for agent_id in self._ids:
            yield self._status_of(agent_id, heard.get(agent_id))

    def _status_of(self, agent_id: int, it: BelievedAMussel | None) -> Any:
        names = f"aMussel {agent_id}", f"{AMUSSEL}{agent_id}"
        if it is None:
            return _status(*names, _STALE, "no report yet")
        event, silent_s = it.event, (self._run.now_ms - it.event.heard) / 1000
        charge = f"{100 * event.charge:.0f} %"
        if event.state in BEYOND_HELP:
            level, text = _ERROR, "lost: both batteries are empty"
        elif event.state in STRANDED or event.charge <= 0.0:
            level, text = _ERROR, "its primary battery is empty"
        elif silent_s > self._rules.silence_timeout_s:
            level, text = _STALE, f"silent for {silent_s:.0f} s"
        elif event.charge <= self._rules.pool_threshold:
            level, text = _WARN, f"wants charging: {charge}"
        else:
            level, text = _OK, charge
        return _status(
            *names, level, text, state=event.state.name, primary=event.charge, secondary=event.secondary
        )

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
            position_covariance=_covariance(place_cov, 9),
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


def _published(topic: str, kind: str, message: Any, kept: int = 0) -> Publication:
    return Publication(topic, kind, serialized(kind, message), kept)


def _tf(transforms: Iterable[Any]) -> Any:
    return make("tf2_msgs/TFMessage", transforms=list(transforms))


def _vector(it: Vector) -> Any:
    return make("geometry_msgs/Vector3", x=it[0], y=it[1], z=it[2])


def _cube(size_m: float) -> Any:
    return _vector((size_m, size_m, size_m))


def _quaternion(it: Quaternion) -> Any:
    return make("geometry_msgs/Quaternion", x=it[0], y=it[1], z=it[2], w=it[3])


def _pose(at: Vector, attitude: Quaternion) -> Any:
    place = make("geometry_msgs/Point", x=at[0], y=at[1], z=at[2])
    return make("geometry_msgs/Pose", position=place, orientation=_quaternion(attitude))


def _covariance(place_cov: Vector | None, size: int) -> Any:
    """A covariance matrix, row by row from east and north on; 0 where nothing is known."""
    matrix = np.zeros(size)
    if place_cov is not None:
        north, between, east = place_cov
        row = math.isqrt(size)
        matrix[[0, 1, row, row + 1]] = east, between, between, north
    return matrix


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


def _supply_status(it: BelievedAMussel) -> int:
    mode = it.event.mode
    if mode is None:
        mode = mode_of(it.event.state, it.event.charge, it.event.secondary)
    if mode is Mode.FULL:
        return _FULL
    return _CHARGING if mode in DOCKED else _DISCHARGING


def _colour(it: BelievedAMussel) -> tuple[float, float, float, float]:
    """From red, empty, to green, full; cyan in a dock, grey when lost."""
    if it.event.state in BEYOND_HELP:
        return 0.4, 0.4, 0.4, 1.0
    return (0.0, 0.8, 0.9, 1.0) if it.is_docked else (1.0 - it.event.charge, it.event.charge, 0.1, 1.0)


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


def _volts(charge: float) -> float:
    return (EMPTY_MV + (FULL_MV - EMPTY_MV) * charge) / 1000

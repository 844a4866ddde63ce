"""Makes ROS's standard messages of beliefs and the aPad's state, given in local NED metres and mission milliseconds."""

from __future__ import annotations

import math

from geometry_msgs.msg import Point, Pose, PoseStamped, Transform, TransformStamped, Vector3
from geometry_msgs.msg import Quaternion as RosQuaternion
from nav_msgs.msg import Path
from sensor_msgs.msg import BatteryState, NavSatFix, NavSatStatus
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import DOCKED as DOCKED_MODES
from apad_bridge.beliefs.modes import Mode
from apad_bridge.ros.system.ros_time import stamp
from apad_bridge.ros_names.frames import UPRIGHT, Quaternion, Vector, ellipse_95, enu
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.area.polygon import bounding_box
from apad_bridge.scenario.schema import Area
from apad_bridge.vehicle.commands import BatteryReported
from firmware_model.power.charge import EMPTY_MV, FULL_MV
from firmware_model.state_groups import BEYOND_HELP, DOCKED

_UNKNOWN = math.nan
"""BatteryState demands NaN for values that are not measured."""
_SMALLEST_BALL_M = 0.5
_BALLS_ACROSS = 100
"""The area is as long as so many balls side by side: seen from above, each is some pixels wide on a common screen."""
_LABEL = 1.2
"""The height of a label, and its distance north of the ball, in diameters of the ball."""
_DISC_M = 0.02
_DISC_ALPHA = 0.3


def header(now_ms: int, frame: str) -> Header:
    return Header(stamp=stamp(now_ms), frame_id=frame)


def agent_battery(belief: Belief, body: str) -> BatteryState:
    """The primary battery, with its voltage on the paper's scale; `cell_voltage` holds both batteries'.

    The values are believed for the stamp, which is the newest packet's, or the time that a belief was carried to.
    """
    if belief.is_predicted:
        docked, full = belief.mode in DOCKED_MODES, belief.mode is Mode.FULL
    else:
        docked = belief.state in DOCKED
        full = docked and belief.primary >= 1.0
    message = BatteryState(
        header=header(belief.at_ms, body),
        voltage=_volts(belief.primary),
        temperature=_UNKNOWN,
        current=_UNKNOWN,
        charge=_UNKNOWN,
        capacity=_UNKNOWN,
        design_capacity=_UNKNOWN,
        percentage=belief.primary,
        cell_voltage=[_volts(belief.primary), _volts(belief.secondary)],
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO,
        present=True,
        location=f"amussel{belief.agent_id}",
    )
    if full:
        message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_FULL
    elif docked:
        message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_CHARGING
    else:
        message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    if belief.state in BEYOND_HELP or belief.primary <= 0.0:
        message.power_supply_health = BatteryState.POWER_SUPPLY_HEALTH_DEAD
    else:
        message.power_supply_health = BatteryState.POWER_SUPPLY_HEALTH_GOOD
    return message


def apad_battery(battery: BatteryReported, name: str, body: str) -> BatteryState:
    return BatteryState(
        header=header(battery.at_ms, body),
        voltage=battery.voltage_v,
        temperature=_UNKNOWN,
        current=_UNKNOWN,
        charge=_UNKNOWN,
        capacity=_UNKNOWN,
        design_capacity=_UNKNOWN,
        percentage=battery.fraction,
        power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
        present=True,
        location=name,
    )


def fix(
    frame: LocalFrame, at_ms: int, body: str, north_m: float, east_m: float, variance_m2: Vector
) -> NavSatFix:
    """Degrees on WGS-84. `variance_m2` is (north, covariance, east), all 0 where it is not known.

    The message's order is east, north, up. A place of ours has no height, for which the message wants NaN.
    """
    latitude_deg, longitude_deg = frame.to_geographic(north_m, east_m)
    north, between, east = variance_m2
    known = north > 0 or east > 0
    return NavSatFix(
        header=header(at_ms, body),
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS),
        latitude=latitude_deg,
        longitude=longitude_deg,
        altitude=math.nan,
        position_covariance=[east, between, 0.0, between, north, 0.0, 0.0, 0.0, 0.0],
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_KNOWN
        if known
        else NavSatFix.COVARIANCE_TYPE_UNKNOWN,
    )


def path(now_ms: int, world: str, points_m: list[tuple[float, float]]) -> Path:
    """Through (north, east) points at the surface."""
    stamped = header(now_ms, world)
    poses = [PoseStamped(header=stamped, pose=pose(enu(*point_m), UPRIGHT)) for point_m in points_m]
    return Path(header=stamped, poses=poses)


def pose(at: Vector, attitude: Quaternion) -> Pose:
    return Pose(position=Point(*at), orientation=RosQuaternion(*attitude))


def transform(now_ms: int, parent: str, child: str, at: Vector, attitude: Quaternion) -> TransformStamped:
    return TransformStamped(
        header=header(now_ms, parent),
        child_frame_id=child,
        transform=Transform(translation=Vector3(*at), rotation=RosQuaternion(*attitude)),
    )


def ball_size_m(area: Area) -> float:
    """The diameter of an aMussel's ball, much larger than the aMussel itself so that it is visible in the area."""
    (south, west), (north, east) = bounding_box(area.polygon_m)
    return max(_SMALLEST_BALL_M, max(north - south, east - west) / _BALLS_ACROSS)


def agent_markers(belief: Belief, now_ms: int, world: str, ball_m: float, row: int = 0) -> list[Marker]:
    """A ball from red (empty) to green (full), cyan when docked, grey when lost; its id and charge above it; and, where the
    place's deviation is known, the ellipse that contains the place with 95 %.

    Labels of aMussels at one place, in an aPad's docks, have a `row` each, from 0 on.
    """
    label_m = _LABEL * ball_m
    at = enu(belief.north_m, belief.east_m)
    ball = _marker("amussels", belief.agent_id, Marker.SPHERE, now_ms, world, at, _colour(belief), ball_m)
    # North of the ball, so that it is legible from above too.
    above = (at[0], at[1] + (1 + row) * label_m, at[2] + label_m)
    label = _marker(
        "labels",
        belief.agent_id,
        Marker.TEXT_VIEW_FACING,
        now_ms,
        world,
        above,
        ColorRGBA(1.0, 1.0, 1.0, 1.0),
        label_m,
    )
    label.text = f"{belief.agent_id}: {100 * belief.primary:.0f} %"
    if not belief.is_predicted:
        return [ball, label]
    return [ball, label, _place_marker(belief, now_ms, world, at)]


def _place_marker(belief: Belief, now_ms: int, world: str, at: Vector) -> Marker:
    ellipse = ellipse_95(belief.place_cov)
    disc = _marker("place_95", belief.agent_id, Marker.CYLINDER, now_ms, world, at, _colour(belief), _DISC_M)
    disc.color.a = _DISC_ALPHA
    disc.pose.orientation = RosQuaternion(*ellipse.attitude)
    # RViz does not draw a scale of 0.
    disc.scale = Vector3(max(ellipse.length_m, _DISC_M), max(ellipse.width_m, _DISC_M), _DISC_M)
    return disc


def apad_marker(now_ms: int, world: str, at: Vector, attitude: Quaternion, ball_m: float) -> Marker:
    """An arrow along its heading, three balls long."""
    arrow = _marker("apad", 0, Marker.ARROW, now_ms, world, at, ColorRGBA(1.0, 0.8, 0.0, 1.0), ball_m)
    arrow.pose.orientation = RosQuaternion(*attitude)
    arrow.scale = Vector3(3 * ball_m, 0.6 * ball_m, 0.6 * ball_m)
    return arrow


def _marker(
    group: str, number: int, kind: int, now_ms: int, world: str, at: Vector, colour: ColorRGBA, size_m: float
) -> Marker:
    return Marker(
        header=header(now_ms, world),
        ns=group,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=pose(at, UPRIGHT),
        scale=Vector3(size_m, size_m, size_m),
        color=colour,
    )


def _colour(belief: Belief) -> ColorRGBA:
    if belief.state in BEYOND_HELP:
        return ColorRGBA(0.4, 0.4, 0.4, 1.0)
    if belief.state in DOCKED:
        return ColorRGBA(0.0, 0.8, 0.9, 1.0)
    return ColorRGBA(1.0 - belief.primary, belief.primary, 0.1, 1.0)


def _volts(charge: float) -> float:
    return (EMPTY_MV + (FULL_MV - EMPTY_MV) * charge) / 1000

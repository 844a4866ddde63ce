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
from apad_bridge.ros.system.ros_time import stamp
from apad_bridge.ros_names.frames import UPRIGHT, Quaternion, Vector, enu
from apad_bridge.ros_names.shown_fleet import LIPO, MarkerShape, ShownAMussel, SupplyStatus, place_matrix
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.vehicle.commands import BatteryReported
from firmware_model.state_groups import DOCKED

_UNKNOWN = dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity"), math.nan)
"""BatteryState demands NaN for values that are not measured."""


def header(now_ms: int, frame: str) -> Header:
    return Header(stamp=stamp(now_ms), frame_id=frame)


def shown(belief: Belief) -> ShownAMussel:
    return ShownAMussel(
        agent_id=belief.agent_id,
        state=belief.state,
        mode=belief.mode,
        charge=belief.primary,
        secondary=belief.secondary,
        place_m=(belief.north_m, belief.east_m),
        depth_m=belief.reported.depth_m or 0.0,
        place_cov=belief.place_cov if belief.is_predicted else None,
        heard_ms=belief.heard_ms,
        at_ms=belief.at_ms,
        is_docked=belief.state in DOCKED,
    )


def agent_battery(belief: Belief, body: str) -> BatteryState:
    """The primary battery, with its voltage on the paper's scale; `cell_voltage` holds both batteries'.

    The values are believed for the stamp, which is the newest packet's, or the time that a belief was carried to.
    """
    it = shown(belief)
    return BatteryState(
        header=header(it.at_ms, body),
        voltage=it.cells_v[0],
        percentage=it.charge,
        cell_voltage=it.cells_v,
        power_supply_status=it.supply_status,
        power_supply_health=it.health,
        power_supply_technology=LIPO,
        present=True,
        location=f"amussel{it.agent_id}",
        **_UNKNOWN,
    )


def apad_battery(battery: BatteryReported, name: str, body: str) -> BatteryState:
    return BatteryState(
        header=header(battery.at_ms, body),
        voltage=battery.voltage_v,
        percentage=battery.fraction,
        power_supply_status=SupplyStatus.DISCHARGING,
        present=True,
        location=name,
        **_UNKNOWN,
    )


def fix(
    frame: LocalFrame, at_ms: int, body: str, north_m: float, east_m: float, variance_m2: Vector
) -> NavSatFix:
    """Degrees on WGS-84. `variance_m2` is (north, covariance, east), all 0 where it is not known.

    The message's order is east, north, up. A place of ours has no height, for which the message wants NaN.
    """
    latitude_deg, longitude_deg = frame.to_geographic(north_m, east_m)
    known = variance_m2[0] > 0 or variance_m2[2] > 0
    return NavSatFix(
        header=header(at_ms, body),
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS),
        latitude=latitude_deg,
        longitude=longitude_deg,
        altitude=math.nan,
        position_covariance=place_matrix(variance_m2, 3),
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


def marker(now_ms: int, world: str, it: MarkerShape) -> Marker:
    return Marker(
        header=header(now_ms, world),
        ns=it.group,
        id=it.number,
        type=it.kind,
        action=Marker.ADD,
        pose=pose(it.at, it.attitude),
        scale=Vector3(*it.size_m),
        color=ColorRGBA(*it.colour),
        text=it.text,
    )

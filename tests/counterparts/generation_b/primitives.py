"""The mission primitives: Go To Point, Dynamic Positioning, Docking/Undocking (paper III, facts B)."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from equipment import VERTICAL_BAND, Camera, Docks
from motion import Boat, Nav, clip, to_body, wrap

HEADING_GAIN, HEADING_RATE = 0.8, 0.5  # 1/s and rad/s
DP_GAIN, DP_SPEED = 0.3, 0.5  # 1/s and m/s
NEAR_GAIN, NEAR_SPEED = 0.5, 0.15  # 1/s and m/s: go-to slows down at the end
DETECTION_AGE = 1.0  # s; facts B: "without a detection younger than 1 s it SEARCHES"
SURGE_STDEV = 0.2  # facts B: exp(-horizontal^2 / (2 * 0.2^2)), used when the caller gives none
PULL_SPEED, PULL_SECONDS = 0.3, 8.0  # facts B: "undock pulls back at 0.3 m/s for 8 s"
SERVO = (0.1, 0.46, 0.75, 1.0)  # facts B: kinect_out for slots 0-3
SEARCH_WAIT = (15.5, 18.74, 21.35, 23.6)  # s; facts B: "waits 15.5-23.6 s by slot": 14.6 s + 9 s * servo
ARM_PATIENCE = 4.0  # vehicle seconds the primitive waits for its arm to close


class End(enum.Enum):
    """How a primitive ended."""

    DONE = "done"
    ABORTED = "aborted"
    PREEMPTED = "pre-empted"


@dataclass
class Ports:
    """What a primitive may touch."""

    boat: Boat
    camera: Camera
    docks: Docks
    dock_out: Callable[[list[float]], None]
    kinect_out: Callable[[float], None]


class Primitive:
    """One primitive: `block` seconds of callback first, then `begin`, then `step` at the tick rate to its end."""

    channel: str | None = None  # whose status topic tells of it: "goto", "docking" or none
    handle: Any = None  # the actionlib goal, when it was ordered as an action
    block = 0.0

    def servo(self, ports: Ports) -> None:
        """What happens before the block."""

    def begin(self, ports: Ports, now: float) -> None:
        """Take the start values."""

    def step(self, ports: Ports, now: float) -> End | None:
        """One round of control; an End when it is over."""
        raise NotImplementedError

    def finish(self, ports: Ports) -> None:
        """Tidy up, whatever the end."""


def turn(nav: Nav, heading: float) -> float:
    """The yaw rate in rad/s that brings the boat to the heading."""
    return clip(HEADING_GAIN * wrap(heading - nav.yaw), HEADING_RATE)


@dataclass
class GoToPoint(Primitive):
    """Go to (north, east) in metres at `speed` m/s until nearer than `radius` metres."""

    north: float
    east: float
    speed: float
    radius: float
    fully_actuated: bool = True
    heading: float | None = None  # radians; None = as it is at the start
    north_enable: bool = True
    east_enable: bool = True
    channel = "goto"
    distance = bearing = math.nan

    def begin(self, ports: Ports, now: float) -> None:
        """An axis that is not enabled keeps the coordinate the boat has now."""
        nav = ports.boat.nav()
        self.north = self.north if self.north_enable else nav.north
        self.east = self.east if self.east_enable else nav.east
        self.kept = nav.yaw if self.heading is None else self.heading

    def step(self, ports: Ports, now: float) -> End | None:
        """Facts B: "speed 0 or victory radius <= 0 aborts"; inside the radius it is done."""
        if not (self.speed > 0 and self.radius > 0 and math.isfinite(self.north + self.east)):
            return End.ABORTED
        nav = ports.boat.nav()
        north, east = self.north - nav.north, self.east - nav.east
        self.distance, self.bearing = math.hypot(north, east), math.atan2(east, north)
        if self.distance < self.radius:
            return End.DONE
        speed = min(self.speed, max(NEAR_SPEED, NEAR_GAIN * self.distance))
        if self.fully_actuated:
            surge, sway = to_body(north / self.distance, east / self.distance, nav.yaw)
            ports.boat.order(speed * surge, speed * sway, turn(nav, self.kept))
        else:
            ahead = max(0.0, math.cos(wrap(self.bearing - nav.yaw)))
            ports.boat.order(speed * ahead, 0.0, turn(nav, self.bearing))
        return None


@dataclass
class DynamicPositioning(Primitive):
    """Hold (north, east) in metres and a heading in radians; facts B: "never succeeds, it holds until pre-empted"."""

    north: float | None
    east: float | None
    heading: float | None  # None: the axis is left alone
    face_point: bool = False

    def step(self, ports: Ports, now: float) -> End | None:
        """Proportional position loop over the velocity controllers."""
        nav = ports.boat.nav()
        drift = _to_local(nav)
        north = drift[0] if self.north is None else DP_GAIN * (self.north - nav.north)
        east = drift[1] if self.east is None else DP_GAIN * (self.east - nav.east)
        size = max(1.0, math.hypot(north, east) / DP_SPEED)
        heading = self.heading
        if self.face_point and None not in (self.north, self.east):
            away = (self.north - nav.north, self.east - nav.east)
            heading = math.atan2(away[1], away[0]) if math.hypot(*away) > 1.0 else nav.yaw
        rate = nav.yaw_rate if heading is None else turn(nav, heading)
        ports.boat.order(*to_body(north / size, east / size, nav.yaw), rate)
        return None


def _to_local(nav: Nav) -> tuple[float, float]:
    return to_body(nav.ground[0], nav.ground[1], -nav.yaw)


def along_slot(slot: int, speed: float) -> tuple[float, float]:
    """Surge and sway of a speed in the slot's direction; facts B: "slot direction = slot * 90 degrees"."""
    return speed * math.cos(slot * math.pi / 2), speed * math.sin(slot * math.pi / 2)


@dataclass
class Docking(Primitive):
    """Visual servoing on the camera's topics, or pulling back; both after the camera servo's block (facts B)."""

    dock: bool
    slot: int
    block: float
    search_wait: float = 0.0  # s after the block, before it searches
    search_yaw_rate: float = 0.2  # rad/s
    max_yaw_rate: float = 0.3  # rad/s
    max_surge_speed: float = 0.2  # m/s
    surge_stdev: float = SURGE_STDEV
    channel = "docking"
    closing_since: float | None = None

    def servo(self, ports: Ports) -> None:
        """Turn the camera to the slot; the callback then blocks while the boat drifts."""
        ports.kinect_out(SERVO[self.slot])

    def begin(self, ports: Ports, now: float) -> None:
        """Open this slot's arm."""
        self.closing_since, self.started, self.last = None, now, now
        self.pulled = 0.0
        ports.dock_out([float(slot == self.slot) for slot in range(4)])

    def finish(self, ports: Ports) -> None:
        """Facts B: dock_out is 0.0 after the action."""
        if self.closing_since is None:
            ports.dock_out([0.0] * 4)

    def step(self, ports: Ports, now: float) -> End | None:
        """One round; while the pilot has the stick nothing is ordered and nothing succeeds."""
        elapsed, self.last = now - self.last, now
        if ports.camera.manual():
            ports.boat.controllers_off()
            return None
        if not self.dock:
            self.pulled += elapsed
            ports.boat.order(*along_slot(self.slot, -PULL_SPEED), 0.0)
            return End.DONE if self.pulled >= PULL_SECONDS else None
        return self._await_arm(ports, now) if self.closing_since is not None else self._approach(ports, now)

    def _approach(self, ports: Ports, now: float) -> End | None:
        """The law of facts B: search without a young detection, else yaw and surge by `docking_horizontal`."""
        if now - self.started < self.search_wait:
            ports.boat.controllers_off()
            return None
        horizontal = ports.camera.value("docking_horizontal", now, DETECTION_AGE)
        vertical = ports.camera.value("docking_vertical", now, DETECTION_AGE)
        if horizontal is None or vertical is None:
            ports.boat.order(0.0, 0.0, self.search_yaw_rate)
        elif VERTICAL_BAND[0] < vertical < VERTICAL_BAND[1]:
            ports.boat.order(0.0, 0.0, 0.0)
            if ports.docks.arms[self.slot].opening == 1.0:  # else it is still opening: wait for it
                self.closing_since = now
                ports.dock_out([0.0] * 4)
        else:
            stdev = self.surge_stdev if self.surge_stdev > 0 else SURGE_STDEV
            surge = self.max_surge_speed * math.exp(-(horizontal**2) / (2 * stdev**2))
            ports.boat.order(*along_slot(self.slot, surge), self.max_yaw_rate * math.tanh(horizontal))
        return None

    def _await_arm(self, ports: Ports, now: float) -> End | None:
        """The camera is content: done once the arm is closed, aborted when its motor stalls."""
        arm = ports.docks.arms[self.slot]
        if arm.opening == 0.0 and not arm.jammed:
            return End.DONE
        late = self.closing_since is not None and now - self.closing_since > ARM_PATIENCE
        return End.ABORTED if arm.jammed or late else None

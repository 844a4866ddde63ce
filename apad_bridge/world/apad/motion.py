"""Motion under power: plans each step's pose and thrusts when the step begins, and takes them when it ends.

Speeds and goals are over ground, as a vehicle with GPS steers. The drag is that of the hull's velocity through the water,
and a wind pushes it, too. So holding a place in a current takes thrust. Where the thrusters do not suffice, the flow sets
the vehicle back.

Simulated stacks use two commands beyond the port's: `Coast` (controllers off) and `Steer` (a body velocity).
They have no id and never end by themselves; a later go-to or hold replaces them, as they replace it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from apad_bridge.scenario.hull_in_flow import (
    SurfaceFlow,
    free_drift_m_s,
    made_good_m_s,
    resistance_n,
    top_speed_m_s,
    weakest_force_n,
)
from apad_bridge.scenario.schema import APad
from apad_bridge.world.apad.kinematics import STEP_S, Goal, Pose, moved, turned, wanted_velocity, wrapped
from apad_bridge.world.apad.thrusters import NO_FORCES, allocate, electrical_w

_TURNING_DISTANCE_M = 0.1
"""Nearer than this the bow keeps its heading: a bearing to a point underneath means nothing."""
_COASTING_ENDS_M_S = 0.02
"""Quadratic drag alone never stops a vehicle; waves would hide a speed below this."""
_LEAST_RESERVE = 0.05
"""The part of the thrust with which a flow that takes all of it is still fought: no plan needs infinite time."""


@dataclass(frozen=True, slots=True)
class Coast:
    """Controllers off: drag stops the vehicle's own motion, and the water carries it along."""


@dataclass(frozen=True, slots=True)
class Steer:
    """Keep a velocity: `speed_m_s` towards `direction_rad` clockwise from the bow, turning at `yaw_rate_rad_s`."""

    speed_m_s: float
    direction_rad: float
    yaw_rate_rad_s: float


class Motion:
    """The vehicle's pose, its goal and its thrusters.

    The limits are the forces that the thrusters give in EVERY direction, so that braking never takes longer
    than planned: the acceleration is at most 2 thruster_max / mass, the speed at most sqrt(2 thruster_max /
    drag). Within these limits, drag and acceleration together may saturate a thruster; then the vehicle
    accelerates more slowly. In a flow the acceleration is what holding leaves of the thrust, and the speed over ground is
    at most what the flow leaves of the top speed.
    """

    def __init__(self, config: APad) -> None:
        self._config = config
        self.acceleration_m_s2 = min(config.max_acceleration_m_s2, weakest_force_n(config) / config.mass_kg)
        self.top_speed_m_s = top_speed_m_s(config)
        self._flow: SurfaceFlow | None = None
        north_m, east_m = config.start_m
        self.pose = Pose(north_m, east_m)
        self.forces_n = NO_FORCES
        self._goal: Goal | None = Goal(north_m, east_m, 0.0, self.top_speed_m_s)
        self._steering: Steer | None = None
        self._planned = self.pose

    def take_flow(self, flow: SurfaceFlow) -> None:
        """The water and the air around the vehicle, for the steps that are planned from now on."""
        if flow == self._flow:
            return
        self._flow, config = flow, self._config
        holding_n = math.hypot(*resistance_n(config, flow, (0.0, 0.0)))
        force_n = weakest_force_n(config)
        left_n = max(force_n - holding_n, _LEAST_RESERVE * force_n)
        self.acceleration_m_s2 = min(config.max_acceleration_m_s2, left_n / config.mass_kg)

    def set_goal(self, north_m: float, east_m: float, speed_m_s: float) -> None:
        """Go to a point from the present pose on; the bow turns to the point's present bearing."""
        pose = self.pose
        heading_rad = pose.heading_rad
        if math.hypot(north_m - pose.north_m, east_m - pose.east_m) > _TURNING_DISTANCE_M:
            heading_rad = wrapped(math.atan2(east_m - pose.east_m, north_m - pose.north_m))
        self._steering = None
        self._goal = Goal(north_m, east_m, heading_rad, min(speed_m_s, self.top_speed_m_s))

    def turn_to(self, heading_rad: float) -> None:
        """Take this heading at the goal, instead of the bearing to it."""
        if self._goal is not None:
            self._goal = replace(self._goal, heading_rad=wrapped(heading_rad))

    def steer(self, steering: Steer) -> None:
        self._goal, self._steering = None, steering

    def cut_power(self) -> None:
        """Remove goal and thrust: drag brings the vehicle to rest, and the water carries it along."""
        self._goal = self._steering = None

    @property
    def is_moving(self) -> bool:
        """The planned step differs from standing still."""
        return self._planned is not self.pose

    @property
    def power_w(self) -> float:
        return electrical_w(self.forces_n, self._config.thruster_w_per_n)

    def end_step(self) -> None:
        self.pose = self._planned

    def plan_step(self) -> None:
        """Plan the step that begins now. Holding at the goal costs nothing in still water."""
        goal, pose = self._goal, self.pose
        if self._steering is not None:
            self._planned = self._steered(self._steering)
        elif goal is None:
            self.forces_n = NO_FORCES
            self._planned = self._coasted()
        elif goal.is_held_by(pose):
            self._planned = self._held()
        else:
            self._plan_towards(goal)

    def _held(self) -> Pose:
        """The same pose at the end of the step, or the one to which the flow has set it."""
        pose = self.pose
        if self._flow is None:
            self.forces_n = NO_FORCES
            return pose
        reached_m_s = self._push((0.0, 0.0), 0.0)
        return pose if reached_m_s == (0.0, 0.0) else moved(pose, reached_m_s, pose.heading_rad)

    def _plan_towards(self, goal: Goal) -> None:
        pose, change_m_s = self.pose, self.acceleration_m_s2 * STEP_S
        # Each of these is needed more than once, and this runs ten times a second of every flight.
        distance_m, speed_m_s = goal.distance_m(pose), pose.speed_m_s
        heading_rad = pose.heading_rad
        if heading_rad != goal.heading_rad:
            heading_rad = turned(heading_rad, goal.heading_rad, self._config.max_yaw_rate_rad_s)
        if distance_m <= change_m_s * STEP_S and speed_m_s <= change_m_s:
            # One step can end at rest at the goal: a few millimetres away, and slow enough to stop.
            reached_m_s = self._push((0.0, 0.0), speed_m_s)
            if self._flow is None or reached_m_s == (0.0, 0.0):
                self._planned = Pose(goal.north_m, goal.east_m, heading_rad)
            else:
                self._planned = moved(pose, reached_m_s, heading_rad)
        else:
            if self._flow is not None and distance_m > 0.0:
                goal = replace(goal, speed_m_s=self._speed_over_ground(goal, distance_m, self._flow))
            wanted_m_s = wanted_velocity(pose, goal, distance_m, self.acceleration_m_s2)
            self._planned = moved(pose, self._push(wanted_m_s, speed_m_s), heading_rad)

    def _speed_over_ground(self, goal: Goal, distance_m: float, flow: SurfaceFlow) -> float:
        """The ordered speed, or what the flow leaves of the top speed on the way to the goal."""
        pose = self.pose
        towards = (goal.north_m - pose.north_m) / distance_m, (goal.east_m - pose.east_m) / distance_m
        return min(goal.speed_m_s, max(0.0, made_good_m_s(self._config, flow, towards)))

    def _push(self, wanted_m_s: tuple[float, float], speed_m_s: float) -> tuple[float, float]:
        """Set the thrusts F = m a + drag |v| v for a wanted velocity; return the velocity that they reach.

        `speed_m_s` is the present speed |v|. In a flow `resistance_n` takes the place of the drag.
        """
        pose, mass_kg = self.pose, self._config.mass_kg
        if self._flow is None:
            drag_n_s_m = self._config.drag_n_per_m2_s2 * speed_m_s
            drag_north_n, drag_east_n = drag_n_s_m * pose.north_m_s, drag_n_s_m * pose.east_m_s
        else:
            velocity_m_s = pose.north_m_s, pose.east_m_s
            drag_north_n, drag_east_n = resistance_n(self._config, self._flow, velocity_m_s)
        north_n = mass_kg * (wanted_m_s[0] - pose.north_m_s) / STEP_S + drag_north_n
        east_n = mass_kg * (wanted_m_s[1] - pose.east_m_s) / STEP_S + drag_east_n
        self.forces_n, fraction = allocate(north_n, east_n, pose.heading_rad, self._config.thruster_max_n)
        if fraction == 1.0:
            return wanted_m_s
        return (
            pose.north_m_s + (fraction * north_n - drag_north_n) / mass_kg * STEP_S,
            pose.east_m_s + (fraction * east_n - drag_east_n) / mass_kg * STEP_S,
        )

    def _steered(self, steering: Steer) -> Pose:
        """One step towards the commanded velocity, within the vehicle's limits."""
        pose, config = self.pose, self._config
        yaw_rate_rad_s = max(
            -config.max_yaw_rate_rad_s, min(config.max_yaw_rate_rad_s, steering.yaw_rate_rad_s)
        )
        speed_m_s = min(steering.speed_m_s, self.top_speed_m_s)
        bearing_rad = pose.heading_rad + steering.direction_rad
        change_north = speed_m_s * math.cos(bearing_rad) - pose.north_m_s
        change_east = speed_m_s * math.sin(bearing_rad) - pose.east_m_s
        change_m_s = math.hypot(change_north, change_east)
        limit_m_s = self.acceleration_m_s2 * STEP_S
        scale = limit_m_s / change_m_s if change_m_s > limit_m_s else 1.0
        wanted = (pose.north_m_s + scale * change_north, pose.east_m_s + scale * change_east)
        velocity_m_s = self._push(wanted, pose.speed_m_s)
        return moved(pose, velocity_m_s, wrapped(pose.heading_rad + yaw_rate_rad_s * STEP_S))

    def _coasted(self) -> Pose:
        """One step under quadratic drag in moving water: v1 = v0 / (1 + drag v0 dt / m), in closed form.

        In a flow v0 is the velocity beyond that of the free drift; the wind's part of the drag is left out.
        """
        if self._flow is not None:
            return self._set_adrift(self._flow)
        pose = self.pose
        speed_m_s = pose.speed_m_s
        drift_north_m_s, drift_east_m_s = self._config.drift_m_s
        if speed_m_s == 0.0 and drift_north_m_s == drift_east_m_s == 0.0:
            return pose
        if speed_m_s < _COASTING_ENDS_M_S:
            coasted = Pose(pose.north_m, pose.east_m, pose.heading_rad)
        else:
            kept = 1 / (1 + self._config.drag_n_per_m2_s2 * speed_m_s * STEP_S / self._config.mass_kg)
            coasted = moved(pose, (pose.north_m_s * kept, pose.east_m_s * kept), pose.heading_rad)
        return replace(
            coasted,
            north_m=coasted.north_m + drift_north_m_s * STEP_S,
            east_m=coasted.east_m + drift_east_m_s * STEP_S,
        )

    def _set_adrift(self, flow: SurfaceFlow) -> Pose:
        pose, (north_m_s, east_m_s) = self.pose, free_drift_m_s(self._config, flow)
        own_north_m_s, own_east_m_s = pose.north_m_s - north_m_s, pose.east_m_s - east_m_s
        own_m_s = math.hypot(own_north_m_s, own_east_m_s)
        kept = 0.0
        if own_m_s >= _COASTING_ENDS_M_S:
            kept = 1 / (1 + self._config.drag_n_per_m2_s2 * own_m_s * STEP_S / self._config.mass_kg)
        velocity_m_s = north_m_s + kept * own_north_m_s, east_m_s + kept * own_east_m_s
        return moved(pose, velocity_m_s, pose.heading_rad)

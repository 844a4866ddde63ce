"""A vehicle's go-tos, flown again by the simulated aPad from where they began."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum, hypot

import numpy as np

from apad_bridge.field.calibration.intervals import Floats
from apad_bridge.field.field_log.log_facts import Work
from apad_bridge.field.field_log.vehicle_log import Done, VehicleLog
from apad_bridge.scenario.schema import APad
from apad_bridge.vehicle.commands import GoTo
from apad_bridge.world.apad.kinematics import STEP_MS, STEP_S, Pose
from apad_bridge.world.apad.motion import Motion
from apad_bridge.world.apad.simulated_apad import ArrivalWatch

_LONGEST_S = 3600.0
_START_STEPS = 10
"""It is at rest at its start, too."""


@dataclass(frozen=True, slots=True)
class Reflown:
    """A go-to: the seconds that the vehicle and the simulated aPad took, None where the latter does not come there."""

    done: Done
    simulated_s: float | None
    impulse_ns: Floats
    """The thrusters' force integrated over time, summed over thrusters, at the end of each step of 0.1 s: N s."""

    @property
    def real_s(self) -> float:
        return self.done.ended_s - self.done.began_s

    @property
    def residual_s(self) -> float | None:
        """Real minus simulated."""
        return None if self.simulated_s is None else self.real_s - self.simulated_s


def refly(log: VehicleLog, config: APad, speed_m_s: float, victory_radius_m: float) -> list[Reflown]:
    """Flies every go-to of the log again, each from the vehicle's own place at its begin, at rest.

    A go-to whose order names no goal goes to where the vehicle came. One whose begin the track does not cover is left out.
    """
    flown, heading_rad = [], 0.0
    for done in log.of(Work.GO_TO):
        track = log.track.between(done.began_s - 1.0, done.ended_s + 1.0)
        if len(track) < 2:
            continue
        start_m = tuple(
            float(np.interp(done.began_s, track.times_s, it)) for it in (track.north_m, track.east_m)
        )
        end_m = tuple(
            float(np.interp(done.ended_s, track.times_s, it)) for it in (track.north_m, track.east_m)
        )
        goal_m = done.goal_m or (end_m[0], end_m[1])
        motion = Motion(config)
        motion.pose = Pose(start_m[0], start_m[1], heading_rad)
        motion.set_goal(*goal_m, speed_m_s)
        flown.append(_flown(motion, done, GoTo(1, *goal_m, speed_m_s, victory_radius_m)))
        heading_rad = motion.pose.heading_rad
    return flown


def _flown(motion: Motion, done: Done, order: GoTo) -> Reflown:
    """Until it is at rest at the goal, and has arrived by the stack's own rule."""
    watch, arrived_s = ArrivalWatch(order), None
    impulse, sums = 0.0, []
    for step in range(round(_LONGEST_S / STEP_S)):
        motion.plan_step()
        impulse += fsum(map(abs, motion.forces_n)) * STEP_S
        sums.append(impulse)
        motion.end_step()
        if arrived_s is None and watch.has_arrived(motion.pose):
            arrived_s = (step + 1) * STEP_MS / 1000
        if arrived_s is not None and motion.pose.speed_m_s == 0.0 and step > _START_STEPS:
            break
    # A goal that was not named is a place on the way, so the arrival there says nothing.
    return Reflown(done, None if done.goal_m is None or not done.is_done else arrived_s, np.array(sums))


def impulse_at(flown: list[Reflown], times_s: Floats) -> Floats:
    """The impulse of all thrusters since the log's begin, at each of these rising times: N s.

    A go-to that is ordered before the one before it has come to rest ends that one.
    """
    edges_s, sums, total = [-np.inf], [0.0], 0.0
    for n, it in enumerate(flown):
        free_s = flown[n + 1].done.began_s - it.done.began_s if n + 1 < len(flown) else np.inf
        steps = int(min(len(it.impulse_ns), free_s / STEP_S))
        edges_s += [it.done.began_s + (step + 1) * STEP_S for step in range(steps)]
        sums += [total + float(it.impulse_ns[step]) for step in range(steps)]
        total = sums[-1]
    place = np.searchsorted(edges_s, times_s, side="right") - 1
    return np.array(sums)[place]


def way_at(log: VehicleLog, times_s: Floats) -> Floats:
    """Metres gone since the log's begin, at each of these rising times: go-tos in straight lines, so noise adds none."""
    edges_s, metres, total = [-1e300], [0.0], 0.0
    for done in log.of(Work.GO_TO):
        track = log.track.between(done.began_s, done.ended_s)
        if len(track) < 2:
            continue
        edges_s += [done.began_s, done.ended_s]
        length_m = hypot(track.north_m[-1] - track.north_m[0], track.east_m[-1] - track.east_m[0])
        metres += [total, total + length_m]
        total += length_m
    return np.interp(times_s, edges_s, metres)

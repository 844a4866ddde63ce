"""The boat in the water: hull, four thrusters in an X, velocity controller, and what its navigation sees.

Axes: north/east in metres of the local NED frame, yaw in radians clockwise from north; body x forward
(surge), y to starboard (sway). Facts: "Local NED in metres ... yaw in radians clockwise from north";
paper II: "four thrusters in an X-shaped configuration which make it overactuated and omnidirectional".
"""

from __future__ import annotations

import math
import random
import threading
from dataclasses import dataclass

MASS, INERTIA = 60.0, 6.0  # kg and kg m2, with the water that moves along
DRAG = (
    (25.0, 30.0),
    (30.0, 35.0),
    (6.0, 4.0),
)  # linear and quadratic, for surge, sway (N s/m..) and yaw (N m s..)
THRUST_MAX = 12.0  # N of each thruster: about 0.7 m/s flat out
LEVER = 0.35  # m, from the centre to each thruster's line of force
YAW_RATE_MAX = 0.6  # rad/s that the controller will ever ask for
THRUSTERS = ((1, 1, 1), (1, -1, -1), (1, -1, 1), (1, 1, -1))  # signs of surge, sway and yaw for each thruster
GAIN = (1.2, 1.2, 2.0)  # 1/s, proportional gains of the velocity controller
GAIN_I = (0.5, 0.5, 0.8)  # 1/s2, integral gains


def wrap(angle: float) -> float:
    """The angle in (-pi, pi], radians."""
    return -((math.pi - angle) % (2 * math.pi) - math.pi)


def clip(value: float, limit: float) -> float:
    """The value held between -limit and limit."""
    return max(-limit, min(limit, value))


def to_body(north: float, east: float, yaw: float) -> tuple[float, float]:
    """A vector of the local frame in body axes (surge, sway)."""
    return north * math.cos(yaw) + east * math.sin(yaw), east * math.cos(yaw) - north * math.sin(yaw)


def to_local(surge: float, sway: float, yaw: float) -> tuple[float, float]:
    """A vector of body axes in the local frame (north, east)."""
    return surge * math.cos(yaw) - sway * math.sin(yaw), surge * math.sin(yaw) + sway * math.cos(yaw)


@dataclass(frozen=True)
class Nav:
    """What the navigation filter reports: metres, radians, m/s over ground and through water (body), rad/s."""

    north: float
    east: float
    yaw: float
    ground: tuple[float, float]
    water: tuple[float, float]
    yaw_rate: float


class Wander:
    """A first-order Gauss-Markov error: standard deviation `sigma`, correlation time `tau` in seconds."""

    def __init__(self, rng: random.Random, sigma: float, tau: float) -> None:
        self.rng, self.sigma, self.tau = rng, sigma, tau
        self.value = rng.gauss(0.0, sigma)

    def step(self, dt: float) -> float:
        """Advance by dt seconds and return the new value."""
        keep = math.exp(-dt / self.tau)
        self.value = keep * self.value + self.rng.gauss(0.0, self.sigma * math.sqrt(1 - keep * keep))
        return self.value


class Boat:
    """Truth and navigation of the vehicle; thread-safe: the motion thread steps it, the worker orders it."""

    def __init__(
        self,
        start: tuple[float, float],
        yaw: float,
        current: tuple[float, float],
        noise: float,
        gust: float,
        rng: random.Random,
    ) -> None:
        self._lock = threading.Lock()
        self.north, self.east, self.yaw = start[0], start[1], yaw
        self.current = current  # m/s north, east
        self.water = [0.0, 0.0]  # m/s surge and sway through the water
        self.rate = 0.0  # rad/s
        self.reference: tuple[float, float, float] | None = None  # m/s, m/s, rad/s; None = controllers off
        self.integral = [0.0, 0.0, 0.0]
        self.powered = True
        self.load = (
            0.0  # mean of the thrusters' |force| / maximum to the power 1.5: their share of full power
        )
        self.errors = [Wander(rng, noise, 20.0), Wander(rng, noise, 20.0), Wander(rng, 0.01, 10.0)]
        self.gusts = [Wander(rng, gust, 4.0), Wander(rng, gust, 4.0), Wander(rng, 0.1 * gust, 4.0)]

    def order(self, surge: float, sway: float, yaw_rate: float) -> None:
        """Switch the velocity controllers on with these references (m/s over ground, rad/s)."""
        with self._lock:
            self.reference = (surge, sway, clip(yaw_rate, YAW_RATE_MAX))

    def controllers_off(self) -> None:
        """No thrust from now on: the boat coasts and drifts (facts B: every primitive's end does this)."""
        with self._lock:
            self.reference, self.integral = None, [0.0, 0.0, 0.0]

    def nav(self) -> Nav:
        """The present navigation solution, errors included."""
        with self._lock:
            north, east, yaw = (error.value for error in self.errors)
            return self._seen_with(north, east, yaw)

    def truth(self) -> Nav:
        """Where it is."""
        with self._lock:
            return self._seen_with(0.0, 0.0, 0.0)

    def _seen_with(self, north: float, east: float, yaw: float) -> Nav:
        """The navigation solution with these errors, m and rad."""
        ahead, aside = to_body(*self.current, self.yaw)
        ground = (self.water[0] + ahead, self.water[1] + aside)
        return Nav(
            self.north + north,
            self.east + east,
            wrap(self.yaw + yaw),
            ground,
            (self.water[0], self.water[1]),
            self.rate,
        )

    def step(self, dt: float) -> None:
        """Advance the boat by dt seconds (at most some 0.1 s at a time)."""
        with self._lock:
            ahead, aside = to_body(*self.current, self.yaw)
            ground = (self.water[0] + ahead, self.water[1] + aside, self.rate)
            force = self._thrust(self._controller(ground, dt))
            through = (*self.water, self.rate)
            new = []
            for axis, inertia in enumerate((MASS, MASS, INERTIA)):
                linear, square = DRAG[axis]
                drag = (linear + square * abs(through[axis])) * through[axis]
                push = force[axis] + self.gusts[axis].step(dt) - drag
                new.append(through[axis] + dt * push / inertia)
            turned = dt * self.rate  # the velocity through the water keeps its direction in the local frame
            self.water = list(to_body(new[0], new[1], turned))
            self.rate = new[2]
            self.yaw = wrap(self.yaw + turned)
            north, east = to_local(*self.water, self.yaw)
            self.north += dt * (north + self.current[0])
            self.east += dt * (east + self.current[1])
            for error in self.errors:
                error.step(dt)

    def _controller(self, ground: tuple[float, float, float], dt: float) -> list[float]:
        """Wanted surge force, sway force (N) and yaw moment (N m)."""
        if self.reference is None or not self.powered:
            return [0.0, 0.0, 0.0]
        wanted = []
        for axis, inertia in enumerate((MASS, MASS, INERTIA)):
            error = self.reference[axis] - ground[axis]
            self.integral[axis] = clip(self.integral[axis] + GAIN_I[axis] * error * dt, 0.8)
            wanted.append(inertia * (GAIN[axis] * error + self.integral[axis]))
        return wanted

    def _thrust(self, wanted: list[float]) -> list[float]:
        """What the four thrusters really give of the wanted forces; all are scaled down alike at the limit."""
        along = math.sqrt(0.5)
        parts = (wanted[0] / (4 * along), wanted[1] / (4 * along), wanted[2] / (4 * LEVER))
        forces = [sum(sign * part for sign, part in zip(signs, parts, strict=True)) for signs in THRUSTERS]
        scale = min(1.0, THRUST_MAX / max(1e-9, max(abs(f) for f in forces)))
        forces = [f * scale for f in forces]
        self.load = sum((abs(f) / THRUST_MAX) ** 1.5 for f in forces) / 4
        return [w * scale for w in wanted]

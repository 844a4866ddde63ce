"""An observer at a vehicle's end of the wire, which judges by arithmetic of its own; and the square that it watches."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import PoseReported

SIDE_M = 60.0
FENCE = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
TICK_MS = 1_000
JUMP_M = 10.0

Place = tuple[float, float]


def is_inside(place_m: Place, clearance_m: float = 0.0) -> bool:
    return all(clearance_m - 1e-6 <= it <= SIDE_M - clearance_m + 1e-6 for it in place_m)


@dataclass(slots=True)
class Observer:
    """Stands at the vehicle's end of the wire, and keeps what it sees there. The limits are the guards' own."""

    age_ms: int
    frozen_limit_ms: int
    heard: PoseReported | None = None
    """The newest position that left the vehicle and is finite."""
    bad_from_ms: float = math.inf
    """From then on the positions that leave the vehicle are wrong, and the limits to notice that are over."""
    goal_m: Place | None = None
    """The last ordered goal or place to hold; None after a stop."""
    held_m: Place | None = None
    """The place at which a stop holds the vehicle: it may be ordered again, wherever the vehicle is by then."""
    frozen_ms: int = 0
    """Time under way with a position that stayed the same to the last bit."""
    pilot_steers: bool = False
    stop_m: float = 0.1
    """A hold so near to where the vehicle was last heard is a stop: its way while the order comes to it."""
    orders: int = 0
    stops: int = 0
    outside: list[str] = field(default_factory=list)
    blind: list[str] = field(default_factory=list)
    """Orders that arrived when no good position had left the vehicle for longer than the limit."""
    against_pilot: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, flown: Scenario, stop_m: float = 0.1) -> Observer:
        assert flown.guards is not None
        return cls(
            round(1000 * flown.guards.position_age_s), round(1000 * flown.guards.frozen_s), stop_m=stop_m
        )

    def hear(self, pose: PoseReported) -> None:
        if not (math.isfinite(pose.north_m) and math.isfinite(pose.east_m)):
            return
        before, here_m = self.heard, (pose.north_m, pose.east_m)
        if before is None or (before.north_m, before.east_m, before.heading_rad) != (
            *here_m,
            pose.heading_rad,
        ):
            self.frozen_ms = 0
        elif self.goal_m is not None and math.dist(self.goal_m, here_m) > 1.0:
            self.frozen_ms += pose.at_ms - before.at_ms
        if before is not None and math.dist((before.north_m, before.east_m), here_m) > JUMP_M:
            self.goal_m = (
                None  # a goal of the old frame is no place of the new one: whether it moves is not known
            )
        self.heard = pose

    def is_bad(self, now_ms: int) -> bool:
        """No good position has left the vehicle for longer than the limits."""
        is_old = self.heard is None or now_ms - self.heard.at_ms > self.age_ms
        return is_old or self.frozen_ms > self.frozen_limit_ms + TICK_MS or now_ms > self.bad_from_ms

    def take_goal(self, goal_m: Place, now_ms: int, *, is_hold: bool) -> None:
        """Judges a go-to or hold. The fence is a convex square, so that a way between two places inside lies inside."""
        text = f"{now_ms / 1000:g} s: to ({goal_m[0]:.1f}, {goal_m[1]:.1f})"
        if (here_m := self._judged(text, now_ms)) is None:
            return
        self.goal_m = goal_m
        if is_hold and (goal_m == self.held_m or math.dist(here_m, goal_m) < self.stop_m):
            self.stops += 1
            self.held_m = goal_m
        elif not (is_inside(goal_m, 2.0) and is_inside(here_m)):
            self.outside.append(text)

    def take_other(self, now_ms: int, what: str) -> None:
        """Judges an order to a dock."""
        text = f"{now_ms / 1000:g} s: {what}"
        here_m = self._judged(text, now_ms)
        if here_m is not None and not is_inside(here_m):
            self.outside.append(text)

    def _judged(self, text: str, now_ms: int) -> Place | None:
        """Where the vehicle was last heard; None where nobody can know."""
        self.orders += 1
        if self.pilot_steers:
            self.against_pilot.append(text)
        if self.heard is not None and not self.is_bad(now_ms):
            return self.heard.north_m, self.heard.east_m
        self.blind.append(text)
        return None

    def take_stop(self, now_ms: int) -> None:
        if self.pilot_steers:
            self.against_pilot.append(f"{now_ms / 1000:g} s: stop")
        self.orders += 1
        self.stops += 1
        self.goal_m = None

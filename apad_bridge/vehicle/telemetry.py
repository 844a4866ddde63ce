"""Telemetry that both generations share: position, battery, silence, and messages stamped ahead of time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import BatteryReported, GoalOfOthers, PoseReported
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived
from apad_bridge.vehicle.vehicle_link import LinkFact

SILENT_MS = 5_000
"""Positions come at 10 Hz: fifty of them missing are no jitter."""
INVALID_COUNT = 3
"""So many unusable positions in a row, or no other since the last tick, are no glitch."""
AHEAD_MS = 10_000
"""An aPad on our clock stamps its messages with ticks that it has reached: a stamp so far ahead is somebody else's."""
FAR_M = 5.0
"""More than a mission's victory radius plus the drift meanwhile; a docking from here is a mistake."""
ReachCheck = Callable[[int, PoseReported | None, int], str | None]
"""The reason to refuse a docking from afar, by aMussel, pose and mission time; None for one that is near or unknown."""


class Readings:
    """The newest valid readings. `battery_v` is (empty, full); the voltage is linear in the published percent."""

    def __init__(self, battery_v: tuple[float, float]) -> None:
        self.dropped: Counter[str] = Counter()
        self.position_ms = -1
        """The newest stamp of an accepted position."""
        self.heard_since_ms = -1
        """The stamp of the first position after the last gap of `SILENT_MS`: no topic is silent since earlier."""
        self.state_ms = -1
        """The newest stamp of `stateRef`."""
        self._empty_v, self._full_v = battery_v
        self.pose: PoseReported | None = None
        """The newest pose, taken or not."""
        self._pose: PoseReported | None = None
        self._poses: list[PoseReported] = []
        """All poses since the last were taken."""
        self._battery: BatteryReported | None = None
        self._invalid: tuple[int, int, str] | None = None
        """The count of unusable positions since the last good one; time of the newest, and why it is unusable."""

    def receive(self, message: PoseReported | StateRefReceived | BatteryReceived) -> None:
        match message:
            case PoseReported():
                self._receive_pose(message)
            case StateRefReceived(at_ms):
                self.state_ms = max(self.state_ms, at_ms)
            case BatteryReceived():
                self._receive_battery(message)

    def _receive_pose(self, message: PoseReported) -> None:
        reason = out_of_range(north_m=message.north_m, east_m=message.east_m, yaw_rad=message.heading_rad)
        if reason is not None:
            self.dropped[f"position: {reason}"] += 1
            count = 0 if self._invalid is None else self._invalid[0]
            self._invalid = count + 1, message.at_ms, reason
        elif message.at_ms < self.position_ms:
            self.dropped["position: a newer one overtook it"] += 1
        else:
            if self.position_ms >= 0 and message.at_ms - self.position_ms >= SILENT_MS:
                self.heard_since_ms = message.at_ms
            self.position_ms = message.at_ms
            self._invalid = None
            before = self._pose
            also_from = "" if before is None else before.also_from
            if before is not None and before.publisher != message.publisher:
                also_from = before.publisher
            self.pose = self._pose = replace(message, also_from=also_from)
            self._poses.append(self._pose)

    def _receive_battery(self, message: BatteryReceived) -> None:
        if (reason := out_of_range(battery_percent=message.percent)) is not None:
            self.dropped[f"battery_level: {reason}"] += 1
            return
        fraction = min(1.0, max(0.0, message.percent / 100))
        voltage_v = self._empty_v + fraction * (self._full_v - self._empty_v)
        self._battery = BatteryReported(message.at_ms, voltage_v, fraction)

    def usable_goal(self, goal: GoalOfOthers, topic: str) -> GoalOfOthers:
        """The goal that was heard on `topic`. A place that cannot be used is counted, and taken out: the order stands."""
        if goal.north_m is None or goal.east_m is None:
            return goal
        if (reason := out_of_range(north_m=goal.north_m, east_m=goal.east_m)) is None:
            return goal
        self.dropped[f"{topic}: {reason}"] += 1
        return replace(goal, north_m=None, east_m=None, fault=reason)

    def take(self, gate: Gate) -> list[LinkFact]:
        """The newest readings since the last call, which the gate observes; its watch looks at each pose."""
        poses, self._poses = self._poses, []
        for pose in poses:
            gate.watch.look_at(pose)
        if self._invalid is not None and (self._invalid[0] >= INVALID_COUNT or self._pose is None):
            gate.watch.take_invalid(self._invalid[1], self._invalid[2])
        newest: list[LinkFact] = [it for it in (self._pose, self._battery) if it is not None]
        self._pose = self._battery = None
        gate.observe(newest)
        return newest


class SilenceWatch:
    """Notices that a vehicle falls silent, and that it is back after a loss of Wi-Fi or a reboot.

    Times are mission time, from the first `look` on.
    """

    def __init__(self) -> None:
        self.is_silent = False
        self.since_ms = -1
        """The time of the last position before the newest silence."""

    def look(self, heard_ms: int, now_ms: int) -> bool:
        """True when a silence has begun or ended up to `now_ms`; `heard_ms` is the time of the last position."""
        was_silent, self.is_silent = self.is_silent, now_ms - heard_ms >= SILENT_MS
        if self.is_silent and not was_silent:
            self.since_ms = heard_ms
        return self.is_silent is not was_silent


class Stamped(Protocol):
    @property
    def at_ms(self) -> int: ...


StampedMessage = TypeVar("StampedMessage", bound=Stamped)


class DeferredMessages(Generic[StampedMessage]):
    """Keeps messages with stamps after the present tick until their time. Mission time begins at `now_ms`.

    One that is stamped more than `AHEAD_MS` ahead is dropped, and counted in `dropped`: it would wait for ever, or stand
    for progress that the vehicle has not made.
    """

    def __init__(self, now_ms: int, dropped: Counter[str]) -> None:
        self._now_ms = now_ms
        self._dropped = dropped
        self._deferred: list[StampedMessage] = []

    def defers(self, message: StampedMessage, now_ms: int) -> bool:
        """Keeps a later message, or drops it, and returns True.

        `stateRef` never waits: it states the vehicle's progress.
        """
        if message.at_ms > now_ms + AHEAD_MS:
            name = type(message).__name__.removesuffix("Received").removesuffix("Reported")
            self._dropped[f"{name}: stamped more than {AHEAD_MS // 1000} s ahead of the mission"] += 1
            return True
        if message.at_ms <= now_ms or isinstance(message, StateRefReceived):
            return False
        self._deferred.append(message)
        return True

    def advance(self, now_ms: int) -> list[StampedMessage]:
        """All deferred messages, to be received again. ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        self._now_ms = now_ms
        deferred, self._deferred = self._deferred, []
        return deferred

"""What aPads of both generations say alike: where one is, and what its battery holds; the newest, and only what can be.

Words heard before their time: a stamp may be ahead of the tick that is being worked.

Whether an aPad is near enough to a simulated aMussel to dock it: no stack asks, and the bench is the world here.

A perch of generation A succeeds from a hundred metres away, and nothing in generation B looks for a simulated aMussel.

Notices that a vehicle has fallen silent, and that it is heard again: its Wi-Fi, or itself after a reboot.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.stack_messages import BatteryHeard, PoseHeard, StateHeard


class Stamped(Protocol):
    @property
    def at_ms(self) -> int: ...


Word = TypeVar("Word", bound=Stamped)


class InTime(Generic[Word]):
    """Keeps what is stamped later until `advance` has come to its time. Mission time begins at `now_ms`."""

    def __init__(self, now_ms: int) -> None:
        self._now_ms = now_ms
        self._later: list[Word] = []

    def puts_off(self, heard: Word, now_ms: int) -> bool:
        """Whether it is kept for later. `stateRef` is not: it says how far the vehicle has come."""
        if heard.at_ms <= now_ms or isinstance(heard, StateHeard):
            return False
        self._later.append(heard)
        return True

    def advance(self, now_ms: int) -> list[Word]:
        """All that was kept, to be heard again. ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        self._now_ms = now_ms
        later, self._later = self._later, []
        return later


Sight = Callable[[int], Mapping[int, tuple[float, float]]]
"""At a mission time: where simulated aMussels float, (north, east) in metres by id; empty where nobody knows."""
FAR_M = 5.0
"""Farther than a mission's victory radius and a drift meanwhile come to; a docking from here is a mistake."""


def why_out_of_reach(agent_id: int, pose: PoseReported | None, sight: Sight, now_ms: int) -> str | None:
    """None where it is near, or where nobody knows."""
    if pose is None or (there_m := sight(now_ms).get(agent_id)) is None:
        return None
    distance_m = math.dist((pose.north_m, pose.east_m), there_m)
    if distance_m <= FAR_M:
        return None
    return f"aMussel {agent_id} floats {distance_m:.1f} m away: go nearer than {FAR_M:g} m before docking it"


SILENT_MS = 5_000
"""Positions come at 10 Hz: fifty of them missing are no jitter."""


@dataclass(frozen=True, slots=True)
class Silence:
    """It has begun, or with `is_silent` false it is over; `since_ms` is when the vehicle was last heard before it."""

    is_silent: bool
    since_ms: int


class SilenceWatch:
    """In mission time, from its first `look` on."""

    def __init__(self) -> None:
        self._since_ms: int | None = None

    def look(self, heard_ms: int, now_ms: int) -> Silence | None:
        """What changed by `now_ms`; `heard_ms` is when a position was last heard."""
        is_silent = now_ms - heard_ms >= SILENT_MS
        if is_silent and self._since_ms is None:
            self._since_ms = heard_ms
            return Silence(True, heard_ms)
        if not is_silent and self._since_ms is not None:
            since_ms, self._since_ms = self._since_ms, None
            return Silence(False, since_ms)
        return None


class Readings:
    """`battery_v` is (empty, full): aPads say percent only, and the voltage follows from it linearly."""

    def __init__(self, battery_v: tuple[float, float]) -> None:
        self.dropped: Counter[str] = Counter()
        self.position_ms = -1
        """The newest stamp of a position that was taken."""
        self.state_ms = -1
        """The newest stamp of `stateRef`."""
        self._empty_v, self._full_v = battery_v
        self.pose: PoseReported | None = None
        """The newest, told or not."""
        self._pose: PoseReported | None = None
        self._battery: BatteryReported | None = None

    def hear(self, heard: PoseHeard | StateHeard | BatteryHeard) -> None:
        match heard:
            case PoseHeard():
                self._hear_pose(heard)
            case StateHeard(at_ms):
                self.state_ms = max(self.state_ms, at_ms)
            case BatteryHeard():
                self._hear_battery(heard)

    def _hear_pose(self, heard: PoseHeard) -> None:
        if not all(map(math.isfinite, (heard.north_m, heard.east_m, heard.heading_rad))):
            self.dropped["position: not finite"] += 1
        elif heard.at_ms < self.position_ms:
            self.dropped["position: a newer one overtook it"] += 1
        else:
            self.position_ms = heard.at_ms
            self.pose = self._pose = PoseReported(heard.at_ms, heard.north_m, heard.east_m, heard.heading_rad)

    def _hear_battery(self, heard: BatteryHeard) -> None:
        if not math.isfinite(heard.percent):
            self.dropped["battery_level: not finite"] += 1
            return
        # Gauges in the field overshoot both ends.
        fraction = min(1.0, max(0.0, heard.percent / 100))
        voltage_v = self._empty_v + fraction * (self._full_v - self._empty_v)
        self._battery = BatteryReported(heard.at_ms, voltage_v, fraction)

    def take(self) -> list[LinkFact]:
        """What came since it was last asked, the newest only."""
        newest: list[LinkFact] = [it for it in (self._pose, self._battery) if it is not None]
        self._pose = self._battery = None
        return newest

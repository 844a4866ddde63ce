"""The base of both generations' simulated stacks: a time grid around the simulated aPad, messages out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from typing import Generic, TypeVar

from apad_bridge.scenario.faults import Fault
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.apad.simulated_apad import SimulatedAPad


@dataclass(frozen=True, slots=True)
class PosePublished:
    at_ms: int
    pose: Pose


PublishedT = TypeVar("PublishedT")


class SimulatedStack(ABC, Generic[PublishedT]):
    """Steps every `grid_ms` in mission time, from `start_ms` on. The times of the aPad inside start at 0."""

    def __init__(self, apad: SimulatedAPad, start_ms: int, grid_ms: int, fault: Fault) -> None:
        self.dropped: Counter[str] = Counter()
        self._apad = apad
        self._start_ms = start_ms
        self._fault = fault
        self.now_ms = start_ms
        self._grid_ms = grid_ms
        self._grid_instant_ms = start_ms - grid_ms
        self._serial = 0
        """Numbers the commands to the aPad inside, and the objects docked to it."""

    @property
    def next_due_ms(self) -> int:
        return self._grid_instant_ms + self._grid_ms

    @property
    def pose(self) -> Pose:
        return self._apad.pose

    @property
    def dock_indices(self) -> range:
        return self._apad.capabilities.docks.indices

    @property
    def battery_percent(self) -> float:
        return 100 * self._apad.battery.fraction

    def advance(self, now_ms: int) -> list[PublishedT]:
        """The messages to publish up to and including `now_ms`, in order. ValueError when time went back."""
        if now_ms < self.now_ms:
            raise ValueError(f"time went back from {self.now_ms} to {now_ms} ms")
        published: list[PublishedT] = []
        while (due_ms := self.next_due_ms) <= now_ms:
            self._grid_instant_ms = self.now_ms = due_ms
            self._step(due_ms, published)
        self.now_ms = now_ms
        return published

    @abstractmethod
    def _step(self, at_ms: int, published: list[PublishedT]) -> None:
        """One grid instant: appends the messages of events up to `at_ms`, and the periodic messages."""

    @property
    def _apad_ms(self) -> int:
        """The present time on the clock of the aPad inside."""
        return self.now_ms - self._start_ms

    def _next_serial(self) -> int:
        self._serial += 1
        return self._serial

"""What the simulated aPad is behind the manners of either generation: it lives on a grid, and shows what to publish."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from typing import Generic, TypeVar

from apad_bridge.scenario.faults import Fault
from apad_bridge.vehicle.simulated.apad import SimulatedAPad
from apad_bridge.vehicle.simulated.kinematics import Pose

Shown = TypeVar("Shown")


class LegacyVehicle(ABC, Generic[Shown]):
    """In mission time, from `start_ms` on. The simulated aPad inside is told times from 0."""

    def __init__(self, apad: SimulatedAPad, start_ms: int, grid_ms: int, fault: Fault) -> None:
        self.dropped: Counter[str] = Counter()
        self._apad = apad
        self._start_ms = start_ms
        self._fault = fault
        self._now_ms = start_ms
        self._grid_ms = grid_ms
        self._instant_ms = start_ms - grid_ms
        self._serial = 0
        """Names commands and what is docked to the aPad inside."""

    @property
    def now_ms(self) -> int:
        return self._now_ms

    @property
    def next_due_ms(self) -> int:
        return self._instant_ms + self._grid_ms

    @property
    def pose(self) -> Pose:
        return self._apad.pose

    @property
    def battery_percent(self) -> float:
        return 100 * self._apad.battery_fraction

    def advance(self, now_ms: int) -> list[Shown]:
        """What is to be published up to and with `now_ms`, in order. ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        shown: list[Shown] = []
        while (due_ms := self.next_due_ms) <= now_ms:
            self._instant_ms = self._now_ms = due_ms
            self._step(due_ms, shown)
        self._now_ms = now_ms
        return shown

    @abstractmethod
    def _step(self, at_ms: int, shown: list[Shown]) -> None:
        """One instant of the grid: what happened up to it, and what is shown by the clock."""

    @property
    def _apad_ms(self) -> int:
        """What the aPad inside calls now."""
        return self._now_ms - self._start_ms

    def _next_serial(self) -> int:
        self._serial += 1
        return self._serial

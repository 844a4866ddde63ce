"""Dockings of generation B that nobody here ordered: by a person's hand, or another's planner. They name no aMussel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from apad_bridge.scenario.lab_interface.messages import DockSaid
from apad_bridge.vehicle.generation_b.messages import Status


class HandDocking:
    """Its slot is the one whose arm was last seen to open; whether it docks or undocks follows from what the slot holds."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._slot: int | None = None
        self._since_ms: int | None = None
        """When one was first heard to run that was not heard to end."""

    @property
    def runs(self) -> bool:
        return self._since_ms is not None

    def is_left_alone(self, now_ms: int, timeout_s: float) -> bool:
        """One that runs is not cut short, for as long as a docking of ours would have."""
        return self._since_ms is not None and now_ms - self._since_ms < timeout_s * 1000

    def see_arm(self, slot: int) -> None:
        self._slot = slot

    def hear(self, status: Status, at_ms: int, held: Mapping[int, int]) -> DockSaid | None:
        """What a word on `docking_status` tells of a dock, when it ends a docking that was seen to run."""
        if status is Status.RUNNING:
            self._since_ms = at_ms if self._since_ms is None else self._since_ms
            return None
        ended, self._since_ms = self.runs, None
        if not ended or status is not Status.DONE:
            return None
        if self._slot is None:
            self.dropped["docking by hand: no arm was seen to open"] += 1
            return None
        return DockSaid(at_ms, None, self._slot, self._slot not in held)

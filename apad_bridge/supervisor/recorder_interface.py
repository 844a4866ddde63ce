"""The interface of a flight's records: on disk, in memory, or with a listener beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Protocol

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.event import Event
from apad_bridge.mission.facts import PlacedSample
from apad_bridge.vehicle.commands import BatteryReported, PoseReported


class FlightRecorder(Protocol):
    def event(self, at_ms: MissionMs, event: Event) -> None: ...

    def truths(self, truths: list[Truth]) -> None: ...

    def samples(self, agent_id: int, samples: Sequence[PlacedSample]) -> None:
        """The samples survive a power cut when this returns, because an acknowledgement follows."""

    def tick(
        self,
        now_ms: MissionMs,
        beliefs: list[Belief],
        pose: PoseReported | None,
        battery: BatteryReported | None,
        primitive: str,
        docks: tuple[int | None, ...],
        dropped: Callable[[], Counter[str]],
    ) -> None:
        """Ends a tick; `dropped` returns the counts of the flight so far."""

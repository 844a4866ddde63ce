"""The records as a flight sees them: on disk, in memory, or with a listener beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from agents.mussel.outputs import Truth
from apad_bridge.beliefs.belief import Belief
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.packets.sample_record import SampleRecord


class Recorder(Protocol):
    """What a flight needs of the records."""

    def event(self, at_ms: int, kind: str, **data: Any) -> None: ...

    def truths(self, truths: list[Truth]) -> None: ...

    def samples(self, agent_id: int, records: Sequence[SampleRecord]) -> None:
        """On disk when it returns: an acknowledgement follows."""
        ...

    def tick(
        self,
        now_ms: int,
        beliefs: list[Belief],
        pose: PoseReported | None,
        battery: BatteryReported | None,
        primitive: str,
        docks: tuple[int | None, ...],
    ) -> None: ...

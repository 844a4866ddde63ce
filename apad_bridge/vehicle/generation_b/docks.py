"""The docks of a generation B aPad, as its core uses them: the stack reports none, so another part keeps them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Protocol

from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.vehicle.commands import CloseDock, OpenDock, PoseReported
from apad_bridge.vehicle.vehicle_link import LinkFact


class KeptDocks(Protocol):
    dropped: Counter[str]

    @property
    def held(self) -> Mapping[int, int]:
        """Agents by dock index; a live view."""

    def holds(self, agent_id: int) -> bool: ...

    def serve(self, simulated_ids: Iterable[int]) -> None:
        """From now on these aMussels are simulated, whichever fleet they belong to."""

    def refusal(self, command: CloseDock) -> str | None: ...

    def is_out_of_reach(self, command: CloseDock, pose: PoseReported | None, now_ms: int) -> bool:
        """The aMussel is known not to float at the closed dock."""

    def close(self, command: CloseDock, pose: PoseReported | None, now_ms: int) -> list[LinkFact]:
        """Closes the dock around the aMussel, or fails with the reason."""

    def open(self, command: OpenDock, now_ms: int) -> list[LinkFact]: ...

    def apply_report(self, report: DockReport, pose: PoseReported | None) -> list[LinkFact]:
        """Applies a report that others docked or undocked an aMussel, found by its id or else by place and dock."""

    def places(self, pose: PoseReported | None, now_ms: int) -> list[LinkFact]:
        """The places of the simulated aMussels that the docks hold."""

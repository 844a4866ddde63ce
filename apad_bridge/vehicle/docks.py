"""What the vehicle has said of its docks. Its word wins over what was asked for, and a later word over an earlier one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from apad_bridge.vehicle.commands import DockClosed, DockOpened

DOCK_COUNT = range(4)


class DockTable:
    def __init__(self) -> None:
        self._agent_by_dock: dict[int, int] = {}

    @property
    def docked(self) -> Mapping[int, int]:
        """Agent ids by slot; a live view."""
        return MappingProxyType(self._agent_by_dock)

    def take(self, fact: DockClosed | DockOpened) -> None:
        """An aMussel is in one dock at most: closing moves it, opening frees it wherever it was thought to be."""
        if (old := self.dock_index_of(fact.agent_id)) is not None:
            del self._agent_by_dock[old]
        if isinstance(fact, DockClosed):
            self._agent_by_dock[fact.dock_index] = fact.agent_id

    def dock_index_of(self, agent_id: int) -> int | None:
        return next(
            (dock_index for dock_index, holder in self._agent_by_dock.items() if holder == agent_id), None
        )

"""Dock occupancy as the vehicle reports it. Reports override commands, and later reports earlier ones."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from apad_bridge.vehicle.commands import DockClosed, DockOpened


class DockTable:
    def __init__(self) -> None:
        self._agent_by_dock: dict[int, int] = {}

    @property
    def docked(self) -> Mapping[int, int]:
        """Agent ids by dock index; a live view."""
        return MappingProxyType(self._agent_by_dock)

    def take(self, fact: DockClosed | DockOpened) -> None:
        """An aMussel is in one dock at most: closing moves it there, opening frees it wherever it was."""
        if (previous := self.dock_index_of(fact.agent_id)) is not None:
            del self._agent_by_dock[previous]
        if isinstance(fact, DockClosed):
            self._agent_by_dock[fact.dock_index] = fact.agent_id

    def dock_index_of(self, agent_id: int) -> int | None:
        return next(
            (dock_index for dock_index, holder in self._agent_by_dock.items() if holder == agent_id), None
        )

"""Docking mechanisms: their occupancy and their refusals."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from apad_bridge.vehicle.commands import CloseDock, CommandFailed, DockClosed, DockOpened, OpenDock
from apad_bridge.world.apad.misses import MISSED, Misses, Place


class Docks:
    """Mechanisms act at once: the docking port, or a real vehicle, accounts for the docking time."""

    def __init__(self, count: int, held: Mapping[int, int] = MappingProxyType({})) -> None:
        """`held` are the aMussels that they hold at the start, by dock index."""
        self._indices = range(count)
        self._agent_by_dock = dict(held)

    @property
    def docked(self) -> Mapping[int, int]:
        """Agent ids by dock index, of the closed docks only; a live view."""
        return MappingProxyType(self._agent_by_dock)

    def refusal(self, command: CloseDock) -> str | None:
        """The reason why this dock cannot close around this aMussel; None if it can."""
        dock_index, agent_id = command.dock_index, command.agent_id
        holder = self._agent_by_dock.get(dock_index)
        if dock_index not in self._indices:
            return f"there is no dock {dock_index + 1}"
        if holder is not None:
            return f"dock {dock_index + 1} holds aMussel {holder}"
        if agent_id in self._agent_by_dock.values():
            return f"aMussel {agent_id} is held in another dock"
        return None

    def try_to_close(
        self, command: CloseDock, misses: Misses | None, now_ms: int, place_m: Place = (0.0, 0.0)
    ) -> DockClosed | CommandFailed:
        """Like `close`, for a mechanism of an aPad at `place_m` that may miss; one that cannot close makes no attempt."""
        can_close = self.refusal(command) is None
        if can_close and misses is not None and misses.misses(command.agent_id, place_m, now_ms):
            return CommandFailed(now_ms, command.command_id, MISSED)
        return self.close(command, now_ms)

    def close(self, command: CloseDock, now_ms: int) -> DockClosed | CommandFailed:
        if (reason := self.refusal(command)) is not None:
            return CommandFailed(now_ms, command.command_id, reason)
        self._agent_by_dock[command.dock_index] = command.agent_id
        return DockClosed(now_ms, command.dock_index, command.agent_id)

    def open(self, command: OpenDock, now_ms: int) -> DockOpened | CommandFailed:
        dock_index, agent_id = command.dock_index, command.agent_id
        holder = self._agent_by_dock.get(dock_index)
        if dock_index not in self._indices:
            reason = f"there is no dock {dock_index + 1}"
        elif holder is None:
            reason = f"dock {dock_index + 1} is empty"
        elif holder != agent_id:
            reason = f"dock {dock_index + 1} holds aMussel {holder}"
        else:
            del self._agent_by_dock[dock_index]
            return DockOpened(now_ms, dock_index, agent_id)
        return CommandFailed(now_ms, command.command_id, reason)

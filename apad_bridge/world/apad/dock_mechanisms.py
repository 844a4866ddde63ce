"""Docking mechanisms: their occupancy and their refusals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from hashlib import blake2b
from struct import Struct
from types import MappingProxyType

from apad_bridge.vehicle.commands import CloseDock, CommandFailed, DockClosed, DockOpened, OpenDock

# Docking misses by a keyed hash of (seed, agent, attempt), so that every stack misses the same dockings.
#
# A flow makes misses likelier: the thrust that holding takes is not there to correct the place. Of the dockings that
# succeed in calm water, the share that misses in a flow is the share of the thrust that holding takes. So an aPad that
# cannot hold its place docks nothing. The form is our choice: we know no published dockings of such a vehicle in a
# current.
_KEY = Struct("<QQQ").pack
_HASH_VALUES = 2**64
MISSED = "the docking mechanism missed the aMussel"
Place = tuple[float, float]
Effort = Callable[[Place, int], float]
"""The part of the thrust, in [0, 1], that holding takes at a place (north, east) in metres and a mission time in ms."""


class Misses:
    """Each attempt misses with `probability` in [0, 1], independently between agents and between attempts.

    With an `effort` e the probability is p + (1 - p) e.
    """

    def __init__(self, seed: int, probability: float, effort: Effort | None = None) -> None:
        self._seed = seed
        self._probability = probability
        self._effort = effort
        self._attempts: Counter[int] = Counter()

    def misses(self, agent_id: int, place_m: Place = (0.0, 0.0), at_ms: int = 0) -> bool:
        """Counts the agent's next attempt, of an aPad at that place and time; True when it misses."""
        probability = self._probability
        if self._effort is not None:
            probability += (1 - probability) * self._effort(place_m, at_ms)
        self._attempts[agent_id] += 1
        digest = blake2b(
            _KEY(self._seed, agent_id, self._attempts[agent_id]), digest_size=8, person=b"dock miss"
        )
        return int.from_bytes(digest.digest(), "little") < round(probability * _HASH_VALUES)


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

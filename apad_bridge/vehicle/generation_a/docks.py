"""Which aMussels an aPad of generation A holds, made out from `position_static` alone: the only thing it says of docks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from apad_bridge.vehicle.commands import DockClosed, DockOpened
from apad_bridge.vehicle.docks import DOCK_COUNT
from apad_bridge.vehicle.generation_a.messages import StaticHeard
from apad_bridge.vehicle.link import Carried, LetGo, LinkFact

RELEASE_SILENCE_MS = 2_000
"""After a release was ordered, `position_static` silent for so long is the release: the published server crashes in it."""
SILENCE_MS = 10_000
"""Without an order. Longer, because a gap in the Wi-Fi is no release; for the same reason silence counts only as far as the
aPad itself is heard."""


@dataclass(slots=True)
class _Holding:
    dock_index: int
    heard_ms: int
    place_m: tuple[float, float] | None
    is_new: bool
    """Whether the place was not told yet."""
    release_ms: int | None = None
    """When its release was ordered."""


class DocksByHearsay:
    """Slots are in the order of perches: the vehicle takes the first free one, whatever was asked.

    `docked`: agents by slot that are known to be held already, at `now_ms`, as after a resume.
    """

    def __init__(self, agent_ids: Iterable[int], docked: Mapping[int, int], now_ms: int = 0) -> None:
        self.dropped: Counter[str] = Counter()
        self._known = frozenset(agent_ids)
        self._elsewhere: frozenset[int] = frozenset()
        self._held = {
            agent_id: _Holding(dock_index, now_ms, None, False)
            for dock_index, agent_id in sorted(docked.items())
        }

    def serve(self, agent_ids: Iterable[int]) -> None:
        """From now on these are of this fleet, or guests; a word of one that no more is, is somebody else's affair."""
        self._elsewhere |= self._known
        self._known = frozenset(agent_ids)
        self._elsewhere -= self._known

    def holds(self, agent_id: int) -> bool:
        return agent_id in self._held

    def dock_index_of(self, agent_id: int) -> int:
        """KeyError for one that is not held."""
        return self._held[agent_id].dock_index

    def unheard(self, now_ms: int) -> list[int]:
        """Agents held whose place up to `now_ms` was not heard; one being released is not waited for."""
        return [
            agent_id
            for agent_id, holding in self._held.items()
            if holding.heard_ms < now_ms and holding.release_ms is None
        ]

    def order_release(self, agent_id: int, now_ms: int) -> None:
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms = now_ms

    def withdraw_release(self, agent_id: int) -> None:
        """The vehicle refused."""
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms = None

    def hear(self, heard: StaticHeard) -> list[LinkFact]:
        """What changed by it. A place that only moved is told by `places`."""
        holding = self._held.get(heard.agent_id)
        if heard.agent_id in self._elsewhere and holding is None:
            return []
        if heard.agent_id not in self._known | self._elsewhere:
            self.dropped["position_static of an aMussel that is not of this fleet"] += 1
            return []
        if heard.released:
            if holding is None:
                self.dropped["release of an aMussel that was not held"] += 1
                return []
            return self._open(heard.agent_id, heard.at_ms)
        place_m = (heard.north_m, heard.east_m)
        if holding is not None:
            holding.heard_ms, holding.place_m, holding.is_new = heard.at_ms, place_m, True
            return []
        taken = {other.dock_index for other in self._held.values()}
        free = [dock_index for dock_index in DOCK_COUNT if dock_index not in taken]
        if not free:
            self.dropped["position_static of more aMussels than there are docks"] += 1
            return []
        self._held[heard.agent_id] = _Holding(free[0], heard.at_ms, place_m, False)
        return [
            DockClosed(heard.at_ms, free[0], heard.agent_id),
            Carried(heard.at_ms, heard.agent_id, *place_m),
        ]

    def silent(self, vehicle_heard_ms: int) -> list[LinkFact]:
        """Opens the docks of those of whom nothing is said any more, though the aPad spoke up to `vehicle_heard_ms`."""
        facts: list[LinkFact] = []
        for agent_id, holding in list(self._held.items()):
            if holding.release_ms is None:
                due_ms = holding.heard_ms + SILENCE_MS
            else:
                due_ms = max(holding.heard_ms, holding.release_ms) + RELEASE_SILENCE_MS
            if due_ms <= vehicle_heard_ms:
                self.dropped["silence on position_static, taken for a release"] += 1
                facts += self._open(agent_id, due_ms)
        return facts

    def places(self) -> list[Carried]:
        """The newest place of each that was heard since it was last asked for."""
        told = []
        for agent_id, holding in sorted(self._held.items()):
            if holding.is_new and holding.place_m is not None:
                holding.is_new = False
                told.append(Carried(holding.heard_ms, agent_id, *holding.place_m))
        return told

    def _open(self, agent_id: int, at_ms: int) -> list[LinkFact]:
        holding = self._held.pop(agent_id)
        return [DockOpened(at_ms, holding.dock_index, agent_id), LetGo(at_ms, agent_id)]

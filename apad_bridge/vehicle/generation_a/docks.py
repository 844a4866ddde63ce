"""Derives a generation A aPad's dock occupancy from `position_static`, the only topic about docks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from apad_bridge.scenario.schema import PAPER_DOCKS
from apad_bridge.vehicle.commands import DockClosed, DockOpened
from apad_bridge.vehicle.generation_a.messages import HeldPositionReceived
from apad_bridge.vehicle.link import Carried, LetGo, LinkFact

RELEASE_SILENCE_MS = 2_000
"""After a release order, so long a silence of `position_static` counts as the release, because the published
server crashes in it."""
SILENCE_MS = 10_000
"""The same without an order. It is longer, because a gap in the Wi-Fi is no release. For the same reason
silence counts only up to the aPad's own last message."""


@dataclass(slots=True)
class _Holding:
    dock_index: int
    heard_ms: int
    place_m: tuple[float, float] | None
    is_new: bool
    """The place was not returned by `places` yet."""
    release_ms: int | None = None
    """The time of the release order."""


class ReportedDocks:
    """Docks fill in the order of perches: the vehicle takes the first free dock, whatever the command named.

    `docked` are the agents by dock index that the vehicle is known to hold at `now_ms`, as after a resume.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        docked: Mapping[int, int],
        now_ms: int = 0,
        count: int = PAPER_DOCKS,
    ) -> None:
        self._indices = range(count)
        self.dropped: Counter[str] = Counter()
        self._served = frozenset(agent_ids)
        self._served_before: frozenset[int] = frozenset()
        self._held = {
            agent_id: _Holding(dock_index, now_ms, None, False)
            for dock_index, agent_id in sorted(docked.items())
        }

    def serve(self, agent_ids: Iterable[int]) -> None:
        """Serves these from now on. Messages about free aMussels that it served before do not count as dropped."""
        self._served_before |= self._served
        self._served = frozenset(agent_ids)
        self._served_before -= self._served

    def holds(self, agent_id: int) -> bool:
        return agent_id in self._held

    def dock_index_of(self, agent_id: int) -> int:
        """KeyError for an aMussel that is not held."""
        return self._held[agent_id].dock_index

    def unreported_ids(self, now_ms: int) -> list[int]:
        """Held agents without a position up to `now_ms`, except those under release."""
        return [
            agent_id
            for agent_id, holding in self._held.items()
            if holding.heard_ms < now_ms and holding.release_ms is None
        ]

    def order_release(self, agent_id: int, now_ms: int) -> None:
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms = now_ms

    def withdraw_release(self, agent_id: int) -> None:
        """The vehicle refused the release."""
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms = None

    def receive(self, message: HeldPositionReceived) -> list[LinkFact]:
        """The changes at the docks. A position that only moved comes with `places`."""
        holding = self._held.get(message.agent_id)
        if message.agent_id in self._served_before and holding is None:
            return []
        if message.agent_id not in self._served | self._served_before:
            self.dropped["position_static of an aMussel that is not of this fleet"] += 1
            return []
        if message.released:
            if holding is None:
                self.dropped["release of an aMussel that was not held"] += 1
                return []
            return self._open(message.agent_id, message.at_ms)
        place_m = (message.north_m, message.east_m)
        if holding is not None:
            holding.heard_ms, holding.place_m, holding.is_new = message.at_ms, place_m, True
            return []
        taken = {other.dock_index for other in self._held.values()}
        free = [dock_index for dock_index in self._indices if dock_index not in taken]
        if not free:
            self.dropped["position_static of more aMussels than there are docks"] += 1
            return []
        self._held[message.agent_id] = _Holding(free[0], message.at_ms, place_m, False)
        return [
            DockClosed(message.at_ms, free[0], message.agent_id),
            Carried(message.at_ms, message.agent_id, *place_m),
        ]

    def silent(self, vehicle_heard_ms: int) -> list[LinkFact]:
        """Opens the docks of silent aMussels, while the aPad itself was heard up to `vehicle_heard_ms`."""
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
        """The newest position of each held aMussel that has one since the last call."""
        carried = []
        for agent_id, holding in sorted(self._held.items()):
            if holding.is_new and holding.place_m is not None:
                holding.is_new = False
                carried.append(Carried(holding.heard_ms, agent_id, *holding.place_m))
        return carried

    def _open(self, agent_id: int, at_ms: int) -> list[LinkFact]:
        holding = self._held.pop(agent_id)
        return [DockOpened(at_ms, holding.dock_index, agent_id), LetGo(at_ms, agent_id)]

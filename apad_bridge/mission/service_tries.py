"""Counts the tries to serve an aMussel, and those to open its dock, that failed: it is left alone when they are used up.

The mission's state keeps both counts (`failed_tries` and `failed_undockings`).
"""

from __future__ import annotations

from apad_bridge.events.mission import LeftAlone
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.scenario.schema import Mission

Counts = tuple[tuple[int, int], ...]


class ServiceTries:
    """The counts of one mission. `config` has the rules that hold now."""

    def __init__(self, config: Mission, book: OrderBook) -> None:
        self.config = config
        self._book = book

    @property
    def used_up(self) -> frozenset[int]:
        """The aMussels that were tried in vain so often as `collection_attempts` says."""
        return self._at_limit(self._book.state.failed_tries)

    @property
    def not_released(self) -> frozenset[int]:
        """The aMussels whose docks did not open so often."""
        return self._at_limit(self._book.state.failed_undockings)

    def service_failed(self, agent_id: int, reason: str) -> None:
        counts = _counted(self._book.state.failed_tries, agent_id)
        self._book.set(failed_tries=counts)
        self._tell_at_limit(counts, agent_id, reason)

    def service_helped(self, agent_id: int) -> None:
        self._book.set(failed_tries=_without(self._book.state.failed_tries, agent_id))

    def undocking_failed(self, agent_id: int, reason: str) -> None:
        counts = _counted(self._book.state.failed_undockings, agent_id)
        self._book.set(failed_undockings=counts)
        self._tell_at_limit(counts, agent_id, f"its dock does not open: {reason}")

    def dock_opened(self, agent_id: int) -> None:
        self._book.set(failed_undockings=_without(self._book.state.failed_undockings, agent_id))

    def _at_limit(self, counts: Counts) -> frozenset[int]:
        return frozenset(agent_id for agent_id, tries in counts if tries >= self.config.collection_attempts)

    def _tell_at_limit(self, counts: Counts, agent_id: int, reason: str) -> None:
        tries = dict(counts)[agent_id]
        if tries == self.config.collection_attempts:
            self._book.tell(LeftAlone(agent_id, tries, reason))


def _counted(counts: Counts, agent_id: int) -> Counts:
    """One more for this aMussel."""
    tries = dict(counts)
    tries[agent_id] = tries.get(agent_id, 0) + 1
    return tuple(sorted(tries.items()))


def _without(counts: Counts, agent_id: int) -> Counts:
    return tuple(it for it in counts if it[0] != agent_id)

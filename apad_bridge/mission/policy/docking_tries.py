"""The limits of a docking's tries, from the smallest to the largest.

- One closing of the mechanism: `mission.docking.attempts`, counted in `apad_bridge/vehicle/docking_port.py`.
- The permission to surface: `mission.surfacing_attempts`, counted by `SurfacingWait` in `docking_routine.py`.
- A search about the believed place: `SEARCH_S` in `docking_search.py`.
- A collecting step: `StepTries`.
- An aMussel: `ServiceTries`. It is left alone after `mission.collection_attempts` steps.
"""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.events.mission_events import LeftAlone
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.scenario.blocks.mission_options import Mission

LEGS_PER_STEP = 3
"""A step is given up when its aMussel floats out of reach after so many go-tos."""
DOCKINGS_PER_STEP = 3
"""A step is given up after so many failed dockings, because an aMussel spends most of its charge at the surface."""
Counts = tuple[tuple[int, int], ...]


@dataclass(slots=True)
class StepTries:
    """The tries of the step under way. A resumed mission counts them anew."""

    legs: int = 1
    """The go-tos to the aMussel."""
    failed_dockings: int = 0

    @property
    def has_leg_left(self) -> bool:
        return self.legs < LEGS_PER_STEP

    @property
    def has_docking_left(self) -> bool:
        return self.failed_dockings < DOCKINGS_PER_STEP


class ServiceTries:
    """Counts the tries to serve an aMussel, and those to open its dock, that failed. `config` has the rules that hold now.

    The mission's state keeps both counts (`failed_tries` and `failed_undockings`).
    """

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
        self._report_at_limit(counts, agent_id, reason)

    def service_helped(self, agent_id: int) -> None:
        self._book.set(failed_tries=_without(self._book.state.failed_tries, agent_id))

    def undocking_failed(self, agent_id: int, reason: str) -> None:
        counts = _counted(self._book.state.failed_undockings, agent_id)
        self._book.set(failed_undockings=counts)
        self._report_at_limit(counts, agent_id, f"its dock does not open: {reason}")

    def dock_opened(self, agent_id: int) -> None:
        self._book.set(failed_undockings=_without(self._book.state.failed_undockings, agent_id))

    def _at_limit(self, counts: Counts) -> frozenset[int]:
        return frozenset(agent_id for agent_id, tries in counts if tries >= self.config.collection_attempts)

    def _report_at_limit(self, counts: Counts, agent_id: int, reason: str) -> None:
        if (tries := dict(counts)[agent_id]) == self.config.collection_attempts:
            self._book.emit(LeftAlone(agent_id, tries, reason))


def _counted(counts: Counts, agent_id: int) -> Counts:
    """One more for this aMussel."""
    tries = dict(counts)
    tries[agent_id] = tries.get(agent_id, 0) + 1
    return tuple(sorted(tries.items()))


def _without(counts: Counts, agent_id: int) -> Counts:
    return tuple(it for it in counts if it[0] != agent_id)

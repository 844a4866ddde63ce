"""The place to which each aMussel is brought back, and the exchanges of places that a mission has planned.

The mission's state keeps both (`homes` and `exchanged`), so that a resumed mission goes on with them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import ExchangeChanged, ExchangePhase
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.planning.exchange_of_places import nearest_places
from apad_bridge.planning.solution import StepKind
from firmware_model.state_groups import DOCKED

Homes = tuple[tuple[int, float, float], ...]
"""(agent, north, east), by agent: the place to which each aMussel is brought back; at first, where it was first heard."""


def with_new_homes(homes: Homes, beliefs: Iterable[Belief]) -> Homes:
    """Adds the places of aMussels heard for the first time."""
    known = {agent_id for agent_id, _, _ in homes}
    new = [
        (b.agent_id, b.north_m, b.east_m)
        for b in beliefs
        if b.agent_id not in known and b.state not in DOCKED and not b.is_of_another_board
    ]
    return tuple(sorted((*homes, *new))) if new else homes


def with_exchanged_homes(homes: Homes, pairs: Iterable[tuple[int, int]]) -> Homes:
    """Has each pair of aMussels exchange its places; one without a known place leaves the other's as it is."""
    known = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in homes}
    for one, other in pairs:
        if one in known and other in known:
            known[one], known[other] = known[other], known[one]
    return tuple((agent_id, *place_m) for agent_id, place_m in sorted(known.items()))


class HomePlaces:
    """Knows and exchanges the places of one mission's aMussels."""

    def __init__(self, book: OrderBook) -> None:
        self._book = book

    def all(self) -> dict[int, tuple[float, float]]:
        """The known places (north, east) in m, by agent."""
        return {agent_id: (north_m, east_m) for agent_id, north_m, east_m in self._book.state.homes}

    def learn(self, beliefs: Iterable[Belief]) -> None:
        """Takes the places of those that are heard for the first time."""
        if (homes := with_new_homes(self._book.state.homes, beliefs)) is not self._book.state.homes:
            self._book.set(homes=homes)

    def take_nearest(
        self, leaving: Sequence[int], from_m: tuple[float, float], kept: Collection[int]
    ) -> list[tuple[int, int]]:
        """Gives those that leave the nearest places of the docked ones; returns the pairs (released, docked).

        Those of `kept` keep theirs.
        """
        docked = {agent_id for _, agent_id in self._book.state.docked}.difference(kept)
        places_m = {it: place_m for it, place_m in self.all().items() if it in docked}
        pairs = nearest_places(leaving, places_m, from_m)
        self._book.set(homes=with_exchanged_homes(self._book.state.homes, pairs))
        return pairs

    def exchange(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Has each pair (released, collected) exchange its homes, and watches it. A new one ends an older one."""
        anew, state = {agent_id for pair in pairs for agent_id in pair}, self._book.state
        self._book.set(
            homes=with_exchanged_homes(state.homes, pairs),
            exchanged=(
                *(it for it in state.exchanged if it[0] not in anew),
                *((*pair, ExchangePhase.PLANNED) for pair in pairs),
            ),
        )

    def settle(self, is_given_up: Callable[[int], bool]) -> None:
        """Ends each exchange of which one is not collected: undone while the other one is aboard, else half done.

        One that is half done ends when the missing one is collected after all, or can be no more. The newest comes first,
        because it has exchanged what an older one left. `is_given_up` tells of an aMussel that it will not be collected.
        """
        book = self._book
        if not book.state.exchanged:
            return
        held = {agent_id for _, agent_id in book.state.docked}
        collects = {it.agent_id for it in book.state.plan if it.kind is StepKind.COLLECT}
        open_ones: list[tuple[int, int, ExchangePhase]] = []
        for released, collected, phase in reversed(book.state.exchanged):
            found = phase
            if collected in held:
                found = ExchangePhase.FINISHED
            elif collected not in collects:
                is_over = released in held or is_given_up(collected)
                found = ExchangePhase.UNDONE if is_over else ExchangePhase.HALF_DONE
            if found is ExchangePhase.UNDONE:
                book.set(homes=with_exchanged_homes(book.state.homes, [(released, collected)]))
            if found in (ExchangePhase.PLANNED, ExchangePhase.HALF_DONE):
                open_ones.insert(0, (released, collected, found))
            is_as_planned = phase is ExchangePhase.PLANNED and found is ExchangePhase.FINISHED
            if found is not phase and not is_as_planned:
                book.emit(ExchangeChanged(released, collected, found))
        book.set(exchanged=tuple(open_ones))

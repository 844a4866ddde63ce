"""The occupancy of an aPad's docks, as the supervisor knows it: one rule for the port, the mission and the journal.

Four sources tell of it, and may disagree. A vehicle's report of a mechanism decides (`after_report`), a later one over
an earlier one; what counts as its report is the affair of each generation: the mechanism's own answer, or the positions
of docked aMussels and their silence (`generation_a/docks.py`), or what the bench commanded (`generation_b/docks.py`).
The mission's order decides nothing: it ends when the report comes. An aMussel's charge edge decides nothing here: it
changes the belief of its state, by which the mission charges, and gives up one that does not gain. The bodies' contacts
(`Contacts` in `supervisor/loop.py`) are the world's, and follow the vehicle's link.
"""

from __future__ import annotations

from apad_bridge.vehicle.commands import DockClosed, DockOpened

Occupancy = tuple[tuple[int, int], ...]
"""(dock, aMussel) of each closed dock, by dock."""


def after_report(docked: Occupancy, dock_index: int, agent_id: int, *, closed: bool) -> Occupancy:
    """The occupancy after a vehicle's report that a dock closed around an aMussel, or opened and let it go.

    An aMussel is in one dock at most: closing moves it there, and opening frees it wherever it was.
    """
    held = {at: holder for at, holder in docked if holder != agent_id}
    if closed:
        held[dock_index] = agent_id
    return tuple(sorted(held.items()))


class DockTable:
    """The port's occupancy."""

    def __init__(self) -> None:
        self.docked: Occupancy = ()

    def take(self, fact: DockClosed | DockOpened) -> None:
        closed = isinstance(fact, DockClosed)
        self.docked = after_report(self.docked, fact.dock_index, fact.agent_id, closed=closed)

    def dock_index_of(self, agent_id: int) -> int | None:
        return next((dock_index for dock_index, holder in self.docked if holder == agent_id), None)

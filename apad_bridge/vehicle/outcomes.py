"""Outcomes of the primitives that a mission orders from a docking port.

Times are integer milliseconds of mission time. An outcome's `primitive_id` repeats the `command_id` that the mission chose.
"""

from __future__ import annotations

from dataclasses import dataclass

# The rule for an aPad's docks, as the supervisor knows them: which aMussel is in which dock.
#
# The supervisor keeps one table, `DockingPort.docked`. Each `DockChanged` carries the table after that change, and the
# mission's state repeats it for the snapshots, from which the next supervisor's port is filled. A resume applies the same
# rule, `after_report`, to the journal's lines since the newest snapshot. The replay shows the docks of the aPad's lines.
#
# Four sources tell of a dock, and may disagree:
#
# - the mechanism's report, which a vehicle's link gives as `DockClosed` and `DockOpened`. It alone decides, a later one
#   over an earlier one. What counts as a report is the affair of each generation: the mechanism's own answer, or what the
#   bench commanded (`world/generation_b/docks.py`).
# - radio silence of a docked aMussel. It becomes a report in `generation_a/docks.py` alone: after an order to open, or
#   after the aPad was asked what it holds.
# - the aMussel's charge edge. It decides nothing here: it changes the belief of the aMussel's state, by which the mission
#   charges, and gives up one that does not gain.
# - the mission's order. It decides nothing: it ends when the report comes, or fails at its time-out.
#
# The bodies' contacts (`world/contacts.py`) are the world's, and follow the vehicle's link.
Occupancy = tuple[tuple[int, int], ...]
"""(dock index, agent) of each closed dock, by dock index."""


def after_report(docked: Occupancy, dock_index: int, agent_id: int, *, closed: bool) -> Occupancy:
    """The occupancy after a vehicle's report that a dock closed around an aMussel, or opened and let it go.

    An aMussel is in one dock at most: closing moves it there, and opening frees it wherever it was.
    """
    held = {at: holder for at, holder in docked if holder != agent_id}
    if closed:
        held[dock_index] = agent_id
    return tuple(sorted(held.items()))


def dock_index_of(docked: Occupancy, agent_id: int) -> int | None:
    """The dock that holds the aMussel, None if none does."""
    return next((dock_index for dock_index, holder in docked if holder == agent_id), None)


@dataclass(frozen=True, slots=True)
class PrimitiveSucceeded:
    at_ms: int
    primitive_id: int


@dataclass(frozen=True, slots=True)
class PrimitiveFailed:
    at_ms: int
    primitive_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class NothingCaught:
    """A docking ended before its mechanism moved, because the aMussel does not float within the catch radius."""

    at_ms: int
    primitive_id: int


@dataclass(frozen=True, slots=True)
class DockChanged:
    """A dock closed or opened, ordered or not. The vehicle reports time, dock and aMussel."""

    at_ms: int
    dock_index: int
    agent_id: int
    closed: bool
    docked: Occupancy
    """The port's occupancy after the change."""


PrimitiveEnded = PrimitiveSucceeded | PrimitiveFailed | NothingCaught
Outcome = PrimitiveEnded | DockChanged

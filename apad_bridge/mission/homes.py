"""Where each aMussel was first heard in the water, which is where it is brought back to."""

from __future__ import annotations

from collections.abc import Iterable

from apad_bridge.beliefs.belief import Belief
from firmware_model.state_groups import DOCKED

Homes = tuple[tuple[int, float, float], ...]
"""(agent, north, east), by agent."""


def with_new_homes(homes: Homes, beliefs: Iterable[Belief]) -> Homes:
    """The same, and those heard for the first time."""
    known = {agent_id for agent_id, _, _ in homes}
    new = [
        (b.agent_id, b.north_m, b.east_m)
        for b in beliefs
        if b.agent_id not in known and b.state not in DOCKED
    ]
    return tuple(sorted((*homes, *new))) if new else homes

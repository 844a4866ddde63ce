"""Where an aMussel seems to be: by its last packet, or by a belief that is carried past it."""

from __future__ import annotations

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import DOCKED, LIKELY, Mode
from firmware_model.state_groups import TO_BE_FETCHED
from firmware_model.states import State


def floats(belief: Belief) -> bool:
    if belief.is_carried:
        return belief.probability_of(Mode.FLOATING) >= LIKELY
    return belief.state is State.FLOATING


def comes_up(belief: Belief) -> bool:
    """It floats, or is on its way."""
    if belief.is_carried:
        return belief.probability_of(Mode.SURFACING, Mode.FLOATING) >= LIKELY
    return belief.state in (State.FLOATING, State.SURFACING)


def can_be_fetched(belief: Belief) -> bool:
    """An aPad that goes there and permits it to surface finds it."""
    if belief.is_carried:
        return belief.probability_of(*DOCKED, Mode.LOST) < LIKELY
    return belief.state in TO_BE_FETCHED

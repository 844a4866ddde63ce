"""The charge with which a docked aMussel may leave, by the scenario's thresholds."""

from __future__ import annotations

from apad_bridge.beliefs.belief import Belief
from apad_bridge.planning import exchange_of_places
from apad_bridge.scenario.mission_options import FullWhen, Mission


def is_full(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed full, by the scenario's definition; one that was never heard is not."""
    return belief is not None and counted_charge(belief, config) > config.full_threshold


def is_charged(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed to have charge enough to make room for an empty one at least."""
    return makes_room(belief, config, 0.0)


def makes_room(belief: Belief | None, config: Mission, waiting_charge: float) -> bool:
    """The aMussel makes room for one with `waiting_charge`: it is believed above the scenario's `charge_to`, or to lead."""
    if belief is None:
        return False
    charge = counted_charge(belief, config)
    return exchange_of_places.makes_room(charge, waiting_charge, config.room_above, config.charge_lead)


def counted_charge(belief: Belief, config: Mission) -> float:
    """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
    is_primary = config.full_when is FullWhen.PRIMARY
    return belief.primary if is_primary else min(belief.primary, belief.secondary)

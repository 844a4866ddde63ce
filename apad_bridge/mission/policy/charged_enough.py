"""The charge with which a docked aMussel may leave, by the scenario's thresholds."""

from __future__ import annotations

from apad_bridge.beliefs.belief import Belief
from apad_bridge.planning.dispatch_rule import FullWhen, ServiceRules


def is_full(belief: Belief | None, config: ServiceRules) -> bool:
    """The aMussel is believed full, by the scenario's definition; one that was never heard is not."""
    return belief is not None and counted_charge(belief, config) > config.full_threshold


def is_charged(belief: Belief | None, config: ServiceRules) -> bool:
    """The aMussel is believed to have charge enough to make room for an empty one at least."""
    return makes_room(belief, config, 0.0)


def makes_room(belief: Belief | None, config: ServiceRules, waiting_charge: float) -> bool:
    """The aMussel makes room for one with `waiting_charge`: it is believed above the scenario's `charge_to`, or to lead."""
    return belief is not None and config.leaves_for(counted_charge(belief, config), waiting_charge)


def counted_charge(belief: Belief, config: ServiceRules) -> float:
    """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
    is_primary = config.full_when is FullWhen.PRIMARY
    return belief.primary if is_primary else min(belief.primary, belief.secondary)

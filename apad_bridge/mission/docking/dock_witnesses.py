"""The witnesses of a docking: the vehicle's report, the aMussel's own packets, and the vehicle's service about its docks.

The vehicle's report moves the mission on, but no witness counts alone: a charge in a dock counts when another one says so
too, and not as many deny it. So one false witness of three neither makes a service nor takes one away.
"""

from __future__ import annotations

from apad_bridge.beliefs.belief import Belief, Source
from firmware_model.state_groups import AT_WORK, DOCKED, STRANDED

ON_BOTTOM = AT_WORK | STRANDED
"""An aMussel that a dock holds reports none of these."""


def says_docked(belief: Belief | None) -> bool | None:
    """The aMussel's own word, in its newest packet; None where it has not been heard since its docking, or floats."""
    if belief is None or Source.DOCKING in belief.learned_from:
        return None
    if belief.state in DOCKED:
        return True
    return False if belief.state in ON_BOTTOM else None


def doubt(belief: Belief | None, named: bool | None) -> str | None:
    """The reason why the vehicle's report that a dock holds the aMussel does not count; None if it counts.

    `named` is the word of the vehicle's service: it names the aMussel, or others alone; None where it knows nothing.
    """
    own = says_docked(belief)
    if (agreeing := 1 + (own, named).count(True)) >= 2 and agreeing > (own, named).count(False):
        return None
    reports = "is not heard in it" if own is None or belief is None else f"reports {belief.state.name}"
    names = "" if named is None else ", and the docks' service names others"
    return f"the vehicle reports it in a dock, the aMussel {reports}{names}: its charge is not counted"

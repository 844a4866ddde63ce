"""The behaviour of a mission's phase: what it does when it begins, at each tick, and when its primitive ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from agents.time_scale import MissionMs

PhaseAct = Callable[[MissionMs], None]
"""It is called with the time at which it is done."""


def nothing(now_ms: MissionMs) -> None:
    pass


@dataclass(frozen=True, slots=True)
class PhaseBehaviour:
    begin: PhaseAct = nothing
    """Runs when the mission starts in this phase, which may be in the middle of a resumed run."""
    tick: PhaseAct = nothing
    decide: Callable[[MissionMs], PhaseAct | None] = lambda now_ms: None
    """Decides, after `tick`, what to do now: an act that is not done yet, or None to wait. It changes nothing.

    These are the boxes of the paper's Fig. 7 that ask something.
    """
    success: PhaseAct = nothing
    """Runs when the phase's primitive has succeeded."""
    failure: Callable[[str, MissionMs], None] | None = None
    """Runs, with the reason, when it has failed; None gives the step up."""

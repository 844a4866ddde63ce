"""No collection: the "no charging" baseline of the paper's Table II."""

from __future__ import annotations

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, StepKind


class NoCollection:
    """Never collects anybody: the aPad waits for the whole mission."""

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        return Solution(())

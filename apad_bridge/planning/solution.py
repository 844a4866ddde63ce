"""The universal solution encoding (paper, section III), which every strategy returns.

A solution is an ordered list of (kind, agent, dock), which the mission executes step by step. Because of this one
form, strategies can be swapped, and plans are journaled and replayed alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from apad_bridge.planning.candidates import Situation


class StepKind(StrEnum):
    """`collect`: go to the agent and dock it. `deploy`: go to its home and undock it there."""

    COLLECT = "collect"
    DEPLOY = "deploy"


class Step(NamedTuple):
    """The journal has it as a row: `["collect", 7, 0]`."""

    kind: StepKind
    agent_id: int
    dock_index: int


@dataclass(frozen=True, slots=True)
class Solution:
    """Steps in the order of execution; an empty solution is a plan to go on waiting."""

    steps: tuple[Step, ...]


def check_solution(solution: Solution, situation: Situation, kind: StepKind) -> None:
    """Raises ValueError, naming the step, unless the mission can carry the plan out.

    Every step must be of `kind` and name another candidate. A collection must fill free docks, each once; a
    redeployment must open the dock that holds the agent. A strategy may come from a user's package, so its plans
    are checked before the vehicle moves.
    """
    candidates = {candidate.agent_id: candidate for candidate in situation.candidates}
    free = set(situation.free_docks)
    for number, step in enumerate(solution.steps, start=1):
        where = f"step {number} of the plan ({step.kind} {step.agent_id} with dock {step.dock_index})"
        if step.kind is not kind:
            raise ValueError(f"{where}: a {kind} plan cannot hold it")
        candidate = candidates.pop(step.agent_id, None)
        if candidate is None:
            raise ValueError(f"{where}: this aMussel is no candidate, or was planned for already")
        if kind is StepKind.COLLECT:
            if step.dock_index not in free:
                raise ValueError(f"{where}: this dock is not free, or was planned for already")
            free.remove(step.dock_index)
        elif step.dock_index != candidate.dock_index:
            raise ValueError(f"{where}: dock {candidate.dock_index} holds this aMussel")

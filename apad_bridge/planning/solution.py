"""The universal solution encoding (paper, section III): what every strategy answers with.

A solution is an ordered list of (kind, agent, slot); the mission walks it step by step. Strategies can so be
swapped, and a plan is journaled and replayed in one form.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from apad_bridge.planning.candidates import Situation


class StepKind(StrEnum):
    """`collect`: go to the agent and dock it. `deploy`: go to its home and undock it there."""

    COLLECT = "collect"
    DEPLOY = "deploy"


@dataclass(frozen=True, slots=True)
class Step:
    kind: StepKind
    agent_id: int
    dock_index: int


@dataclass(frozen=True, slots=True)
class Solution:
    """Steps in the order in which they are to be made; none at all is a plan to go on waiting."""

    steps: tuple[Step, ...]

    def encode(self) -> list[list[str | int]]:
        """As plain lists, `["collect", 7, 0]` for each step: what the journal holds."""
        return [[step.kind.value, step.agent_id, step.dock_index] for step in self.steps]

    @classmethod
    def decode(cls, rows: Iterable[Sequence[str | int]]) -> Solution:
        """The inverse of `encode`. Raises ValueError for an unknown kind or a row of another length."""
        return cls(
            tuple(Step(StepKind(str(kind)), int(agent), int(dock_index)) for kind, agent, dock_index in rows)
        )


def check_solution(solution: Solution, situation: Situation, kind: StepKind) -> None:
    """Raise ValueError, naming the step, unless the mission can carry the plan out.

    Every step must be of `kind` and name another candidate. A collection must fill slots that are free, each
    once; a redeployment must open the slot that holds the agent. A strategy may come from a user's package:
    its plans are checked before the vehicle moves.
    """
    candidates = {candidate.agent_id: candidate for candidate in situation.candidates}
    free = set(situation.free_docks)
    for number, step in enumerate(solution.steps, start=1):
        where = f"step {number} of the plan ({step.kind} {step.agent_id} with slot {step.dock_index})"
        if step.kind is not kind:
            raise ValueError(f"{where}: a {kind} plan cannot hold it")
        candidate = candidates.pop(step.agent_id, None)
        if candidate is None:
            raise ValueError(f"{where}: this aMussel is no candidate, or was planned for already")
        if kind is StepKind.COLLECT:
            if step.dock_index not in free:
                raise ValueError(f"{where}: this slot is not free, or was planned for already")
            free.remove(step.dock_index)
        elif step.dock_index != candidate.dock_index:
            raise ValueError(f"{where}: slot {candidate.dock_index} holds this aMussel")

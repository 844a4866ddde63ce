"""The plans that are refused before the vehicle moves."""

from __future__ import annotations

import pytest

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.solution import Solution, Step, StepKind, check_solution

COLLECT, DEPLOY = StepKind.COLLECT, StepKind.DEPLOY


def agent(agent_id: int, dock_index: int | None = None) -> Candidate:
    return Candidate(agent_id, 1.0, 2.0, 0.5, 1.0, 1.0, 2.0, dock_index)


POOL = Situation(0.0, 0.0, (agent(1), agent(2), agent(3)), (0, 2))
DOCKED = Situation(0.0, 0.0, (agent(1, 3), agent(2, 0)), ())


@pytest.mark.parametrize(
    ("plan", "situation", "kind", "message"),
    [
        ([Step(COLLECT, 9, 0)], POOL, COLLECT, "step 1 .*no candidate"),
        ([Step(COLLECT, 1, 0), Step(COLLECT, 1, 2)], POOL, COLLECT, "step 2 .*planned for already"),
        ([Step(COLLECT, 1, 1)], POOL, COLLECT, "dock is not free"),
        ([Step(COLLECT, 1, 2), Step(COLLECT, 2, 2)], POOL, COLLECT, "step 2 .*dock is not free"),
        ([Step(DEPLOY, 1, 0)], POOL, COLLECT, "a collect plan cannot hold it"),
        ([Step(DEPLOY, 1, 0)], DOCKED, DEPLOY, "dock 3 holds this aMussel"),
        ([Step(COLLECT, 1, 3)], DOCKED, DEPLOY, "a deploy plan cannot hold it"),
    ],
)
def test_plans_that_cannot_be_carried_out(
    plan: list[Step], situation: Situation, kind: StepKind, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        check_solution(Solution(tuple(plan)), situation, kind)


def test_plans_that_can() -> None:
    check_solution(Solution((Step(COLLECT, 3, 2), Step(COLLECT, 1, 0))), POOL, COLLECT)
    check_solution(Solution((Step(DEPLOY, 2, 0),)), DOCKED, DEPLOY)


def test_a_situation_names_everything_once() -> None:
    with pytest.raises(ValueError, match="candidate twice"):
        Situation(0.0, 0.0, (agent(1), agent(1)), ())
    with pytest.raises(ValueError, match="free and taken"):
        Situation(0.0, 0.0, (agent(1, 2),), (2, 3))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_belief_that_is_no_number_never_reaches_a_planner(bad: float) -> None:
    with pytest.raises(ValueError, match="aMussel 1: a planner needs finite numbers"):
        Candidate(1, 0.0, bad, 0.5, 1.0, 0.0, 0.0)

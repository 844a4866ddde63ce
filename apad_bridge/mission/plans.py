"""Checks plans of a strategy, which may be a user's, and writes plans into the journal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

from apad_bridge.mission.ending import EndReason
from apad_bridge.mission.orders import Note
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.costs import Scales, cost_of
from apad_bridge.planning.solution import Solution, StepKind, check_solution


def plan_or_reason(
    name: str, plan: Callable[[], Solution], situation: Situation, kind: StepKind
) -> Solution | str:
    """The strategy's plan if it can be flown, else the reason. A user's error must not raise while a vehicle is out."""
    try:
        solution = plan()
        check_solution(solution, situation, kind)
    except Exception as error:
        return f"{EndReason.STRATEGY_FAILED} {name!r}: {type(error).__name__}: {error}"
    return solution


def plan_note(what: str, name: str, solution: Solution, situation: Situation, scales: Scales) -> Note:
    return Note(
        "plan",
        {
            "what": what,
            "strategy": name,
            "steps": [{"agent": step.agent_id, "dock": step.dock_index} for step in solution.steps],
            "costs": asdict(cost_of(solution, situation, scales)),
            "beliefs": [
                {"id": c.agent_id, "charge": round(c.charge, 5), "north_m": c.north_m, "east_m": c.east_m}
                for c in situation.candidates
            ],
        },
    )

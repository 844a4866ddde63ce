"""Checks plans of a strategy, which may be a user's, and writes plans into the journal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import isfinite
from typing import Any

from apad_bridge.events.mission_events import PlanMade
from apad_bridge.events.run_events import EndReason
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.costs import Scales, cost_of
from apad_bridge.planning.registry import A_USERS_ERROR, label, words_of_package
from apad_bridge.planning.solution import Solution, StepKind, check_solution
from apad_bridge.planning.strategy import CollectionStrategy, Strategy
from firmware_model.entry_points import in_one_line

Planning = Callable[[str], AbstractContextManager[None]]
"""Makes, of a strategy's name, what is entered while that strategy plans."""


def without_progress(name: str) -> AbstractContextManager[None]:
    """Plans take their time, and nobody sees it."""
    return nullcontext()


class StrategyFailed(Exception):
    """A strategy raised an error, or made a plan that cannot be flown; the text is one line. It ends the mission."""

    @classmethod
    def by(cls, name: str, error: BaseException) -> StrategyFailed:
        named = f"{label(name)!r}{words_of_package(name)}"
        return cls(f"{EndReason.STRATEGY_FAILED} {named}: {in_one_line(error)}")


def checked_plan(name: str, plan: Callable[[], Solution], situation: Situation, kind: StepKind) -> Solution:
    """The strategy's plan, which can be flown; StrategyFailed for any other."""
    try:
        solution = plan()
        check_solution(solution, situation, kind)
    except A_USERS_ERROR as error:
        raise StrategyFailed.by(name, error) from error
    return solution


def is_refused(name: str, strategy: CollectionStrategy, situation: Situation) -> bool:
    """True if the strategy refuses this pool for the present (`CollectionStrategy`). StrategyFailed for its error."""
    try:
        return bool(strategy.refuses(situation))
    except A_USERS_ERROR as error:
        raise StrategyFailed.by(name, error) from error


def plan_event(
    what: str,
    name: str,
    solution: Solution,
    situation: Situation,
    scales: Scales,
    strategy: Strategy | None = None,
    exchanged: Sequence[tuple[int, int]] = (),
) -> PlanMade:
    """The plan for the journal, with the reasons that `strategy` gives, if it gives any.

    `exchanged` are the pairs (released, other), who exchange places.
    """
    costs, north_east = cost_of(solution, situation, scales), situation.apad_m
    return PlanMade(
        what,
        label(name),
        [{"agent": step.agent_id, "dock": step.dock_index} for step in solution.steps],
        {
            "distance_m": costs.distance_m,
            "demand": costs.demand,
            "distance_cost": costs.distance_cost,
            "energy_cost": costs.energy_cost,
        },
        [
            {
                "id": c.agent_id,
                "charge": round(c.charge, 5),
                "north_m": c.north_m,
                "east_m": c.east_m,
                "secondary": round(c.secondary, 5),
                "unserved_s": c.unserved_s,
                "reported": c.reported.stated,
            }
            for c in situation.candidates
        ],
        from_=north_east,
        exchanged=[{"released": out, "collected": other} for out, other in exchanged] or None,
        **_reasons(name, strategy, situation, solution),
    )


def _reasons(
    name: str, strategy: Strategy | None, situation: Situation, solution: Solution
) -> dict[str, Any]:
    """The fields of an explanation. A user's error in one must not end a flight: it stands in the place of the reasons."""
    try:
        options = [] if strategy is None else list(strategy.explain(situation, solution))
        if not options:
            return {}
        if not all(isfinite(cost) for option in options for cost in (option.cost, *option.parts.values())):
            raise ValueError("a cost that is no finite number")
        return {
            "options": [
                {
                    "agents": [int(agent_id) for agent_id in option.agents],
                    "cost": float(option.cost),
                    "parts": {str(name): float(cost) for name, cost in option.parts.items()},
                }
                for option in options
            ]
        }
    except A_USERS_ERROR as error:
        return {"unexplained": f"{in_one_line(error)}{words_of_package(name)}"}

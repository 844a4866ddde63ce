"""Plans for scripts, with the same strategies, checks and costs that the paper's mission uses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.policy.plan_checks import StrategyFailed, checked_plan, plan_event
from apad_bridge.mission.policy.pool import ChargingPool
from apad_bridge.mission.policy.situation import placeholder_belief, situation_of
from apad_bridge.mission.script_values import Refused, dock_of
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.costs import CostBreakdown, cost_of
from apad_bridge.planning.solution import Solution, StepKind

T = TypeVar("T")
_OF_A_SCRIPT = registry.Trust()
"""A script is executed already, so the strategies that it names need no further permission."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps (aMussel, dock's number) in the order of service, and the `situation` for which they were planned."""

    steps: tuple[tuple[int, int], ...]
    solution: Solution
    situation: Situation


def collection(mission: ManualMission, pool: ChargingPool, batch: int | None, strategy: str | None) -> Plan:
    """Plans a collection of at most `batch` by a strategy, by default the scenario's. Refused where there is none."""
    name = strategy or mission.config.collection
    collector = _strategy(lambda: registry.collection(name, trust=_OF_A_SCRIPT))
    situation = situation_of(
        mission.state,
        _pose(mission),
        pool.candidates(mission.now_ms, served=mission.state.served),
        mission.now_ms,
    )
    wanted = mission.config.batch if batch is None else batch
    if wanted < 1:
        raise Refused(f"a batch of {wanted}: 1 or more")
    return _planned(
        mission, "collect", name, lambda: collector.plan(situation, wanted), situation, StepKind.COLLECT
    )


def redeployment(mission: ManualMission, strategy: str | None) -> Plan:
    """Plans the return of all docked aMussels, as `collection` does."""
    name = strategy or mission.config.redeployment
    redeployer = _strategy(lambda: registry.redeployment(name, _OF_A_SCRIPT))
    here = _pose(mission)
    beliefs = [
        mission.beliefs.get(agent) or placeholder_belief(agent, here) for _, agent in mission.state.docked
    ]
    situation = situation_of(mission.state, here, beliefs, mission.now_ms)
    return _planned(mission, "redeploy", name, lambda: redeployer.plan(situation), situation, StepKind.DEPLOY)


def cost(mission: ManualMission, plan: Plan) -> CostBreakdown:
    """The cost of a plan, by the scenario's `mission.costs`."""
    return cost_of(plan.solution, plan.situation, mission.config.costs)


def _planned(
    mission: ManualMission,
    purpose: str,
    name: str,
    plan: Callable[[], Solution],
    situation: Situation,
    kind: StepKind,
) -> Plan:
    try:
        solution = checked_plan(name, plan, situation, kind)
    except StrategyFailed as failed:
        raise Refused(str(failed)) from failed
    if solution.steps:
        mission.emit(plan_event(purpose, name, solution, situation, mission.config.costs))
    return Plan(
        tuple((step.agent_id, dock_of(step.dock_index)) for step in solution.steps), solution, situation
    )


def _strategy(make: Callable[[], T]) -> T:
    try:
        return make()
    except ValueError as error:
        raise Refused(str(error)) from None


def _pose(mission: ManualMission) -> tuple[float, float]:
    if mission.pose is None:
        raise Refused("the aPad's place is not known yet")
    return mission.pose

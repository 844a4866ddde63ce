"""The planner's energy model, from a scenario's numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from apad_bridge.assembly.estimator import schedules
from apad_bridge.planning.dispatch_rule import ServiceRules
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.scenario.firmware_config import board_config
from apad_bridge.scenario.schema import Scenario
from firmware_model.config import BoardConfig
from firmware_model.power.charge import FULL, MS_PER_MIN
from firmware_model.power.rails import rails_of
from firmware_model.states import State


def energy_model(scenario: Scenario) -> EnergyModel:
    """Builds the model of nominal boards. What a whole board draws from its charger in a dock is left out."""
    mission = scenario.mission
    board, ids = board_config(scenario.board), scenario.fleet.all_ids
    per_s = scenario.time_scale.agent_span(1000) / FULL
    segments = board.charge.segments_by_two or board.charge.segments
    drain_per_min = drain_per_min_of(board, ids) if ids else 0.0
    return EnergyModel(
        **{it.name: getattr(mission, it.name) for it in fields(ServiceRules)},
        # An aMussel that draws nothing is never low; the planner divides by its drain.
        drain_per_s=max(1e-12, scenario.time_scale.agent_time(drain_per_min) / 60),
        curve=tuple((end / FULL, rate * per_s) for end, rate in segments),
        motor_run=scenario.board.motor_run_charge,
        speed_m_s=mission.speed_m_s,
        dock_s=mission.docking.dock_s,
        undock_s=mission.docking.undock_s,
        docks=scenario.apad.docks,
    )


def drain_per_min_of(board: BoardConfig, all_ids: Sequence[int]) -> float:
    """The mean drain of an aMussel at work, over its duty cycle, in charge on [0, 1] an agent minute.

    `board` has the id of one of `all_ids`, or 0 for the first of them.
    """
    if (whole := board.whole) is None:
        return board.charge.discharge * MS_PER_MIN / FULL
    agent_id = board.agent_id or all_ids[0]
    if (cycle := schedules(whole, all_ids, [agent_id])[agent_id].cycle) is not None:
        return cycle.in_all * MS_PER_MIN / cycle.period_ms
    loads = whole.power.loads.total(rails_of(State.ACTIVE, whole.power.kept_on, True, 0))
    return loads * MS_PER_MIN / FULL

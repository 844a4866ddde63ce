"""Builds the parts of a flight from a scenario, and converts the scenario's numbers for them."""

from __future__ import annotations

from collections.abc import Sequence

from agents.fleet import FleetConfig, resting_on_bottom
from agents.modem.frames import Generation
from agents.mussel.body import BodyConfig
from agents.mussel.physical import Physical
from agents.mussel.reporter import ReportConfig
from agents.water.patches import CALM_BAY
from apad_bridge.assembly.acoustics import ranging_of
from apad_bridge.assembly.estimator import fleet_beliefs
from apad_bridge.assembly.water import current_config, fields_config, generation_of, leeway_um_s
from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.manual import CommandSource, ManualMission
from apad_bridge.mission.role import Mission
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.mission.state import MissionState
from apad_bridge.mission.takeover import Takeover
from apad_bridge.planning import registry
from apad_bridge.scenario.firmware_config import board_config, clock_drift_ppb, sinking_of, spread_of
from apad_bridge.scenario.schema import DriftMode, HearingMode, Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.supervisor.context import LearnedState
from apad_bridge.supervisor.core import Supervisor
from apad_bridge.supervisor.sample_collection import SampleCollection
from apad_bridge.vehicle.capabilities import Capabilities, of_simulated_apad
from apad_bridge.vehicle.docking import DockingPort
from apad_bridge.vehicle.simulated.apad import SimulatedAPad
from apad_bridge.vehicle.simulated.misses import Misses
from firmware_model.packets.codec import load_codec


def agent_ids(scenario: Scenario) -> Sequence[int]:
    return scenario.fleet.ids


def fleet_config(scenario: Scenario) -> FleetConfig:
    board, drift, theta, water = scenario.board, scenario.fleet.drift, scenario.theta, scenario.water
    modems = Generation.V3 if water is None else generation_of(water.modems)
    return FleetConfig(
        theta=theta,
        seed=scenario.seed,
        codec=scenario.hearing.codec,
        board=board_config(board, scenario.seed, modems),
        body=BodyConfig(
            sinking_of(scenario),
            drifts_always=drift.mode is DriftMode.PAPER,
            drift_amplitude_um=round(drift.amplitude_m * 1e6),
            leeway_um_s=leeway_um_s(scenario),
            coil_alignment_ms=round(board.coil_alignment_s * 1000),
        ),
        reports=ReportConfig(
            round(scenario.hearing.report_period_s * 1000) * theta,
            heard_always=scenario.hearing.mode is HearingMode.PAPER,
            modem=modems,
        ),
        current=current_config(scenario),
        fields=CALM_BAY if water is None else fields_config(water.fields),
        first_id=scenario.fleet.first_id,
        clock_drift_ppb=clock_drift_ppb(board),
        spread=spread_of(scenario),
    )


def initial_states(scenario: Scenario, starts: Sequence[Start]) -> dict[int, Physical]:
    """Returns the physical state of every agent at time 0, by id: resting on the bottom."""
    depth_m = scenario.area.depth_m
    return {
        start.agent_id: resting_on_bottom(
            start.north_m, start.east_m, depth_m, start.primary, start.secondary
        )
        for start in starts
    }


def misses(scenario: Scenario) -> Misses:
    """Builds the draw of failing dockings, which is alike for every vehicle."""
    return Misses(scenario.seed, scenario.apad.dock_miss_probability)


def simulated_apad(scenario: Scenario) -> SimulatedAPad:
    return SimulatedAPad(scenario.apad, misses(scenario))


def initial_learned_state(scenario: Scenario, has_modem: bool = True) -> LearnedState:
    ids = agent_ids(scenario)
    return LearnedState(fleet_beliefs(scenario, ids), ranging_of(scenario, ids) if has_modem else None)


def supervisor(
    scenario: Scenario,
    state: MissionState | None = None,
    first_command_id: int = 1,
    command_sources: Sequence[CommandSource] = (),
    samples: SampleCollection | None = None,
    takeover: CallQueue | None = None,
    has_modem: bool = True,
    capabilities: Capabilities | None = None,
    breakdown: Breakdown | None = None,
    allocation: Allocation | None = None,
    known: LearnedState | None = None,
) -> Supervisor:
    """Builds a supervisor that knows nothing yet, or one that goes on with a mission's journaled `state`.

    It flies the paper's mission, which `takeover` can take over, or, with `command_sources`, a manual mission that executes
    their orders. Without `samples` it does not collect the aMussels' logs; without a modem it runs no ranging service. With
    a `breakdown` it is one of several supervisors that take over from each other. `known` holds the state learned so far,
    and `allocation`, over its beliefs, the aMussels that it serves. Without `capabilities` the vehicle is
    the simulated aPad.
    """
    state = state or MissionState(dock_count=scenario.apad.docks)
    known = known or initial_learned_state(scenario, has_modem)
    beliefs = known.beliefs
    if allocation is None:
        allocation = Allocation(beliefs, agent_ids(scenario))
    mission: Mission
    if command_sources:
        mission = ManualMission(
            scenario.mission, scenario.apad.max_speed_m_s, beliefs, command_sources, state
        )
    elif takeover is not None:
        mission = Takeover(
            lambda mission_state: _energy_exchange(scenario, allocation, mission_state),
            lambda mission_state: ManualMission(
                scenario.mission, scenario.apad.max_speed_m_s, beliefs, (), mission_state
            ),
            takeover,
            state,
        )
    else:
        mission = _energy_exchange(scenario, allocation, state)
    port = DockingPort(
        scenario.mission.docking,
        first_command_id=first_command_id,
        capabilities=capabilities or of_simulated_apad(scenario.apad.docks),
    )
    return Supervisor(
        beliefs,
        mission,
        port,
        load_codec(scenario.hearing.codec),
        samples,
        round(scenario.duration_s * 1000),
        scenario.mission.end_at_apad_fraction,
        known.ranging,
        allocation,
        breakdown,
    )


def _energy_exchange(scenario: Scenario, beliefs: BeliefSource, state: MissionState | None) -> EnergyExchange:
    return EnergyExchange(
        scenario.mission,
        beliefs,
        registry.collection(scenario.mission.collection),
        registry.redeployment(scenario.mission.redeployment),
        state,
    )

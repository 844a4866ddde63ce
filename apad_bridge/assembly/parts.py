"""Builds the parts of a flight from its configuration."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.fleet import FleetConfig, resting_on_bottom
from agents.hosting.faulty_host import FaultyHost
from agents.hosting.host import Host
from agents.mussel.body import gps_fix_um
from agents.mussel.physical import Physical
from agents.water.patches import CALM
from agents.water.sea import Sea
from agents.water.sea_client import RemoteSea
from apad_bridge.acoustics.locator import Locator
from apad_bridge.acoustics.ranging import NoRanging, RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler
from apad_bridge.assembly.energy_model import energy_model
from apad_bridge.assembly.flight_config import FlightConfig, flight_config, gps_deviation_um
from apad_bridge.assembly.water import current_config, waters_config
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.breakdown import NeverStandsDown, StandDownRule
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.end_by import EndBy
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.home_stays import HomeStays
from apad_bridge.mission.manual import CommandSource, ManualMission
from apad_bridge.mission.role import Mission
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.mission.state import MissionState
from apad_bridge.mission.takeover import Takeover
from apad_bridge.planning import registry
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.firmware_config import clock_drift_ppb, spread_of
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.scenario.timed_faults import planned
from apad_bridge.supervisor.core import LearnedState, Supervisor
from apad_bridge.supervisor.fault_injection import FaultInjection, Ongoing
from apad_bridge.supervisor.fleet import Fleet, InSea, LinksFile, NoFleet, WithoutWater
from apad_bridge.supervisor.sample_collection import NoSampleCollection, SampleCollection
from apad_bridge.vehicle.capabilities import Capabilities, of_simulated_apad
from apad_bridge.vehicle.docking import DockingPort
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.simulated.apad import SimulatedAPad
from apad_bridge.vehicle.simulated.misses import Misses
from firmware_model.packets.codec import load_codec


def fleet_config(config: FlightConfig) -> FleetConfig:
    """Builds the configuration of the flight's agents, and reads the current's file.

    OSError, or ValueError for a file that is no current.
    """
    scenario = config.scenario
    return FleetConfig(
        theta=scenario.theta,
        seed=scenario.seed,
        codec=scenario.hearing.codec,
        board=config.board,
        body=config.body,
        reports=config.reports,
        current=current_config(scenario),
        waters=CALM if scenario.water is None else waters_config(scenario.water.fields),
        first_id=scenario.fleet.first_id,
        agent_ids=scenario.fleet.agent_ids,
        clock_drift_ppb=clock_drift_ppb(scenario.board),
        spread=spread_of(scenario),
    )


def fleet_of(
    config: FlightConfig,
    host: Host,
    granted_ms: Mapping[int, int],
    now_ms: int = 0,
    opened: Collection[int] = (),
    sea: Sea | RemoteSea | None = None,
) -> Fleet:
    """Builds the fleet that runs in `host` at mission time `now_ms`; each aMussel has run up to its `granted_ms`.

    `opened` are the aMussels whose modems are open to other programs, in a scenario with water. It joins the `sea` that
    several flights share; without one, a scenario with water has a sea of its own.
    """
    scenario = config.scenario
    host = FaultyHost(host, scenario.seed)
    coordinator = Coordinator(host, granted_ms, scenario.theta, now_ms)
    if config.sea is None or scenario.water is None:
        return Fleet(coordinator, host, WithoutWater(coordinator, host), config.timeslots)
    if sea is None:
        sea = Sea(config.sea, scenario.theta, granted_ms, now_ms=now_ms, opened=opened)
    station = sea.join(coordinator, host)
    if scenario.water.links_file is None:
        return Fleet(coordinator, host, InSea(station), config.timeslots)
    links = LinksFile(Path(scenario.water.links_file), scenario.theta)
    station.set_topology(links.read())
    return Fleet(coordinator, host, InSea(station), config.timeslots, links)


def shared_sea(scenario: Scenario, apads: int) -> Sea | None:
    """Builds the sea that the flights of so many aPads share; None for one flight, or without water."""
    config = flight_config(scenario).sea
    if config is None or apads == 1:
        return None
    return Sea(config, scenario.theta, scenario.fleet.all_ids, apads)


def fault_injection(
    config: FlightConfig,
    fleet: Fleet | NoFleet,
    after_ms: int = -1,
    ongoing: Iterable[Ongoing] = (),
    *,
    real_hull: bool = False,
) -> FaultInjection:
    """The faults of a flight that goes on after `after_ms`; `ongoing` are those that had begun and not ended by then."""
    scenario = config.scenario
    host = None if isinstance(fleet, NoFleet) else fleet.host
    assert host is None or isinstance(host, FaultyHost)
    ids = () if host is None else config.ids
    due = []
    if scenario.faults is not None:
        processes = scenario.fleet.hosting is Hosting.PROCESSES
        due = planned(scenario.faults, ids, scenario.duration_s, processes=processes)
    later = [
        (at_ms, it) for at_ms, it in due if at_ms > after_ms and (it.agent_id is None or it.agent_id in ids)
    ]
    return FaultInjection(host, scenario.theta, later, ongoing, real_hull=real_hull)


def initial_states(scenario: Scenario, starts: Sequence[Start]) -> dict[int, Physical]:
    """Returns the physical state of every agent at time 0, by id: resting on the bottom, put there from the surface."""
    depth_m, deviation_um = scenario.area.depth_m, gps_deviation_um(scenario.hearing)

    def resting(start: Start) -> Physical:
        physical = resting_on_bottom(start.north_m, start.east_m, depth_m, start.primary, start.secondary)
        if deviation_um is None:
            return physical
        fix_um = gps_fix_um(scenario.seed, start.agent_id, 0, physical.fix_um, deviation_um)
        return replace(physical, fix_um=fix_um)

    return {start.agent_id: resting(start) for start in starts}


def misses(scenario: Scenario) -> Misses:
    """Builds the draw of failing dockings, which is alike for every vehicle."""
    return Misses(scenario.seed, scenario.apad.dock_miss_probability)


def simulated_apad(scenario: Scenario) -> SimulatedAPad:
    return SimulatedAPad(scenario.apad, misses(scenario), scenario.area.home_m)


def home_stays(scenario: Scenario) -> HomeStays:
    """Builds the rule by which the aPad goes home."""
    apad, home_m = scenario.apad, scenario.area.home_m
    return HomeStays(apad.start_m if home_m is None else home_m, apad.home, apad.unavailable)


def initial_learned_state(config: FlightConfig, has_modem: bool = True) -> LearnedState:
    """Builds the state of a supervisor that has learned nothing yet. Without a modem it runs no ranging service."""
    beliefs = fleet_beliefs(config)
    ranging = ranging_service(config) if has_modem else NoRanging()
    return LearnedState(beliefs, ranging, Allocation(beliefs, config.ids))


def fleet_beliefs(config: FlightConfig) -> FleetBeliefs:
    """Builds the scenario's estimator. Only twins import filterpy, which takes half a second."""
    twin, theta = config.twin, config.scenario.theta
    if twin is None:
        return HoldLast(config.ids, theta)
    from apad_bridge.beliefs.twin import Twin

    due_every_ms = config.reports.period_ms // theta
    return FleetBeliefs(Twin(twin.parameters, twin.schedules), config.ids, due_every_ms, theta)


def ranging_service(config: FlightConfig) -> RangingService | NoRanging:
    """Builds the aPad's ranging service, which does nothing if the scenario has no water."""
    acoustics, water, depth_m = config.acoustics, config.scenario.water, config.scenario.area.depth_m
    if acoustics is None or water is None:
        return NoRanging()
    codec, localisation = load_codec(config.scenario.hearing.codec), water.localisation
    return RangingService(
        AcousticScheduler(
            acoustics.schedule, codec, config.timeslots, config.scenario.fleet.all_ids, served=config.ids
        ),
        None if localisation is None else Locator(localisation, depth_m),
        water.sound.keel_m,
        depth_m,
        1.0 if localisation is None else localisation.deviation_m,
        acoustics.places,
        acoustics.charges,
    )


def supervisor(
    config: FlightConfig,
    state: MissionState | None = None,
    first_command_id: int = 1,
    command_sources: Sequence[CommandSource] = (),
    samples: SampleCollection | NoSampleCollection | None = None,
    takeover: CallQueue | None = None,
    capabilities: Capabilities | None = None,
    stands_down: StandDownRule | None = None,
    learned: LearnedState | None = None,
    gate: Gate | None = None,
) -> Supervisor:
    """Builds a supervisor that knows nothing yet, or one that goes on with a mission's journaled `state`.

    It flies the paper's mission, which `takeover` can take over, or, with `command_sources`, a manual mission that executes
    their orders. Without `samples` it does not collect the aMussels' logs. `stands_down` is the rule of one of several
    supervisors that take over from each other. `learned` holds the state learned so far. Without `capabilities` the vehicle
    is the simulated aPad. `gate` is the flight's; without one nothing is guarded.
    """
    scenario, learned = config.scenario, learned or initial_learned_state(config)
    state = state or MissionState(dock_count=scenario.apad.docks)
    beliefs, allocation = learned.beliefs, learned.allocation
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
        usual_go_to=(scenario.mission.speed_m_s, scenario.mission.victory_radius_m),
        docked=state.docked,
    )
    return Supervisor(
        learned,
        mission,
        port,
        load_codec(scenario.hearing.codec),
        samples or NoSampleCollection(),
        round(scenario.duration_s * 1000),
        scenario.mission.end_at_apad_fraction,
        stands_down or NeverStandsDown(),
        gate or Gate.without_guards(),
    )


def _energy_exchange(scenario: Scenario, beliefs: BeliefSource, state: MissionState | None) -> EnergyExchange:
    return EnergyExchange(
        scenario.mission,
        beliefs,
        registry.collection(scenario.mission.collection, scenario.mission.costs),
        registry.redeployment(scenario.mission.redeployment),
        state,
        energy_model(scenario),
        home_stays(scenario),
        _end_by(scenario),
    )


def change_planning(mission: EnergyExchange, scenario: Scenario) -> None:
    """Lets the mission go on by the scenario's strategies, thresholds and rules of dispatch."""
    rules = scenario.mission
    mission.change_planning(
        rules,
        registry.collection(rules.collection, rules.costs),
        registry.redeployment(rules.redeployment),
        energy_model(scenario),
    )


def _end_by(scenario: Scenario) -> EndBy | None:
    mission, docking = scenario.mission, scenario.mission.docking
    if mission.end_by is None:
        return None
    if isinstance(mission.end_by, str):
        raise ScenarioError(
            [f"mission.end_by: {mission.end_by} is a local time, which this flight has not: say seconds"]
        )
    home_m = home_stays(scenario).place_m
    return EndBy(mission.end_by, home_m, mission.speed_m_s, docking.timeout_s, docking.timeout_s)

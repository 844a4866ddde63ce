"""Builds the parts of a flight from its configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from agents.hosting.faulty_host import FaultyHost
from apad_bridge.acoustics.locator import Locator
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler
from apad_bridge.assembly.flight_config import FlightConfig
from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.events.mission_events import MissionState
from apad_bridge.events.person_events import Steering
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.end_by import EndBy, KnownEnd
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.flight_mission import FlightMission, MissionRole
from apad_bridge.mission.going_home import HomeStays
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.policy.plan_checks import Planning
from apad_bridge.mission.policy.planner import PlanRules
from apad_bridge.mission.sources import Allocation
from apad_bridge.planning import registry
from apad_bridge.planning.dispatch_rule import Horizon
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.hull_in_flow import LegForecast, holding_effort, surface_of
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.timed_faults import planned
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.recorder_interface import FlightRecorder
from apad_bridge.supervisor.run_spec import FROM_START, RunSpec
from apad_bridge.supervisor.sample_collection import NoSampleCollection, SampleCollection
from apad_bridge.supervisor.supervisor import LearnedState, Supervisor
from apad_bridge.vehicle.capabilities import of_simulated_apad
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.guards.gate import Gate, Safety
from apad_bridge.vehicle.guards.monitor import Monitor
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.fault_injection import FaultInjection, Ongoing
from apad_bridge.world.simulated_fleet import FlightFleet, NoFleet
from apad_bridge.world.world import World


def fault_injection(
    config: FlightConfig,
    fleet: FlightFleet | NoFleet,
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
    return FaultInjection(host, scenario.time_scale, later, ongoing, real_hull=real_hull)


def misses(scenario: Scenario) -> Misses:
    """Builds the draw of failing dockings, which is alike for every vehicle."""
    apad, surface = scenario.apad, surface_of(scenario)
    if surface is None:
        return Misses(scenario.seed, apad.dock_miss_probability)
    return Misses(
        scenario.seed,
        apad.dock_miss_probability,
        lambda place_m, at_ms: holding_effort(apad, surface.flow(place_m, at_ms)),
    )


def simulated_apad(scenario: Scenario) -> SimulatedAPad:
    """Builds the simulated aPad in the scenario's sea, for a flight in one process."""
    return SimulatedAPad(scenario.apad, misses(scenario), scenario.area.home_m, surface=surface_of(scenario))


def simulated_hull(scenario: Scenario, held: Mapping[int, int] = MappingProxyType({})) -> SimulatedAPad:
    """Builds the same aPad in the same sea for a stack that decides by itself which dockings miss.

    `held` are the aMussels that its docks hold at the start, by dock index.
    """
    return SimulatedAPad(scenario.apad, None, scenario.area.home_m, held, surface_of(scenario))


def home_of(scenario: Scenario) -> tuple[float, float]:
    """The aPad's home, (north, east) in metres: its start where the scenario names none."""
    return scenario.apad.start_m if scenario.area.home_m is None else scenario.area.home_m


def home_stays(scenario: Scenario) -> HomeStays:
    """Builds the rule by which the aPad goes home. ScenarioError for an end at a local time."""
    return HomeStays(home_of(scenario), scenario.apad.home, scenario.apad.unavailable, _end_by(scenario))


def initial_learned_state(config: FlightConfig, has_modem: bool = True) -> LearnedState:
    """Builds the state of a supervisor that has learned nothing yet. Without a modem it runs no ranging service."""
    beliefs = fleet_beliefs(config)
    ranging = ranging_service(config) if has_modem else None
    return LearnedState(beliefs, ranging, Allocation(beliefs, config.ids))


def fleet_beliefs(config: FlightConfig) -> FleetBeliefs:
    """Builds the scenario's estimator. Only twins import filterpy, which takes half a second."""
    twin, scale = config.twin, config.scenario.time_scale
    if twin is None:
        return HoldLast(config.ids, scale)
    from apad_bridge.beliefs.twin import Twin

    due_every_ms = scale.mission_span(config.reports.period_ms)
    return FleetBeliefs(Twin(twin.parameters, twin.schedules), config.ids, due_every_ms, scale)


def ranging_service(config: FlightConfig) -> RangingService | None:
    """Builds the aPad's ranging service; None if the scenario has no water."""
    acoustics, water, depth_m = config.acoustics, config.scenario.water, config.scenario.area.depth_m
    if acoustics is None or water is None:
        return None
    codec, localisation = codec_of(config.scenario), water.localisation
    return RangingService(
        scheduler=AcousticScheduler(
            acoustics.schedule, codec, config.timeslots, config.scenario.fleet.all_ids, served=config.ids
        ),
        locator=None if localisation is None else Locator(localisation, depth_m),
        keel_m=water.sound.keel_m,
        depth_m=depth_m,
        deviation_m=1.0 if localisation is None else localisation.deviation_m,
        places=acoustics.places,
        charges=acoustics.charges,
    )


def flight(
    config: FlightConfig,
    context: FlightContext,
    recorder: FlightRecorder,
    spec: RunSpec = FROM_START,
    samples: SampleCollection | NoSampleCollection | None = None,
    watchers: Sequence[Watcher] = (),
) -> Flight:
    """Builds the flight of a new supervisor in its context, whatever hosts the fleet; `supervisor` states the rest."""
    flown_by = supervisor(config, spec, context, samples)
    return Flight(flown_by, context, recorder, spec.start_ms, tuple(watchers))


def supervisor(
    config: FlightConfig,
    spec: RunSpec = FROM_START,
    context: FlightContext | None = None,
    samples: SampleCollection | NoSampleCollection | None = None,
) -> Supervisor:
    """Builds a supervisor that knows nothing yet, or one that goes on from the resume point of `spec`.

    It flies the paper's mission, which the calls of `spec` can take over. With its command sources no mission plans: they
    and the calls fly the aPad by hand. Without `samples` it does not collect the aMussels' logs. Without a `context`
    nothing is guarded, and every docking catches.
    """
    scenario, point, context = config.scenario, spec.resume_point, context or _nobody_flies(config.scenario)
    learned = spec.learned or initial_learned_state(config)
    state = MissionState(dock_count=scenario.apad.docks) if point is None else point.state
    beliefs, allocation = learned.beliefs, learned.allocation

    def planned(mission_state: MissionState | None) -> EnergyExchange:
        return _energy_exchange(config, allocation, mission_state, context.planning)

    def by_hand(mission_state: MissionState) -> ManualMission:
        return ManualMission(
            scenario.mission, scenario.apad.max_speed_m_s, beliefs, spec.command_sources or (), mission_state
        )

    mission: MissionRole
    if spec.calls is None and spec.command_sources is None:
        mission = planned(state)
    else:
        plan = planned if spec.command_sources is None else None
        steering = Steering.PERSON if point is None else point.steering
        mission = FlightMission(plan, by_hand, spec.calls or CallQueue(), state, steering)
    port = DockingPort(
        scenario.mission.docking,
        first_command_id=spec.first_command_id,
        capabilities=context.capabilities or of_simulated_apad(scenario.apad.docks),
        usual_go_to=(scenario.mission.speed_m_s, scenario.mission.victory_radius_m),
        docked=state.docked,
        distance_m=context.world.distance_m,
        first_failure=None if point is None else point.first_failure,
    )
    return Supervisor(
        scenario=scenario,
        learned=learned,
        mission=mission,
        port=port,
        codec=codec_of(scenario),
        samples=samples or NoSampleCollection(),
        stands_down=context.stands_down,
        gate=context.safety.gate,
    )


def _nobody_flies(scenario: Scenario) -> FlightContext:
    return FlightContext(
        vehicle=InProcessVehicle(simulated_apad(scenario)),
        pace=AsFastAsPossible(),
        world=World(NoFleet()),
        safety=Safety(Gate.without_guards(), Monitor([])),
    )


def _energy_exchange(
    config: FlightConfig, allocation: Allocation, state: MissionState | None, planning: Planning
) -> EnergyExchange:
    scenario = config.scenario
    return EnergyExchange(
        plan_rules(scenario, config.trust),
        allocation,
        state,
        home_stays(scenario),
        LegForecast(scenario.apad, surface_of(scenario)),
        needs_battery=scenario.guards is not None and scenario.guards.battery_reserve is not None,
        planning=planning,
        barred=lambda: allocation.barred,
    )


def plan_rules(scenario: Scenario, trust: registry.Trust | None) -> PlanRules:
    """The scenario's strategies, thresholds and rule of dispatch."""
    rules = scenario.mission
    return PlanRules(
        rules,
        registry.collection(rules.collection, rules.costs, trust),
        registry.redeployment(rules.redeployment, trust),
        energy_model(scenario),
        _known_end(scenario),
    )


def _known_end(scenario: Scenario) -> KnownEnd | None:
    """The mission's end for its rules. The way home of `mission.end_by` is no part of the time at work."""
    if scenario.mission.horizon is Horizon.OPEN:
        return None
    end_by = _end_by(scenario)
    end_s = scenario.duration_s if end_by is None else min(scenario.duration_s, end_by.deadline_s)
    return KnownEnd(end_s, energy_model(scenario).drain_per_s)


def _end_by(scenario: Scenario) -> EndBy | None:
    mission, docking = scenario.mission, scenario.mission.docking
    if mission.end_by is None:
        return None
    if isinstance(mission.end_by, str):
        raise ScenarioError(
            [f"mission.end_by: {mission.end_by} is a local time, which this flight has not: say seconds"]
        )
    legs = LegForecast(scenario.apad, surface_of(scenario))
    return EndBy(
        mission.end_by, home_of(scenario), mission.speed_m_s, docking.timeout_s, docking.timeout_s, legs
    )

"""Builds the parts of a flight's fleet from its configuration: agents, their water, and what a nursery starts them from."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.fleet_config import FirmwareConfig, FleetConfig, resting_on_bottom
from agents.hosting.faulty_host import FaultyHost
from agents.hosting.host import Host
from agents.mussel.body import gps_fix_um
from agents.mussel.physical import Physical
from agents.time_scale import MissionMs
from agents.water.sea import Sea
from agents.water.sea_client import RemoteSea
from apad_bridge.assembly.flight_config import FlightConfig, flight_config, gps_deviation_um
from apad_bridge.assembly.water import waters_config
from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.firmware_config import clock_drift_ppb, spread_of
from apad_bridge.scenario.hull_in_flow import current_config
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.world.simulated_fleet import FlightFleet, LinksFile, WithoutWater

_START_MS = MissionMs(0)


def fleet_config(config: FlightConfig) -> FleetConfig:
    """Builds the configuration of the flight's agents, and reads the current's file.

    It names the scenario's firmware, which a nursery would execute, with the flight's trust alone.

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
        waters=waters_config(scenario),
        first_id=scenario.fleet.first_id,
        agent_ids=scenario.fleet.agent_ids,
        clock_drift_ppb=clock_drift_ppb(scenario.board),
        spread=spread_of(scenario),
        firmware=() if config.trust is None else _firmware(scenario, config.trust),
    )


def _firmware(scenario: Scenario, _: Trust) -> tuple[FirmwareConfig, ...]:
    return tuple(FirmwareConfig((it.executable, *it.arguments), it.agents) for it in scenario.fleet.firmware)


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


def fleet_of(
    config: FlightConfig,
    host: Host,
    granted_ms: Mapping[int, int],
    now_ms: MissionMs = _START_MS,
    opened: Collection[int] = (),
    sea: Sea | RemoteSea | None = None,
) -> FlightFleet:
    """Builds the fleet that runs in `host` at mission time `now_ms`; each aMussel has run up to its `granted_ms`.

    `opened` are the aMussels whose modems are open to other programs, in a scenario with water. It joins the `sea` that
    several flights share; without one, a scenario with water has a sea of its own.
    """
    scenario = config.scenario
    host = FaultyHost(host, scenario.seed)
    coordinator = Coordinator(host, granted_ms, scenario.time_scale, now_ms)
    if config.sea is None or scenario.water is None:
        return FlightFleet(coordinator, host, WithoutWater(coordinator, host), config.timeslots)
    if sea is None:
        sea = Sea(config.sea, scenario.time_scale, granted_ms, now_ms=now_ms, opened=opened)
    station = sea.join(coordinator, host)
    links: LinksFile | None = None
    if scenario.water.links_file is not None:
        links = LinksFile(Path(scenario.water.links_file), scenario.time_scale)
        station.set_topology(links.read())
    return FlightFleet(coordinator, host, station, config.timeslots, links, config.sea.sound.sound_speed_m_s)


def shared_sea(scenario: Scenario, apads: int) -> Sea | None:
    """Builds the sea that the flights of so many aPads share; None for one flight, or without water."""
    config = flight_config(scenario).sea
    if config is None or apads == 1:
        return None
    return Sea(config, scenario.time_scale, scenario.fleet.all_ids, apads)

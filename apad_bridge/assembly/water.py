"""Builds the simulated water from the scenario's block `water`: a fleet's sea, and the agents' part as plain values.

The agents receive currents, tides and fields.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from agents.coordinator import Coordinator
from agents.hosting.host import Host
from agents.modem.frames import Generation
from agents.water import sound, wifi
from agents.water.patches import Waters
from agents.water.places import Sinking
from agents.water.sea import Sea, SeaConfig
from apad_bridge.scenario.currents import current_text
from apad_bridge.scenario.firmware_config import full_firmware
from apad_bridge.scenario.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water import Fields, ModemGeneration, Sound, Water
from apad_bridge.supervisor.fleet import Fleet, LinksFile


@dataclass(frozen=True, slots=True)
class AgentsWater:
    """The water in the form of the agents' `FleetConfig`."""

    current_csv: str | None
    tides: tuple[tuple[int, int, int, int, int], ...]
    current_profile: tuple[tuple[int, int], ...]
    oxygen_mg_l: Waters
    temperature_c: Waters
    turbidity_ntu: Waters


def agents_water(scenario: Scenario) -> AgentsWater:
    """Converts the scenario's water for the agents, and reads the current's file."""
    fields = Fields() if scenario.water is None else scenario.water.fields
    return AgentsWater(
        _current(scenario),
        _tides(scenario),
        _profile(scenario),
        *(_waters(fields, name) for name in ("oxygen_mg_l", "temperature_c", "turbidity_ntu")),
    )


def _current(scenario: Scenario) -> str | None:
    name = scenario.fleet.drift.current_file
    if name is None and scenario.water is not None and scenario.water.current is not None:
        name = scenario.water.current.file
    return None if name is None else current_text(Path(name), LocalFrame.about(scenario.area.origin))


def _tides(scenario: Scenario) -> tuple[tuple[int, int, int, int, int], ...]:
    if scenario.water is None or scenario.water.current is None:
        return ()
    return tuple(
        (
            round(tide.period_h * 3600),
            round(tide.north_m_s * 1e6),
            round(tide.east_m_s * 1e6),
            round(tide.north_phase_deg / 360 * 1e6),
            round(tide.east_phase_deg / 360 * 1e6),
        )
        for tide in scenario.water.current.tides
    )


def _profile(scenario: Scenario) -> tuple[tuple[int, int], ...]:
    if scenario.water is None or scenario.water.current is None:
        return ()
    return tuple(
        (round(depth * 1e6), round(fraction * 1e6)) for depth, fraction in scenario.water.current.profile
    )


def _waters(fields: Fields, name: str) -> Waters:
    layers = tuple((round(depth_m * 1e6), value) for depth_m, value in getattr(fields, name))
    patches = tuple(
        (
            core,
            round(patch.begins_s * 1000),
            round(patch.growing_s * 1000),
            *(round(it * 1e6) for it in patch.place_m),
            *(round(it * 1e6) for it in patch.drift_m_s),
            round(patch.radius_m * 1e6),
            round(patch.from_depth_m * 1e6),
        )
        for patch in fields.patches
        if (core := getattr(patch, name)) is not None
    )
    return Waters(layers, patches)


def fleet_of(
    scenario: Scenario,
    host: Host,
    granted_ms: Mapping[int, int],
    now_ms: int = 0,
    opened: Collection[int] = (),
) -> Fleet:
    """Builds the fleet that runs in `host` at mission time `now_ms`; each aMussel has run up to its `granted_ms`.

    `opened` are the aMussels whose modems are open to other programs, in a scenario with water.
    """
    coordinator = Coordinator(host, granted_ms, scenario.theta, now_ms)
    firmware = full_firmware(scenario.board)
    timeslots = None if firmware is None or firmware.cycle is None else firmware.cycle.slots
    water = scenario.water
    if water is None:
        return Fleet(coordinator, host, timeslots=timeslots)
    sea = Sea(sea_config(scenario, water), coordinator, host, now_ms, opened)
    if water.links_file is None:
        return Fleet(coordinator, host, sea, timeslots)
    links = LinksFile(Path(water.links_file), scenario.theta)
    sea.set_topology(links.read())
    return Fleet(coordinator, host, sea, timeslots, links)


def sea_config(scenario: Scenario, water: Water) -> SeaConfig:
    board, settings, radio = scenario.board, water.sound, water.wifi
    return SeaConfig(
        seed=scenario.seed,
        sound=sound_of(settings),
        wifi=None
        if radio is None
        else wifi.Wifi(
            radio.frequency_mhz,
            radio.transmit_dbm,
            radio.sensitivity_dbm,
            radio.mussel_antenna_m,
            radio.apad_antenna_m,
            radio.slope_db,
        ),
        sinking=Sinking(
            round(scenario.area.depth_m * 1e6),
            round(board.surfacing_s * 1000),
            round(board.sinking_s * 1000),
        ),
        keel_um=round(settings.keel_m * 1e6),
        range_noise_m=settings.range_noise_m,
        thrusting_m_s=settings.thrusting_m_s,
        modems=generation_of(water.modems),
    )


def generation_of(modems: ModemGeneration) -> Generation:
    return Generation.V2 if modems is ModemGeneration.V2 else Generation.V3


def sound_of(settings: Sound) -> sound.Sound:
    absorption = settings.absorption_db_per_km
    return sound.Sound(
        speed_m_s=settings.sound_speed_m_s,
        source_level_db=settings.source_level_db,
        spreading_db=settings.spreading_db,
        absorption_db_per_km=sound.thorp_db_per_km(settings.frequency_khz)
        if absorption is None
        else absorption,
        noise_db_per_hz=settings.noise_db_per_hz,
        bandwidth_hz=settings.bandwidth_hz,
        fading_db=settings.fading_db,
        reverberation_ms=round(settings.reverberation_s * 1000),
        reverberation_db=settings.reverberation_db,
        capture_db=settings.capture_db,
        thruster_noise_db=settings.thruster_noise_db,
        range_limit_m=settings.range_limit_m,
        turnaround_ms=round(settings.turnaround_s * 1000),
        errors=sound.NANOMODEM_ERRORS
        if settings.error_curve is None
        else sound.ErrorCurve(
            settings.error_curve.snrs_db, settings.error_curve.sizes, settings.error_curve.rates
        ),
    )

"""Builds a fleet's sea from the scenario's block `water`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from agents.coordinator import Coordinator
from agents.hosting.host import Host
from agents.modem.frames import Generation
from agents.water import sound, wifi
from agents.water.places import Sinking
from agents.water.sea import Sea, SeaConfig
from apad_bridge.links_file import LinksFile
from apad_bridge.scenario.board_model import whole_firmware
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water import ModemGeneration, Sound, Water
from apad_bridge.supervisor.fleet import Fleet


def fleet_of(
    scenario: Scenario,
    host: Host,
    granted_ms: Mapping[int, int],
    now_ms: int = 0,
    opened: Collection[int] = (),
) -> Fleet:
    """The fleet that lives in `host`, each aMussel having lived to its `granted_ms`, at mission time `now_ms`.

    `opened` are the aMussels whose modems somebody else may talk to, in a scenario with water.
    """
    coordinator = Coordinator(host, granted_ms, scenario.theta, now_ms)
    whole = whole_firmware(scenario.board)
    slots = None if whole is None or whole.cycle is None else whole.cycle.slots
    water = scenario.water
    if water is None:
        return Fleet(coordinator, host, slots=slots)
    sea = Sea(sea_config(scenario, water), coordinator, host, now_ms, opened)
    if water.links_file is None:
        return Fleet(coordinator, host, sea, slots)
    links = LinksFile(Path(water.links_file), scenario.theta)
    sea.lay_links(links.read())
    return Fleet(coordinator, host, sea, slots, links)


def sea_config(scenario: Scenario, water: Water) -> SeaConfig:
    board, told, radio = scenario.board, water.sound, water.wifi
    return SeaConfig(
        seed=scenario.seed,
        sound=sound_of(told),
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
        keel_um=round(told.keel_m * 1e6),
        range_noise_m=told.range_noise_m,
        thrusting_m_s=told.thrusting_m_s,
        modems=generation_of(water.modems),
    )


def generation_of(modems: ModemGeneration) -> Generation:
    return Generation.V2 if modems is ModemGeneration.V2 else Generation.V3


def sound_of(told: Sound) -> sound.Sound:
    absorption = told.absorption_db_per_km
    return sound.Sound(
        speed_m_s=told.sound_speed_m_s,
        source_level_db=told.source_level_db,
        spreading_db=told.spreading_db,
        absorption_db_per_km=sound.thorp_db_per_km(told.frequency_khz) if absorption is None else absorption,
        noise_db_per_hz=told.noise_db_per_hz,
        bandwidth_hz=told.bandwidth_hz,
        fading_db=told.fading_db,
        reverberation_ms=round(told.reverberation_s * 1000),
        reverberation_db=told.reverberation_db,
        capture_db=told.capture_db,
        thruster_noise_db=told.thruster_noise_db,
        range_limit_m=told.range_limit_m,
        turnaround_ms=round(told.turnaround_s * 1000),
        errors=sound.NANOMODEM_ERRORS
        if told.error_curve is None
        else sound.ErrorCurve(told.error_curve.snrs_db, told.error_curve.sizes, told.error_curve.rates),
    )

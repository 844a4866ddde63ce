"""Converts the scenario's block `water` for a fleet's sea and for the agents, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, dist, hypot

from agents.water.fields import WaterFields
from agents.water.patches import CALM, QuantityWater, WaterPatch
from apad_bridge.acoustics.schedule import ASK_AGAIN_MS, ScheduleConfig
from apad_bridge.assembly.estimator import readings_apart_ms
from apad_bridge.beliefs.pings import PingForCharge, PingForPlace, PingSuspects
from apad_bridge.beliefs.questions import candidate_below
from apad_bridge.scenario.blocks.mission_options import Suspects
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water.water_options import Fields, Water
from firmware_model.config import FullFirmware
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits, rails_of
from firmware_model.states import State

# Converts the scenario's block `water` for the aPad's acoustic service beside its mission.
_PAUSE_MS = 20
"""The pause between two packets, beside the time in which the echoes of the first die away."""


@dataclass(frozen=True, slots=True)
class AcousticsConfig:
    """The configuration of an aPad's acoustic service."""

    schedule: ScheduleConfig
    places: PingForPlace | None
    """Decides which aMussels to ping because their place is too uncertain; None for no such pings."""
    charges: PingForCharge | PingSuspects | None
    """Decides which aMussels to ask for their status; None for no such requests."""


def acoustics_config(scenario: Scenario, water: Water, firmware: FullFirmware | None) -> AcousticsConfig:
    corners = scenario.area.polygon_m
    across_m = max(dist(one, other) for one in corners for other in corners) + scenario.area.depth_m
    longest_m, talk = min(across_m, water.sound.range_limit_m), water.talk
    return AcousticsConfig(
        ScheduleConfig(
            scenario.time_scale,
            water,
            longest_delay_ms=ceil(1000 * longest_m / water.sound.sound_speed_m_s),
            answer_ms=0 if firmware is None else firmware.turnaround_ms + firmware.answer_ms,
            pause_ms=_PAUSE_MS + round(1000 * water.sound.reverberation_s),
        ),
        PingForPlace(candidate_below(scenario.mission.pool_threshold), talk.ping_worth_m)
        if talk.ping_worth_m
        else None,
        None if firmware is None else _status_requests(scenario, talk.ask_worth_answers, firmware),
    )


def _status_requests(
    scenario: Scenario, worth_answers: float, firmware: FullFirmware
) -> PingForCharge | PingSuspects | None:
    policy = status_request_policy(scenario, worth_answers, firmware)
    if scenario.mission.suspects is not Suspects.ASKED:
        return policy
    return PingSuspects(policy, scenario.time_scale.mission_span(ASK_AGAIN_MS))


def status_request_policy(
    scenario: Scenario, worth_answers: float, firmware: FullFirmware
) -> PingForCharge | None:
    """Builds the policy of status requests to aMussels with boards of `firmware`; None for no requests."""
    model = scenario.beliefs.twin
    if not worth_answers or model is None:
        return None
    answer = answer_charge(firmware)
    return PingForCharge(
        candidate_below(scenario.mission.pool_threshold),
        wrong_plan_charge(firmware),
        answer * worth_answers,
        not_before_ms=scenario.time_scale.mission_span(readings_apart_ms(scenario.time_scale)),
        spare_charge=answer,
        answer_deviation=hypot(model.sensor_noise, model.bias_deviation),
    )


def answer_charge(firmware: FullFirmware) -> float:
    """Computes a sleeping board's cost of a status request, in charge: to receive it, to be awake, and to answer."""
    asleep, awake, receiving, sending = (
        firmware.power.loads.total(
            rails_of(State.SLEEPING, firmware.power.kept_on, firmware.cycle is None, bits(*pulsed))
        )
        for pulsed in (
            (),
            (Rail.MU_ACTIVE,),
            (Rail.MU_ACTIVE, Rail.MODEM_RECEIVING),
            (Rail.MU_ACTIVE, Rail.MODEM_TRANSMITTING),
        )
    )
    receive_ms = min(firmware.power.receive_ms, firmware.turnaround_ms)
    drawn = (
        receive_ms * (receiving - awake)
        + firmware.turnaround_ms * (awake - asleep)
        + firmware.answer_ms * (sending - asleep)
    )
    return drawn / FULL


def wrong_plan_charge(firmware: FullFirmware) -> float:
    """Computes the cost of a plan that collects an aMussel without need, in charge: its motors' runs up and down.

    A plan that leaves out an aMussel in need is taken to cost the same: it costs samples, which have no price in charge.
    """
    return 2 * firmware.power.loads.of[Rail.MOTORS] * firmware.power.motor_run_ms / FULL


def waters_config(scenario: Scenario) -> dict[str, QuantityWater]:
    """Converts the water's true values, by the sensors' keys: those of a calm bay without the block."""
    return CALM if scenario.water is None else {key: _waters(scenario.water.fields, key) for key in CALM}


def true_water(scenario: Scenario) -> WaterFields:
    """The water's true value of each quantity that a sensor measures, at a place and an agent time."""
    return WaterFields.by_key({key: it.field() for key, it in waters_config(scenario).items()})


def leeway_um_s(scenario: Scenario) -> tuple[int, int]:
    wind = None if scenario.water is None else scenario.water.wind
    if wind is None:
        return 0, 0
    return round(wind.leeway * wind.north_m_s * 1e6), round(wind.leeway * wind.east_m_s * 1e6)


def _waters(fields: Fields, key: str) -> QuantityWater:
    layers = tuple((round(depth_m * 1e6), value) for depth_m, value in getattr(fields, key))
    patches = tuple(
        WaterPatch(
            core=core,
            begins_ms=round(patch.begins_s * 1000),
            growing_ms=round(patch.growing_s * 1000),
            north_um=round(patch.place_m[0] * 1e6),
            east_um=round(patch.place_m[1] * 1e6),
            north_um_s=round(patch.drift_m_s[0] * 1e6),
            east_um_s=round(patch.drift_m_s[1] * 1e6),
            radius_um=round(patch.radius_m * 1e6),
            from_depth_um=round(patch.from_depth_m * 1e6),
        )
        for patch in fields.patches
        if (core := getattr(patch, key)) is not None
    )
    return QuantityWater(layers, patches)

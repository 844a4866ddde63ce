"""Builds an aPad's acoustic services beside its mission from the scenario's block `water`."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, dist, hypot

from apad_bridge.acoustics.locator import Locator, LocatorConfig
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.assembly.estimator import readings_apart_ms
from apad_bridge.assembly.water import generation_of
from apad_bridge.beliefs.pings import PingForCharge, PingForPlace
from apad_bridge.beliefs.questions import candidate_below
from apad_bridge.scenario.firmware_config import board_config
from apad_bridge.scenario.schema import Scenario
from firmware_model.config import FullFirmware
from firmware_model.packets.codec import load_codec
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits, rails_of
from firmware_model.states import State

_PAUSE_MS = 20
"""The pause between two packets, beside the time in which the echoes of the first die away."""


def ranging_of(scenario: Scenario, agent_ids: Iterable[int]) -> RangingService | None:
    """Builds the aPad's ranging service; None if the scenario has no water."""
    water = scenario.water
    if water is None:
        return None
    modems = generation_of(water.modems)
    firmware = board_config(scenario.board, scenario.seed, modems).whole
    timeslots = None if firmware is None or firmware.cycle is None else firmware.cycle.slots
    speed_m_s, corners = water.sound.sound_speed_m_s, scenario.area.polygon_m
    across_m = max(dist(one, other) for one in corners for other in corners) + scenario.area.depth_m
    schedule = ScheduleConfig(
        theta=scenario.theta,
        sound_speed_m_s=speed_m_s,
        longest_delay_ms=ceil(1000 * min(across_m, water.sound.range_limit_m) / speed_m_s),
        waits=water.talk.waits,
        assigns=water.talk.assigns,
        guard_ms=0 if timeslots is None else timeslots.guard_ms,
        beacon_period_ms=round(water.talk.beacon_period_s * 1000),
        ping_period_ms=round(water.talk.ping_period_s * 1000),
        modems=modems,
        pause_ms=_PAUSE_MS + round(1000 * water.sound.reverberation_s),
        answer_ms=0 if firmware is None else firmware.turnaround_ms + firmware.answer_ms,
    )
    localisation = water.localisation
    locator = None
    if localisation is not None:
        depth_m = scenario.area.depth_m
        locator = Locator(
            LocatorConfig(
                localisation.deviation_m,
                depth_m,
                localisation.memory_s,
                localisation.apart_m,
                worst_hdop=localisation.worst_hdop,
            )
        )
    deviation_m = 1.0 if localisation is None else localisation.deviation_m
    return RangingService(
        AcousticScheduler(schedule, load_codec(scenario.hearing.codec), timeslots, agent_ids),
        locator,
        water.sound.keel_m,
        scenario.area.depth_m,
        deviation_m,
        PingForPlace(candidate_below(scenario.mission.pool_threshold), water.talk.ping_worth_m)
        if water.talk.ping_worth_m
        else None,
        None if firmware is None else status_request_policy(scenario, water.talk.ask_worth_answers, firmware),
    )


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
        not_before_ms=readings_apart_ms(scenario.theta) // scenario.theta,
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

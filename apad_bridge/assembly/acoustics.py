"""Builds what an aPad does by sound beside its mission from the scenario's block `water`."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, dist, hypot

from apad_bridge.acoustics.locator import Locator, LocatorConfig
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.assembly.estimator import readings_apart_ms
from apad_bridge.assembly.water import generation_of
from apad_bridge.beliefs.pings import WorthItsEnergy, WorthItsWay
from apad_bridge.beliefs.questions import candidate_below
from apad_bridge.scenario.board_model import full_firmware
from apad_bridge.scenario.schema import Scenario
from firmware_model.config import FullFirmware
from firmware_model.packets.codec import load_codec
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits, rails_of
from firmware_model.states import State

_BREATH_MS = 20
"""And the echoes of the word before are to die away."""


def ranging_of(scenario: Scenario, agent_ids: Iterable[int]) -> RangingService | None:
    """What the aPad does by sound; None where the scenario knows no water."""
    water = scenario.water
    if water is None:
        return None
    modems = generation_of(water.modems)
    whole = full_firmware(scenario.board, scenario.seed, modems)
    slots = None if whole is None or whole.cycle is None else whole.cycle.slots
    speed_m_s, corners = water.sound.sound_speed_m_s, scenario.area.polygon_m
    across_m = max(dist(one, other) for one in corners for other in corners) + scenario.area.depth_m
    talk = ScheduleConfig(
        theta=scenario.theta,
        sound_speed_m_s=speed_m_s,
        way_ms=ceil(1000 * min(across_m, water.sound.range_limit_m) / speed_m_s),
        waits=water.talk.waits,
        assigns=water.talk.assigns,
        guard_ms=0 if slots is None else slots.guard_ms,
        beacon_period_ms=round(water.talk.beacon_period_s * 1000),
        ping_period_ms=round(water.talk.ping_period_s * 1000),
        modems=modems,
        breath_ms=_BREATH_MS + round(1000 * water.sound.reverberation_s),
        answer_ms=0 if whole is None else whole.turnaround_ms + whole.answer_ms,
    )
    told = water.localisation
    locator = None
    if told is not None:
        depth_m = scenario.area.depth_m
        locator = Locator(
            LocatorConfig(told.deviation_m, depth_m, told.memory_s, told.apart_m, worst_hdop=told.worst_hdop)
        )
    deviation_m = 1.0 if told is None else told.deviation_m
    return RangingService(
        AcousticScheduler(talk, load_codec(scenario.hearing.codec), slots, agent_ids),
        locator,
        water.sound.keel_m,
        scenario.area.depth_m,
        deviation_m,
        WorthItsWay(candidate_below(scenario.mission.pool_threshold), water.talk.ping_worth_m)
        if water.talk.ping_worth_m
        else None,
        None if whole is None else asks_of(scenario, water.talk.ask_worth_answers, whole),
    )


def asks_of(scenario: Scenario, worth_answers: float, whole: FullFirmware) -> WorthItsEnergy | None:
    """Who is asked how it is, on boards of `whole`; None for nobody."""
    model = scenario.beliefs.twin
    if not worth_answers or model is None:
        return None
    answer = answer_charge(whole)
    return WorthItsEnergy(
        candidate_below(scenario.mission.pool_threshold),
        wrong_plan_charge(whole),
        answer * worth_answers,
        not_before_ms=readings_apart_ms(scenario.theta) // scenario.theta,
        spare_charge=answer,
        answer_deviation=hypot(model.sensor_noise, model.bias_deviation),
    )


def answer_charge(whole: FullFirmware) -> float:
    """What it costs a sleeper to be asked how it is, in charge: to hear the question, to be awake, and to answer."""
    asleep, awake, hearing, sending = (
        whole.power.loads.total(
            rails_of(State.SLEEPING, whole.power.kept_on, whole.cycle is None, bits(*pulsed))
        )
        for pulsed in (
            (),
            (Rail.MU_ACTIVE,),
            (Rail.MU_ACTIVE, Rail.MODEM_RECEIVING),
            (Rail.MU_ACTIVE, Rail.MODEM_TRANSMITTING),
        )
    )
    heard_ms = min(whole.power.receive_ms, whole.turnaround_ms)
    drawn = (
        heard_ms * (hearing - awake)
        + whole.turnaround_ms * (awake - asleep)
        + whole.answer_ms * (sending - asleep)
    )
    return drawn / FULL


def wrong_plan_charge(whole: FullFirmware) -> float:
    """What a plan costs that fetches one that needs nothing, in charge: its motors' runs up and down.

    The same is taken for a plan that leaves one that does: what that costs is samples, which no charge is the price of.
    """
    return 2 * whole.power.loads.of[Rail.MOTORS] * whole.power.motor_run_ms / FULL

"""Builds what an aPad does by sound beside its mission from the scenario's block `water`."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, dist

from apad_bridge.beliefs.pings import WorthItsWay
from apad_bridge.beliefs.questions import candidate_below
from apad_bridge.boards import whole_firmware
from apad_bridge.localisation.locator import Locator, LocatorConfig
from apad_bridge.scenario.schema import Scenario
from apad_bridge.sea_building import generation_of
from apad_bridge.talking.ears import Ears
from apad_bridge.talking.talk import Talk, TalkConfig
from firmware_model.codec import load_codec


def ears_of(scenario: Scenario, agent_ids: Iterable[int]) -> Ears | None:
    """What the aPad does by sound; None where the scenario knows no water."""
    water = scenario.water
    if water is None:
        return None
    whole = whole_firmware(scenario.board, scenario.seed)
    slots = None if whole is None or whole.cycle is None else whole.cycle.slots
    speed_m_s, corners = water.sound.sound_speed_m_s, scenario.area.polygon_m
    across_m = max(dist(one, other) for one in corners for other in corners) + scenario.area.depth_m
    talk = TalkConfig(
        theta=scenario.theta,
        sound_speed_m_s=speed_m_s,
        way_ms=ceil(1000 * min(across_m, water.sound.range_limit_m) / speed_m_s),
        waits=water.talk.waits,
        assigns=water.talk.assigns,
        guard_ms=0 if slots is None else slots.guard_ms,
        beacon_period_ms=round(water.talk.beacon_period_s * 1000),
        ping_period_ms=round(water.talk.ping_period_s * 1000),
        modems=generation_of(water.modems),
    )
    told = water.localisation
    locator = None
    if told is not None:
        depth_m = scenario.area.depth_m
        locator = Locator(
            LocatorConfig(told.deviation_m, depth_m, told.memory_s, told.apart_m, worst_hdop=told.worst_hdop)
        )
    deviation_m = 1.0 if told is None else told.deviation_m
    return Ears(
        Talk(talk, load_codec(scenario.hearing.codec), slots, agent_ids),
        locator,
        water.sound.keel_m,
        scenario.area.depth_m,
        deviation_m,
        WorthItsWay(candidate_below(scenario.mission.pool_threshold), water.talk.ping_worth_m)
        if water.talk.ping_worth_m
        else None,
    )

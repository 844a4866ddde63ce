"""The place that an aMussel states: a GPS fix at the surface, and below the last one from there."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from fleets import STILL
from hypothesis import given
from hypothesis import strategies as st

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.body import Body, gps_fix_um
from agents.mussel.outputs import WifiSent
from agents.mussel.physical import Physical
from agents.mussel.stimuli import Placed
from firmware_model.actions import Buoyancy
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.stimuli import ResetCause

DEVIATION_UM = 500_000
FLEET = replace(STILL, body=replace(STILL.body, gps_deviation_um=DEVIATION_UM))
CONFIG = FLEET.maker().config(7)
BOTTOM_UM = FLEET.body.sinking.bottom_um


def body_at(depth_um: int, buoyancy: Buoyancy = Buoyancy.SINK, fix_um: tuple[int, int] = (1, 2)) -> Body:
    resting = resting_on_bottom(0.0, 0.0, depth_um / 1e6, 1.0, 1.0)
    return Body(7, CONFIG.water, replace(resting, buoyancy=buoyancy, fix_um=fix_um), 0)


def test_fixes_scatter_by_their_deviation_about_the_true_place() -> None:
    fixes = [gps_fix_um(3, 12, n, (10_000_000, -4_000_000), DEVIATION_UM) for n in range(4000)]
    for axis, true_um in ((0, 10_000_000), (1, -4_000_000)):
        errors = [fix[axis] - true_um for fix in fixes]
        mean, square = sum(errors) / 4000, sum(error**2 for error in errors) / 4000
        assert abs(mean) < 4 * DEVIATION_UM / math.sqrt(4000)
        assert math.sqrt(square) == pytest.approx(DEVIATION_UM, rel=0.05)
    product = sum((north - 10_000_000) * (east + 4_000_000) for north, east in fixes) / 4000
    assert abs(product) < 4 * DEVIATION_UM**2 / math.sqrt(4000)


@given(st.integers(-(10**7), 10**7), st.integers(0, 10**6))
def test_below_it_knows_its_last_fix_whatever_moved_it(carried_um: int, now_ms: int) -> None:
    body = body_at(BOTTOM_UM)
    body.north_um += carried_um
    assert body.known_place_um(now_ms) == (1, 2)


def test_its_last_fix_is_that_from_when_it_left_the_surface() -> None:
    body = body_at(0, Buoyancy.FLOAT)
    body.north_um = 5_000_000  # drifted since its last report
    body.run_buoyancy(Buoyancy.SINK, 90_000)
    left = body.fix_um
    assert math.dist(left, (5_000_000, 0)) < 5 * DEVIATION_UM
    body.north_um = 9_000_000  # carried on its way down
    assert body.known_place_um(90_000 + FLEET.body.sinking.sinking_ms) == left


def test_at_the_surface_each_second_has_a_fix_of_its_own() -> None:
    body = body_at(0, Buoyancy.FLOAT)
    second = CONFIG.water.step_ms
    assert body.known_place_um(0) != body.known_place_um(second)
    assert body.known_place_um(second) == body.known_place_um(2 * second - 1)


def test_bodies_without_a_receiver_know_where_they_are() -> None:
    water = replace(CONFIG.water, body=replace(FLEET.body, gps_deviation_um=None))
    body = Body(7, water, resting_on_bottom(0.0, 0.0, BOTTOM_UM / 1e6, 1.0, 1.0), 0)
    body.north_um = 123
    assert body.known_place_um(5) == (123, 0)


def stated_m(agent: Agent, until_ms: int) -> tuple[float, float]:
    """The place in the agent's last report."""
    sent = [output.data for output in agent.advance(until_ms) if isinstance(output, WifiSent)]
    packet = MusselbedCodec().decode(sent[-1])
    assert isinstance(packet, StatusPacket)
    return packet.north_m, packet.east_m


def test_a_reset_on_the_bottom_leaves_the_fix_and_a_new_place_has_a_new_one() -> None:
    physical = replace(resting_on_bottom(1.0, 2.0, BOTTOM_UM / 1e6, 0.9, 1.0), fix_um=(1_250_000, 1_750_000))
    config = replace(CONFIG, reports=replace(CONFIG.reports, heard_always=True))
    kept = Physical.unpack(physical.pack())
    for cause in (ResetCause.POWER_ON, ResetCause.BROWN_OUT):
        agent = Agent(config, MusselbedCodec(), kept, 0, cause)
        assert stated_m(agent, 60_000) == (1.25, 1.75)
        kept = Physical.unpack(agent.physical.pack())
        kept = replace(kept, primary=physical.primary, secondary=physical.secondary, depth_anchor_ms=0)
    agent.receive(Placed(20_000_000, 0, BOTTOM_UM, 10**14, 10**14), 60_000)
    north_m, east_m = stated_m(agent, 120_000)
    assert 0 < math.dist((north_m, east_m), (20.0, 0.0)) < 3

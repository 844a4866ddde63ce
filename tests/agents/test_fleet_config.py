"""A fleet's configuration across a link, and its agents' configurations."""

from __future__ import annotations

from dataclasses import replace
from statistics import correlation, mean, stdev

import pytest
from fleets import PAPER, with_whole_boards
from hypothesis import given
from hypothesis import strategies as st

from agents.fleet_config import FleetConfig, Spread, deviations_of, drift_of
from agents.link_codec import LinkCodec
from agents.water.patches import CALM, QuantityWater, WaterPatch
from agents.water.water_current import CurrentConfig, TideConstituent
from firmware_model.config import FullFirmware, LastResort
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits
from firmware_model.table_one import FIELD, HOURLY, METERING, power

WORST = PAPER
POWER = power(LastResort.SURFACE, bits(Rail.PI))
FLEETS = {
    "worst case": WORST,
    "field": with_whole_boards(replace(WORST, first_id=5), FullFirmware(POWER, FIELD, 1000, 60_000, 600_000)),
    "gaps": with_whole_boards(
        replace(WORST, first_id=3, agent_ids=(3, 7, 12)), FullFirmware(POWER, FIELD, 1000, 60_000, 600_000)
    ),
    "hourly": with_whole_boards(WORST, FullFirmware(POWER, HOURLY, 1000, 60_000, 600_000)),
    "metered": with_whole_boards(
        replace(WORST, board=replace(WORST.board, pin_check_ms=1000)),
        FullFirmware(power(LastResort.CALL, 0, METERING, FULL // 3), FIELD, 1000, 60_000, 600_000),
    ),
    "in the sea": replace(
        WORST,
        current=CurrentConfig(
            "north_m,east_m,north_m_s,east_m_s,time_s\n0,0,0.1,0,0\n0,0,0.2,0,60\n",
            (TideConstituent(44_714, 300_000, -10_000, 250_000, 0), TideConstituent(86_400, 1, 2, 3, 4)),
            ((0, 1_000_000), (3_000_000, 200_000)),
        ),
        waters={
            **CALM,
            "oxygen_mg_l": QuantityWater(
                ((0, 8.5), (3_000_000, 6.0)), (WaterPatch(0.2, 1, 2, 3, 4, 5, 6, 7, 8),)
            ),
        },
    ),
    "differing": replace(WORST, spread=Spread(drain=1000, capacity=500)),
    "never asleep": with_whole_boards(WORST, FullFirmware(POWER, None, 1000, 60_000, 600_000)),
}


CODEC = LinkCodec([FleetConfig])


def over_the_wire(fleet: FleetConfig) -> FleetConfig:
    crossed = CODEC.decode(CODEC.encode(fleet))
    assert isinstance(crossed, FleetConfig)
    return crossed


@pytest.mark.parametrize("fleet", FLEETS.values(), ids=FLEETS)
def test_a_fleet_crosses_the_link_whole(fleet: FleetConfig) -> None:
    assert over_the_wire(fleet) == fleet
    assert over_the_wire(fleet).maker().config(7) == fleet.maker().config(7)


def test_agents_share_the_firmware_s_numbers_and_have_timeslots_of_their_own() -> None:
    configs = FLEETS["field"].maker()
    fifth, ninth = configs.config(5).board, configs.config(9).board
    assert fifth.whole is ninth.whole and fifth.charge is ninth.charge
    assert (fifth.slot, ninth.slot) == (0, 4)


def test_one_that_has_no_timeslot_is_refused() -> None:
    with pytest.raises(ValueError, match="slot 60 does not lie in a frame of 60"):
        FLEETS["field"].maker().config(65)


def test_boards_of_a_spread_differ_in_what_they_draw_and_in_what_their_batteries_hold() -> None:
    """A drain of d and a capacity of c, both relative: loads are d / c times the nominal, a charger's rates 1 / c."""
    fleet = replace(FLEETS["field"], seed=7, first_id=1, spread=Spread(drain=1000, capacity=1000))
    drains, capacities = [], []
    for agent_id in range(1, 61):
        board = fleet.maker().config(agent_id).board
        capacity = fleet.board.charge.segments[0][1] / board.charge.segments[0][1]
        own, nominal = board.whole.power.loads.of, fleet.board.whole.power.loads.of
        drain = own[Rail.MOTORS] / nominal[Rail.MOTORS] * capacity
        assert [load / drain * capacity for load in own] == pytest.approx(nominal, rel=1e-3, abs=1)
        assert fleet.spread.charge_model(fleet.board.charge, fleet.seed, agent_id) == board.charge
        drains.append(drain)
        capacities.append(capacity)
    for found in (drains, capacities):
        assert len(set(found)) > 50 and min(found) >= 0.7 and max(found) <= 1.3
        # Sixty draws of deviation 0.1: the mean's is 0.013, the deviation's 0.009.
        assert mean(found) == pytest.approx(1.0, abs=0.05) and stdev(found) == pytest.approx(0.1, abs=0.035)
    assert correlation(drains, capacities) == pytest.approx(0.0, abs=0.4)


def test_a_fleet_without_a_spread_keeps_the_very_numbers() -> None:
    board = FLEETS["field"].maker().config(5).board
    assert Spread().applied(board, 7) is board
    assert max(abs(deviations_of(7, agent_id, b"drain")) for agent_id in range(5000)) == 3.0


def test_crystals_differ_and_stay_within_the_bound() -> None:
    drifts = [drift_of(7, agent_id, 50_000) for agent_id in range(1, 1001)]
    assert max(map(abs, drifts)) <= 50_000 and len(set(drifts)) > 950
    # Uniform: the mean's standard deviation is 50 000 / sqrt(3) / sqrt(1000) = 913.
    assert abs(sum(drifts) / 1000) < 4 * 913
    assert [drift_of(7, agent_id, 0) for agent_id in (1, 2)] == [0, 0]
    assert drift_of(8, 1, 50_000) != drift_of(7, 1, 50_000)


def test_timeslots_follow_each_other_where_ids_have_gaps() -> None:
    configs = replace(FLEETS["field"], first_id=3, agent_ids=(3, 7, 12, 999)).maker()
    assert [configs.config(agent_id).board.slot for agent_id in (3, 7, 12, 999)] == [0, 1, 2, 3]


@given(st.integers(1, 1000), st.integers(-5000, 5000), st.integers(0, 3000))
def test_a_bias_scales_every_board_s_drain_alike(agent_id: int, bias: int, drain: int) -> None:
    nominal = WORST.board.charge
    without = Spread(drain=drain).charge_model(nominal, 7, agent_id)
    biased = Spread(drain=drain, drain_bias=bias).charge_model(nominal, 7, agent_id)
    assert biased.discharge == pytest.approx(without.discharge * (1 + bias / 10_000), rel=1e-3)
    assert biased.segments == without.segments

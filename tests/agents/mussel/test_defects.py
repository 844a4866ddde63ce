"""Defects of one aMussel: what it does with each, and that it does as before when it is healed."""

from __future__ import annotations

import pytest
from fleets import PAPER
from hypothesis import given
from hypothesis import strategies as st
from seas import FLEET as WHOLE

from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.defects import BoardPart
from agents.mussel.failing_flash import FailingFlash
from agents.mussel.outputs import StimulusDropped
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    ClockShifted,
    ContactBounced,
    ContactClosed,
    CrystalSkewed,
    PartFailed,
    PinDisturbed,
    SoundArrived,
    WasReset,
)
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Flow, grains
from firmware_model.power.charge_pin import PinFault
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

CODEC = MusselbedCodec()
PERMISSION = SoundArrived(CODEC.encode(CommandPacket(Kind.PERMISSION, 7)))


def agent(fleet: FleetConfig = PAPER, charge: float = 0.5, secondary: float = 1.0) -> Agent:
    physical = resting_on_bottom(1.0, 2.0, 3.0, charge, secondary)
    return Agent(fleet.maker().config(7), CODEC, physical, 0, ResetCause.POWER_ON)


def lived(mussel: Agent, *story: tuple[int, AgentStimulus] | int) -> None:
    """Tells it stimuli at their times, and lets it come to times."""
    for it in story:
        if isinstance(it, int):
            mussel.advance(it)
        else:
            mussel.receive(it[1], it[0])


def floating() -> Agent:
    mussel = agent()
    lived(mussel, (3_000, PERMISSION), 70_000)
    assert mussel.board.state is State.FLOATING
    return mussel


def docked() -> Agent:
    mussel = floating()
    lived(mussel, (70_000, ContactClosed(0, 0)), 71_000)
    assert mussel.board.state is State.CHARGING
    return mussel


def charge(mussel: Agent, now_ms: int) -> int:
    return mussel.config.board.charge.charge_at(mussel.board.primary, now_ms)


def test_a_jam_holds_the_body_where_it_is_and_then_lets_the_last_run_be_done() -> None:
    mussel = agent()
    lived(mussel, (1_000, BuoyancyJammed(1)), (3_000, PERMISSION), 20_000)
    assert mussel.board.state is State.SURFACING and mussel.body.depth_at_um(20_000) == 3_000_000
    lived(mussel, (20_000, BuoyancyJammed(0)), 80_000)
    assert mussel.board.state is State.FLOATING and mussel.body.depth_at_um(80_000) == 0


def test_a_false_edge_deceives_the_board_and_charges_nothing() -> None:
    mussel = floating()
    before = charge(mussel, 70_000)
    lived(mussel, (70_000, PinDisturbed(1, 0)), 100_000)
    assert mussel.board.state is State.CHARGING
    assert charge(mussel, 100_000) < before and mussel.board.primary.flow is Flow.DISCHARGING
    lived(mussel, (100_000, PinDisturbed(0, 0)), 101_000)
    assert mussel.board.state is State.RELEASED


def test_a_missed_edge_is_found_by_the_level() -> None:
    mussel = floating()
    lived(mussel, (70_000, PinDisturbed(0, 1)), (70_000, ContactClosed(0, 0)))
    check_ms = mussel.config.board.pin_check_ms
    dropped = mussel.advance(70_000 + 2 * check_ms)
    assert PinFault.MISSED.value in [it.reason for it in dropped if isinstance(it, StimulusDropped)]
    assert mussel.board.state is State.CHARGING


def test_a_bouncing_contact_chatters_until_it_holds() -> None:
    mussel = docked()
    mussel.receive(ContactBounced(50), 71_000)
    dropped = mussel.advance(73_000)
    assert PinFault.CHATTER.value in [it.reason for it in dropped if isinstance(it, StimulusDropped)]
    mussel.advance(74_000)
    assert mussel.board.state is State.CHARGING and mussel.body.pin_high and mussel.body.pin_due_ms == 0


def test_a_contact_bounces_in_a_dock_only() -> None:
    reason = "a contact bounced in a dock that does not hold this aMussel"
    assert floating().receive(ContactBounced(20), 70_000) == [StimulusDropped(70_000, 7, reason)]


@given(
    st.sampled_from([PAPER, WHOLE]),
    st.sampled_from([0.0, 0.01, 0.5, 1.0]),
    st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from([0.0, 0.001, 0.3, 1.0])), max_size=6),
)
def test_a_loss_takes_its_charge_and_no_more_than_there_is(
    fleet: FleetConfig, at_first: float, losses: list[tuple[int, float]]
) -> None:
    mussel = agent(fleet, at_first)
    for at_ms, loss in sorted(losses):
        mussel.advance(at_ms)
        held, other = charge(mussel, at_ms), mussel.board.secondary
        mussel.receive(ChargeLost(grains(loss), 0), at_ms)
        assert charge(mussel, at_ms) == max(0, held - grains(loss))
        assert mussel.config.board.charge.charge_at(other, at_ms) == mussel.board.secondary.charge


def test_a_battery_that_lost_all_its_charge_is_empty_at_once() -> None:
    worst, whole = agent(PAPER), agent(WHOLE)
    for mussel in (worst, whole):
        lived(mussel, (60_000, ChargeLost(grains(1.0), 0)), 60_000)
    assert worst.board.state is whole.board.state is State.EMPTY
    assert whole.board.feed is ActiveBattery.SECONDARY
    lived(whole, (61_000, ChargeLost(0, grains(1.0))), 61_000)
    assert whole.board.feed is ActiveBattery.NEITHER


def test_a_clock_jumps_and_runs_fast_until_it_is_healed() -> None:
    mussel = agent(WHOLE)
    drift = mussel.config.board.drift_ppb
    mussel.receive(ClockShifted(60_000), 10_000)
    off_ms = mussel.board.clock_ms(10_000) - 10_000
    assert abs(off_ms - 60_000) <= 1
    mussel.receive(CrystalSkewed(10**6), 10_000)
    assert mussel.board.clock_ms(1_010_000) - 1_010_000 - off_ms == 10**6 * (drift + 10**6) // 10**9
    mussel.receive(CrystalSkewed(0), 1_010_000)
    fast_ms = mussel.board.clock_ms(1_010_000) - 1_010_000
    assert abs(mussel.board.clock_ms(2_010_000) - 2_010_000 - fast_ms - drift // 1000) <= 1


@pytest.mark.parametrize(
    "stimulus",
    [
        ClockShifted(60_000),
        *(PartFailed(getattr(BoardPart, it), 1) for it in ("BUS", "WRITES", "CELLS", "SUPPLY", "FLASH")),
    ],
    ids=repr,
)
def test_the_worst_case_has_neither_clock_nor_sensors_nor_flash(stimulus: AgentStimulus) -> None:
    (dropped,) = agent(PAPER).receive(stimulus, 0)
    assert isinstance(dropped, StimulusDropped) and "the worst case has none" in dropped.reason


@given(st.sampled_from([PAPER, WHOLE]), st.integers(0, 10**7))
def test_readings_scatter_within_their_noise_and_the_charge_does_not(fleet: FleetConfig, at_ms: int) -> None:
    noisy, healthy = agent(fleet), agent(fleet)
    noisy.receive(PartFailed(BoardPart.CONVERTER, grains(0.05)), 0)
    for mussel in (noisy, healthy):
        mussel.advance(at_ms)
    assert noisy.board.primary == healthy.board.primary
    for read, exact in zip(noisy.board.readings(at_ms), healthy.board.readings(at_ms), strict=True):
        assert abs(read - exact) <= grains(0.05) and 0 <= read <= grains(1.0)
    noisy.receive(PartFailed(BoardPart.CONVERTER, 0), at_ms)
    assert noisy.board.readings(at_ms) == healthy.board.readings(at_ms)


def test_noise_outlives_a_reset_of_the_board_and_differs_from_time_to_time() -> None:
    mussel = agent(PAPER)
    lived(mussel, (0, PartFailed(BoardPart.CONVERTER, grains(0.05))), (1_000, WasReset(ResetCause.BROWN_OUT)))
    errors = {
        mussel.board.readings(at_ms)[0] - charge(mussel, at_ms) for at_ms in range(10_000, 20_000, 1_000)
    }
    assert len(errors) == 10


@pytest.mark.parametrize("fleet", [PAPER, WHOLE], ids=["worst case", "whole"])
def test_a_converter_that_stands_holds_its_readings_until_it_is_healed(fleet: FleetConfig) -> None:
    mussel = agent(fleet)
    mussel.receive(PartFailed(BoardPart.HOLD, 1), 60_000)
    held = mussel.board.readings(60_000)
    mussel.advance(4_000_000)
    assert mussel.board.readings(4_000_000) == held
    mussel.receive(PartFailed(BoardPart.HOLD, 0), 4_000_000)
    assert mussel.board.readings(4_000_000)[0] < held[0]


def test_a_converter_that_stands_reads_the_batteries_once_after_a_reset() -> None:
    mussel = agent(PAPER)
    lived(mussel, (60_000, PartFailed(BoardPart.HOLD, 1)), (4_000_000, WasReset(ResetCause.BROWN_OUT)))
    at_reset = mussel.board.readings(4_000_000)
    mussel.advance(8_000_000)
    assert mussel.board.readings(8_000_000) == at_reset
    assert charge(mussel, 4_000_000) == at_reset[0] > charge(mussel, 8_000_000)


def test_a_pressure_sensor_that_stands_shows_the_surface_once_it_is_healed() -> None:
    mussel = agent()
    lived(mussel, (1_000, PartFailed(BoardPart.DEPTH, 1)), (3_000, PERMISSION), 100_000)
    assert mussel.body.depth_at_um(100_000) == 0 and mussel.board.state is State.SURFACING
    mussel.receive(PartFailed(BoardPart.DEPTH, 0), 100_000)
    assert mussel.board.state is State.FLOATING


def test_a_board_that_never_notices_the_surface_sinks_again_in_time_and_then_stays_sinking() -> None:
    mussel = agent()
    lived(mussel, (1_000, PartFailed(BoardPart.DEPTH, 1)), (3_000, PERMISSION))
    timeout_ms = mussel.config.board.surfacing_timeout_ms
    mussel.advance(3_000 + 2 * timeout_ms)
    assert mussel.board.state is State.SINKING and mussel.body.rests_on_bottom
    mussel.receive(PartFailed(BoardPart.DEPTH, 0), 3_000 + 2 * timeout_ms)
    assert mussel.board.state is State.ACTIVE


def test_a_packet_that_overruns_the_uart_is_dropped() -> None:
    for fleet in (PAPER, WHOLE):
        mussel = agent(fleet)
        mussel.receive(PartFailed(BoardPart.UARTS, 4), 3_000)
        dropped = mussel.receive(PERMISSION, 4_000)
        assert [it.reason for it in dropped if isinstance(it, StimulusDropped)] == ["not a command"]
        lived(mussel, (5_000, PartFailed(BoardPart.UARTS, 0)), (6_000, PERMISSION))
        assert mussel.board.state is State.SURFACING


HOUR_MS = 3_600_000


def sampled(*failing: tuple[int, AgentStimulus], hours: int = 5) -> Agent:
    """A whole board after so many hourly samples; each failure comes at an hour, half an hour after a sample."""
    mussel = agent(WHOLE)
    for hour, stimulus in failing:
        mussel.receive(stimulus, hour * HOUR_MS + HOUR_MS // 2)
    mussel.advance(hours * HOUR_MS + HOUR_MS // 2)
    return mussel


def readable(mussel: Agent) -> list[int]:
    return [record.sequence for record in mussel._logbook.log.read(0, 99)]


def test_a_silent_bus_repeats_the_last_counts_as_another_record() -> None:
    mussel = sampled((2, PartFailed(BoardPart.BUS, 1)), (4, PartFailed(BoardPart.BUS, 0)))
    counts = [record.counts for record in mussel._logbook.log.read(0, 99)]
    assert len(counts) == 5
    assert counts[1] == counts[2] == counts[3] and len(set(counts)) == 3


@pytest.mark.parametrize(
    ("part", "value"), [(BoardPart.WRITES, 10), (BoardPart.WRITES, 1), (BoardPart.CELLS, 16)]
)
def test_a_write_that_fails_spoils_its_record_alone(part: BoardPart, value: int) -> None:
    mussel = sampled((2, PartFailed(part, value)), (4, PartFailed(part, 0)))
    assert readable(mussel) == [0, 1, 4] and mussel.physical.samples == 5


def test_a_flash_that_does_not_answer_misses_its_records_and_keeps_the_others() -> None:
    mussel = sampled((2, PartFailed(BoardPart.FLASH, 1)), (4, PartFailed(BoardPart.FLASH, 0)))
    assert readable(mussel) == [0, 1, 4] and mussel.physical.samples == 5
    mussel.receive(PartFailed(BoardPart.FLASH, 1), 6 * HOUR_MS)
    assert readable(mussel) == []


def test_a_page_whose_erasure_failed_takes_no_record_until_it_is_erased() -> None:
    flash = FailingFlash(MemoryFlash(pages=3, page_bytes=96))
    flash.program(96, b"old")
    flash.parts = {BoardPart.FLASH: 1}
    flash.erase(1)
    flash.program(0, b"lost")
    flash.parts = {}
    flash.program(96, b"new")
    flash.program(100, b"free")
    assert flash.read(0, 4) == bytes(4) and flash.read(96, 8) == b"old\0free"
    flash.erase(1)
    flash.program(96, b"new")
    assert flash.read(96, 8) == b"new" + bytes(5)


@pytest.mark.parametrize("written", [1, 10, 23])
def test_a_brown_out_in_a_write_tears_one_record_and_boots_the_board(written: int) -> None:
    """The third sample is torn at 3 h and 10 s; the board boots at once, and its next record is the fourth."""
    mussel = sampled((2, PartFailed(BoardPart.SUPPLY, written)))
    boots = [it.at_ms for it in mussel.take_truths() if it.state is State.BOOTING]
    assert boots == [0, 3 * HOUR_MS + 10_000]
    assert mussel.board.reset_cause is ResetCause.BROWN_OUT
    assert mussel._logbook is not None and mussel._logbook.log.torn == 1
    assert readable(mussel) == [0, 1, 3, 4]


def test_a_brown_out_that_found_no_write_is_forgotten() -> None:
    mussel = agent(WHOLE)
    lived(
        mussel,
        (1_000, PartFailed(BoardPart.SUPPLY, 10)),
        (2_000, PartFailed(BoardPart.SUPPLY, 0)),
        2 * HOUR_MS,
    )
    assert mussel.board.reset_cause is ResetCause.POWER_ON

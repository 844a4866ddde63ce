"""An agent's samples, its statuses by each medium, and the upload of its log in a dock."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fleets import PAPER, STILL, reporting_every, with_whole_boards

from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.modem.frames import ModemGeneration
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, SoundSent, StimulusDropped, WifiSent
from agents.mussel.stimuli import ContactClosed, SoundArrived, WifiArrived
from agents.water.patches import CALM, QuantityWater
from firmware_model.config import FullFirmware, LastResort
from firmware_model.packets import (
    AcousticStatus,
    CommandPacket,
    Kind,
    LogAck,
    LogRecords,
    Packet,
    ShortStatus,
    StatusPacket,
    WifiStatus,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.sampling.sensors import SENSORS, values
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, power

CODEC = MusselbedCodec()
CYCLE = replace(FIELD, alarm_ms=600_000, sample_ms=10_000, report_ms=20_000)
FLEET = with_whole_boards(
    replace(
        reporting_every(STILL, 60_000),
        theta=1,
        first_id=7,
        waters={
            **CALM,
            "oxygen_mg_l": QuantityWater(((0, 6.0),)),
            "temperature_c": QuantityWater(((0, 25.0),)),
            "turbidity_ntu": QuantityWater(((0, 2000.0),)),
        },
    ),
    FullFirmware(power(LastResort.CALL), CYCLE, transmit_ms=1000, call_ms=600_000, hover_ms=600_000),
)
BORN = resting_on_bottom(1.0, 2.0, 3.0, 0.9, 1.0)


def boot(fleet: FleetConfig = FLEET, flash: MemoryFlash | None = None) -> Agent:
    return Agent(fleet.maker().config(7), CODEC, BORN, 0, ResetCause.POWER_ON, flash)


def packets(outputs: list[Output], medium: type = WifiSent) -> list[Packet | None]:
    return [CODEC.decode(it.data) for it in outputs if isinstance(it, medium)]


def records(outputs: list[Output]) -> list[SampleRecord]:
    return [record for it in packets(outputs) if isinstance(it, LogRecords) for record in it.records]


def docked_after(samples: int, flash: MemoryFlash | None = None) -> tuple[Agent, int, list[Output]]:
    """An agent that has just woken in a dock, with so many samples in its log; the time, and its outputs."""
    mussel = boot(flash=flash)
    up_ms = samples * CYCLE.alarm_ms + 30_000
    mussel.advance(up_ms)
    mussel.receive(SoundArrived(CommandPacket(Kind.PERMISSION, 7).encode()), up_ms)
    mussel.receive(ContactClosed(0, 0), up_ms + 61_000)
    wake_ms = (samples + 1) * CYCLE.alarm_ms
    outputs = mussel.advance(wake_ms)
    assert mussel.board.state is State.REPORTING
    return mussel, wake_ms, outputs


def test_a_sample_is_what_is_true_of_the_water_but_for_noise_and_range() -> None:
    mussel, _, outputs = docked_after(3)
    found = records(outputs)
    assert [(it.sequence, it.agent_ms) for it in found] == [(n, 600_000 * (n + 1) + 10_000) for n in range(3)]
    for record in found:
        oxygen, pressure, temperature, turbidity, *_ = values(SENSORS, record.counts)
        assert oxygen == pytest.approx(6.0, abs=0.25)
        assert pressure == pytest.approx(1013.25 + 301.6, abs=2.5)
        assert temperature == pytest.approx(25.0, abs=0.05)
        assert turbidity == pytest.approx(1000.0, abs=0.1)
        assert record.saturated == 0b1000  # the turbidity
    assert len({record.counts for record in found}) == 3
    assert (mussel.physical.samples, mussel.physical.acknowledged) == (3, 0)


def test_each_medium_has_its_own_status() -> None:
    by_sound = packets(boot().advance(1_200_000), SoundSent)
    assert by_sound and all(isinstance(it, AcousticStatus) for it in by_sound)
    short = packets(
        boot(replace(FLEET, reports=replace(FLEET.reports, modem=ModemGeneration.V2))).advance(1_200_000),
        SoundSent,
    )
    assert len(short) == len(by_sound) and all(isinstance(it, ShortStatus) for it in short)
    _, _, outputs = docked_after(2)
    (status,) = [it for it in packets(outputs) if isinstance(it, WifiStatus) and it.depth_m == 0][-1:]
    assert (status.samples, status.acknowledged, status.oldest, status.overwritten) == (2, 0, 0, 0)
    assert status.counts == records(outputs)[-1].counts


def test_the_worst_case_has_no_log_and_one_status() -> None:
    mussel = boot(replace(reporting_every(PAPER, 60_000), theta=1, first_id=7))
    outputs = mussel.advance(1_200_000)
    assert packets(outputs) and all(type(it) is StatusPacket for it in packets(outputs))
    assert mussel.physical.samples == 0
    (dropped,) = mussel.receive(WifiArrived(LogAck(7, 1).encode()), 1_200_000)
    assert isinstance(dropped, StimulusDropped)


def test_asleep_in_a_dock_its_wifi_is_silent() -> None:
    mussel, wake_ms, _ = docked_after(1)
    outputs = mussel.advance(wake_ms + 2 * CYCLE.alarm_ms)
    at_ms = {it.at_ms for it in outputs if isinstance(it, WifiSent)}
    assert at_ms == {wake_ms + CYCLE.alarm_ms, wake_ms + 2 * CYCLE.alarm_ms}


def test_acknowledged_once_it_is_sent_no_more_and_a_reset_does_not_forget_that() -> None:
    flash = MemoryFlash()
    mussel, wake_ms, _ = docked_after(3, flash)
    assert mussel.receive(WifiArrived(LogAck(7, 2).encode()), wake_ms + 1000) == []
    again = Agent(mussel.config, CODEC, mussel.physical, wake_ms + 5000, ResetCause.BROWN_OUT, flash)
    outputs = again.advance(wake_ms + CYCLE.alarm_ms)
    assert [it.sequence for it in records(outputs)] == [2]


ON, OFF = State.REPORTING, State.CHARGING
TOLD: dict[str, list[tuple[int, Packet | None, list[int | str], State]]] = {
    "an acknowledgement that moves nothing asks for what is missing": [
        (1000, LogAck(7, 0), [0, 1, 2], ON),
        (2000, CommandPacket(Kind.BACK_UP_LOG, 7), [0, 1, 2], ON),
    ],
    "an acknowledgement of what was never taken is dropped, and counts nothing": [
        (1000, LogAck(7, 4), ["an acknowledgement of records that were never taken"], ON),
        (2000, LogAck(7, 0), [0, 1, 2], ON),
    ],
    "it stays awake while somebody takes its log": [
        *((15_000 * n, LogAck(7, n), [], ON) for n in (1, 2, 3)),
        (64_999, None, [], ON),
        (65_000, None, [], OFF),
        (70_000, LogAck(7, 3), ["Wi-Fi is off"], OFF),
    ],
}
"""What is told by Wi-Fi, at a time after its wake; the records that it sends then or why it took nothing, and its state."""


@pytest.mark.parametrize("steps", TOLD.values(), ids=TOLD)
def test_three_samples_in_a_dock(steps: list[tuple[int, Packet | None, list[int | str], State]]) -> None:
    mussel, wake_ms, _ = docked_after(3)
    for after_ms, packet, sent, state in steps:
        mussel.advance(wake_ms + after_ms)
        told = mussel.receive(WifiArrived(packet.encode()), wake_ms + after_ms) if packet else []
        dropped = [it.reason for it in told if isinstance(it, StimulusDropped)]
        assert ([*dropped, *(it.sequence for it in records(told))], mussel.board.state) == (sent, state)


def test_a_long_log_goes_out_four_packets_at_once() -> None:
    """600 records are 34 packets of 18: four, and then as many as were acknowledged."""
    quick = replace(CYCLE, alarm_ms=20_000, sample_ms=1000, processing_ms=0, slots=None, report_ms=5000)
    assert FLEET.board.whole is not None
    mussel = boot(with_whole_boards(FLEET, replace(FLEET.board.whole, cycle=quick)))
    mussel.advance(12_061_500)  # 603 alarms; it listens through the first three, having just booted
    assert mussel.physical.samples == 600
    mussel.receive(SoundArrived(CommandPacket(Kind.PERMISSION, 7).encode()), 12_061_500)
    mussel.receive(ContactClosed(0, 0), 12_122_000)
    outputs = mussel.advance(12_140_000)
    assert [it.sequence for it in records(outputs)] == list(range(72))
    more = mussel.receive(WifiArrived(LogAck(7, 50).encode()), 12_141_000)
    assert [it.sequence for it in records(more)] == list(range(72, 122))
    assert {it.oldest for it in packets(more) if isinstance(it, LogRecords)} == {50}
    last = mussel.receive(WifiArrived(LogAck(7, 122).encode()), 12_142_000)
    assert [it.sequence for it in records(last)] == list(range(122, 194))

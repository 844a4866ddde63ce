"""A sea with opened modems: each answers like a real modem, and no other part notices."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest
from seas import FLEET, SEA, SeaBench

from agents.modem.frames import ModemGeneration
from agents.mussel.stimuli import ModemSent, PingArrived, SoundArrived
from agents.water.medium import PacketEnded
from agents.water.sea_events import (
    AgentRanged,
    NotRanged,
    Printed,
    SeaResult,
    SoundReached,
    StimulusDelivered,
)
from firmware_model.packets import CommandPacket, Kind, ShortStatus
from firmware_model.packets.codec import MusselbedCodec

HOUR_MS = 3_600_000


class Bench(SeaBench):
    """aMussels 1, 2 and 3 at 150, 300 and 450 m north of the aPad, all as deep."""

    def __init__(self, *opened: int, **changes: Any) -> None:
        super().__init__(150.0, 300.0, 450.0, opened=opened, **changes)

    def on(self, for_ms: int, step_ms: int = 50) -> list[SeaResult]:
        return self.run(self.now_ms + for_ms, step_ms)

    def ask(self, agent_id: int, command: bytes, for_ms: int = 6000) -> bytes:
        """Returns the modem's output after the command, within the time."""
        self.sea.write(agent_id, command)
        return printed(self.on(for_ms), agent_id)


def printed(results: list[SeaResult], agent_id: int) -> bytes:
    return b"".join(it.data for it in results if isinstance(it, Printed) and it.agent_id == agent_id)


def test_an_opened_modem_is_answered_by_those_that_are_not() -> None:
    """150 m are 3200 steps; 255 is the aPad's address."""
    bench = Bench(1)
    bench.on(5000)
    for command, answer in (
        (b"$P002", rb"\$P002\r\n#R002T03200\r\n"),
        (b"$P255", rb"\$P255\r\n#R255T03200\r\n"),
        (b"$P003", rb"\$P003\r\n#R003T06400\r\n"),
        (b"$P004", rb"\$P004\r\n#TO\r\n"),
        (b"$V002", rb"\$V002\r\n#B00227V21845R.*"),
        (b"$E00305hello", rb"\$E00305\r\n#B00305hello\r\n"),
        (b"$M00205hello", rb"\$M00205\r\n#R002T03200\r\n"),
        (b"$?", rb"#A001V.*"),
        (b"$T002", rb"\$T002\r\n#B00264.{64}\r\n"),
    ):
        assert re.fullmatch(answer, bench.ask(1, command), re.DOTALL), command


def test_an_address_set_by_a_driver_is_the_one_that_the_water_knows() -> None:
    bench = Bench(1, 2)
    bench.on(5000)
    assert bench.ask(2, b"$A042") == b"#A042\r\n"
    assert bench.ask(1, b"$P042") == b"$P042\r\n#R042T03200\r\n"
    assert bench.ask(1, b"$P002") == b"$P002\r\n#TO\r\n"
    bench.ask(1, b"$U04205hello")
    assert SoundArrived(b"hello") in [
        it.stimulus for it in bench.came if isinstance(it, StimulusDelivered) and it.agent_id == 2
    ]
    # The aPad still calls aMussel 2 by the address that it was given, and the board sends under the new one.
    bench.came.clear()
    bench.sea.send_sound(2, b"hello")
    bench.sea.send_sound(3, b"hello")
    bench.on(3000)
    assert {it.agent_id for it in bench.came if isinstance(it, StimulusDelivered)} == {3}
    assert bench.ask(2, b"$B02ab").startswith(b"$B02")
    assert bench.ask(1, b"$E04202ab") == b"$E04202\r\n#B04202ab\r\n"


def test_each_modem_has_a_chip_of_its_own() -> None:
    bench = Bench(1, 2)
    bench.on(1000)
    with pytest.raises(ValueError, match="aMussel 3 has not been opened"):
        Bench().sea.write(3, b"$D")
    one, other = bench.ask(1, b"$D"), bench.ask(2, b"$D")
    assert one.startswith(b"#DID:0x") and other.startswith(b"#DID:0x") and one != other
    assert one == Bench(1).ask(1, b"$D"), "in each run the same"


def test_the_noise_is_the_water_s_and_thrusters_add_to_the_apad_s() -> None:
    """89.03 dB in the band, 168 dB are the full scale: 65535 x 10^(-78.97 / 20) = 7.38. Thrusters: ten times that."""
    bench = Bench(1, sea=replace(SEA, sound=replace(SEA.sound, noise_db_per_hz=50.0)))
    bench.on(5000)
    assert bench.ask(1, b"$N").endswith(b"#NR000007P000066M000006\r\n")
    assert b"R000007P000066M000006" in bench.ask(1, b"$V255")
    bench.sea.carry_apad(5.0, 0.0, bench.now_ms)
    assert b"R000074P000664M000059" in bench.ask(1, b"$V255")
    assert b"R000007P000066M000006" in bench.ask(1, b"$V002")


def test_its_words_reach_boards_and_the_apad_as_packets() -> None:
    bench = Bench(1)
    bench.on(5000)
    permission = MusselbedCodec().encode(CommandPacket(Kind.PERMISSION, 2))
    bench.ask(1, b"$U002%02d" % len(permission) + permission)
    assert [it.stimulus for it in bench.came if isinstance(it, StimulusDelivered) and it.agent_id == 2] == [
        SoundArrived(permission)
    ]
    bench.ask(1, b"$B05hello")
    told = [it for it in bench.came if isinstance(it, StimulusDelivered)]
    assert {it.agent_id for it in told if isinstance(it.stimulus, SoundArrived)} == {2, 3}
    # The battery of the modem's own board pays for the driver's 6 and 5 bytes.
    assert [(it.agent_id, it.stimulus) for it in told if isinstance(it.stimulus, ModemSent)] == [
        (1, ModemSent(380)),
        (1, ModemSent(368)),
    ]
    assert SoundReached in {type(it) for it in bench.came}
    # A beacon carries no data, so no board learns of it.
    bench.came.clear()
    bench.ask(1, b"$F")
    assert [it.stimulus for it in bench.came if isinstance(it, StimulusDelivered)] == [ModemSent(105)]


def test_the_board_goes_on_beside_whoever_opened_its_modem() -> None:
    bench = Bench(1)
    bench.on(5000)
    permission = MusselbedCodec().encode(CommandPacket(Kind.PERMISSION, 1))
    bench.sea.send_sound(1, permission)
    came = bench.on(3000)
    assert printed(came, 1) == b"#U%02d" % len(permission) + permission + b"\r\n"
    assert SoundArrived(permission) in [it.stimulus for it in came if isinstance(it, StimulusDelivered)]


def packets(bench: Bench) -> list[tuple[int, int, bytes, tuple[object, ...]]]:
    return [
        (it.sender, it.began_ms, it.frame.data, it.receptions)
        for it in bench.came
        if isinstance(it, PacketEnded)
    ]


@pytest.mark.parametrize("theta", [1, 30])
def test_machines_send_the_same_packets_as_no_machines(theta: int) -> None:
    fleet = replace(FLEET, theta=theta)
    plain, opened = Bench(fleet=fleet), Bench(2, fleet=fleet)
    for bench in (plain, opened):
        bench.sea.send_sound(1, b"a word")
        bench.sea.send_sound(None, b"to all")
        bench.sea.ping(2)
        bench.on(2 * HOUR_MS // theta, step_ms=1000)
        bench.sea.ping(3)
        bench.on(6000, step_ms=1000)
    data = [it for it in packets(plain) if it[2]]
    assert len(data) >= 2 + 3
    assert [it for it in packets(opened) if it[2]] == data
    ranges = [
        [it for it in bench.came if isinstance(it, AgentRanged | NotRanged)] for bench in (plain, opened)
    ]
    assert [type(it) for it in ranges[0]] == [AgentRanged, AgentRanged]
    assert [(type(it), it.agent_id) for it in ranges[1]] == [(type(it), it.agent_id) for it in ranges[0]]
    assert [it.range_m for it in ranges[1]] == [it.range_m for it in ranges[0]]
    # Simulated modems answer pings by themselves, without waking a board.
    asked = [
        sum(isinstance(it, StimulusDelivered) and isinstance(it.stimulus, PingArrived) for it in bench.came)
        for bench in (plain, opened)
    ]
    assert asked == [2, 0]


def test_a_status_over_the_serial_line_is_the_same_packet_as_in_memory() -> None:
    in_memory = Bench()
    in_memory.on(HOUR_MS + 600_000, step_ms=1000)
    sent = next(it for it in in_memory.came if isinstance(it, PacketEnded) and it.sender == 1)
    reached = next(it for it in in_memory.came if isinstance(it, SoundReached) and it.agent_id == 1)
    serial = Bench(1)
    serial.on(5000)
    serial.ask(1, b"$U255%02d" % len(sent.frame.data) + sent.frame.data)
    again = next(it for it in serial.came if isinstance(it, PacketEnded) and it.sender == 1)
    heard = next(it for it in serial.came if isinstance(it, SoundReached) and it.agent_id == 1)
    assert again.frame == sent.frame
    assert heard.data == reached.data == sent.frame.data
    (there,), (here,) = sent.receptions, again.receptions
    assert (here.receiver, here.outcome, here.travelled_us) == (
        there.receiver,
        there.outcome,
        there.travelled_us,
    )
    assert here.at_ms - again.began_ms == there.at_ms - sent.began_ms


def test_v2_modems_carry_short_statuses_at_40_bit_a_second() -> None:
    fleet = replace(FLEET, reports=replace(FLEET.reports, modem=ModemGeneration.V2))
    bench = Bench(1, fleet=fleet, sea=replace(SEA, modems=ModemGeneration.V2))
    bench.on(5000)
    assert bench.ask(1, b"$P002") == b"#P002\r\n#R002T03200\r\n"
    permission = MusselbedCodec().encode(CommandPacket(Kind.PERMISSION, 3))
    bench.sea.send_sound(3, permission)
    for size in range(8, 208):
        bench.sea.send_sound(3, bytes(size))
    bench.on(HOUR_MS + 600_000, step_ms=1000)
    carried = [it.frame for it in bench.came if isinstance(it, PacketEnded) and it.frame.data]
    assert (carried[0].data, carried[0].duration_ms) == (permission, 430 + 6 * 200)
    assert bench.sea.dropped["sound: not the 1 to 7 bytes that a V2 modem carries"] == 200
    reached = [MusselbedCodec().decode(it.data) for it in bench.came if isinstance(it, SoundReached)]
    assert {it.agent_id for it in reached if isinstance(it, ShortStatus)} >= {1, 2}
    assert {frame.duration_ms for frame in carried[1:]} == {1830}


def test_windows_do_not_show() -> None:
    traces = []
    for step_ms in (50, 1000, 250):
        bench = Bench(1)
        bench.on(5000, step_ms)
        bench.sea.write(1, b"$P003")
        bench.on(2000, step_ms)
        bench.sea.write(1, b"$U00305hello")
        bench.on(8000, step_ms)
        traces.append((packets(bench), printed(bench.came, 1)))
    assert traces[0] == traces[1] == traces[2]

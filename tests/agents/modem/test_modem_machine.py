"""The modem's timing, states and energy, by hand; and the law that windows change nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.modem.facts import (
    Delivered,
    EmitFrame,
    FrameArrived,
    FrameDropped,
    FrameRequested,
    ModemAction,
    ModemStateChanged,
    ModemStimulus,
    Pin,
    PinRose,
    PowerCame,
    PowerWent,
    QuestionAnswered,
    SerialBytes,
    SerialOut,
    SoundBegan,
)
from agents.modem.frames import FrameKind, ModemFrame
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig
from agents.modem.states import TABLE, ModemState, ModemTrigger, next_state

Pair = Callable[..., Any]
PING = ModemFrame(FrameKind.PING, 9, 1)


def modem(**config: int) -> Modem:
    return Modem(ModemConfig(**config), 1)


def outs(actions: list[ModemAction]) -> list[tuple[int, bytes]]:
    return [(it.at_ms, it.data) for it in actions if isinstance(it, SerialOut)]


@pytest.mark.parametrize("state", ModemState)
@pytest.mark.parametrize("trigger", ModemTrigger)
def test_what_is_not_in_the_table_raises(state: ModemState, trigger: ModemTrigger) -> None:
    if (state, trigger) in TABLE:
        assert next_state(state, trigger) is TABLE[state, trigger]
    else:
        with pytest.raises(ValueError, match=trigger.name):
            next_state(state, trigger)


def test_the_table_by_hand() -> None:
    lines = {f"{old.name} {trigger.name} {new.name}" for (old, trigger), new in TABLE.items()}
    assert lines == {
        "OFF POWER_CAME LISTENING",
        "LISTENING SOUND_BEGAN RECEIVING",
        "LISTENING SENDING_BEGAN TRANSMITTING",
        "LISTENING SLEEP_TOLD SLEEPING",
        "LISTENING RESET_TOLD LISTENING",
        "LISTENING POWER_WENT OFF",
        "RECEIVING SOUND_ENDED LISTENING",
        "RECEIVING SENDING_BEGAN TRANSMITTING",
        "RECEIVING SLEEP_TOLD SLEEPING",
        "RECEIVING RESET_TOLD LISTENING",
        "RECEIVING POWER_WENT OFF",
        "TRANSMITTING SENDING_ENDED LISTENING",
        "TRANSMITTING POWER_WENT OFF",
        "SLEEPING WAKE_TOLD LISTENING",
        "SLEEPING POWER_WENT OFF",
    }


def test_a_ping_takes_serial_bytes_two_frames_and_two_ways(pair: Pair) -> None:
    water = pair(turnaround_ms=5)
    water.write("near", b"$P002", until_ms=5000)
    came = [(it.at_ms, it.data) for who, it in water.seen if isinstance(it, SerialOut) and who == "near"]
    # 5 bytes in: 5.2 ms, so the ping leaves at 6. Its acknowledgement, 7 bytes, has left 7.3 ms after 5.2.
    # Out 105 + 100 ms, 5 ms of turnaround, back 105 + 100: at 421. 13 bytes more take 13.5 ms.
    assert came == [(13, b"$P002\r\n"), (435, b"#R002T03200\r\n")]


@pytest.fixture
def water(pair: Pair) -> Any:
    return pair()


def test_nothing_comes_for_4_s_after_the_question(water: Any) -> None:
    water.write("near", b"$P050", until_ms=4000)
    assert water.printed("near") == b"$P050\r\n"
    water.run(6 + 105 + 4000 + 4)
    assert water.printed("near") == b""
    water.run(6 + 105 + 4000 + 6)
    assert water.printed("near") == b"#TO\r\n"


# 66 687 us are 100.03 m: 2133.98 steps.
@pytest.mark.parametrize(
    ("way_us", "writes", "printed"),
    [
        pytest.param(
            66_687, [(b"$P002", 1000)], b"$P002\r\n#R002T02134\r\n", id="a range is finer than a millisecond"
        ),
        pytest.param(
            100_000,
            [(b"$P050", 500), (b"$P002", 8000)],
            b"$P050\r\nE\r\n#TO\r\n",
            id="a question while another waits is refused",
        ),
    ],
)
def test_a_question_is_answered(
    pair: Pair, way_us: int, writes: list[tuple[bytes, int]], printed: bytes
) -> None:
    water = pair(propagation_us=way_us)
    for command, until_ms in writes:
        water.write("near", command, until_ms=until_ms)
    assert water.printed("near") == printed


def test_while_it_sends_bytes_wait(water: Any) -> None:
    water.write("near", b"$B64" + bytes(64), until_ms=200)
    water.write("near", b"$?", until_ms=1000)
    assert b"#A" not in water.printed("near")
    water.run(1300)
    assert water.printed("near").startswith(b"#A001")


@pytest.fixture
def modem_1() -> Modem:
    return modem()


def test_slow_bytes_are_an_error_2_ms_after_the_last(modem_1: Modem) -> None:
    actions = modem_1.receive(SerialBytes(b"$P0"), 0)
    actions += modem_1.advance(100)
    # 3 bytes end at 3.125 ms, 2 ms of silence at 5.125; `E` and CR LF take 3.1 ms more from 6.
    assert outs(actions) == [(10, b"E\r\n")]
    assert outs(modem_1.receive(SerialBytes(b"$A009"), 100) + modem_1.advance(200)) == [(113, b"#A009\r\n")]


def test_bytes_within_2_ms_are_one_command(modem_1: Modem) -> None:
    actions: list[ModemAction] = []
    for n, byte in enumerate(b"$A009"):
        actions += modem_1.receive(SerialBytes(bytes([byte])), 3 * n)
    assert [data for _, data in outs(actions + modem_1.advance(100))] == [b"#A009\r\n"]
    for n, byte in enumerate(b"$A008"):
        actions += modem_1.receive(SerialBytes(bytes([byte])), 100 + 4 * n)
    assert modem_1.address == 9
    assert b"E\r\n" in [data for _, data in outs(actions + modem_1.advance(200))]


def test_half_duplex_what_comes_while_it_sends_is_lost(modem_1: Modem) -> None:
    modem_1.receive(SerialBytes(b"$B64" + bytes(64)), 0)
    modem_1.advance(500)
    assert modem_1.state is ModemState.TRANSMITTING
    modem_1.receive(SoundBegan(105), 500)
    (lost,) = modem_1.receive(FrameArrived(PING), 605)
    assert isinstance(lost, FrameDropped)
    modem_1.advance(1200)
    assert modem_1.state is ModemState.LISTENING
    # This frame began while the modem sent.
    (lost,) = modem_1.receive(FrameArrived(PING), 1250)
    assert isinstance(lost, FrameDropped)
    assert modem_1.receive(FrameArrived(PING), 1300) == []
    assert [type(action) for action in modem_1.advance(1305)] == [ModemStateChanged, EmitFrame]


def test_told_to_send_it_drops_what_it_receives(modem_1: Modem) -> None:
    modem_1.receive(SoundBegan(105), 0)
    assert modem_1.state is ModemState.RECEIVING
    modem_1.receive(SerialBytes(b"$F"), 0)
    modem_1.advance(50)
    assert modem_1.state is ModemState.TRANSMITTING
    (lost,) = modem_1.receive(FrameArrived(PING), 105)
    assert isinstance(lost, FrameDropped)


def test_asleep_it_hears_nothing_and_wakes_by_w_repeated(modem_1: Modem) -> None:
    assert outs(modem_1.receive(SerialBytes(b"$Z"), 0) + modem_1.advance(100)) == [(7, b"$Z\r\n")]
    assert modem_1.state is ModemState.SLEEPING
    (lost,) = modem_1.receive(FrameArrived(PING), 400)
    assert isinstance(lost, FrameDropped)
    assert outs(modem_1.receive(SerialBytes(b"$?"), 400) + modem_1.advance(500)) == []
    assert outs(modem_1.receive(SerialBytes(b"$W"), 500) + modem_1.advance(600)) == []
    assert modem_1.state is ModemState.LISTENING
    assert outs(modem_1.receive(SerialBytes(b"$W"), 600) + modem_1.advance(700)) == [(607, b"$W\r\n")]


def test_the_address_outlives_power_and_the_rest_does_not(modem_1: Modem) -> None:
    modem_1.receive(SerialBytes(b"$A077$XQE$XTE$P002"), 0)
    modem_1.advance(1000)
    assert modem_1.question is not None and modem_1.reports_quality
    modem_1.receive(PowerWent(), 1000)
    assert modem_1.next_due_ms is None
    assert [type(action) for action in modem_1.receive(SerialBytes(b"$?"), 1100)] == [FrameDropped]
    modem_1.receive(PowerCame(), 1200)
    answer = outs(modem_1.receive(SerialBytes(b"$?$XTG"), 1200) + modem_1.advance(1400))
    assert answer[0][1].startswith(b"#A077V21845")
    assert answer[1][1] == b"#XTD00000000000000\r\n"
    assert modem_1.question is None and not modem_1.reports_quality


def test_pins_rise_for_a_unicast_and_for_any_frame(modem_1: Modem) -> None:
    unicast = FrameArrived(ModemFrame(FrameKind.UNICAST, 9, 1, b"hi"))
    other = FrameArrived(ModemFrame(FrameKind.UNICAST, 9, 2, b"hi"))
    assert modem_1.receive(unicast, 1000) == [PinRose(1000, Pin.RXM), Delivered(1000, unicast.frame)]
    modem_1.advance(1900)
    assert modem_1.receive(other, 2000) == []
    modem_1.receive(SerialBytes(b"$XFE"), 2000)
    modem_1.advance(2100)
    assert PinRose(3000, Pin.RXS) in modem_1.receive(other, 3000)


def test_energy_by_state(modem_1: Modem) -> None:
    modem_1.receive(SoundBegan(1105), 1000)  # listened 1 s, received 1.105 s
    modem_1.receive(SerialBytes(b"$F"), 3000)  # 2 bytes: sent from 3.003 to 3.108 s
    modem_1.receive(SerialBytes(b"$Z"), 4000)  # asleep from 4.003 s
    modem_1.advance(60_000)
    listened_ms = 4003 - 1105 - 105
    assert modem_1.drawn_ua_ms(60_000) == 2_500 * listened_ms + 5_000 * 1105 + 300_000 * 105


def test_two_lines_get_their_own_answers_and_both_what_is_heard(pair: Pair) -> None:
    water = pair(lines=2)
    water.write("near", b"$P002", line=0)
    water.write("near", b"$?", line=1, until_ms=1000)
    water.write("far", b"$B02hi", until_ms=2000)
    assert water.printed("near", 0) == b"$P002\r\n#R002T03200\r\n#B00202hi\r\n"
    assert water.printed("near", 1).endswith(b":00\r\n#B00202hi\r\n")


def test_a_host_without_a_line_asks_and_is_told(water: Any) -> None:
    ping = ModemFrame(FrameKind.PING, 1, 2)
    water.tell("near", FrameRequested(ping), until_ms=1000)
    lost = ModemFrame(FrameKind.PING, 1, 3)
    water.tell("near", FrameRequested(lost), until_ms=6000)
    words = ModemFrame(FrameKind.UNICAST, 1, 2, b"words")
    water.tell("near", FrameRequested(words), until_ms=7000)
    # 105 ms out, 100 of way, 5 of turnaround, and the same back; the other ping is given up after 4 s.
    assert water.of("near", QuestionAnswered) == [
        QuestionAnswered(415, ping, 3200),
        QuestionAnswered(1000 + 105 + 4000, lost, None),
    ]
    assert [(it.at_ms, it.frame) for it in water.of("near", EmitFrame)] == [
        (0, ping),
        (1000, lost),
        (6000, words),
    ]
    assert water.of("far", Delivered) == [Delivered(6000 + words.duration_ms + 100, words)]
    assert water.printed("near") == b""
    assert water.printed("far") == b"#U05words\r\n"


def test_a_host_without_a_line_is_told_why_not(modem_1: Modem) -> None:
    modem_1.receive(FrameRequested(ModemFrame(FrameKind.BROADCAST, 1, None, b"one")), 0)
    assert modem_1.receive(FrameRequested(ModemFrame(FrameKind.BROADCAST, 1, None, b"two")), 1) == []
    (refused,) = modem_1.receive(FrameRequested(ModemFrame(FrameKind.BROADCAST, 1, None, b"three")), 2)
    assert isinstance(refused, FrameDropped)


def test_a_pause_parts_bytes_whenever_they_are_told(modem_1: Modem) -> None:
    modem_1.receive(SerialBytes(b"$P0"), 0)
    actions = modem_1.receive(SerialBytes(b"02", paused=True), 0) + modem_1.advance(100)
    assert [data for _, data in outs(actions)] == [b"E\r\n", b"E\r\n"]


def test_time_does_not_go_back(modem_1: Modem) -> None:
    modem_1.advance(5)
    with pytest.raises(ValueError, match="went back"):
        modem_1.advance(4)


STIMULI: list[ModemStimulus] = [
    *(
        SerialBytes(data)
        for data in (b"$P002", b"$U00203abc", b"$?", b"$XTE", b"$", b"x", b"$Z", b"$W", b"$R$Q")
    ),
    SerialBytes(b"$B02abT%014d" % 3_000_000),
    SerialBytes(b"$F", 1),
    SerialBytes(b"2", 0, paused=True),
    FrameRequested(ModemFrame(FrameKind.PING, 1, 2)),
    FrameRequested(ModemFrame(FrameKind.BROADCAST, 1, None, b"abc")),
    SoundBegan(330),
    FrameArrived(ModemFrame(FrameKind.PING, 3, 1), 1234),
    FrameArrived(ModemFrame(FrameKind.PING_REPLY, 2, 1, flight_us=1234), 1234),
    FrameArrived(ModemFrame(FrameKind.UNICAST_ACKED, 3, 1, b"data"), 1234),
    FrameArrived(ModemFrame(FrameKind.STATUS_REQUEST, 3, 1)),
    PowerWent(),
    PowerCame(),
]


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 400), st.sampled_from(STIMULI)), max_size=15),
    st.lists(st.integers(0, 8000), max_size=20),
)
@example([(0, SerialBytes(b"$?", 0)), (0, SerialBytes(b"$F", 1))], [])
def test_windows_do_not_show(told: list[tuple[int, ModemStimulus]], cuts: list[int]) -> None:
    whole, cut, dues = modem(lines=2), modem(lines=2), modem(lines=2)
    one: list[ModemAction] = []
    many: list[ModemAction] = []
    by_dues: list[ModemAction] = []
    at_ms = 0
    for after_ms, stimulus in told:
        for until_ms in sorted(it for it in cuts if at_ms < it < at_ms + after_ms):
            many += cut.advance(until_ms)
        at_ms += after_ms
        while (due_ms := dues.next_due_ms) is not None and due_ms <= at_ms:
            by_dues += dues.advance(due_ms)
        one += whole.receive(stimulus, at_ms)
        many += cut.receive(stimulus, at_ms)
        by_dues += dues.receive(stimulus, at_ms)
    while (due_ms := dues.next_due_ms) is not None and due_ms <= 20_000:
        before = len(by_dues)
        by_dues += dues.advance(due_ms)
        # next_due_ms was too late for an action with a stamp before this call.
        assert all(action.at_ms == due_ms for action in by_dues[before:])
    for until_ms in range(at_ms, 20_000, 377):
        many += cut.advance(until_ms)
    assert one + whole.advance(20_000) == many + cut.advance(20_000) == by_dues + dues.advance(20_000)
    assert whole.drawn_ua_ms(20_000) == cut.drawn_ua_ms(20_000) == dues.drawn_ua_ms(20_000)

"""The modem's timing, states and energy, by hand; and the law that windows change nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.modem.facts import (
    AddressChanged,
    Delivered,
    EmitFrame,
    FrameArrived,
    FrameRequested,
    ModemAction,
    ModemStateChanged,
    ModemStimulus,
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


def word(action: ModemAction) -> str:
    """An action in a row: what the serial line prints, the name of a new state, or whatever else it does."""
    match action:
        case SerialOut(at_ms, data, line):
            return f"{at_ms} {data.rstrip().decode()}" + f" on {line}" * line
        case ModemStateChanged(at_ms, _, _, new):
            return f"{at_ms} {new.name}"
        case AddressChanged(at_ms, address):
            return f"{at_ms} is {address}"
        case EmitFrame(at_ms, frame):
            return f"{at_ms} emits {frame.kind.name}"
        case PinRose(at_ms, pin):
            return f"{at_ms} pin {pin.name}"
        case Delivered(at_ms, frame):
            return f"{at_ms} hands on {frame.kind.name}"
        case QuestionAnswered(at_ms, question, steps):
            return f"{at_ms} {question.kind.name} to {question.destination}: {steps}"
    return f"{action.at_ms} loses"


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
        "LISTENING SLEEP_ORDERED SLEEPING",
        "LISTENING RESET_ORDERED LISTENING",
        "LISTENING POWER_WENT OFF",
        "RECEIVING SOUND_ENDED LISTENING",
        "RECEIVING SENDING_BEGAN TRANSMITTING",
        "RECEIVING SLEEP_ORDERED SLEEPING",
        "RECEIVING RESET_ORDERED LISTENING",
        "RECEIVING POWER_WENT OFF",
        "TRANSMITTING SENDING_ENDED LISTENING",
        "TRANSMITTING POWER_WENT OFF",
        "SLEEPING WAKE_ORDERED LISTENING",
        "SLEEPING POWER_WENT OFF",
    }


def told(kind: FrameKind, to: int | None, payload: bytes = b"") -> FrameRequested:
    return FrameRequested(ModemFrame(kind, 1, to, payload))


Step = tuple[int, ModemStimulus | bytes | None, list[str]]
STEPS: dict[str, list[Step]] = {
    "slow bytes are an error 2 ms after the last": [
        # 3 bytes end at 3.125 ms, 2 ms of silence at 5.125; `E` and CR LF take 3.1 ms more from 6.
        (0, b"$P0", []),
        (100, None, ["6 loses", "10 E"]),
        (100, b"$A009", []),
        (200, None, ["106 is 9", "113 #A009"]),
    ],
    "bytes within 2 ms are one command": [
        (0, b"$", []),
        (3, b"A", []),
        (6, b"0", []),
        (9, b"0", []),
        (12, b"9", []),
        (100, None, ["14 is 9", "21 #A009"]),
        (100, b"$", []),
        (104, b"A", ["104 loses"]),
        (108, b"0", ["106 loses", "108 E"]),
        (112, b"0", ["110 loses", "111 E"]),
        (116, b"8", ["114 loses", "114 E"]),
        (200, b"$?", ["117 E", "118 loses", "121 E"]),
        (300, None, ["249 #A009V21845R001.006.000B2024-02-15T00:00:00"]),
    ],
    "half duplex: what comes while it sends is lost": [
        (0, b"$B64" + bytes(64), []),
        (500, None, ["71 TRANSMITTING", "71 emits BROADCAST", "78 $B64"]),
        (500, SoundBegan(105), []),
        (605, FrameArrived(PING), ["605 loses"]),
        # The next frame began while the modem sent.
        (1200, None, ["1176 LISTENING"]),
        (1250, FrameArrived(PING), ["1250 loses"]),
        (1300, FrameArrived(PING), []),
        (1305, None, ["1305 TRANSMITTING", "1305 emits PING_REPLY"]),
    ],
    "told to send it drops what it receives": [
        (0, SoundBegan(105), ["0 RECEIVING"]),
        (0, b"$F", []),
        (50, None, ["3 TRANSMITTING", "3 emits BEACON", "7 $F"]),
        (105, FrameArrived(PING), ["105 loses"]),
    ],
    "asleep it hears nothing and wakes by W repeated": [
        (0, b"$Z", []),
        (100, None, ["3 SLEEPING", "7 $Z"]),
        (400, FrameArrived(PING), ["400 loses"]),
        (400, b"$?", []),
        (500, None, []),
        (500, b"$W", []),
        (600, None, ["503 LISTENING"]),
        (600, b"$W", []),
        (700, None, ["607 $W"]),
    ],
    "the address outlives power and the rest does not": [
        (0, b"$A077$XQE$XTE$P002", []),
        (
            1000,
            None,
            [
                "6 is 77",
                "13 #A077",
                "19 TRANSMITTING",
                "19 emits PING",
                "19 #XQE",
                "40 #XTE00000000000000",
                "47 $P002",
                "124 LISTENING",
            ],
        ),
        (1000, PowerWent(), ["1000 OFF"]),
        (1100, b"$?", ["1100 loses"]),
        (1200, PowerCame(), ["1200 LISTENING"]),
        (1200, b"$?$XTG", []),
        (1400, None, ["1249 #A077V21845R001.006.000B2024-02-15T00:00:00", "1270 #XTD00000000000000"]),
        (6000, None, []),
        (6000, FrameArrived(ModemFrame(FrameKind.BROADCAST, 9, None, b"hi")), ["6000 hands on BROADCAST"]),
        (6100, None, ["6012 #B00902hi"]),
    ],
    "pins rise for a unicast and for any frame": [
        (
            1000,
            FrameArrived(ModemFrame(FrameKind.UNICAST, 9, 1, b"hi")),
            ["1000 pin RXM", "1000 hands on UNICAST"],
        ),
        (1900, None, ["1009 #U02hi"]),
        (2000, FrameArrived(ModemFrame(FrameKind.UNICAST, 9, 2, b"hi")), []),
        (2000, b"$XFE", []),
        (2100, None, ["2011 #XFE"]),
        (3000, FrameArrived(ModemFrame(FrameKind.UNICAST, 9, 2, b"hi")), ["3000 pin RXS"]),
    ],
    "a host without a line is told why not": [
        (0, told(FrameKind.BROADCAST, None, b"one"), ["0 TRANSMITTING", "0 emits BROADCAST"]),
        (1, told(FrameKind.BROADCAST, None, b"two"), []),
        (2, told(FrameKind.BROADCAST, None, b"three"), ["2 loses"]),
    ],
    "a pause parts bytes whenever they are told": [
        (0, b"$P0", []),
        (0, SerialBytes(b"02", paused=True), []),
        (100, None, ["6 loses", "7 loses", "10 E", "13 E"]),
    ],
}
"""A time in ms, what the modem is told then, with bytes for bytes at its line, and all that it does up to then."""


@pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
def test_what_one_modem_does(steps: list[Step]) -> None:
    alone = modem()
    for at_ms, it, does in steps:
        stimulus = SerialBytes(it) if isinstance(it, bytes) else it
        did = alone.advance(at_ms) if stimulus is None else alone.receive(stimulus, at_ms)
        assert list(map(word, did)) == does, at_ms
    with pytest.raises(ValueError, match="went back"):
        alone.advance(at_ms - 1)


PAIRS: dict[
    str, tuple[dict[str, int], list[tuple[str, ModemStimulus | bytes, int]], dict[str, list[str]]]
] = {
    "a ping takes serial bytes, two frames and two ways": (
        {"turnaround_ms": 5},
        [
            # 5 bytes in: 5.2 ms, so the ping leaves at 6. Its acknowledgement, 7 bytes, has left 7.3 ms after 5.2.
            # Out 105 + 100 ms, 5 ms of turnaround, back 105 + 100: at 421. 13 bytes more take 13.5 ms.
            ("near", b"$P002", 5000),
        ],
        {"near": ["6 emits PING", "13 $P002", "435 #R002T03200"]},
    ),
    "nothing comes for 4 s after the question": (
        {},
        [
            ("near", b"$P050", 6000),
        ],
        {"near": ["6 emits PING", "13 $P050", "4117 #TO"]},
    ),
    "a range is finer than a millisecond": (
        {"propagation_us": 66_687},
        [
            # 66 687 us are 100.03 m: 2133.98 steps.
            ("near", b"$P002", 1000),
        ],
        {"near": ["6 emits PING", "13 $P002", "369 #R002T02134"]},
    ),
    "a question while another waits is refused": (
        {},
        [
            ("near", b"$P050", 500),
            ("near", b"$P002", 8000),
        ],
        {"near": ["6 emits PING", "13 $P050", "506 loses", "509 E", "4117 #TO"], "far": []},
    ),
    "while it sends bytes wait": (
        {},
        [
            ("near", b"$B64" + bytes(64), 200),
            ("near", b"$?", 1300),
        ],
        {"near": ["71 emits BROADCAST", "78 $B64", "1222 #A001V21845R001.006.000B2024-02-15T00:00:00"]},
    ),
    "two lines get their own answers and both what is heard": (
        {"lines": 2},
        [
            ("near", b"$P002", 0),
            ("near", SerialBytes(b"$?", 1), 1000),
            ("far", b"$B02hi", 2000),
        ],
        {
            "near": [
                "6 emits PING",
                "13 $P002",
                "49 #A001V21845R001.006.000B2024-02-15T00:00:00 on 1",
                "435 #R002T03200",
                "1437 hands on BROADCAST",
                "1449 #B00202hi",
                "1449 #B00202hi on 1",
            ]
        },
    ),
    "a host without a line asks and is told": (
        {},
        [
            # 105 ms out, 100 of way, 5 of turnaround, and the same back; the other ping is given up after 4 s.
            ("near", told(FrameKind.PING, 2), 1000),
            ("near", told(FrameKind.PING, 3), 6000),
            ("near", told(FrameKind.UNICAST, 2, b"words"), 7000),
        ],
        {
            "near": [
                "0 emits PING",
                "415 PING to 2: 3200",
                "1000 emits PING",
                "5105 PING to 3: None",
                "6000 emits UNICAST",
            ],
            "far": ["210 emits PING_REPLY", "6468 pin RXM", "6468 hands on UNICAST", "6480 #U05words"],
        },
    ),
}
"""A pair's configuration; who is told what, and until when time runs then; and all that each does but change its state."""


@pytest.mark.parametrize(("config", "acts", "does"), PAIRS.values(), ids=PAIRS)
def test_what_two_modems_do(
    config: dict[str, int],
    acts: list[tuple[str, ModemStimulus | bytes, int]],
    does: dict[str, list[str]],
    pair: Pair,
) -> None:
    water = pair(**config)
    for who, it, until_ms in acts:
        water.tell(who, SerialBytes(it) if isinstance(it, bytes) else it, until_ms)
    seen = [(who, word(it)) for who, it in water.seen if not isinstance(it, ModemStateChanged)]
    assert {who: [it for by, it in seen if by == who] for who in does} == does


def test_energy_by_state() -> None:
    alone = modem()
    alone.receive(SoundBegan(1105), 1000)  # listened 1 s, received 1.105 s
    alone.receive(SerialBytes(b"$F"), 3000)  # 2 bytes: sent from 3.003 to 3.108 s
    alone.receive(SerialBytes(b"$Z"), 4000)  # asleep from 4.003 s
    alone.advance(60_000)
    listened_ms = 4003 - 1105 - 105
    assert alone.drawn_ua_ms(60_000) == 2_500 * listened_ms + 5_000 * 1105 + 300_000 * 105


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

"""Every row of the V3 manual's table, byte for byte: the answers at once, later, and at the far modem."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import Any

import pytest

from agents.modem.answers import impulse_response
from agents.modem.facts import EmitFrame, ModemStimulus, NoiseChanged, SerialBytes, SupplyChanged
from agents.modem.modem_model import ModemFirmware

Pair = Callable[..., Any]
"""Makes the water of `conftest.py`."""
DATA = b"\r\n$#" + bytes(range(12))
LONG = bytes(range(64))

# 150 m: 100 ms one way are 3200 steps of 31.25 us; 3200 x 1500 x 3.125e-5 = 150 m.
ROWS = [
    ("status", b"$?", b"#A001V21845R001.006.000B2024-02-15T00:00:00\r\n", b"", b""),
    ("set address", b"$A200", b"#A200\r\n", b"", b""),
    ("set address beyond 255", b"$A256", b"E\r\n", b"", b""),
    ("broadcast", b"$B16" + DATA, b"$B16\r\n", b"", b"#B00116" + DATA + b"\r\n"),
    ("broadcast of 2", b"$B02hi", b"$B02\r\n", b"", b"#B00102hi\r\n"),
    ("broadcast of 64", b"$B64" + LONG, b"$B64\r\n", b"", b"#B00164" + LONG + b"\r\n"),
    ("unicast", b"$U00216" + DATA, b"$U00216\r\n", b"", b"#U16" + DATA + b"\r\n"),
    ("unicast to another", b"$U00316" + DATA, b"$U00316\r\n", b"", b""),
    ("unicast with ack", b"$M00216" + DATA, b"$M00216\r\n", b"#R002T03200\r\n", b"#U16" + DATA + b"\r\n"),
    ("unacknowledged", b"$M00316" + DATA, b"$M00316\r\n", b"#TO\r\n", b""),
    ("ping", b"$P002", b"$P002\r\n", b"#R002T03200\r\n", b""),
    ("unanswered ping", b"$P255", b"$P255\r\n", b"#TO\r\n", b""),
    ("voltage", b"$V002", b"$V002\r\n", b"#B00227V21845R000000P000000M000000\r\n", b""),
    ("echo", b"$E00216" + DATA, b"$E00216\r\n", b"#B00216" + DATA + b"\r\n", b""),
    ("beacon", b"$F", b"$F\r\n", b"", b"#F001\r\n"),
    ("impulse response, none", b"$CM003", b"$CM003\r\n", b"#TO\r\n", b""),
    ("impulse response, none", b"$CC003", b"$CC003\r\n", b"#TO\r\n", b""),
    ("reset", b"$R", b"$R\r\n", b"", b""),
    ("quality of nothing", b"$Q", b"$C-\r\n", b"", b""),
    ("noise", b"$N", b"$N\r\n", b"#NR000000P000000M000000\r\n", b""),
    ("quality on", b"$XQE", b"#XQE\r\n", b"", b""),
    ("quality off", b"$XQD", b"#XQD\r\n", b"", b""),
    ("timer cleared", b"$XTC", b"#XTD00000000000000\r\n", b"", b""),
    ("timer read", b"$XTG", b"#XTD00000000000000\r\n", b"", b""),
    ("timer on", b"$XTE", b"#XTE00000000000000\r\n", b"", b""),
    ("timer off", b"$XTD", b"#XTD00000000000000\r\n", b"", b""),
    ("RxS on", b"$XFE", b"#XFE\r\n", b"", b""),
    ("RxS off", b"$XFD", b"#XFD\r\n", b"", b""),
    ("sleep", b"$Z", b"$Z\r\n", b"", b""),
    ("wake when awake", b"$W", b"$W\r\n", b"", b""),
    ("unknown", b"$Y", b"E\r\n", b"", b""),
    ("no digit", b"$P0x2", b"E\r\n", b"", b""),
    ("too short to send", b"$B01a", b"E\r\n", b"", b""),
    ("too long to send", b"$U00265", b"E\r\n", b"", b""),
    ("no command at all", b"hello", b"E\r\n", b"", b""),
]


@pytest.mark.parametrize(
    ("command", "at_once", "later", "remote"), [it[1:] for it in ROWS], ids=[it[0] for it in ROWS]
)
def test_a_row_of_the_table(pair: Pair, command: bytes, at_once: bytes, later: bytes, remote: bytes) -> None:
    water = pair()
    water.write("near", command, until_ms=300)
    assert water.printed("near")[: len(at_once)] == at_once
    water = pair()
    water.write("near", command, until_ms=6000)
    assert water.printed("near") == at_once + later and water.printed("far") == remote


@pytest.fixture
def water(pair: Pair) -> Any:
    return pair()


EARLY = ModemFirmware.V3_EARLY
NOISE = NoiseChanged(40, 900, 31)
Told = tuple[str, bytes | ModemStimulus, int]
"""Who is told what, with bytes for its line's, and until when time runs then."""
STORIES: dict[str, tuple[ModemFirmware, list[Told], dict[str, bytes | re.Pattern[bytes]]]] = {
    "early firmware tells less": (
        EARLY,
        [("near", b"$?", 100), ("near", b"$V002", 3000)],
        {"near": b"#A001V21845\r\n$V002\r\n#B00206V21845\r\n"},
    ),
    "quality is appended when it is on": (
        ModemFirmware.V3,
        [("far", b"$XQE", 50), ("near", b"$B02ab", 1000), ("near", b"$U00202cd", 2000), ("far", b"$Q", 2100)],
        {"far": b"#XQE\r\n#B00102abQ20D+000\r\n#U02cdQ20D+000\r\n$C0\r\n"},
    ),
    # 4 bytes of 25/24 ms: the far timer starts at 4.166 ms; the beacon leaves at 50 + 3 ms and travels 100 ms.
    "times are appended when the timer is on": (
        ModemFirmware.V3,
        [("far", b"$XTE", 50), ("near", b"$F", 1000)],
        {"far": b"#XTE00000000000000\r\n#F001T%014d\r\n" % (153_000 - 4_166)},
    ),
    "a ping to oneself is an error": (
        ModemFirmware.V3,
        [("near", b"$P001", 6000), ("near", b"$A009", 6100), ("near", b"$P009", 6200)],
        {"near": b"E\r\n#A009\r\nE\r\n", "far": b""},
    ),
    "without a time a command is over at the next byte or after silence": (
        ModemFirmware.V3,
        [("far", b"$?", 100), ("near", b"$XTE$F", 500), ("near", b"$B02ab$A001", 3000)],
        {
            "near": b"#XTE00000000000000\r\n$F\r\n$B02\r\n#A001\r\n",
            "far": b"#A002V21845R001.006.000B2024-02-15T00:00:00\r\n#F001\r\n#B00102ab\r\n",
        },
    ),
    # The makers' driver takes the letter after #XT for the state, E for on.
    "a timer's answer begins with its state": (
        ModemFirmware.V3,
        [("near", b"$XT" + it, 100 * n) for n, it in enumerate((b"G", b"E", b"G", b"C", b"D"), start=1)],
        {
            "near": b"#XTD00000000000000\r\n#XTE00000000000000\r\n#XTE%014d\r\n"
            b"#XTE00000000000000\r\n#XTD%014d\r\n" % (100_000, 100_000)
        },
    ),
    # 4.9 V x 65536 / 15 = 21408.4
    "noise is what was measured": (
        ModemFirmware.V3,
        [("far", NOISE, 0), ("far", SupplyChanged(4900), 0), ("far", b"$N", 0), ("near", b"$V002", 3000)],
        {
            "far": b"$N\r\n#NR000040P000900M000031\r\n",
            "near": b"$V002\r\n#B00227V21408R000040P000900M000031\r\n",
        },
    ),
    "a test is 64 bytes from the far modem": (
        ModemFirmware.V3,
        [("near", b"$T002", 3000)],
        {"near": re.compile(rb"\$T002\r\n#B00264.{64}\r\n", re.DOTALL)},
    ),
    "help is whole lines": (
        ModemFirmware.V3,
        [("near", b"$H", 1000)],
        {"near": re.compile(rb"(?=(?s:.{101}))(?:[\x01-\x7f]{0,100}?\r\n)+")},
    ),
    "a spectrum is 257 words": (
        ModemFirmware.V3,
        [("near", NOISE, 0), ("near", b"$S", 4000)],
        {"near": b"$S\r\n#S00257" + 257 * b"\x1f\0" + b"\r\n"},
    ),
    # The makers' driver takes 50 000 for 1.0, unsigned from $CM and signed from $CC, which cannot hold it.
    **{
        f"an impulse response has the range and the words: {name}": (
            ModemFirmware.V3,
            [("near", b"$%s002" % name.encode(), 3000)],
            {
                "near": b"$%s002\r\n#%s002T03200L%05d" % (name.encode(), name.encode(), count)
                + words
                + b"\r\n"
            },
        )
        for name, count, words in (
            ("CM", 128, struct.pack("<128H", 50_000, *127 * [0])),
            ("CC", 256, struct.pack("<256h", 32_767, *255 * [0])),
        )
    },
}


@pytest.mark.parametrize("name", STORIES)
def test_a_story_of_two_modems(pair: Pair, name: str) -> None:
    firmware, told, printed = STORIES[name]
    water = pair(firmware)
    for who, it, until_ms in told:
        water.tell(who, SerialBytes(it) if isinstance(it, bytes) else it, until_ms)
    for who, expected in printed.items():
        came = water.printed(who)
        assert expected.fullmatch(came) if isinstance(expected, re.Pattern) else came == expected


def test_identity_names_the_chip_and_addresses_of_four_lengths(pair: Pair) -> None:
    water = pair(unique_id=0x0123456789AB_CDEF01234567)
    water.write("near", b"$D", until_ms=1000)
    head, *addresses = water.printed("near").removesuffix(b"\r\n").split(b"-A")
    assert head == b"#DID:0x0123456789ABCDEF01234567"
    assert [len(address) for address in addresses] == [1 + 3, 2 + 5, 2 + 8, 2 + 10]


def test_an_echo_has_its_delay_and_in_a_complex_response_its_sign() -> None:
    echoes = ((625, -0.5), (1250, 0.25))
    magnitudes = struct.unpack("<128H", impulse_response("CM", 2, 0, echoes)[18:-2])
    parts = struct.unpack("<256h", impulse_response("CC", 2, 0, echoes)[18:-2])
    assert (magnitudes[10], magnitudes[20]) == (25_000, 12_500) and sum(magnitudes) == 87_500
    assert (parts[20], parts[40]) == (-25_000, 12_500) and not any(parts[1::2])


@pytest.mark.parametrize(("command", "took_ms"), [(b"$N", 1000), (b"$S", 2000)])
def test_a_measurement_takes_its_time_and_sees_the_noise_at_its_end(
    water: Any, command: bytes, took_ms: int
) -> None:
    water.tell("near", NoiseChanged(1, 1, 1))
    water.write("near", command, until_ms=took_ms - 10)
    assert water.printed("near") == command + b"\r\n"
    water.write("near", b"$N", until_ms=took_ms)
    water.tell("near", NoiseChanged(40, 900, 31), until_ms=took_ms + 3000)
    printed = water.printed("near")
    assert printed.startswith(b"E\r\n#"), "one measurement at a time"
    assert (b"R000040P000900M000031" in printed) if command == b"$N" else (b"\x1f\x00\x1f\x00" in printed)


@pytest.mark.parametrize(("meanwhile", "is_measured"), [(b"$A", True), (b"$R", False), (b"$Z", False)])
def test_what_restarts_a_modem_ends_its_measurement(water: Any, meanwhile: bytes, is_measured: bool) -> None:
    water.write("near", b"$N", until_ms=water.now_ms + 100)
    water.write("near", meanwhile, until_ms=water.now_ms + 3000)
    assert (b"#NR" in water.printed("near")) is is_measured


# The timer was 0 at 4.166 ms.
@pytest.mark.parametrize(
    ("timer_us", "sent_ms", "answer", "heard"),
    [(1_500_000, [1505], b"$U00202", b"#U02ab\r\n"), (0, [], b"E", b""), (2_300_000, [], b"E", b"")],
    ids=["put off", "into the past", "beyond 2 s"],
)
def test_sending_is_put_off_by_the_timer(
    water: Any, timer_us: int, sent_ms: list[int], answer: bytes, heard: bytes
) -> None:
    water.write("near", b"$XTE", until_ms=100)
    water.write("near", b"$U00202abT%014d" % timer_us, until_ms=5000)
    assert [it.at_ms for it in water.of("near", EmitFrame)] == sent_ms
    assert water.printed("near") == b"#XTE00000000000000\r\n" + answer + b"\r\n"
    assert water.printed("far") == heard


def test_a_frame_of_another_generation_is_noise(water: Any, pair: Pair) -> None:
    water.modems["far"] = pair(ModemFirmware.V2).modems["far"]
    water.write("near", b"$B02ab", until_ms=3000)
    assert water.printed("far") == b""

"""The V2 modem of the early swarm: one digit of length, seven bytes, acknowledgements with `#`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from agents.modem.facts import EmitFrame
from agents.modem.modem_model import ModemFirmware

Pair = Callable[..., Any]

# 5 V: 5000 mV x 1024 / 6600 = 775.8
ROWS = [
    (b"$?", b"#A001V00776\r\n", b"", b""),
    (b"$A077", b"#A077\r\n", b"", b""),
    (b"$A256", b"E\r\n", b"", b""),
    (b"$P002", b"#P002\r\n", b"#R002T03200\r\n", b""),
    (b"$P003", b"#P003\r\n", b"#TO\r\n", b""),
    (b"$V002", b"#V002\r\n", b"#B0026V00776\r\n", b""),
    (b"$U0027\r\n$#abc", b"#U0027\r\n", b"", b"#U7\r\n$#abc\r\n"),
    (b"$U0021a", b"#U0021\r\n", b"", b"#U1a\r\n"),
    (b"$B3xyz", b"#B3\r\n", b"", b"#B0013xyz\r\n"),
    (b"$B8", b"E\r\n", b"", b""),
    (b"$B0", b"E\r\n", b"", b""),
    (b"$M002", b"E\r\n", b"", b""),
    (b"$XTE", b"E\r\n", b"", b""),
]


@pytest.mark.parametrize(("command", "at_once", "later", "remote"), ROWS)
def test_a_v2_command(pair: Pair, command: bytes, at_once: bytes, later: bytes, remote: bytes) -> None:
    water = pair(ModemFirmware.V2)
    water.write("near", command, until_ms=200)
    assert water.printed("near") == at_once
    water.run(8000)
    assert water.printed("near") == later and water.printed("far") == remote


def test_seven_bytes_take_what_40_bit_a_second_take(pair: Pair) -> None:
    water = pair(ModemFirmware.V2)
    water.write("near", b"$B71234567", until_ms=5000)
    (sent,) = water.of("near", EmitFrame)
    assert sent.frame.duration_ms == 30 + (2 + 7) * 8 * 1000 // 40

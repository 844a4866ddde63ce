"""Asks a physical nanomodem for its status and, through the water, another one for an echo.

The lines are those of the Nanomodem v3: `$?` is answered by `#AxxxVyyyyy...`, a ping `$Pxxx` by `#RxxxTttttt`, or by `#TO`
after 4 s.
"""

from __future__ import annotations

import re
import threading
import time
from pathlib import Path

from agents.modem.answers import FOUND
from agents.modem.modem_model import metres_of
from agents.serial_port import BytesRead, SerialPort
from apad_bridge.doctor.finding import Finding, fail, ok

_ANSWER_S, _ECHO_S, _POLL_S = 2.0, 6.0, 0.03
_STATUS = re.compile(rb"#A(\d{3})(?:V(\d{5})|(?=\D))")
_ECHO = re.compile(FOUND.pattern + rb"|#TO")
_VOLTS = 15 / 65536


def check_modem(path: Path, echo_from: int | None) -> list[Finding]:
    """The modem's status, and the echo of the one with address `echo_from`; None asks for no echo."""
    mend = "see the plug, the port's name and its rights (group dialout), and that no other program has it"
    port = SerialPort(str(path))
    port.poll()
    try:
        if not port.is_open:
            return [fail(f"{path}: {port.why_closed}", mend)]
        if (status := _ask(port, b"$?", _STATUS, _ANSWER_S)) is None:
            return [fail(f"{path}: no answer to $? within {_ANSWER_S:g} s", mend)]
        volts = "" if status[2] is None else f", {int(status[2]) * _VOLTS:.1f} V"
        findings = [ok(f"{path}: address {int(status[1])}{volts}")]
        if echo_from is not None:
            findings.append(_echo(_ask(port, b"$P%03d" % echo_from, _ECHO, _ECHO_S), echo_from))
        return findings
    finally:
        port.close()


def _echo(answer: re.Match[bytes] | None, echo_from: int) -> Finding:
    if answer is None or answer[1] is None:
        mend = "hang both transducers into the water, 1 m deep, in sight of each other; see the address"
        return fail(f"none from address {echo_from} within {_ECHO_S:g} s", mend, check="modem echo")
    return ok(f"address {echo_from} answers, {metres_of(int(answer[2])):.1f} m away", check="modem echo")


def _ask(
    port: SerialPort, line: bytes, wanted: re.Pattern[bytes], timeout_s: float
) -> re.Match[bytes] | None:
    """The first answer of the wanted form; None when none comes in time, or the port is lost."""
    port.poll()  # what came before
    port.write(line)
    heard, until_s, pause = b"", time.monotonic() + timeout_s, threading.Event()
    while time.monotonic() < until_s and port.is_open:
        heard += b"".join(it.data for it in port.poll() if isinstance(it, BytesRead))
        if (found := wanted.search(heard)) is not None:
            return found
        pause.wait(_POLL_S)
    return None

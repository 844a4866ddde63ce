"""Commands that send sound, at once or at a time of the modem's timer; some are questions that wait for an answer."""

from __future__ import annotations

from agents.modem import answers
from agents.modem.commands import ModemCommand
from agents.modem.core import ModemCore
from agents.modem.facts import FrameDropped, ModemAction
from agents.modem.frames import TO_ALL, FrameKind, ModemFrame
from agents.modem.serial_line import TICKS_PER_MS

_KINDS = {
    "B": FrameKind.BROADCAST,
    "U": FrameKind.UNICAST,
    "M": FrameKind.UNICAST_ACKED,
    "P": FrameKind.PING,
    "V": FrameKind.STATUS_REQUEST,
    "T": FrameKind.TEST_REQUEST,
    "E": FrameKind.ECHO_REQUEST,
    "F": FrameKind.BEACON,
    "CM": FrameKind.PROBE,
    "CC": FrameKind.PROBE,
}
AWAITED = {
    FrameKind.UNICAST_ACKED: FrameKind.ACK,
    FrameKind.PING: FrameKind.PING_REPLY,
    FrameKind.PROBE: FrameKind.PROBE_REPLY,
}
"""The kind of answer to each kind of question."""


def goes_out(name: str) -> bool:
    return name in _KINDS


def send(
    modem: ModemCore, command: ModemCommand, line_index: int, tick: int, now_ms: int
) -> list[ModemAction]:
    """Acknowledges the command on its line and sends its frame; answers `E` if it cannot."""
    wait_us: int | None = 0
    now_us = tick * 1000 // TICKS_PER_MS
    if command.timer_us is not None:
        wait_us = modem.timer.wait_us(command.timer_us, now_us)
    kind = _KINDS[command.name]
    reason = why_not(modem, kind)
    if kind is FrameKind.PING and command.address == modem.address:
        reason = "a ping to its own address"
    if wait_us is None:
        reason = "a transmission can be put off by 2 s at most, and not into the past"
    if reason is not None or wait_us is None:
        modem.answer(line_index, answers.ERROR, tick)
        return [FrameDropped(now_ms, f"serial: {reason}")]
    generation = modem.config.firmware.generation
    to = None if kind in TO_ALL else command.address
    frame = ModemFrame(kind, modem.address, to, command.data, generation)
    address = "" if to is None else f"{to:03}"
    size = answers.length(generation, command.data) if command.data else ""
    modem.answer(line_index, answers.acknowledgement(generation, command.name + address + size), tick)
    if kind in AWAITED:
        modem.ask(command.name, frame, AWAITED[kind], line_index)
    modem.send(frame, max(now_ms, -(-(now_us + wait_us) // 1000)))
    return []


def why_not(modem: ModemCore, kind: FrameKind) -> str | None:
    """The reason why the modem cannot send a frame of this kind now; None if it can."""
    if modem.waiting:
        return "a frame waits to be sent already"
    return "an answer is waited for already" if kind in AWAITED and modem.question is not None else None

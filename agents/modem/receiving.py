"""Receives a frame: prints it, answers it, or takes it as the answer to a question."""

from __future__ import annotations

from agents.modem import answers
from agents.modem.core import ModemCore
from agents.modem.facts import (
    Delivered,
    FrameArrived,
    FrameDropped,
    ModemAction,
    Pin,
    PinRose,
    QuestionAnswered,
)
from agents.modem.frames import ANSWERS, FrameKind, ModemFrame
from agents.modem.modem_model import range_steps
from agents.modem.states import RECEPTIVE

_DATA = (FrameKind.UNICAST, FrameKind.UNICAST_ACKED)
_REPLIES = {
    FrameKind.UNICAST_ACKED: FrameKind.ACK,
    FrameKind.PING: FrameKind.PING_REPLY,
    FrameKind.PROBE: FrameKind.PROBE_REPLY,
}


def receive_frame(modem: ModemCore, arrived: FrameArrived, now_ms: int) -> list[ModemAction]:
    frame = arrived.frame
    if modem.state not in RECEPTIVE or now_ms - frame.duration_ms < modem.receptive_since_ms:
        return [FrameDropped(now_ms, f"sound: the modem was {modem.state.name.lower()} or had just been so")]
    if frame.generation is not modem.config.firmware.generation:
        return [FrameDropped(now_ms, "sound: a frame of another generation")]
    actions: list[ModemAction] = [PinRose(now_ms, Pin.RXS)] if modem.raises_rxs else []
    if not frame.is_for(modem.address):
        return actions
    modem.corrected = arrived.corrected
    if frame.kind in ANSWERS:
        return actions + _take_answer(modem, arrived, now_ms)
    if frame.kind in _DATA:
        actions.append(PinRose(now_ms, Pin.RXM))
    if (printed := _printed(modem, arrived, now_ms)) is not None:
        actions.append(Delivered(now_ms, frame))
        for line_index in range(len(modem.lines)):
            modem.answer(line_index, printed)
    if (reply := _reply(modem, frame, arrived.propagation_us)) is not None:
        modem.send(reply, now_ms + modem.config.turnaround_ms)
    return actions


def _printed(modem: ModemCore, arrived: FrameArrived, now_ms: int) -> bytes | None:
    """The text that every line prints; None for requests, which a modem answers by itself."""
    frame, generation = arrived.frame, modem.config.firmware.generation
    time = ""
    if modem.timer.is_on:
        # The first sound's arrival. Frames act at a whole ms: this subtracts what the rounding added.
        began_us = 1000 * (now_ms - frame.duration_ms) - (-arrived.propagation_us % 1000)
        time = answers.timestamp(modem.timer.read_us(began_us))
    quality = answers.quality(arrived.snr_db, arrived.doppler) if modem.reports_quality else ""
    if frame.kind is FrameKind.BROADCAST:
        return answers.broadcast(generation, frame.source, frame.data, quality + time)
    if frame.kind in _DATA:
        return answers.unicast(generation, frame.data, quality + time)
    return answers.line(f"#F{frame.source:03}{time}") if frame.kind is FrameKind.BEACON else None


def _reply(modem: ModemCore, frame: ModemFrame, propagation_us: int) -> ModemFrame | None:
    generation = modem.config.firmware.generation
    if frame.kind in _REPLIES:
        return ModemFrame(_REPLIES[frame.kind], modem.address, frame.source, b"", generation, propagation_us)
    match frame.kind:
        case FrameKind.STATUS_REQUEST:
            data = answers.remote_report(modem.config.firmware, modem.supply_mv, modem.noise)
        case FrameKind.TEST_REQUEST:
            data = answers.TEST_TEXT
        case FrameKind.ECHO_REQUEST:
            data = frame.data
        case _:
            return None
    return ModemFrame(FrameKind.BROADCAST, modem.address, None, data, generation)


def _take_answer(modem: ModemCore, arrived: FrameArrived, now_ms: int) -> list[ModemAction]:
    question, frame = modem.question, arrived.frame
    if (
        question is None
        or question.awaited is not frame.kind
        or question.frame.destination != frame.source
        or question.until_ms is None
    ):
        return [FrameDropped(now_ms, "sound: an answer that is not waited for")]
    # Half of the round trip; both modems know the turnaround, which is taken off.
    steps = range_steps((frame.flight_us + arrived.propagation_us) / 2)
    modem.question = None
    if question.line is None:
        return [QuestionAnswered(now_ms, question.frame, steps)]
    if frame.kind is FrameKind.PROBE_REPLY:
        result = answers.impulse_response(question.name, frame.source, steps, arrived.echoes)
    else:
        result = answers.found(frame.source, steps)
    modem.answer(question.line, result)
    return []

"""A nanomodem: bytes on its serial line, frames in the water, and its state between them, moved by the three verbs.

Events that are due at one time go in this order: the end of a transmission, the end of a sound, a question's time-out, a
frame that waits to be sent, a measurement's end, received bytes, and printed answers. While the modem transmits, it reads
no bytes: they wait. A modem that is told to send while it receives sends, and loses the frame that was arriving.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum

from agents.modem import answers, command_handler, sending
from agents.modem.core import ModemCore
from agents.modem.facts import (
    EmitFrame,
    FrameArrived,
    FrameDropped,
    FrameRequested,
    ModemAction,
    ModemStimulus,
    NoiseChanged,
    PowerCame,
    PowerWent,
    QuestionAnswered,
    SerialBytes,
    SerialOut,
    SoundBegan,
    SupplyChanged,
)
from agents.modem.frames import ModemFrame
from agents.modem.receiving import receive_frame
from agents.modem.serial_line import TICKS_PER_MS
from agents.modem.states import RECEPTIVE, ModemState, ModemTrigger


class ModemTimer(IntEnum):
    """The events that a modem waits for; of those due at one time the first named goes first."""

    SENDING_ENDS = 0
    SOUND_ENDS = 1
    QUESTION_TIMES_OUT = 2
    FRAME_IS_DUE = 3
    MEASUREMENT_ENDS = 4
    INPUT = 5
    OUTPUT = 6


class Modem(ModemCore):
    """The three verbs."""

    @property
    def next_due_ms(self) -> int | None:
        """The time at which something may happen next. Until then bytes only gather."""
        dues = [*(due for due, _ in self._timers()), *(line.output_due_ms for line in self.lines)]
        if self._reads:
            dues += [line.wake_ms for line in self.lines]
        due_ms = min((due for due in dues if due is not None), default=None)
        return None if due_ms is None else max(self._now_ms, due_ms)

    def advance(self, now_ms: int) -> list[ModemAction]:
        """Lets time pass to `now_ms`, in order (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[ModemAction] = []
        while dues := [due for due in self._dues() if due[0] <= now_ms]:
            dues.sort()
            due_ms, timer, line_index = dues[0]
            self._now_ms = max(self._now_ms, due_ms)
            if timer is ModemTimer.INPUT:
                # Reads bytes up to the next other event, or to just before it if the event goes first at the same time.
                limits = [
                    due - ((other, line) < (ModemTimer.INPUT, line_index)) for due, other, line in dues[1:]
                ]
                actions += self._read(line_index, min([now_ms, *limits]))
            elif timer is ModemTimer.OUTPUT:
                actions.append(SerialOut(self._now_ms, self.lines[line_index].printed(), line_index))
            else:
                actions += self._fire(timer)
        self._now_ms = now_ms
        return actions

    def receive(self, stimulus: ModemStimulus, now_ms: int) -> list[ModemAction]:
        """Takes a fact at `now_ms`, after everything that was due by then."""
        actions = self.advance(now_ms)
        match stimulus:
            case SerialBytes():
                actions += self._take_bytes(stimulus)
            case FrameRequested(frame):
                actions += self._take_frame(frame)
            case SoundBegan(duration_ms):
                if self.state in RECEPTIVE:
                    self._sound_until_ms = max(self._sound_until_ms or 0, now_ms + duration_ms)
                    if self.state is ModemState.LISTENING:
                        actions += self.go(ModemTrigger.SOUND_BEGAN)
            case FrameArrived():
                actions += receive_frame(self, stimulus, now_ms)
            case SupplyChanged(supply_mv):
                self.supply_mv = supply_mv
            case NoiseChanged():
                self.noise = stimulus
            case PowerCame():
                if self.state is ModemState.OFF:
                    actions += self.go(ModemTrigger.POWER_CAME)
            case PowerWent():
                if self.state is not ModemState.OFF:
                    self._start_up()
                    for line in self.lines:
                        line.empty()
                    actions += self.go(ModemTrigger.POWER_WENT)
        return actions

    @property
    def _reads(self) -> bool:
        return self.state not in (ModemState.TRANSMITTING, ModemState.OFF)

    def _timers(self) -> tuple[tuple[int | None, ModemTimer], ...]:
        """Each timer but those of the serial lines, with its due time."""
        return (
            (None if self._sending is None else self._sending[0], ModemTimer.SENDING_ENDS),
            (self._sound_until_ms, ModemTimer.SOUND_ENDS),
            (None if self.question is None else self.question.until_ms, ModemTimer.QUESTION_TIMES_OUT),
            (self.waiting[0][0] if self.waiting and self._sending is None else None, ModemTimer.FRAME_IS_DUE),
            (None if self.measurement is None else self.measurement.until_ms, ModemTimer.MEASUREMENT_ENDS),
        )

    def _dues(self) -> list[tuple[int, ModemTimer, int]]:
        """(time, timer, line) of everything that has a due time."""
        dues = [(due, timer, 0) for due, timer in self._timers() if due is not None]
        for line_index, line in enumerate(self.lines):
            if self._reads and (due := line.input_due_ms) is not None:
                dues.append((due, ModemTimer.INPUT, line_index))
            if (due := line.output_due_ms) is not None:
                dues.append((due, ModemTimer.OUTPUT, line_index))
        return dues

    def _fire(self, timer: ModemTimer) -> list[ModemAction]:
        now_ms, question = self._now_ms, self.question
        if timer is ModemTimer.SENDING_ENDS:
            assert self._sending is not None
            if question is not None and question.frame is self._sending[1]:
                self.question = replace(question, until_ms=now_ms + self.config.answer_wait_ms)
            self._sending = None
            return self.go(ModemTrigger.SENDING_ENDED)
        if timer is ModemTimer.SOUND_ENDS:
            return self.go(ModemTrigger.SOUND_ENDED)
        if timer is ModemTimer.QUESTION_TIMES_OUT:
            assert question is not None
            self.question = None
            if question.line is None:
                return [QuestionAnswered(now_ms, question.frame, None)]
            self.answer(question.line, answers.TIME_OUT)
            return []
        if timer is ModemTimer.MEASUREMENT_ENDS:
            measurement, self.measurement = self.measurement, None
            assert measurement is not None
            self.answer(measurement.line, answers.measured(measurement.name, self.noise))
            return []
        return self._send_next()

    def _send_next(self) -> list[ModemAction]:
        now_ms = self._now_ms
        _, frame = self.waiting.pop(0)
        self._sending = (now_ms + frame.duration_ms, frame)
        return [*self.go(ModemTrigger.SENDING_BEGAN), EmitFrame(now_ms, frame)]

    def _take_bytes(self, written: SerialBytes) -> list[ModemAction]:
        if self.state is ModemState.OFF:
            return [FrameDropped(self._now_ms, "bytes for a modem without power")]
        lost = self.lines[written.line].write(written.data, self._now_ms, written.paused)
        return [FrameDropped(self._now_ms, "bytes beyond the serial line's buffer")] if lost else []

    def _take_frame(self, frame: ModemFrame) -> list[ModemAction]:
        reason = sending.why_not(self, frame.kind)
        if self.state in (ModemState.OFF, ModemState.SLEEPING):
            reason = f"the modem is {self.state.name.lower()}"
        if reason is not None:
            return [FrameDropped(self._now_ms, f"asked: {reason}")]
        if frame.kind in sending.AWAITED:
            self.ask("", frame, sending.AWAITED[frame.kind], None)
        self.send(frame, self._now_ms)
        return self._send_next() if self._sending is None and self.waiting[0][1] is frame else []

    def _read(self, line_index: int, until_ms: int) -> list[ModemAction]:
        if (read := self.lines[line_index].read(until_ms)) is None:
            return []
        tick, items = read
        at_ms = -(-tick // TICKS_PER_MS)
        # Bytes that waited for the end of a transmission are read then.
        tick = max(tick, (self._now_ms - 1) * TICKS_PER_MS + 1)
        self._now_ms = max(self._now_ms, at_ms)
        actions: list[ModemAction] = []
        for item in items:
            actions += command_handler.handle(self, item, line_index, tick, self._now_ms)
        return actions

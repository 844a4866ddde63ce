"""A nanomodem: bytes on its serial line, frames in the water, and its state between them, moved by the three verbs.

Of several things due at one time the end of a transmission goes first, then the end of a sound, a question's time-out, a
frame that waits to be sent, then bytes that came and at last answers that have left. While it transmits it reads no
bytes: they wait. Told to send while it receives, it sends, and what it was receiving is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from agents.modem import answers, asking, obeying
from agents.modem.facts import (
    Action,
    Answered,
    Asked,
    Dropped,
    EmitFrame,
    FrameArrived,
    NoiseChanged,
    PowerCame,
    PowerWent,
    SerialBytes,
    SerialOut,
    SoundBegan,
    StateChanged,
    Stimulus,
    SupplyChanged,
)
from agents.modem.firmware import ModemConfig
from agents.modem.frames import Frame, FrameKind
from agents.modem.hearing import hear
from agents.modem.serial_line import TICKS_PER_MS, SerialLine
from agents.modem.states import HEARING, SUPPLY_UA, ModemState, Trigger, next_state
from agents.modem.timer import MicrosecondTimer

_INPUT, _OUTPUT = 4, 5


@dataclass(frozen=True, slots=True)
class Question:
    """What a line asked and the water has not answered yet; `until_ms` is set when its last sound has left."""

    name: str
    frame: Frame
    awaited: FrameKind
    line: int | None
    """None: it was asked without a line."""
    until_ms: int | None = None


class Modem:
    """Powered from the start. `address` is kept over power-off and reset; whoever hosts the modem keeps it between runs."""

    def __init__(self, config: ModemConfig, address: int, now_ms: int = 0) -> None:
        self.config = config
        self.address = address
        self.state = ModemState.LISTENING
        self.supply_mv = config.supply_mv
        self.noise = NoiseChanged(0, 0, 0)
        self.lines = [SerialLine(config.firmware.generation) for _ in range(config.lines)]
        self.hearing_since_ms = now_ms
        """Since when it has been able to hear without a break; of no meaning while it cannot."""
        self._now_ms = now_ms
        self._drawn = (now_ms, 0)
        """When the state last changed, and what had been drawn by then."""
        self._start_up()

    def _start_up(self) -> None:
        """Every start forgets all but the address."""
        self.timer = MicrosecondTimer()
        self.tells_quality = False
        self.raises_rxs = False
        self.corrected: int | None = None
        self.question: Question | None = None
        self.waiting: list[tuple[int, Frame]] = []
        """Frames to be sent, each with its time, the next one first."""
        self._sending: tuple[int, Frame] | None = None
        self._sound_until_ms: int | None = None
        for line in self.lines:
            line.forget()

    def drawn_ua_ms(self, now_ms: int) -> int:
        """Charge drawn since the beginning, in microampere-milliseconds at 5 V: exact, whatever the windows."""
        since_ms, drawn = self._drawn
        return drawn + SUPPLY_UA[self.state] * (now_ms - since_ms)

    @property
    def next_due_ms(self) -> int | None:
        """When something may happen next. Until then bytes only gather."""
        dues = [*self._timers(), *(line.output_due_ms for line in self.lines)]
        if self._reads:
            dues += [line.wake_ms for line in self.lines]
        due_ms = min((due for due in dues if due is not None), default=None)
        return None if due_ms is None else max(self._now_ms, due_ms)

    def advance(self, now_ms: int) -> list[Action]:
        """Lets time pass to `now_ms`, in order (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[Action] = []
        while dues := [due for due in self._dues() if due[0] <= now_ms]:
            dues.sort()
            due_ms, which, number = dues[0]
            self._now_ms = max(self._now_ms, due_ms)
            if which == _INPUT:
                # Bytes up to whatever comes next of all else, which goes first at the same time if it is earlier in order.
                limits = [due - ((other, line) < (_INPUT, number)) for due, other, line in dues[1:]]
                actions += self._read(number, min([now_ms, *limits]))
            elif which == _OUTPUT:
                actions.append(SerialOut(self._now_ms, self.lines[number].printed(), number))
            else:
                actions += self._fire(which)
        self._now_ms = now_ms
        return actions

    def receive(self, stimulus: Stimulus, now_ms: int) -> list[Action]:
        """Takes a fact at `now_ms`, after everything that was due by then."""
        actions = self.advance(now_ms)
        match stimulus:
            case SerialBytes():
                actions += self._take_bytes(stimulus)
            case Asked(frame):
                actions += self._take_frame(frame)
            case SoundBegan(duration_ms):
                if self.state in HEARING:
                    self._sound_until_ms = max(self._sound_until_ms or 0, now_ms + duration_ms)
                    if self.state is ModemState.LISTENING:
                        actions += self.go(Trigger.SOUND_BEGAN)
            case FrameArrived():
                actions += hear(self, stimulus, now_ms)
            case SupplyChanged(supply_mv):
                self.supply_mv = supply_mv
            case NoiseChanged():
                self.noise = stimulus
            case PowerCame():
                if self.state is ModemState.OFF:
                    actions += self.go(Trigger.POWER_CAME)
            case PowerWent():
                if self.state is not ModemState.OFF:
                    self._start_up()
                    for line in self.lines:
                        line.empty()
                    actions += self.go(Trigger.POWER_WENT)
        return actions

    def answer(self, number: int, data: bytes, tick: int | None = None) -> None:
        """Prints on that line, from `tick` on or from now."""
        self.lines[number].answer(data, self._now_ms * TICKS_PER_MS if tick is None else tick)

    def ask(self, name: str, frame: Frame, awaited: FrameKind, line: int | None) -> None:
        """The frame is a question of that line, by the command `name`; it waits for an answer once it is sent."""
        self.question = Question(name, frame, awaited, line)

    def send(self, frame: Frame, at_ms: int) -> None:
        """Sends the frame at that time, or as soon after as nothing else is being sent."""
        self.waiting.append((at_ms, frame))
        self.waiting.sort(key=lambda it: it[0])

    def restart(self) -> list[Action]:
        self._start_up()
        return self.go(Trigger.RESET_TOLD)

    def fall_asleep(self) -> list[Action]:
        self.waiting.clear()
        self.question = None
        return self.go(Trigger.SLEEP_TOLD)

    def go(self, trigger: Trigger) -> list[Action]:
        """Changes the state by the table."""
        old, new = self.state, next_state(self.state, trigger)
        self._drawn = (self._now_ms, self.drawn_ua_ms(self._now_ms))
        self.state = new
        if new is not ModemState.RECEIVING:
            self._sound_until_ms = None
        if new in HEARING and (old not in HEARING or trigger is Trigger.RESET_TOLD):
            self.hearing_since_ms = self._now_ms
        return [StateChanged(self._now_ms, old, trigger, new)]

    @property
    def _reads(self) -> bool:
        return self.state not in (ModemState.TRANSMITTING, ModemState.OFF)

    def _timers(self) -> tuple[int | None, ...]:
        return (
            None if self._sending is None else self._sending[0],
            self._sound_until_ms,
            None if self.question is None else self.question.until_ms,
            self.waiting[0][0] if self.waiting and self._sending is None else None,
        )

    def _dues(self) -> list[tuple[int, int, int]]:
        """(time, which, line) of all that is due some time."""
        dues = [(due, which, 0) for which, due in enumerate(self._timers()) if due is not None]
        for number, line in enumerate(self.lines):
            if self._reads and (due := line.input_due_ms) is not None:
                dues.append((due, _INPUT, number))
            if (due := line.output_due_ms) is not None:
                dues.append((due, _OUTPUT, number))
        return dues

    def _fire(self, which: int) -> list[Action]:
        now_ms, question = self._now_ms, self.question
        if which == 0:
            assert self._sending is not None
            if question is not None and question.frame is self._sending[1]:
                self.question = replace(question, until_ms=now_ms + self.config.answer_wait_ms)
            self._sending = None
            return self.go(Trigger.SENDING_ENDED)
        if which == 1:
            return self.go(Trigger.SOUND_ENDED)
        if which == 2:
            assert question is not None
            self.question = None
            if question.line is None:
                return [Answered(now_ms, question.frame, None)]
            self.answer(question.line, answers.NOTHING_CAME)
            return []
        _, frame = self.waiting.pop(0)
        self._sending = (now_ms + frame.duration_ms, frame)
        return [*self.go(Trigger.SENDING_BEGAN), EmitFrame(now_ms, frame)]

    def _take_bytes(self, came: SerialBytes) -> list[Action]:
        if self.state is ModemState.OFF:
            return [Dropped(self._now_ms, "bytes for a modem without power")]
        lost = self.lines[came.line].write(came.data, self._now_ms, came.paused)
        return [Dropped(self._now_ms, f"{lost} bytes beyond the serial line's buffer")] if lost else []

    def _take_frame(self, frame: Frame) -> list[Action]:
        reason = asking.why_not(self, frame.kind)
        if self.state in (ModemState.OFF, ModemState.SLEEPING):
            reason = f"the modem is {self.state.name.lower()}"
        if reason is not None:
            return [Dropped(self._now_ms, f"asked: {reason}")]
        if frame.kind in asking.AWAITED:
            self.ask("", frame, asking.AWAITED[frame.kind], None)
        self.send(frame, self._now_ms)
        return self._fire(3) if self._sending is None and self.waiting[0][1] is frame else []

    def _read(self, number: int, until_ms: int) -> list[Action]:
        came = self.lines[number].read(until_ms)
        if came is None:
            return []
        tick, items = came
        at_ms = -(-tick // TICKS_PER_MS)
        # Bytes that waited for a transmission's end are read then.
        tick = max(tick, (self._now_ms - 1) * TICKS_PER_MS + 1)
        self._now_ms = max(self._now_ms, at_ms)
        actions: list[Action] = []
        for item in items:
            actions += obeying.obey(self, item, number, tick, self._now_ms)
        return actions

"""A modem's state and the basic acts that change it; the modules that receive, send and handle commands share them."""

from __future__ import annotations

from dataclasses import dataclass

from agents.modem.facts import ModemAction, ModemStateChanged, NoiseChanged
from agents.modem.frames import FrameKind, ModemFrame
from agents.modem.modem_model import ModemConfig
from agents.modem.serial_line import TICKS_PER_MS, SerialLine
from agents.modem.states import RECEPTIVE, SUPPLY_UA, ModemState, ModemTrigger, next_state

AHEAD_US = 2_000_000
"""A transmission can be put off by 2 s at most."""


MEASURING_MS = {"N": 1000, "S": 2000}
"""The time from a command until the noise, or its spectrum, is measured; the makers' driver waits about as long."""


class MicrosecondTimer:
    """The modem's 1 MHz timer, controlled over the serial line. At power-on it is off and reads 0."""

    def __init__(self) -> None:
        self.is_on = False
        self._base_us = 0
        """The clock's reading when the timer was 0; while the timer is off, minus the timer's reading."""

    def read_us(self, now_us: int) -> int:
        return now_us - self._base_us if self.is_on else -self._base_us

    def switch(self, on: bool, now_us: int) -> None:
        reading_us = self.read_us(now_us)
        self.is_on = on
        self._base_us = now_us - reading_us if on else -reading_us

    def clear(self, now_us: int) -> None:
        self._base_us = now_us if self.is_on else 0

    def wait_us(self, timer_us: int, now_us: int) -> int | None:
        """From now until the timer reads `timer_us`; None if that is past, or further ahead than a modem can plan."""
        wait_us = timer_us - self.read_us(now_us)
        return wait_us if 0 <= wait_us <= AHEAD_US else None


@dataclass(frozen=True, slots=True)
class PendingMeasurement:
    """A measurement of the noise, by the command `name` of a serial line."""

    name: str
    line: int
    until_ms: int


@dataclass(frozen=True, slots=True)
class PendingQuestion:
    """A frame that waits for its answer; `until_ms` is set when the frame's last sound has left."""

    name: str
    frame: ModemFrame
    awaited: FrameKind
    line: int | None
    """The serial line that asked; None for a host without a line."""
    until_ms: int | None = None


class ModemCore:
    """Powered from the start. `address` is kept over power-off and reset; the modem's host keeps it between runs."""

    def __init__(self, config: ModemConfig, address: int, now_ms: int = 0) -> None:
        self.config = config
        self.address = address
        self.state = ModemState.LISTENING
        self.supply_mv = config.supply_mv
        self.noise = NoiseChanged(0, 0, 0)
        self.lines = [SerialLine(config.firmware.generation) for _ in range(config.lines)]
        self.receptive_since_ms = now_ms
        """Since when it has been able to receive without a break; meaningless while it cannot."""
        self._now_ms = now_ms
        self._drawn = (now_ms, 0)
        """When the state last changed, and the charge drawn until then."""
        self._start_up()

    def _start_up(self) -> None:
        """Every start forgets all but the address."""
        self.timer = MicrosecondTimer()
        self.reports_quality = False
        self.raises_rxs = False
        self.corrected: int | None = None
        self.question: PendingQuestion | None = None
        self.measurement: PendingMeasurement | None = None
        self.waiting: list[tuple[int, ModemFrame]] = []
        """Frames to be sent, each with its time, the next one first."""
        self._sending: tuple[int, ModemFrame] | None = None
        self._sound_until_ms: int | None = None
        for line in self.lines:
            line.reset()

    def drawn_ua_ms(self, now_ms: int) -> int:
        """Charge drawn since the beginning, in microampere-milliseconds at 5 V: exact, whatever the windows."""
        since_ms, drawn = self._drawn
        return drawn + SUPPLY_UA[self.state] * (now_ms - since_ms)

    def answer(self, line_index: int, data: bytes, tick: int | None = None) -> None:
        """Prints on that line, from `tick` on or from now."""
        self.lines[line_index].answer(data, self._now_ms * TICKS_PER_MS if tick is None else tick)

    def ask(self, name: str, frame: ModemFrame, awaited: FrameKind, line: int | None) -> None:
        """Notes that the frame is a question of that line, by the command `name`. Its wait begins once it is sent."""
        self.question = PendingQuestion(name, frame, awaited, line)

    def measure(self, name: str, line: int, tick: int) -> None:
        """Begins to measure the noise, by the command `name` that was whole at `tick`."""
        self.measurement = PendingMeasurement(name, line, -(-tick // TICKS_PER_MS) + MEASURING_MS[name])

    def send(self, frame: ModemFrame, at_ms: int) -> None:
        """Sends the frame at that time, or as soon after as nothing else is being sent."""
        self.waiting.append((at_ms, frame))
        self.waiting.sort(key=lambda it: it[0])

    def restart(self) -> list[ModemAction]:
        self._start_up()
        return self.go(ModemTrigger.RESET_ORDERED)

    def fall_asleep(self) -> list[ModemAction]:
        self.waiting.clear()
        self.question = None
        self.measurement = None
        return self.go(ModemTrigger.SLEEP_ORDERED)

    def go(self, trigger: ModemTrigger) -> list[ModemAction]:
        """Changes the state by the table."""
        old, new = self.state, next_state(self.state, trigger)
        self._drawn = (self._now_ms, self.drawn_ua_ms(self._now_ms))
        self.state = new
        if new is not ModemState.RECEIVING:
            self._sound_until_ms = None
        if new in RECEPTIVE and (old not in RECEPTIVE or trigger is ModemTrigger.RESET_ORDERED):
            self.receptive_since_ms = self._now_ms
        return [ModemStateChanged(self._now_ms, old, trigger, new)]

"""Firmware whose code takes time: it exposes races that code without a duration hides."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from hashlib import blake2b

from firmware_model.actions import Action
from firmware_model.port import FirmwareLike, Level, Timer
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

FirmwareTurn = Callable[[int], list[Action]]


class CostlyFirmware:
    """Lets each turn of `program` act 0 to `cost_ms` after its cause, by a keyed hash of (seed, number of the turn).

    Turns queue: what happens during one waits for its end. Pins have the level of the time at which the turn acts.
    """

    def __init__(self, program: FirmwareLike, cost_ms: int, seed: int) -> None:
        self.program = program
        self._cost_ms = cost_ms
        self._seed = seed
        self._waiting: deque[tuple[int, FirmwareTurn]] = deque()
        """The interrupts that no turn has taken yet, with the time of each."""
        self._turns = 0
        self._free_ms = 0
        """The end of the last turn."""

    @property
    def state(self) -> State:
        return self.program.state

    @property
    def reset_cause(self) -> ResetCause | None:
        return self.program.reset_cause

    @property
    def watchdog_fired(self) -> bool:
        return self.program.watchdog_fired

    @property
    def clock_offset_ms(self) -> int:
        return self.program.clock_offset_ms

    def next_timer(self) -> tuple[int | None, Timer]:
        due_ms, timer = self.program.next_timer()
        if self._waiting and (due_ms is None or self._waiting[0][0] < due_ms):
            due_ms = self._waiting[0][0]
        return None if due_ms is None else max(due_ms, self._free_ms) + self._cost(), timer

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        due_ms, _ = self.program.next_timer()
        is_interrupt = self._waiting and (due_ms is None or self._waiting[0][0] < due_ms)
        self._turns += 1
        self._free_ms = now_ms
        return self._waiting.popleft()[1](now_ms) if is_interrupt else self.program.fire(timer, now_ms)

    def _cost(self) -> int:
        key = f"{self._seed} {self._turns}".encode()
        return int.from_bytes(blake2b(key, digest_size=4).digest(), "little") % (self._cost_ms + 1)

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        return self.program.start(cause, now_ms)

    def pin_changed(self, noticed: bool, now_ms: int) -> list[Action]:
        if not noticed:
            return self.program.pin_changed(noticed, now_ms)
        return self._interrupt(now_ms, lambda at_ms: self.program.pin_changed(True, at_ms))

    def depth_changed(self, now_ms: int) -> list[Action]:
        return self._interrupt(now_ms, self.program.depth_changed)

    def sound_received(self, data: bytes, now_ms: int) -> list[Action]:
        return self._interrupt(now_ms, lambda at_ms: self.program.sound_received(data, at_ms))

    def wifi_received(self, data: bytes, now_ms: int) -> list[Action]:
        return self._interrupt(now_ms, lambda at_ms: self.program.wifi_received(data, at_ms))

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        return self._interrupt(now_ms, lambda at_ms: self.program.level_reached(level, at_ms))

    def power_changed(self, now_ms: int) -> None:
        self.program.power_changed(now_ms)

    def clock_disturbed(self, now_ms: int) -> None:
        self.program.clock_disturbed(now_ms)

    def close(self) -> None:
        self.program.close()

    def _interrupt(self, now_ms: int, turn: FirmwareTurn) -> list[Action]:
        self._waiting.append((now_ms, turn))
        return []

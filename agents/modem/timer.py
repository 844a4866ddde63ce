"""The modem's 1 MHz timer: switched on and off, cleared and read over the serial line. Off and at 0 when power comes."""

from __future__ import annotations

AHEAD_US = 2_000_000
"""A transmission can be put off by 2 s at most."""


class MicrosecondTimer:
    def __init__(self) -> None:
        self.is_on = False
        self._base_us = 0
        """What the clock read when the timer was 0; while it is off, minus what it stands at."""

    def read_us(self, now_us: int) -> int:
        return now_us - self._base_us if self.is_on else -self._base_us

    def switch(self, on: bool, now_us: int) -> None:
        stands_us = self.read_us(now_us)
        self.is_on = on
        self._base_us = now_us - stands_us if on else -stands_us

    def clear(self, now_us: int) -> None:
        self._base_us = now_us if self.is_on else 0

    def wait_us(self, timer_us: int, now_us: int) -> int | None:
        """From now until the timer reads `timer_us`; None if that is past, or further ahead than a modem can plan."""
        wait_us = timer_us - self.read_us(now_us)
        return wait_us if 0 <= wait_us <= AHEAD_US else None

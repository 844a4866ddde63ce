"""The clock chip of an MU board: a crystal that runs a little fast or slow, with a cell of its own.

Everything is counted in whole milliseconds and parts of 10^9, so that a reading does not depend on how often it is taken.
A reset of the MU does not change the clock.
"""

from __future__ import annotations

from dataclasses import dataclass

BILLION = 10**9


@dataclass(slots=True)
class Clock:
    """The chip: it read `reading_ms` at agent time `anchor_ms`, and has gained `drift_ppb` parts of 10^9 since.

    Firmware can read it, set it and set its alarm; a defect can disturb it.
    """

    anchor_ms: int
    reading_ms: int
    drift_ppb: int

    def __post_init__(self) -> None:
        if abs(self.drift_ppb) >= BILLION:
            raise ValueError(f"a drift of {self.drift_ppb} of 10^9 is no clock's")

    def reading_at(self, now_ms: int) -> int:
        """The reading at agent time `now_ms`, rounded down; ValueError before the anchor."""
        elapsed_ms = now_ms - self.anchor_ms
        if elapsed_ms < 0:
            raise ValueError(f"time went back: {now_ms} before {self.anchor_ms}")
        return self.reading_ms + elapsed_ms + elapsed_ms * self.drift_ppb // BILLION

    def when(self, reading_ms: int) -> int:
        """The first agent time, from the anchor on, at which the clock reads `reading_ms` or more."""
        ahead_ms = reading_ms - self.reading_ms
        return self.anchor_ms + max(0, -(-ahead_ms * BILLION // (BILLION + self.drift_ppb)))

    def doubt_ms(self, now_ms: int, bound_ppb: int) -> int:
        """The largest error at `now_ms`, if a crystal of its kind drifts by up to `bound_ppb`; rounded up."""
        return -(-(now_ms - self.anchor_ms) * bound_ppb // BILLION)

    def set(self, reading_ms: int, now_ms: int) -> None:
        self.anchor_ms, self.reading_ms = now_ms, reading_ms

    def jump(self, by_ms: int, now_ms: int) -> None:
        """The reading changes by itself; no reading is negative."""
        self.set(max(0, self.reading_at(now_ms) + by_ms), now_ms)

    def skew(self, drift_ppb: int, now_ms: int) -> None:
        """The crystal has another drift from now on, until the board is reset."""
        self.set(self.reading_at(now_ms), now_ms)
        self.drift_ppb = drift_ppb
        self.__post_init__()

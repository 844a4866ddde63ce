"""Watches the aPad's reported charge, and says which reading to believe: the guards and the mission ask the same watch.

`mission/going_home.py` sends the aPad home, `guards.py` refuses a leg, and `supervisor/supervisor.py` ends the mission.
"""

from __future__ import annotations

from apad_bridge.vehicle.commands import BatteryReported

SUDDEN = 0.05
"""A charge that falls by more of a full battery from one reading to the next may be a fault of the sensor."""
DOUBTED_MS = 3_000
"""Such a fall, or a first reading of less than `SUDDEN`, counts when the readings say so for this long."""
AGE_MS = 30_000
"""An older reading tells nothing: one comes each second."""


class BatteryWatch:
    """Takes each reading; `believed` is the newest one that counts, None before the first."""

    def __init__(self) -> None:
        self.believed: BatteryReported | None = None
        self._newest: BatteryReported | None = None
        self._falls_since_ms: int | None = None
        """The time of the reading at which the charge fell in a way that does not count yet."""

    @property
    def doubts(self) -> bool:
        """True while the newest reading does not count."""
        return self._falls_since_ms is not None

    def take(self, reading: BatteryReported) -> bool:
        """Takes a reading; returns True if it counts. The same one again changes nothing."""
        if reading != self._newest:
            self._newest = reading
            self._judge(reading)
        return self.believed == reading

    def fraction(self, now_ms: int) -> float | None:
        """The believed charge, in [0, 1]; None where no reading of the last `AGE_MS` counts."""
        believed = self.believed
        return None if believed is None or now_ms - believed.at_ms > AGE_MS else believed.fraction

    def _judge(self, reading: BatteryReported) -> None:
        believed = self.believed
        is_sudden = (
            reading.fraction < SUDDEN if believed is None else believed.fraction - reading.fraction > SUDDEN
        )
        if is_sudden:
            if self._falls_since_ms is None:
                self._falls_since_ms = reading.at_ms
            if reading.at_ms - self._falls_since_ms < DOUBTED_MS:
                return
        self.believed, self._falls_since_ms = reading, None

"""The board's switches: turns rails on by the state, or for a time of their own, and sets the batteries' load."""

from __future__ import annotations

from firmware_model.actions import SetRail
from firmware_model.config import FullFirmware
from firmware_model.power.power_path import PowerPath
from firmware_model.power.rails import Rail, bits, rails_of
from firmware_model.states import State


class Switchboard:
    """The switches of all rails. `due_ms` is the time at which the next rail that is on for its own time goes off."""

    def __init__(self, whole: FullFirmware, batteries: PowerPath) -> None:
        self._whole = whole
        self._batteries = batteries
        self.rails = 0
        """The rails that are on, as bits."""
        self._pulses: dict[Rail, int] = {}
        self.due_ms: int | None = None

    def is_on(self, *rails: Rail) -> bool:
        """True if any of `rails` is on."""
        return self.rails & bits(*rails) != 0

    def pulse(self, rail: Rail, until_ms: int) -> None:
        """Keeps `rail` on until `until_ms` in any state; takes effect with `switch`."""
        self._pulses[rail] = until_ms

    def due(self, now_ms: int) -> None:
        """Drops the pulses that are over; takes effect with `switch`."""
        self._pulses = {rail: off_ms for rail, off_ms in self._pulses.items() if off_ms > now_ms}

    def switch(self, state: State, charger_on: bool, now_ms: int) -> list[SetRail]:
        """Switches the rails by the state and the pulses, and sets the batteries' charger and load."""
        whole = self._whole
        if state is State.LOST:
            self._pulses.clear()
        self.due_ms = min(self._pulses.values(), default=None)
        on = rails_of(state, whole.power.kept_on, whole.cycle is None, bits(*self._pulses))
        changed = on ^ self.rails
        self.rails = on
        self._batteries.set(charger_on, whole.power.loads.total(on), now_ms)
        return [SetRail(now_ms, rail, bool(on >> rail & 1)) for rail in Rail if changed >> rail & 1]

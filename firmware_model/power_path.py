"""Both batteries and what feeds the board: who charges, who is drawn on, and when that has to change."""

from __future__ import annotations

from enum import IntEnum

from firmware_model.charge import Battery, ChargeModel, Flow
from firmware_model.plan import PATH_UNIT, Power


class Feed(IntEnum):
    """The battery that the board lives on."""

    PRIMARY = 0
    SECONDARY = 1
    NEITHER = 2
    """Both are empty."""


class WorstCase:
    """The paper's choice (section IV-A): one battery, one load, the secondary's charging curve, the other kept full."""

    def __init__(self, model: ChargeModel, primary: Battery, secondary: Battery) -> None:
        self._model = model
        self.primary = primary
        self.secondary = secondary
        self.due_ms: int | None = None
        """Nothing about the batteries happens by itself: the board watches the one that it uses."""
        self.feed = Feed.PRIMARY

    def charge(self, charging: bool, now_ms: int) -> None:
        flow = Flow.CHARGING if charging else Flow.DISCHARGING
        if flow is not self.primary.flow:
            self.primary = self._model.settle(self.primary, now_ms, flow)


class PowerPath:
    """Two batteries with a charger each, two coils for the primary and one for the secondary, under a switched load.

    Charging, the battery that feeds the board loses the stated part of the load on the way; the other one loses nothing.
    """

    def __init__(
        self, model: ChargeModel, power: Power, primary: Battery, secondary: Battery, now_ms: int
    ) -> None:
        self._model = model
        self._power = power
        self.primary = primary
        self.secondary = secondary
        self.charging = primary.flow is Flow.CHARGING
        self.load = 0
        self.feed = self._fed_by(now_ms)
        self.due_ms: int | None = None
        """When `due` has to be called next."""

    def _fed_by(self, now_ms: int) -> Feed:
        """What a reset finds: the switch between the batteries stays where it was."""
        if self._model.charge_at(self.secondary, now_ms) > 0 and self.secondary.load > 0:
            return Feed.SECONDARY
        if self.charging or self._model.charge_at(self.primary, now_ms) > 0:
            return Feed.PRIMARY
        return Feed.SECONDARY if self._model.charge_at(self.secondary, now_ms) > 0 else Feed.NEITHER

    def set(self, charging: bool, load: int, now_ms: int) -> None:
        """From `now_ms` on the chargers are on or off, and the board draws `load` grains a millisecond."""
        if (charging, load) == (self.charging, self.load):
            return
        if charging and self.feed is Feed.NEITHER:
            self.feed = Feed.PRIMARY
        self.charging, self.load = charging, load
        self._settle(now_ms)

    def due(self, now_ms: int) -> Feed:
        """Switches over, or back; the battery that feeds the board from now on. Call it at `due_ms`."""
        if self.feed is Feed.SECONDARY and self.charging:
            self.feed = Feed.PRIMARY
        elif self.feed is Feed.PRIMARY and self._model.charge_at(self.secondary, now_ms) > 0:
            self.feed = Feed.SECONDARY
        else:
            self.feed = Feed.NEITHER
        self._settle(now_ms)
        return self.feed

    def safe_level_ms(self, now_ms: int) -> int | None:
        """From when on the backup battery, feeding the board, stands at its safe level or below."""
        if self.feed is not Feed.SECONDARY:
            return None
        found_ms = self._model.falls_to_at_ms(self.secondary, self._power.safe_level)
        return None if found_ms is None else max(now_ms, found_ms)

    def _settle(self, now_ms: int) -> None:
        load = self.load * self._power.path // PATH_UNIT if self.charging else self.load
        self.primary = self._flowing(self.primary, load if self.feed is Feed.PRIMARY else 0, 2, now_ms)
        self.secondary = self._flowing(self.secondary, load if self.feed is Feed.SECONDARY else 0, 1, now_ms)
        due_ms = self._next_due_ms()
        self.due_ms = None if due_ms is None else max(now_ms, due_ms)

    def _flowing(self, battery: Battery, load: int, coils: int, now_ms: int) -> Battery:
        unplugged = Flow.DISCHARGING if load else Flow.RESTING
        flow = Flow.CHARGING if self.charging else unplugged
        if (flow, load, coils) == (battery.flow, battery.load, battery.coils):
            return battery
        return Battery(now_ms, self._model.charge_at(battery, now_ms), flow, load, coils)

    def _next_due_ms(self) -> int | None:
        if self.feed is Feed.NEITHER:
            return None
        if not self.charging:
            feeding = self.primary if self.feed is Feed.PRIMARY else self.secondary
            return self._model.falls_to_at_ms(feeding, 0)
        if self.feed is Feed.SECONDARY:
            return self._model.reaches_at_ms(self.primary, self._power.switch_back)
        # Drawn on by more than its charger gives, the primary empties in the dock too: nothing to switch to that lasts.
        return None

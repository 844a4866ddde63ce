"""The power path between chargers, batteries and the board, the levels at which it changes, and a board's readings."""

from __future__ import annotations

from firmware_model.config import PATH_UNIT, Power
from firmware_model.hardware.voltage import Meter, Watch
from firmware_model.port import Level
from firmware_model.power.active_battery import ActiveBattery, without
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow


class PowerPath:
    """Two batteries with a charger each, two coils for the primary and one for the secondary, under a switched load.

    While charging, the stated part of the load reaches the feeding battery, and none of it the other one. With a
    `Metering`, the board concludes levels from readings (`firmware_model.hardware.voltage`); even so a battery ends at a
    charge of 0, because then its protection cuts it off.
    """

    def __init__(
        self,
        model: ChargeModel,
        power: Power,
        primary: Battery,
        secondary: Battery,
        now_ms: int,
        agent_id: int,
        levels: tuple[int, int, int] | None = None,
    ) -> None:
        """`levels` are the switch-back, safe and low levels, in grains; None for the configuration's."""
        self._model = model
        self._power = power
        self.primary = primary
        self.secondary = secondary
        self.charging = primary.flow is Flow.CHARGING
        self.load = 0
        self._levels = (0, *(levels or (power.switch_back, power.safe_level, power.low_level)))
        """Grains, in the order of `Level`."""
        self.feed = self._initial_feed(now_ms)
        self.safe_ms: int | None = None
        """The time since which the backup battery, feeding the board, is known to be at its safe level or below."""
        self._is_low = False
        self.due_ms: int | None = None
        """The time of the next call of `due`."""
        self._dues: tuple[tuple[int, Level], ...] = ()
        self._watches: dict[Level, Watch] = {}
        self._meter: Meter | None = None
        if power.metering is not None:
            self._meter = Meter(model, power.metering, agent_id)
            self._settled_ms = now_ms
            self._sampled = self._read(now_ms // power.metering.period_ms, now_ms)

    def _initial_feed(self, now_ms: int) -> ActiveBattery:
        """The feeding battery after a reset, in which the switch between the batteries stays where it was."""
        if self._model.charge_at(self.secondary, now_ms) > 0 and self.secondary.load > 0:
            return ActiveBattery.SECONDARY
        if self.charging or self._model.charge_at(self.primary, now_ms) > 0:
            return ActiveBattery.PRIMARY
        return (
            ActiveBattery.SECONDARY
            if self._model.charge_at(self.secondary, now_ms) > 0
            else ActiveBattery.NEITHER
        )

    def set(self, charging: bool, load: int, now_ms: int) -> None:
        """Switches the chargers on or off from `now_ms` on; the board then draws `load` grains a millisecond."""
        if (charging, load) == (self.charging, self.load):
            return
        self._count_samples(now_ms)
        if charging and self.feed is ActiveBattery.NEITHER:
            self.feed = ActiveBattery.PRIMARY
        if charging:
            self.safe_ms, self._is_low = None, False
        self.charging, self.load = charging, load
        self._settle(now_ms)

    def lose(self, primary: int, secondary: int, now_ms: int) -> None:
        """Takes these charges (grains) from both batteries at once, at most what they hold."""
        self._count_samples(now_ms)
        self.primary = without(self.primary, primary, self._model, now_ms)
        self.secondary = without(self.secondary, secondary, self._model, now_ms)
        self._settle(now_ms)

    def set_levels(self, levels: tuple[int, int, int], now_ms: int) -> None:
        """Sets other levels from `now_ms` on, in the order of the constructor."""
        self._count_samples(now_ms)
        self._levels = (0, *levels)
        self.safe_ms, self._is_low = None, False
        self._watches.clear()
        self._settle(now_ms)

    def due(self, now_ms: int) -> Level | None:
        """Returns the level that was reached, once; None if this was only a check in between. Call it at `due_ms`."""
        found = [
            level for due_ms, level in self._dues if due_ms <= now_ms and self._is_confirmed(level, now_ms)
        ]
        self._count_samples(now_ms)
        level = min(found, default=None)
        match level:
            case Level.EMPTIED:
                full = (
                    self.feed is ActiveBattery.PRIMARY and self._model.charge_at(self.secondary, now_ms) > 0
                )
                self.feed = ActiveBattery.SECONDARY if full else ActiveBattery.NEITHER
                self._watches.clear()
            case Level.SWITCH_BACK:
                self.feed = ActiveBattery.PRIMARY
                self._watches.clear()
            case Level.SAFE_LEVEL:
                self.safe_ms = now_ms
            case Level.LOW_LEVEL:
                self._is_low = True
        self._settle(now_ms)
        return level

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary as the monitor last sampled them, or as they are where nothing is metered; 0 to `FULL`."""
        if self._meter is None:
            return self._model.charge_at(self.primary, now_ms), self._model.charge_at(self.secondary, now_ms)
        n = now_ms // self._meter.metering.period_ms
        primary, secondary = self._sampled if self._is_sampled(n) else self._read(n, now_ms)
        return max(0, min(FULL, primary)), max(0, min(FULL, secondary))

    def _is_sampled(self, n: int) -> bool:
        assert self._meter is not None
        return n * self._meter.metering.period_ms <= self._settled_ms

    def _read(self, n: int, now_ms: int) -> tuple[int, int]:
        """Sample `n` of both batteries; a sample from before this board ran is taken at `now_ms`."""
        meter = self._meter
        assert meter is not None
        at_ms = max(n * meter.metering.period_ms, self._settled_ms)
        primary, secondary = (meter.voltage(battery, at_ms) for battery in (self.primary, self.secondary))
        return primary + meter.noise(0, n), secondary + meter.noise(1, n)

    def _count_samples(self, now_ms: int) -> None:
        """Counts all samples on the courses that end here."""
        if self._meter is None:
            return
        for level, watch in self._watches.items():
            watch.count(self._watched(level), now_ms)
        n = now_ms // self._meter.metering.period_ms
        if not self._is_sampled(n):
            self._sampled = self._read(n, now_ms)
        self._settled_ms = now_ms

    def _settle(self, now_ms: int) -> None:
        load = self.load * self._power.path // PATH_UNIT if self.charging else self.load
        self.primary = self._flowing(
            self.primary, load if self.feed is ActiveBattery.PRIMARY else 0, 2, now_ms
        )
        self.secondary = self._flowing(
            self.secondary, load if self.feed is ActiveBattery.SECONDARY else 0, 1, now_ms
        )
        wanted = self._active_levels()
        if self._meter is not None:
            self._watches = {
                level: self._watches.get(level) or self._watch(self._meter, level, now_ms) for level in wanted
            }
        dues = ((self._level_due_ms(level), level) for level in wanted)
        self._dues = tuple((max(now_ms, due_ms), level) for due_ms, level in dues if due_ms is not None)
        self.due_ms = min((due_ms for due_ms, _ in self._dues), default=None)

    def _flowing(self, battery: Battery, load: int, coils: int, now_ms: int) -> Battery:
        unplugged = Flow.DISCHARGING if load else Flow.RESTING
        flow = Flow.CHARGING if self.charging else unplugged
        if (flow, load, coils) == (battery.flow, battery.load, battery.coils):
            return battery
        return Battery(now_ms, self._model.charge_at(battery, now_ms), flow, load, coils)

    def _active_levels(self) -> tuple[Level, ...]:
        """The levels that matter in the present feed and charging state."""
        if self.feed is ActiveBattery.NEITHER:
            return ()
        if self.charging:
            # Under a load above the charger's output, the primary empties in the dock too: no other battery would last.
            return (Level.SWITCH_BACK,) if self.feed is ActiveBattery.SECONDARY else ()
        if self.feed is ActiveBattery.SECONDARY:
            return (Level.EMPTIED, Level.SAFE_LEVEL) if self.safe_ms is None else (Level.EMPTIED,)
        return (
            (Level.EMPTIED, Level.LOW_LEVEL)
            if self._levels[Level.LOW_LEVEL] and not self._is_low
            else (Level.EMPTIED,)
        )

    def _watched(self, level: Level) -> Battery:
        if level is Level.SAFE_LEVEL or (level is Level.EMPTIED and self.feed is ActiveBattery.SECONDARY):
            return self.secondary
        return self.primary

    def _watch(self, meter: Meter, level: Level, now_ms: int) -> Watch:
        which = 1 if self._watched(level) is self.secondary else 0
        return Watch(meter, which, self._levels[level], level is Level.SWITCH_BACK, now_ms)

    def _exact_ms(self, level: Level) -> int | None:
        battery, target = self._watched(level), self._levels[level]
        if level is Level.SWITCH_BACK:
            return self._model.reaches_at_ms(battery, target)
        return self._model.falls_to_at_ms(battery, target)

    def _level_due_ms(self, level: Level) -> int | None:
        if self._meter is None:
            return self._exact_ms(level)
        due_ms = self._watches[level].due_ms(self._watched(level))
        if level is not Level.EMPTIED:
            return due_ms
        empty_ms = self._exact_ms(level)
        return empty_ms if due_ms is None else due_ms if empty_ms is None else min(due_ms, empty_ms)

    def _is_confirmed(self, level: Level, now_ms: int) -> bool:
        if self._meter is None or (
            level is Level.EMPTIED and self._model.charge_at(self._watched(level), now_ms) == 0
        ):
            return True
        return self._watches[level].count(self._watched(level), now_ms)

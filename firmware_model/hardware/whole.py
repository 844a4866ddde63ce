"""The hardware of a whole board: rails with switches, two batteries, a charger for both, a clock, and settings in flash."""

from __future__ import annotations

from firmware_model.actions import Action, Buoyancy, RunBuoyancy, SetRail
from firmware_model.config import BoardConfig
from firmware_model.hardware.clock_chip import Clock
from firmware_model.hardware.power_path import PowerPath
from firmware_model.port import Level, Timer
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Battery
from firmware_model.power.rails import Rail, bits, powered
from firmware_model.settings import Settings, StoredSettings
from firmware_model.states import State
from firmware_model.stimuli import ClockJumped, ClockSkewed


class WholeBoardHardware:
    """`kept` holds the clock and the settings that outlived a reset; without it they are as delivered."""

    def __init__(
        self,
        config: BoardConfig,
        primary: Battery,
        secondary: Battery,
        now_ms: int,
        kept: StoredSettings | None,
    ) -> None:
        assert config.whole is not None
        self._config = config
        self._power = config.whole.power
        self.kept = kept
        # As delivered, the clock was set when the board was put into the water, at agent time 0.
        anchor_ms, reading_ms = (0, 0) if kept is None else (kept.anchor_ms, kept.reading_ms)
        self.clock = Clock(anchor_ms, reading_ms, config.drift_ppb)
        self.stored = Settings.of(config) if kept is None else kept.settings
        self._batteries = PowerPath(
            config.charge, self._power, primary, secondary, now_ms, config.agent_id, self.stored.levels
        )
        self.noise = 0
        """The defect of a converter: its readings are off by up to so many grains."""
        self.held: tuple[int, int] | None = None
        """The readings that a defect converter holds."""
        self.rails = 0
        """The rails that are on, as bits."""
        self._state_rails = 0
        """The rails that the firmware switched on."""
        self._pulses: dict[Rail, int] = {}
        """The rails that are on until a time of their own: motors, a modem that receives or sends, a short wake."""
        self._pulse_due_ms: int | None = None
        self.pin_high = False
        self.at_surface = False
        self._is_powered = True
        """False while the pin is high without a charger."""

    @property
    def primary(self) -> Battery:
        return self._batteries.primary

    @property
    def secondary(self) -> Battery:
        return self._batteries.secondary

    @property
    def feed(self) -> ActiveBattery:
        return self._batteries.feed

    @property
    def is_at_safe_level(self) -> bool:
        return self._batteries.safe_ms is not None

    @property
    def is_modem_listening(self) -> bool:
        return self.is_on(Rail.MODEM_LISTENING, Rail.MODEM_RECEIVING)

    @property
    def has_wifi(self) -> bool:
        return self.is_on(Rail.WIFI)

    def is_on(self, *rails: Rail) -> bool:
        """True if any of `rails` is on."""
        return self.rails & bits(*rails) != 0

    def clock_reads(self, now_ms: int) -> int:
        return self.clock.reading_at(now_ms)

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary as the battery monitor reads them, in grains."""
        if self.held is not None:
            return self.held
        read = self._batteries.readings(now_ms)
        if not self.noise:
            return read
        from firmware_model.hardware.converter import scattered

        return scattered(read, self.noise, self._config.agent_id, now_ms)

    def next_timer(self) -> tuple[int | None, Timer]:
        due_ms, pulse_ms = self._batteries.due_ms, self._pulse_due_ms
        if pulse_ms is not None and (due_ms is None or pulse_ms < due_ms):
            return pulse_ms, Timer.PULSE
        return due_ms, Timer.BATTERIES

    def level_due(self, now_ms: int) -> Level | None:
        return self._batteries.due(now_ms)

    def pulse_over(self, now_ms: int) -> list[Action]:
        self._pulses = {rail: off_ms for rail, off_ms in self._pulses.items() if off_ms > now_ms}
        return self._switch(now_ms)

    def power_on(self, pin_high: bool, at_surface: bool, now_ms: int) -> None:
        self.pin_high, self.at_surface, self._is_powered = pin_high, at_surface, True

    def pin_changed(self, high: bool, powered: bool, now_ms: int) -> list[Action]:
        """Another level of the pin. The chargers need no firmware: they run for as long as it is high."""
        self.pin_high = high
        if high:
            self._is_powered = powered
        return self._switch(now_ms)

    def enter(self, state: State, rails: int, now_ms: int) -> list[Action]:
        self._state_rails = rails
        if not rails:
            self._pulses.clear()
        return self._switch(now_ms)

    def run_motors(self, to: Buoyancy, depth_mm: int | None, now_ms: int) -> Action:
        """The motors draw their load from the next switching on: a state that runs them is entered with `enter`."""
        self._pulses[Rail.MOTORS] = now_ms + self._power.motor_run_ms
        return RunBuoyancy(now_ms, to, depth_mm)

    def stay_awake(self, until_ms: int, now_ms: int) -> list[Action]:
        self._pulses[Rail.MU_ACTIVE] = until_ms
        return self._switch(now_ms)

    def receive_packet(self, now_ms: int) -> list[Action]:
        self._pulses[Rail.MODEM_RECEIVING] = now_ms + self._power.receive_ms
        return self._switch(now_ms)

    def transmit(self, lasting_ms: int, now_ms: int) -> list[Action]:
        """The modem sends for so long, or for longer if it is sending already."""
        until_ms = self._pulses.get(Rail.MODEM_TRANSMITTING, 0)
        self._pulses[Rail.MODEM_TRANSMITTING] = max(until_ms, now_ms + lasting_ms)
        return self._switch(now_ms)

    def watch_levels(self, levels: tuple[int, int, int], now_ms: int) -> None:
        self._batteries.set_levels(levels, now_ms)

    def store(self, settings: Settings) -> None:
        """Writes the settings; the clock's own registers are kept with them."""
        self.stored = settings
        self.kept = StoredSettings(self.clock.anchor_ms, self.clock.reading_ms, settings)

    def lose(self, primary: int, secondary: int, now_ms: int) -> None:
        """Takes these charges (grains) from both batteries at once, at most what they hold."""
        self._batteries.lose(primary, secondary, now_ms)

    def disturb_clock(self, defect: ClockJumped | ClockSkewed, now_ms: int) -> str | None:
        """Returns None: the defect has an effect on a board with a clock."""
        if isinstance(defect, ClockJumped):
            self.clock.jump(defect.by_ms, now_ms)
        else:
            self.clock.skew(self._config.drift_ppb + defect.skew_ppb, now_ms)
        self.store(self.stored)
        return None

    def _switch(self, now_ms: int) -> list[Action]:
        """Switches the rails by the firmware's wish and the pulses, and sets the batteries' charger and load."""
        self._pulse_due_ms = min(self._pulses.values(), default=None)
        on = powered(self._state_rails, self._power.kept_on, bits(*self._pulses))
        changed = on ^ self.rails
        self.rails = on
        self._batteries.set(self.pin_high and self._is_powered, self._power.loads.total(on), now_ms)
        return [SetRail(now_ms, rail, bool(on >> rail & 1)) for rail in Rail if changed >> rail & 1]

"""The hardware of the paper's worst case (section IV-A): one battery, one load, the secondary's charging curve."""

from __future__ import annotations

from copy import copy

from firmware_model.actions import Action, Buoyancy, MotorsStalled, RunBuoyancy
from firmware_model.config import BoardConfig
from firmware_model.port import Level, Timer
from firmware_model.power.active_battery import ActiveBattery, after_motor_run, without
from firmware_model.power.charge import FULL, Battery, Flow
from firmware_model.states import State
from firmware_model.stimuli import ClockJumped, ClockSkewed


class WorstCaseHardware:
    """Its primary battery feeds the board; the secondary gives a motor run what the primary lacks.

    The charger feeds the primary. Where motor runs cost charge, it fills the secondary too, since the paper's docks charge
    both batteries at once. Where they cost none, the secondary stays as it is.
    """

    def __init__(self, config: BoardConfig, primary: Battery, secondary: Battery) -> None:
        self._config = config
        self.primary = primary
        self.secondary = secondary
        self.feed = ActiveBattery.PRIMARY
        self.pin_high = False
        self.at_surface = False
        self.noise = 0
        """The defect of a converter: its readings are off by up to so many grains."""
        self.held: tuple[int, int] | None = None
        """The readings that a defect converter holds."""
        self._is_powered = True
        """False while the pin is high without a charger."""
        self._watch_from_ms: int | None = None
        """Since when the monitor's interrupt of an empty battery is armed."""
        self._charger_on = False
        """The firmware lets the charger run."""
        self._contact_until_ms: int | None = None
        """When a charger without a contact stops, whatever the firmware does; None while there is a contact."""
        self._loaded_from_ms: int | None = None
        """When the board's load begins at the latest, whether or not its firmware has ever set the charger's switch; None
        before the power comes on."""

    def copy(self) -> WorstCaseHardware:
        return copy(self)

    rails = 0
    is_modem_listening = True
    has_wifi = True
    kept = None

    def clock_reads(self, now_ms: int) -> int:
        """The clock of the worst case is exact."""
        return now_ms

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary charge, in grains: the worst case measures them exactly, unless its converter is defect."""
        if self.held is not None:
            return self.held
        charge = self._config.charge
        exact = charge.charge_at(self.primary, now_ms), charge.charge_at(self.secondary, now_ms)
        if not self.noise:
            return exact
        # Imported here: few converters are defect, and every memory page of an agent counts.
        from firmware_model.hardware.converter import scattered

        return scattered(exact, self.noise, self._config.agent_id, now_ms)

    def next_timer(self) -> tuple[int | None, Timer]:
        if self.primary.flow is Flow.RESTING:
            return self._loaded_from_ms, Timer.PULSE
        due_ms = None
        if self._watch_from_ms is not None:
            due_ms = self._config.charge.empty_at_ms(self.primary)
            due_ms = None if due_ms is None else max(self._watch_from_ms, due_ms)
        until_ms = self._contact_until_ms
        if (
            until_ms is not None
            and self.primary.flow is Flow.CHARGING
            and (due_ms is None or until_ms < due_ms)
        ):
            return until_ms, Timer.PULSE
        return due_ms, Timer.BATTERIES

    def level_due(self, now_ms: int) -> Level:
        """The battery is empty: the monitor interrupts once."""
        self._watch_from_ms = None
        return Level.EMPTIED

    def pulse_over(self, now_ms: int) -> list[Action]:
        """The boot is over, or the contact has been gone for longer than firmware needs to notice."""
        self.set_charger(False, now_ms)
        return []

    def power_on(self, pin_high: bool, at_surface: bool, now_ms: int) -> None:
        self.pin_high, self.at_surface, self._is_powered = pin_high, at_surface, True
        self._loaded_from_ms = now_ms + self._config.boot_ms + 1
        if pin_high:
            self._contact_until_ms = None
        else:
            # A charger that ran stays on, and the firmware finds the lost contact when it has booted.
            ran = self.primary.flow is Flow.CHARGING
            self._contact_until_ms = now_ms + self._config.boot_ms + 1 if ran else now_ms

    def pin_changed(self, high: bool, powered: bool, now_ms: int) -> list[Action]:
        """Another level of the pin. The charger waits for the firmware, which debounces the pin or finds a missed edge."""
        self.pin_high = high
        if high:
            self._is_powered = powered
            self._contact_until_ms = None
            if self._charger_on:
                self.set_charger(True, now_ms)
        elif self._contact_until_ms is None:
            config = self._config
            self._contact_until_ms = now_ms + config.pin_check_ms + config.pin_chatter_ms
        return []

    def enter(self, state: State, rails: int, now_ms: int) -> list[Action]:
        """The charger runs in the dock, and the monitor interrupts only a board that measures."""
        if state is not State.BOOTING:
            self.set_charger(state is State.CHARGING, now_ms)
        self.watch_battery(state is State.ACTIVE, now_ms)
        return []

    def set_charger(self, on: bool, now_ms: int) -> None:
        """Lets the charger feed the battery, if it has power and a contact."""
        self._charger_on = on
        until_ms = self._contact_until_ms
        is_fed = on and self._is_powered and (until_ms is None or now_ms < until_ms)
        flow = Flow.CHARGING if is_fed else Flow.DISCHARGING
        if flow is not self.primary.flow:
            self.primary = self._config.charge.settle(self.primary, now_ms, flow)
        charge = self._config.charge.charge_at(self.secondary, now_ms)
        is_filling = is_fed and self._config.motor_run > 0 and charge < FULL
        backup = Flow.CHARGING if is_filling else Flow.RESTING
        if backup is not self.secondary.flow:
            self.secondary = self._config.charge.settle(self.secondary, now_ms, backup)

    def watch_battery(self, on: bool, now_ms: int) -> None:
        """Arms the monitor's interrupt of an empty battery."""
        self._watch_from_ms = now_ms if on else None

    def run_motors(self, to: Buoyancy, depth_mm: int | None, now_ms: int) -> Action:
        """Takes the charge of a run at once, from the primary as far as it reaches; without that charge nothing runs."""
        if self._config.motor_run:
            left = after_motor_run(
                self.primary, self.secondary, self._config.motor_run, self._config.charge, now_ms
            )
            if left is None:
                return MotorsStalled(now_ms, to)
            self.primary, self.secondary = left
        return RunBuoyancy(now_ms, to, depth_mm)

    def receive_packet(self, now_ms: int) -> list[Action]:
        return []

    def transmit(self, lasting_ms: int, now_ms: int) -> list[Action]:
        """The modem sends. The worst case has one load, whatever its modem does."""
        return []

    def lose(self, primary: int, secondary: int, now_ms: int) -> None:
        """Takes these charges (grains) from both batteries at once, at most what they hold."""
        self.primary = without(self.primary, primary, self._config.charge, now_ms)
        self.secondary = without(self.secondary, secondary, self._config.charge, now_ms)
        if self._watch_from_ms is not None:
            self._watch_from_ms = now_ms

    def disturb_clock(self, defect: ClockJumped | ClockSkewed, now_ms: int) -> str | None:
        """Returns the reason why the defect has no effect."""
        return "a defect of the clock: the worst case has none"

"""The MU board: its hardware with a program on it, driven by the three verbs in agent time."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, Any

from firmware_model.actions import Action, Dropped
from firmware_model.base_firmware import Firmware
from firmware_model.config import BoardConfig
from firmware_model.hardware.worst_case import WorstCaseHardware
from firmware_model.packets.codec import Codec
from firmware_model.port import FirmwareLike, Timer
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Battery
from firmware_model.states import State
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    ChargeVanished,
    ClockJumped,
    ClockSkewed,
    ConverterDisturbed,
    ModemSpoke,
    PacketHeard,
    PowerCameOn,
    ResetCause,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)

if TYPE_CHECKING:
    from firmware_model.hardware.whole import WholeBoardHardware
    from firmware_model.settings import StoredSettings


MakeFirmware = Callable[[Any], FirmwareLike]
"""Makes another program than ours for this hardware: a WorstCaseHardware or a WholeBoardHardware, by the configuration."""


class Board:
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries go on whether it runs or not.

    It passes facts from outside to the hardware first and then to the firmware, and lets the timers of both fire in order.
    """

    _hardware: WorstCaseHardware | WholeBoardHardware
    firmware: FirmwareLike

    def __init__(
        self,
        config: BoardConfig,
        codec: Codec,
        primary: Battery,
        secondary: Battery,
        now_ms: int,
        kept: StoredSettings | None = None,
        firmware: MakeFirmware | None = None,
    ) -> None:
        """`kept` holds the clock and settings of a whole board that outlived a reset; without it they are as delivered.

        `firmware` makes another program than ours.
        """
        self.config = config
        self._now_ms = now_ms
        self._was_dark = False
        """A charger feeds the board again, after neither battery did."""
        if config.whole is None:
            self._hardware = worst = WorstCaseHardware(config, primary, secondary)
            self.firmware = Firmware(config, codec, worst, now_ms) if firmware is None else firmware(worst)
        else:
            # Imported here: a fleet in the worst case does not need it, and every memory page of an agent counts.
            from firmware_model.hardware.whole import WholeBoardHardware

            self._hardware = whole = WholeBoardHardware(config, primary, secondary, now_ms, kept)
            if firmware is None:
                from firmware_model.whole_firmware import WholeFirmware

                self.firmware = WholeFirmware(config, codec, whole, now_ms)
            else:
                self.firmware = firmware(whole)

    def copy(self) -> Board:
        """A board in the same state that goes on by itself. TypeError for a whole board, whose log is not its own."""
        if not isinstance(self._hardware, WorstCaseHardware) or not isinstance(self.firmware, Firmware):
            raise TypeError("neither a whole board nor firmware in a process of its own can be copied")
        other = copy(self)
        other._hardware = hardware = self._hardware.copy()
        other.firmware = self.firmware.copy(hardware)
        return other

    @property
    def state(self) -> State:
        return self.firmware.state

    @property
    def reset_cause(self) -> ResetCause | None:
        return self.firmware.reset_cause

    @property
    def reset_due(self) -> ResetCause | None:
        """The cause of the reset that is due: its watchdog fired, or its power came back; None for none."""
        if self._was_dark:
            return ResetCause.BROWN_OUT
        return ResetCause.WATCHDOG if self.firmware.watchdog_fired else None

    @property
    def primary(self) -> Battery:
        return self._hardware.primary

    @property
    def secondary(self) -> Battery:
        return self._hardware.secondary

    @property
    def feed(self) -> ActiveBattery:
        """The battery that feeds the board."""
        return self._hardware.feed

    @property
    def rails(self) -> int:
        """The rails that are on, as bits; always 0 in the worst case, which has one load only."""
        return self._hardware.rails

    @property
    def is_modem_listening(self) -> bool:
        """True while the modem listens; in the worst case always."""
        return self._hardware.is_modem_listening

    @property
    def has_wifi(self) -> bool:
        """True while Wi-Fi is on; in the worst case always."""
        return self._hardware.has_wifi

    @property
    def kept(self) -> StoredSettings | None:
        """The settings that outlive a reset; None for a board that has received no setting and no time yet."""
        return self._hardware.kept

    @property
    def clock_offset_ms(self) -> int:
        """The clock minus the last beacon's time; within 32 bits."""
        return self.firmware.clock_offset_ms

    def clock_ms(self, now_ms: int) -> int:
        """The reading of the board's own clock; in the paper's worst case it is exact."""
        return self._hardware.clock_reads(now_ms)

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary charge as the board knows them, in grains: the monitor's last samples."""
        return self._hardware.readings(now_ms)

    @property
    def next_due_ms(self) -> int | None:
        """The time of the board's next timer; those due together fire in the order of `Timer`."""
        return self._next()[0]

    @property
    def _is_running(self) -> bool:
        """False while no code runs, for want of power."""
        return self.firmware.state is not State.LOST or self._hardware.feed is not ActiveBattery.NEITHER

    def _next(self) -> tuple[int | None, Timer]:
        found = self._hardware.next_timer()
        # Asked here as well as by the property: boards do this more often than anything else.
        if self.firmware.state is State.LOST and not self._is_running:
            return found
        due_ms, timer = self.firmware.next_timer()
        if found[0] is None or (due_ms is not None and (due_ms, timer) < found):
            return due_ms, timer
        return found

    def advance(self, now_ms: int) -> list[Action]:
        """Fires every timer that is due by `now_ms`, in order, each at its own time (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[Action] = []
        while True:
            due_ms, timer = self._next()
            if due_ms is None or due_ms > now_ms:
                break
            self._now_ms = due_ms
            actions += self._fire(timer, due_ms)
        self._now_ms = now_ms
        return actions

    def _fire(self, timer: Timer, now_ms: int) -> list[Action]:
        if timer is Timer.BATTERIES:
            return self.firmware.level_reached(self._hardware.level_due(now_ms), now_ms)
        if timer is Timer.PULSE:
            return self._switched(self._hardware.pulse_over(now_ms), now_ms)
        return self.firmware.fire(timer, now_ms)

    def _switched(self, actions: list[Action], now_ms: int) -> list[Action]:
        """Power that changed without the firmware, which may depend on it."""
        self.firmware.power_changed(now_ms)
        return actions

    def receive(self, stimulus: Stimulus, now_ms: int) -> list[Action]:
        """Takes a fact from outside at `now_ms`, after every timer that was due by then."""
        actions = self.advance(now_ms)
        hardware, firmware = self._hardware, self.firmware
        match stimulus:
            case ChargePinRose(noticed, powered):
                was_running = self._is_running
                actions += hardware.pin_changed(True, powered, now_ms)
                actions += firmware.pin_changed(noticed, now_ms) if was_running else []
                self._was_dark = not was_running and self._is_running
            case ChargePinFell(noticed):
                actions += hardware.pin_changed(False, False, now_ms)
                actions += firmware.pin_changed(noticed, now_ms) if self._is_running else []
            case PacketHeard(data):
                if hardware.is_modem_listening:
                    actions += self._switched(hardware.receive_packet(now_ms), now_ms)
                    actions += firmware.sound_received(data, now_ms)
                else:
                    actions.append(Dropped(now_ms, "the modem is not listening"))
            case ModemSpoke(lasting_ms):
                # The firmware sleeps on, but the modem draws its load; while it transmits it receives nothing.
                actions += self._switched(hardware.transmit(lasting_ms, now_ms), now_ms)
            case WifiReceived(data):
                if hardware.has_wifi:
                    actions += firmware.wifi_received(data, now_ms)
                else:
                    actions.append(Dropped(now_ms, "Wi-Fi is off"))
            case SurfaceReached() | BottomReached():
                hardware.at_surface = isinstance(stimulus, SurfaceReached)
                actions += firmware.depth_changed(now_ms) if self._is_running else []
            case PowerCameOn(cause, at_surface, pin_high):
                hardware.power_on(pin_high, at_surface, now_ms)
                actions += firmware.start(cause, now_ms)
            case ChargeVanished(primary, secondary):
                hardware.lose(primary, secondary, now_ms)
            case ConverterDisturbed(noise, holds):
                hardware.held = hardware.readings(now_ms) if holds else None
                hardware.noise = noise
            case ClockJumped() | ClockSkewed():
                reason = hardware.disturb_clock(stimulus, now_ms)
                firmware.clock_disturbed(now_ms)
                actions += [] if reason is None else [Dropped(now_ms, reason)]
        return actions

"""The firmware of an MU board: its state machine, timers and commands, behind `firmware_model.port`.

`Firmware` is the part that every board has. Alone it is the paper's worst case: one battery in use, one load, never asleep.
`firmware_model.whole_firmware` adds the rest. `actions.py` names the states that report, and `deadlines.py` has the times.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING

from firmware_model.actions import MOTORS, REPORTS, Action, Dropped, SendStatus, StateChanged
from firmware_model.config import BoardConfig
from firmware_model.packets import Command, Kind
from firmware_model.packets.codec import Codec
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.packets.commands import parse_command
from firmware_model.port import Hardware, Level, Timer
from firmware_model.power.charge_pin import ChargePin, Edge, PinFault
from firmware_model.power.rails import RAILS, Rail
from firmware_model.states import TABLE, State, Trigger, TriggerRefused, next_state
from firmware_model.stimuli import ResetCause

if TYPE_CHECKING:
    from firmware_model.deadlines import Deadline

_DOCKED = (State.CHARGING, State.REPORTING)


class Firmware:
    """The program on one MU board. It is OFF until `start`."""

    watchdog_fired = False

    def __init__(self, config: BoardConfig, codec: Codec, hardware: Hardware, now_ms: int) -> None:
        self.config = config
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self._codec = codec
        self._hardware = hardware
        self._now_ms = now_ms
        self._pin = ChargePin(config.pin_debounce_ms, False, config.pin_chatter_ms, config.pin_check_ms)
        self._clear_to_sink = False
        self._deadline: Deadline | None = None

    def copy(self, hardware: Hardware) -> Firmware:
        """The program in the same state on another board; the worst case alone can be copied."""
        other = copy(self)
        other._hardware, other._pin = hardware, copy(self._pin)
        return other

    @property
    def clock_offset_ms(self) -> int:
        """The clock minus the last beacon's time; within 32 bits."""
        return 0

    def next_timer(self) -> tuple[int | None, Timer]:
        """The next timer and its time; only the pin and the deadline of a state are the worst case's."""
        due_ms = self._pin.next_due_ms
        if self._deadline is not None and (due_ms is None or self._deadline[0] < due_ms):
            return self._deadline[0], Timer.DEADLINE
        return due_ms, Timer.PIN

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        """Takes the timer that is due."""
        self._now_ms = now_ms
        if timer is Timer.PIN:
            edge, fault = self._pin.due(now_ms)
            faults: list[Action] = [] if fault is None else [Dropped(now_ms, fault.value)]
            return faults if edge is None else faults + self._pin_edge(edge)
        assert self._deadline is not None
        (_, trigger), self._deadline = self._deadline, None
        if trigger is Trigger.SURFACING_TIMED_OUT:
            return [
                Dropped(now_ms, "a surfacing: it did not come up in time"),
                *self._deadline_reached(trigger),
            ]
        return self._deadline_reached(
            self._boot_trigger() if trigger is Trigger.BOOTED_ON_BOTTOM else trigger
        )

    def _deadline_reached(self, trigger: Trigger) -> list[Action]:
        """Ends the state after its own time."""
        return self._apply(trigger)

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        """The MCU left reset."""
        self._now_ms = now_ms
        self.reset_cause = cause
        self._pin.restart(self._hardware.pin_high, now_ms)
        return self._apply(Trigger.POWER_CAME_ON)

    def pin_changed(self, noticed: bool, now_ms: int) -> list[Action]:
        """Reads the charger's pin; `noticed` is False if the edge's interrupt was lost, and then a timer finds it."""
        self._now_ms = now_ms
        if noticed:
            self._pin.level(self._hardware.pin_high, now_ms)
        else:
            self._pin.level_unseen(self._hardware.pin_high, now_ms)
        return []

    def depth_changed(self, now_ms: int) -> list[Action]:
        """The pressure sensor noticed the surface or the bottom."""
        self._now_ms = now_ms
        return self._apply(Trigger.SURFACE_REACHED if self._hardware.at_surface else Trigger.BOTTOM_REACHED)

    def sound_received(self, data: bytes, now_ms: int) -> list[Action]:
        self._now_ms = now_ms
        return self._command(data)

    def wifi_received(self, data: bytes, now_ms: int) -> list[Action]:
        self._now_ms = now_ms
        return self._command(data)

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        """The battery monitor's interrupt. The worst case arms it for a board that measures."""
        self._now_ms = now_ms
        return self._apply(Trigger.BATTERY_EMPTIED)

    def power_changed(self, now_ms: int) -> None:
        """Rails or charger changed without the firmware. The worst case does not notice."""

    def clock_disturbed(self, now_ms: int) -> None:
        """The clock's reading or rate changed by itself. The worst case has none."""

    def close(self) -> None:
        """It has nothing outside of the board."""

    def _pinged(self) -> list[Action]:
        """Takes a ping. The worst case does not answer by sound."""
        return []

    def _command(self, data: bytes) -> list[Action]:
        command = parse_command(data, self._codec, self.config)
        return [Dropped(self._now_ms, command)] if isinstance(command, str) else self._execute(command)

    def _execute(self, command: Command) -> list[Action]:
        if command.kind is Kind.RELEASE and self.state in _DOCKED:
            # The packet and the contact are independent: the packet may come before the falling edge is certain.
            self._clear_to_sink = True
            return []
        return self._apply(TRIGGERS[command.kind])

    def _pin_edge(self, edge: Edge) -> list[Action]:
        if self.state in (State.OFF, State.BOOTING):
            return []  # the board reads the level again after it has booted
        if edge is Edge.ROSE:
            self._clear_to_sink = False
            return self._apply(Trigger.CHARGE_EDGE_ROSE)
        actions = self._apply(Trigger.CHARGE_EDGE_FELL)
        if self._clear_to_sink and self.state is State.RELEASED:
            actions += self._apply(Trigger.CLEAR_TO_SINK)
        return actions

    def _boot_trigger(self) -> Trigger:
        if self._pin.high:
            return Trigger.BOOTED_ON_CHARGER
        return Trigger.BOOTED_AT_SURFACE if self._hardware.at_surface else Trigger.BOOTED_ON_BOTTOM

    def _apply(self, trigger: Trigger) -> list[Action]:
        old = self.state
        try:
            self.state = next_state(old, trigger)
        except TriggerRefused as refusal:
            return [Dropped(self._now_ms, str(refusal))]
        follows = self._pinged() if trigger is Trigger.PING_HEARD else self._enter()
        return [StateChanged(self._now_ms, old, trigger, self.state), *follows]

    def _apply_if_allowed(self, trigger: Trigger) -> list[Action]:
        return self._apply(trigger) if (self.state, trigger) in TABLE else []

    def _enter(self) -> list[Action]:
        """Sets the motors, the switches and the deadline for the state just entered."""
        state, now_ms = self.state, self._now_ms
        actions: list[Action] = []
        if state in MOTORS:
            actions.append(self._hardware.run_motors(MOTORS[state], self._hover_mm(), now_ms))
        actions += self._switch()
        self._deadline = self._deadline_of(state, now_ms)
        if state in REPORTS:
            actions += self._report(REPORTS[state])
        if not RAILS[state] >> Rail.MU_ASLEEP & 1 and self._pin.sample_level(now_ms):
            actions.append(Dropped(now_ms, PinFault.MISSED.value))
        return actions

    def _hover_mm(self) -> int | None:
        """The depth of a motor run that has one. The worst case does not hover."""
        return None

    def _switch(self) -> Sequence[Action]:
        """Sets the board's switches for the state just entered."""
        return self._hardware.enter(self.state, RAILS[self.state], self._now_ms)

    def _report(self, by: Rail) -> list[Action]:
        return [SendStatus(self._now_ms, by)]

    def _deadline_of(self, state: State, now_ms: int) -> Deadline | None:
        """The time at which `state`, entered at `now_ms`, ends by itself; None if only a fact from outside ends it."""
        config = self.config
        match state:
            case State.BOOTING:
                return now_ms + config.boot_ms, Trigger.BOOTED_ON_BOTTOM
            case State.SURFACING:
                return now_ms + config.surfacing_timeout_ms, Trigger.SURFACING_TIMED_OUT
            case State.FLOATING:
                return now_ms + config.float_timeout_ms, Trigger.FLOAT_TIMED_OUT
            case State.RELEASED:
                return now_ms + config.release_wait_ms, Trigger.CLEAR_TO_SINK
        return None

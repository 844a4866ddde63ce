"""The MU board: its state machine, its batteries and its timers, moved by the three verbs in agent time.

`Board` is what every board has, and with it the paper's worst case: one battery in use, one load, never asleep.
`firmware_model.whole_board` adds the rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_model.actions import MOTORS, REPORTS, Action, Dropped, RunBuoyancy, SendStatus, StateChanged
from firmware_model.config import BoardConfig
from firmware_model.packets import Command, Kind
from firmware_model.packets.codec import Codec
from firmware_model.packets.commands import TRIGGERS, parse_command
from firmware_model.power.charge import Battery
from firmware_model.power.charge_pin import ChargePin, Edge, Fault
from firmware_model.power.feed import ActiveBattery, WorstCase
from firmware_model.power.rails import RAILS, Rail
from firmware_model.states import TABLE, Refused, State, Trigger, next_state
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    ModemSpoke,
    PacketHeard,
    PowerCameOn,
    ResetCause,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)

if TYPE_CHECKING:
    from firmware_model.power.power_path import PowerPath
    from firmware_model.settings import StoredSettings
    from firmware_model.timers import Deadline

_DOCKED = (State.CHARGING, State.REPORTING)


class Board:
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries live on whether it runs or not."""

    _batteries: WorstCase | PowerPath

    def __init__(
        self, config: BoardConfig, codec: Codec, primary: Battery, secondary: Battery, now_ms: int
    ) -> None:
        self.config = config
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self._codec = codec
        self._now_ms = now_ms
        self._pin = ChargePin(config.pin_debounce_ms, False, config.pin_chatter_ms, config.pin_check_ms)
        self._at_surface = False
        self._clear_to_sink = False
        self._deadline: Deadline | None = None
        if config.whole is None:
            self._batteries = WorstCase(config.charge, primary, secondary)

    @property
    def primary(self) -> Battery:
        return self._batteries.primary

    @property
    def secondary(self) -> Battery:
        return self._batteries.secondary

    @property
    def feed(self) -> ActiveBattery:
        """The battery that the board lives on."""
        return self._batteries.feed

    @property
    def rails(self) -> int:
        """What is on, as bits; always 0 in the worst case, which knows one load only."""
        return 0

    @property
    def hears(self) -> bool:
        """Whether the modem listens. The worst case's always does."""
        return True

    @property
    def has_wifi(self) -> bool:
        """Whether Wi-Fi is on. The worst case's always is."""
        return True

    @property
    def kept(self) -> StoredSettings | None:
        """What a reset has to leave; None for a board that nobody has told anything yet."""
        return None

    @property
    def clock_offset_ms(self) -> int:
        """By how much the clock was ahead of the last beacon; within 32 bits."""
        return 0

    def clock_ms(self, now_ms: int) -> int:
        """What the board's own clock reads; the paper's worst case has one that is never off."""
        return now_ms

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary as the board knows them, in grains: the monitor's last samples."""
        return self._batteries.readings(now_ms)

    @property
    def next_due_ms(self) -> int | None:
        """When something of the board is due next; of several at once pin, batteries, pulses, deadline in this order."""
        return self._next()[0]

    def _next(self) -> tuple[int | None, int]:
        """When something is due next, and which: 0 the pin, 3 the deadline."""
        due_ms = self._pin.next_due_ms
        if self._deadline is not None and (due_ms is None or self._deadline[0] < due_ms):
            return self._deadline[0], 3
        return due_ms, 0

    def advance(self, now_ms: int) -> list[Action]:
        """Fires every timer that is due by `now_ms`, in order, each at its own time (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[Action] = []
        while True:
            due_ms, which = self._next()
            if due_ms is None or due_ms > now_ms:
                break
            self._now_ms = due_ms
            actions += self._fire(which, due_ms)
        self._now_ms = now_ms
        return actions

    def _fire(self, which: int, now_ms: int) -> list[Action]:
        if which == 0:
            edge, fault = self._pin.due(now_ms)
            faults: list[Action] = [] if fault is None else [Dropped(now_ms, fault.value)]
            return faults if edge is None else faults + self._edge(edge)
        assert self._deadline is not None
        (_, trigger), self._deadline = self._deadline, None
        return self._time_is_up(self._boot_trigger() if self.state is State.BOOTING else trigger)

    def _time_is_up(self, trigger: Trigger) -> list[Action]:
        """The state ends by itself."""
        return self._pull(trigger)

    def receive(self, stimulus: Stimulus, now_ms: int) -> list[Action]:
        """Takes a fact from outside at `now_ms`, after everything that was due by then."""
        actions = self.advance(now_ms)
        match stimulus:
            case ChargePinRose(noticed):
                actions += self._wire(True, noticed)
            case ChargePinFell(noticed):
                actions += self._wire(False, noticed)
            case PacketHeard(data):
                actions += self._hear(data)
            case ModemSpoke(lasting_ms):
                actions += self._modem_sends(lasting_ms)
            case WifiReceived(data):
                actions += self._command(data) if self.has_wifi else [Dropped(now_ms, "Wi-Fi is off")]
            case SurfaceReached():
                self._at_surface = True
                actions += self._pull(Trigger.SURFACE_REACHED)
            case BottomReached():
                self._at_surface = False
                actions += self._pull(Trigger.BOTTOM_REACHED)
            case PowerCameOn(cause, at_surface, pin_high):
                self.reset_cause = cause
                self._at_surface = at_surface
                self._pin.restart(pin_high)
                actions += self._pull(Trigger.POWER_CAME_ON)
        return actions

    def _wire(self, high: bool, noticed: bool) -> list[Action]:
        """The charger's pin has another level, whether the firmware noticed or not."""
        if noticed:
            self._pin.level(high, self._now_ms)
        else:
            self._pin.level_unseen(high, self._now_ms)
        return []

    def _hear(self, data: bytes) -> list[Action]:
        return self._command(data)

    def _modem_sends(self, lasting_ms: int) -> list[Action]:
        """The worst case has one load, whatever its modem does."""
        return []

    def _pinged(self) -> list[Action]:
        """Somebody asks how it is. The worst case says nothing by sound."""
        return []

    def _command(self, data: bytes) -> list[Action]:
        command = parse_command(data, self._codec, self.config)
        return [Dropped(self._now_ms, command)] if isinstance(command, str) else self._obey(command)

    def _obey(self, command: Command) -> list[Action]:
        if command.kind is Kind.RELEASE and self.state in _DOCKED:
            # The packet and the contact travel apart: it may come before the falling edge is certain.
            self._clear_to_sink = True
            return []
        return self._pull(TRIGGERS[command.kind])

    def _edge(self, edge: Edge) -> list[Action]:
        if self.state in (State.OFF, State.BOOTING):
            return []  # the level is read again when the board has booted
        if edge is Edge.ROSE:
            self._clear_to_sink = False
            return self._pull(Trigger.CHARGE_EDGE_ROSE)
        actions = self._pull(Trigger.CHARGE_EDGE_FELL)
        if self._clear_to_sink and self.state is State.RELEASED:
            actions += self._pull(Trigger.CLEAR_TO_SINK)
        return actions

    def _boot_trigger(self) -> Trigger:
        if self._pin.high:
            return Trigger.BOOTED_ON_CHARGER
        return Trigger.BOOTED_AT_SURFACE if self._at_surface else Trigger.BOOTED_ON_BOTTOM

    def _pull(self, trigger: Trigger) -> list[Action]:
        old = self.state
        try:
            self.state = next_state(old, trigger)
        except Refused as refusal:
            return [Dropped(self._now_ms, str(refusal))]
        follows = self._pinged() if trigger is Trigger.PING_HEARD else self._enter()
        return [StateChanged(self._now_ms, old, trigger, self.state), *follows]

    def _pull_if_taken(self, trigger: Trigger) -> list[Action]:
        return self._pull(trigger) if (self.state, trigger) in TABLE else []

    def _enter(self) -> list[Action]:
        """Sets the motors, the power and the deadline for the state just entered."""
        state, now_ms = self.state, self._now_ms
        actions: list[Action] = []
        if state in MOTORS:
            actions.append(self._motors())
        actions += self._power()
        self._deadline = self._deadline_of(state, now_ms)
        if state in REPORTS:
            actions += self._report(REPORTS[state])
        if not RAILS[state] >> Rail.MU_ASLEEP & 1 and self._pin.look(now_ms):
            actions.append(Dropped(now_ms, Fault.MISSED.value))
        return actions

    def _motors(self) -> RunBuoyancy:
        return RunBuoyancy(self._now_ms, MOTORS[self.state])

    def _power(self) -> list[Action]:
        """Makes the batteries feel the state just entered."""
        if isinstance(self._batteries, WorstCase) and self.state is not State.BOOTING:
            self._batteries.charge(self.state is State.CHARGING, self._now_ms)
        return []

    def _report(self, by: Rail) -> list[Action]:
        return [SendStatus(self._now_ms, by)]

    def _deadline_of(self, state: State, now_ms: int) -> Deadline | None:
        """When `state`, entered at `now_ms`, ends by itself; None when only a fact from outside ends it."""
        config = self.config
        match state:
            case State.BOOTING:
                return now_ms + config.boot_ms, Trigger.BOOTED_ON_BOTTOM
            case State.FLOATING:
                return now_ms + config.float_timeout_ms, Trigger.FLOAT_TIMED_OUT
            case State.RELEASED:
                return now_ms + config.release_wait_ms, Trigger.CLEAR_TO_SINK
            case State.ACTIVE:
                empty_at_ms = config.charge.empty_at_ms(self.primary)
                return None if empty_at_ms is None else (max(now_ms, empty_at_ms), Trigger.BATTERY_EMPTIED)
        return None

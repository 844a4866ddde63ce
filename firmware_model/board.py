"""The MU board: its state machine, batteries and timers, driven by the three verbs in agent time.

`Board` is the part that every board has. Alone it is the paper's worst case: one battery in use, one load, never asleep.
`firmware_model.whole_board` adds the rest.
"""

from __future__ import annotations

from copy import copy
from enum import Enum, auto
from typing import TYPE_CHECKING

from firmware_model.actions import MOTORS, REPORTS, Action, Dropped, RunBuoyancy, SendStatus, StateChanged
from firmware_model.config import BoardConfig
from firmware_model.packets import Command, Kind
from firmware_model.packets.codec import Codec
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.packets.commands import parse_command
from firmware_model.power.active_battery import ActiveBattery, WorstCase
from firmware_model.power.charge import Battery
from firmware_model.power.charge_pin import ChargePin, Edge, Fault
from firmware_model.power.rails import RAILS, Rail
from firmware_model.states import TABLE, Refused, State, Trigger, next_state
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    ChargeVanished,
    ClockJumped,
    ClockSkewed,
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


class Timer(Enum):
    """The timers of a board, in the order in which those due together fire."""

    PIN = auto()
    """The charger's pin: an edge becomes certain, or is looked for."""
    BATTERIES = auto()
    """A battery reaches a level."""
    PULSE = auto()
    """A rail that was on for a stated time goes off."""
    DEADLINE = auto()
    """The state ends by itself."""
    ANSWER = auto()
    """The modem answers a ping."""


class Board:
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries go on whether it runs or not."""

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
        self._is_powered = True
        """False while the pin is high without a charger."""
        self._at_surface = False
        self._clear_to_sink = False
        self._deadline: Deadline | None = None
        if config.whole is None:
            self._batteries = WorstCase(config.charge, primary, secondary)

    def copy(self) -> Board:
        """A board in the same state that goes on by itself. TypeError for a whole board, whose log is not its own."""
        if self.config.whole is not None:
            raise TypeError("a whole board cannot be copied")
        other = copy(self)
        other._batteries, other._pin = copy(self._batteries), copy(self._pin)
        return other

    @property
    def primary(self) -> Battery:
        return self._batteries.primary

    @property
    def secondary(self) -> Battery:
        return self._batteries.secondary

    @property
    def feed(self) -> ActiveBattery:
        """The battery that feeds the board."""
        return self._batteries.feed

    @property
    def rails(self) -> int:
        """The rails that are on, as bits; always 0 in the worst case, which has one load only."""
        return 0

    @property
    def is_modem_listening(self) -> bool:
        """True while the modem listens; in the worst case always."""
        return True

    @property
    def has_wifi(self) -> bool:
        """True while Wi-Fi is on; in the worst case always."""
        return True

    @property
    def kept(self) -> StoredSettings | None:
        """The settings that outlive a reset; None for a board that has received no setting and no time yet."""
        return None

    @property
    def clock_offset_ms(self) -> int:
        """The clock minus the last beacon's time; within 32 bits."""
        return 0

    def clock_ms(self, now_ms: int) -> int:
        """The reading of the board's own clock; in the paper's worst case it is exact."""
        return now_ms

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary charge as the board knows them, in grains: the monitor's last samples."""
        return self._batteries.readings(now_ms)

    @property
    def next_due_ms(self) -> int | None:
        """The time of the board's next timer; those due together fire in the order of `Timer`."""
        return self._next()[0]

    def _next(self) -> tuple[int | None, Timer]:
        """The next timer and its time; only the pin and the deadline of a state are the worst case's."""
        due_ms = self._pin.next_due_ms
        if self._deadline is not None and (due_ms is None or self._deadline[0] < due_ms):
            return self._deadline[0], Timer.DEADLINE
        return due_ms, Timer.PIN

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
        return self._deadline_reached(self._boot_trigger() if self.state is State.BOOTING else trigger)

    def _deadline_reached(self, trigger: Trigger) -> list[Action]:
        """Ends the state after its own time."""
        return self._apply(trigger)

    def receive(self, stimulus: Stimulus, now_ms: int) -> list[Action]:
        """Takes a fact from outside at `now_ms`, after every timer that was due by then."""
        actions = self.advance(now_ms)
        match stimulus:
            case ChargePinRose(noticed, powered):
                self._is_powered = powered
                actions += self._pin_changed(True, noticed)
            case ChargePinFell(noticed):
                actions += self._pin_changed(False, noticed)
            case PacketHeard(data):
                actions += self._packet_received(data)
            case ModemSpoke(lasting_ms):
                actions += self._modem_sends(lasting_ms)
            case WifiReceived(data):
                actions += self._command(data) if self.has_wifi else [Dropped(now_ms, "Wi-Fi is off")]
            case SurfaceReached():
                self._at_surface = True
                actions += self._apply(Trigger.SURFACE_REACHED)
            case BottomReached():
                self._at_surface = False
                actions += self._apply(Trigger.BOTTOM_REACHED)
            case PowerCameOn(cause, at_surface, pin_high):
                self.reset_cause = cause
                self._at_surface = at_surface
                self._is_powered = True
                self._pin.restart(pin_high)
                actions += self._apply(Trigger.POWER_CAME_ON)
            case ChargeVanished(primary, secondary):
                actions += self._lose(primary, secondary)
            case ClockJumped() | ClockSkewed():
                actions += self._disturb_clock(stimulus)
        return actions

    def _lose(self, primary: int, secondary: int) -> list[Action]:
        """Takes charges out of the batteries, in grains."""
        self._batteries.lose(primary, secondary, self._now_ms)
        if self.state is State.ACTIVE:
            self._deadline = self._deadline_of(self.state, self._now_ms)
        return []

    def _disturb_clock(self, stimulus: ClockJumped | ClockSkewed) -> list[Action]:
        return [Dropped(self._now_ms, "a defect of the clock: the worst case has none")]

    def _pin_changed(self, high: bool, noticed: bool) -> list[Action]:
        """Gives the charger's pin another level, even if the firmware did not notice the edge."""
        if noticed:
            self._pin.level(high, self._now_ms)
        else:
            self._pin.level_unseen(high, self._now_ms)
        return []

    def _packet_received(self, data: bytes) -> list[Action]:
        return self._command(data)

    def _modem_sends(self, lasting_ms: int) -> list[Action]:
        """The modem sends by itself. The worst case has one load, whatever its modem does."""
        return []

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
        return Trigger.BOOTED_AT_SURFACE if self._at_surface else Trigger.BOOTED_ON_BOTTOM

    def _apply(self, trigger: Trigger) -> list[Action]:
        old = self.state
        try:
            self.state = next_state(old, trigger)
        except Refused as refusal:
            return [Dropped(self._now_ms, str(refusal))]
        follows = self._pinged() if trigger is Trigger.PING_HEARD else self._enter()
        return [StateChanged(self._now_ms, old, trigger, self.state), *follows]

    def _apply_if_allowed(self, trigger: Trigger) -> list[Action]:
        return self._apply(trigger) if (self.state, trigger) in TABLE else []

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
        if not RAILS[state] >> Rail.MU_ASLEEP & 1 and self._pin.sample_level(now_ms):
            actions.append(Dropped(now_ms, Fault.MISSED.value))
        return actions

    def _motors(self) -> RunBuoyancy:
        if isinstance(self._batteries, WorstCase):
            self._batteries.spend(self.config.motor_run, self._now_ms)
        return RunBuoyancy(self._now_ms, MOTORS[self.state])

    def _power(self) -> list[Action]:
        """Sets the batteries' load and charger for the state just entered."""
        if isinstance(self._batteries, WorstCase) and self.state is not State.BOOTING:
            self._batteries.charge(self.state is State.CHARGING and self._is_powered, self._now_ms)
        return []

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
            case State.ACTIVE:
                empty_at_ms = config.charge.empty_at_ms(self.primary)
                return None if empty_at_ms is None else (max(now_ms, empty_at_ms), Trigger.BATTERY_EMPTIED)
        return None

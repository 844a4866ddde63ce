"""The MU board: its state machine, its batteries and its timers, moved by the three verbs in agent time."""

from __future__ import annotations

from firmware_model.actions import (
    MOTORS,
    REPORTS,
    Action,
    DropLog,
    Dropped,
    FeedFrom,
    LogSample,
    RunBuoyancy,
    SendLog,
    SendStatus,
    SetRail,
    StateChanged,
)
from firmware_model.charge import Battery
from firmware_model.charge_pin import ChargePin, Edge, Fault
from firmware_model.codec import Codec
from firmware_model.packets import EVERYONE, Command, Kind, LogAck
from firmware_model.plan import BoardConfig
from firmware_model.power_path import Feed, Level, PowerPath, WorstCase
from firmware_model.rails import RAILS, Rail, bits, rails_of
from firmware_model.states import TABLE, Refused, State, Trigger, next_state
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    PacketHeard,
    PowerCameOn,
    ResetCause,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)
from firmware_model.timers import deadline_ms, deadline_trigger

_COMMANDS = {
    Kind.PERMISSION: Trigger.PERMISSION_HEARD,
    Kind.RELEASE: Trigger.CLEAR_TO_SINK,
    Kind.PING: Trigger.PING_HEARD,
    Kind.HOVER: Trigger.HOVER_TOLD,
    Kind.SINK: Trigger.CLEAR_TO_SINK,
}
_EMPTIED = {Feed.SECONDARY: Trigger.BATTERY_EMPTIED, Feed.NEITHER: Trigger.BOTH_EMPTIED}
_DOCKED = (State.CHARGING, State.REPORTING)


class Board:
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries live on whether it runs or not."""

    def __init__(
        self, config: BoardConfig, codec: Codec, primary: Battery, secondary: Battery, now_ms: int
    ) -> None:
        self.config = config
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self.rails = 0
        """What is on, as bits; always 0 in the worst case, which knows one load only."""
        self._whole = config.whole
        self._batteries: WorstCase | PowerPath = (
            WorstCase(config.charge, primary, secondary)
            if config.whole is None
            else PowerPath(config.charge, config.whole.power, primary, secondary, now_ms, config.agent_id)
        )
        self._codec = codec
        self._now_ms = now_ms
        self._pin = _pin(config, high=False)
        self._at_surface = False
        self._clear_to_sink = False
        self._last_resort_ms: int | None = None
        self._pulses: dict[Rail, int] = {}
        """Rails that are on for a time of their own, and until when."""
        self._pulse_due_ms: int | None = None
        self._deadline_ms: int | None = None

    @property
    def primary(self) -> Battery:
        return self._batteries.primary

    @property
    def secondary(self) -> Battery:
        return self._batteries.secondary

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary as the board knows them, in grains: the monitor's last samples."""
        return self._batteries.readings(now_ms)

    @property
    def hears(self) -> bool:
        """Whether the modem listens. The worst case's always does."""
        return self._whole is None or bool(
            self.rails & (1 << Rail.MODEM_LISTENING | 1 << Rail.MODEM_RECEIVING)
        )

    @property
    def feed(self) -> Feed:
        """The battery that the board lives on."""
        return self._batteries.feed

    @property
    def next_due_ms(self) -> int | None:
        """When something of the board is due next; of several at once pin, batteries, pulses, deadline in this order."""
        return self._next()[0]

    def _next(self) -> tuple[int | None, int]:
        """When something is due next, and which: 0 the pin, 1 the batteries, 2 a pulse, 3 the deadline."""
        due_ms, which = self._pin.next_due_ms, 0
        for n, other_ms in enumerate((self._batteries.due_ms, self._pulse_due_ms, self._deadline_ms), 1):
            if other_ms is not None and (due_ms is None or other_ms < due_ms):
                due_ms, which = other_ms, n
        return due_ms, which

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
        if which == 1:
            return self._level_reached(now_ms)
        if which == 2:
            self._pulses = {rail: off_ms for rail, off_ms in self._pulses.items() if off_ms > now_ms}
            return self._set_rails()
        self._deadline_ms = None
        if self.state is State.BOOTING:
            return self._pull(self._boot_trigger())
        sampled: list[Action] = [LogSample(now_ms)] if self.state is State.SAMPLING else []
        trigger = deadline_trigger(self.state, self._whole, self._batteries.feed)
        if trigger in (Trigger.LAST_RESORT_CALL, Trigger.LAST_RESORT_SURFACE):
            self._last_resort_ms = now_ms
        return sampled + self._pull(trigger)

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
            case WifiReceived(data):
                if self._whole is not None and not self.rails >> Rail.WIFI & 1:
                    return [*actions, Dropped(now_ms, "Wi-Fi is off")]
                actions += self._command(data)
            case SurfaceReached():
                self._at_surface = True
                actions += self._pull(Trigger.SURFACE_REACHED)
            case BottomReached():
                self._at_surface = False
                actions += self._pull(Trigger.BOTTOM_REACHED)
            case PowerCameOn(cause, at_surface, pin_high):
                self.reset_cause = cause
                self._at_surface = at_surface
                self._pin = _pin(self.config, pin_high)
                actions += self._pull(Trigger.POWER_CAME_ON)
        return actions

    def _wire(self, high: bool, noticed: bool) -> list[Action]:
        if noticed:
            self._pin.level(high, self._now_ms)
        else:
            self._pin.level_unseen(high, self._now_ms)
        # The chargers need no firmware: they run for as long as the pin is high.
        return self._set_rails() if self._whole is not None else []

    def _hear(self, data: bytes) -> list[Action]:
        if self._whole is None:
            return self._command(data)
        if not self.hears:
            return [Dropped(self._now_ms, "the modem is not listening")]
        self._pulses[Rail.MODEM_RECEIVING] = self._now_ms + self._whole.power.receive_ms
        return self._set_rails() + self._command(data)

    def _command(self, data: bytes) -> list[Action]:
        packet = self._codec.decode(data)
        if not isinstance(packet, Command):
            return [Dropped(self._now_ms, "not a command")]
        if packet.agent_id not in (self.config.agent_id, EVERYONE):
            return [Dropped(self._now_ms, "for another aMussel")]
        if isinstance(packet, LogAck):
            return self._keep_uploading(DropLog(self._now_ms, packet.next_sequence))
        if packet.kind is Kind.BACK_UP_LOG:
            return self._keep_uploading(SendLog(self._now_ms))
        if packet.kind is Kind.RELEASE and self.state in _DOCKED:
            # The packet and the contact travel apart: it may come before the falling edge is certain.
            self._clear_to_sink = True
            return []
        if packet.kind is Kind.HOVER and self._whole is None:
            return [Dropped(self._now_ms, "the worst case knows no hovering")]
        trigger = _COMMANDS.get(packet.kind)
        return (
            [Dropped(self._now_ms, "a command that is not obeyed here")]
            if trigger is None
            else self._pull(trigger)
        )

    def _keep_uploading(self, action: Action) -> list[Action]:
        """A docked board stays awake for as long as somebody takes its log."""
        if self._whole is None:
            return [Dropped(self._now_ms, "the worst case has no log")]
        if not self.rails >> Rail.WIFI & 1:
            return [Dropped(self._now_ms, "Wi-Fi is off")]
        if self.state is State.REPORTING:
            self._set_deadline()
        return [action]

    def _edge(self, edge: Edge) -> list[Action]:
        if self.state in (State.OFF, State.BOOTING):
            return []  # the level is read again when the board has booted
        if edge is Edge.ROSE:
            self._clear_to_sink = False
            self._last_resort_ms = None
            return self._pull(Trigger.CHARGE_EDGE_ROSE)
        actions = self._pull(Trigger.CHARGE_EDGE_FELL)
        if self._clear_to_sink and self.state is State.RELEASED:
            actions += self._pull(Trigger.CLEAR_TO_SINK)
        return actions

    def _level_reached(self, now_ms: int) -> list[Action]:
        """Whatever the batteries came to."""
        assert isinstance(self._batteries, PowerPath)
        level, feed = self._batteries.due(now_ms), self._batteries.feed
        match level:
            case Level.EMPTIED:
                return [FeedFrom(now_ms, feed), *self._pull_if_taken(_EMPTIED[feed])]
            case Level.SWITCH_BACK:
                return [FeedFrom(now_ms, feed)]
            case Level.SAFE_LEVEL if self.state is State.EMPTY:
                self._set_deadline()
            case Level.LOW_LEVEL:
                return self._pull_if_taken(Trigger.LOW_LEVEL_REACHED)
        return []

    def _pull_if_taken(self, trigger: Trigger) -> list[Action]:
        return self._pull(trigger) if (self.state, trigger) in TABLE else []

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
        return [StateChanged(self._now_ms, old, trigger, self.state), *self._enter()]

    def _enter(self) -> list[Action]:
        """Sets the motors, the power path and the deadline for the state just entered."""
        state, now_ms = self.state, self._now_ms
        actions: list[Action] = []
        motors = MOTORS.get(state)
        if motors is not None:
            actions.append(RunBuoyancy(now_ms, motors))
            if self._whole is not None:
                self._pulses[Rail.MOTORS] = now_ms + self._whole.power.motor_run_ms
        if isinstance(self._batteries, PowerPath):
            actions += self._set_rails()
        elif state is not State.BOOTING:
            self._batteries.charge(state is State.CHARGING, now_ms)
        self._set_deadline()
        if state in REPORTS:
            actions.append(SendStatus(now_ms, REPORTS[state]))
            if state is State.REPORTING:
                actions.append(SendLog(now_ms))
        if not RAILS[state] >> Rail.MU_ASLEEP & 1 and self._pin.look(now_ms):
            actions.append(Dropped(now_ms, Fault.MISSED.value))
        return actions

    def _set_deadline(self) -> None:
        self._deadline_ms = deadline_ms(
            self.state, self.config, self._batteries, self._last_resort_ms, self._now_ms
        )

    def _set_rails(self) -> list[Action]:
        """Switches what the state and the pulses want, and tells the batteries."""
        whole, batteries, now_ms, state = self._whole, self._batteries, self._now_ms, self.state
        assert whole is not None and isinstance(batteries, PowerPath)
        if state is State.LOST:
            self._pulses.clear()
        pulsed = bits(*self._pulses)
        self._pulse_due_ms = min(self._pulses.values(), default=None)
        on = rails_of(state, whole.power.kept_on, whole.cycle is None, pulsed)
        changed = on ^ self.rails
        self.rails = on
        batteries.set(self._pin.wire_high, whole.power.loads.total(on), now_ms)
        if state is State.EMPTY:
            self._set_deadline()  # a charger that touched it lifts it off its safe level
        return [SetRail(now_ms, rail, bool(on >> rail & 1)) for rail in Rail if changed >> rail & 1]


def _pin(config: BoardConfig, high: bool) -> ChargePin:
    return ChargePin(config.pin_debounce_ms, high, config.pin_chatter_ms, config.pin_check_ms)

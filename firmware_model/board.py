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
    StateChanged,
)
from firmware_model.charge import Battery
from firmware_model.charge_pin import Edge, Fault
from firmware_model.codec import Codec
from firmware_model.commands import TRIGGERS, understood
from firmware_model.keeper import Kept
from firmware_model.packets import Beacon, HoverAt, Kind, LogAck, SetThreshold, SleepSchedule, SlotAssignment
from firmware_model.parts import Parts
from firmware_model.plan import BoardConfig
from firmware_model.power_path import Feed, Level, PowerPath, WorstCase
from firmware_model.rails import RAILS, Rail
from firmware_model.states import TABLE, Refused, State, Trigger, next_state
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    PacketHeard,
    PowerCameOn,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)
from firmware_model.timers import Deadline, basic_deadline, last_resort, whole_deadline

_EMPTIED = {Feed.SECONDARY: Trigger.BATTERY_EMPTIED, Feed.NEITHER: Trigger.BOTH_EMPTIED}
_BY_THE_CLOCK = (State.SLEEPING, State.CHARGING, State.AWAITING_SLOT)
NOT_SENT = "a status: no beacon came, and the clock may be off by more than the guard"
_DOCKED = (State.CHARGING, State.REPORTING)


class Board(Parts):
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries live on whether it runs or not."""

    def __init__(
        self,
        config: BoardConfig,
        codec: Codec,
        primary: Battery,
        secondary: Battery,
        now_ms: int,
        kept: Kept | None = None,
    ) -> None:
        """`kept` is what a reset leaves of a whole board's clock and settings; without it they are as delivered."""
        super().__init__(config, primary, secondary, now_ms, kept)
        self._codec = codec
        self._now_ms = now_ms
        self._at_surface = False
        self._clear_to_sink = False
        self._last_resort_ms: int | None = None
        self._stays_down_until_ms = 0
        self._hover_mm: int | None = None
        self._deadline: Deadline | None = None

    @property
    def next_due_ms(self) -> int | None:
        """When something of the board is due next; of several at once pin, batteries, pulses, deadline in this order."""
        return self._next()[0]

    def _next(self) -> tuple[int | None, int]:
        """When something is due next, and which: 0 the pin, 1 the batteries, 2 a pulse, 3 the deadline."""
        due_ms, which = self._pin.next_due_ms, 0
        pulse_ms = None if self._switches is None else self._switches.due_ms
        deadline_ms = None if self._deadline is None else self._deadline[0]
        for n, other_ms in enumerate((self._batteries.due_ms, pulse_ms, deadline_ms), 1):
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
            assert self._switches is not None
            self._switches.due(now_ms)
            return self._set_rails()
        return self._time_is_up(now_ms)

    def _time_is_up(self, now_ms: int) -> list[Action]:
        """The state ends by itself."""
        assert self._deadline is not None
        (_, trigger), self._deadline = self._deadline, None
        actions: list[Action] = []
        match self.state:
            case State.BOOTING:
                trigger = self._boot_trigger()
            case State.SAMPLING:
                actions.append(LogSample(now_ms))
            case State.AWAITING_BEACON:
                actions.append(Dropped(now_ms, NOT_SENT))
        match trigger:
            case Trigger.LAST_RESORT_CALL | Trigger.LAST_RESORT_SURFACE:
                self._last_resort_ms = now_ms
            case Trigger.ALARM_RANG:
                assert self._keeper is not None
                self._keeper.clock.rang(self._keeper.settings.alarm_ms)
        return actions + self._pull(trigger)

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
                if self._switches is not None and not self._switches.is_on(Rail.WIFI):
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
                self._pin.restart(pin_high)
                actions += self._pull(Trigger.POWER_CAME_ON)
        return actions

    def _wire(self, high: bool, noticed: bool) -> list[Action]:
        if noticed:
            self._pin.level(high, self._now_ms)
        else:
            self._pin.level_unseen(high, self._now_ms)
        # The chargers need no firmware: they run for as long as the pin is high.
        return self._set_rails() if self._switches is not None else []

    def _hear(self, data: bytes) -> list[Action]:
        switches, whole = self._switches, self.config.whole
        if switches is None or whole is None:
            return self._command(data)
        if not self.hears:
            return [Dropped(self._now_ms, "the modem is not listening")]
        switches.pulse(Rail.MODEM_RECEIVING, self._now_ms + whole.power.receive_ms)
        return self._set_rails() + self._command(data)

    def _command(self, data: bytes) -> list[Action]:
        command, now_ms = understood(data, self._codec, self.config), self._now_ms
        match command:
            case str():
                return [Dropped(now_ms, command)]
            case Beacon(_, agent_ms):
                return self._set_clock(agent_ms)
            case SleepSchedule() | SlotAssignment() | SetThreshold():
                return self._set(command)
            case LogAck(_, next_sequence):
                return self._keep_uploading(DropLog(now_ms, next_sequence))
        if command.kind is Kind.BACK_UP_LOG:
            return self._keep_uploading(SendLog(now_ms))
        if command.kind is Kind.RELEASE and self.state in _DOCKED:
            # The packet and the contact travel apart: it may come before the falling edge is certain.
            self._clear_to_sink = True
            return []
        trigger = TRIGGERS[command.kind]
        if (self.state, trigger) in TABLE:
            if isinstance(command, HoverAt):
                self._hover_mm = round(command.depth_m * 1000)
            elif command.kind is Kind.HOVER:
                self._hover_mm = None
            elif command.kind is Kind.SINK and self.config.whole is not None:
                self._stays_down_until_ms = now_ms + self.config.whole.stay_down_ms
        return self._pull(trigger)

    def _set_clock(self, agent_ms: int) -> list[Action]:
        assert self._keeper is not None  # the worst case knows no beacon
        self._keeper.set_clock(agent_ms, self._now_ms)
        if self.state in _BY_THE_CLOCK:
            self._set_deadline()
        return self._pull_if_taken(Trigger.BEACON_HEARD)

    def _set(self, command: SleepSchedule | SlotAssignment | SetThreshold) -> list[Action]:
        assert self._keeper is not None and isinstance(self._batteries, PowerPath)
        if not self._keeper.told(command, self._now_ms):
            return [Dropped(self._now_ms, f"a {command.kind.name} that cannot be")]
        if isinstance(command, SetThreshold):
            self._batteries.set_levels(self._keeper.settings.levels, self._now_ms)
        if self.state in _BY_THE_CLOCK:
            self._set_deadline()
        return []

    def _keep_uploading(self, action: Action) -> list[Action]:
        """A docked board stays awake for as long as somebody takes its log."""
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
            depth_mm = self._hover_mm if state is State.HOVERING else None
            actions.append(RunBuoyancy(now_ms, motors, depth_mm))
            if self._switches is not None and self.config.whole is not None:
                self._switches.pulse(Rail.MOTORS, now_ms + self.config.whole.power.motor_run_ms)
        if self._keeper is not None:
            self._keeper.clock.pass_over(now_ms)
            actions += self._set_rails()
        elif isinstance(self._batteries, WorstCase) and state is not State.BOOTING:
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
        state, whole, batteries, now_ms = self.state, self.config.whole, self._batteries, self._now_ms
        if state is State.BOOTING:
            self._deadline = (now_ms + self.config.boot_ms, Trigger.BOOTED_ON_BOTTOM)
            return
        stays_up = self._last_resort_ms is not None
        self._deadline = basic_deadline(state, self.config, batteries, stays_up, now_ms)
        if self._deadline is not None or whole is None:
            return
        assert isinstance(batteries, PowerPath) and self._keeper is not None
        if state is State.EMPTY:
            last_ms, until_ms = self._last_resort_ms, self._stays_down_until_ms
            self._deadline = last_resort(whole, batteries, last_ms, until_ms, now_ms)
        else:
            self._deadline = whole_deadline(state, whole, self._keeper, now_ms)

    def _set_rails(self) -> list[Action]:
        assert self._switches is not None
        switched = self._switches.switch(self.state, self._pin.wire_high, self._now_ms)
        if self.state is State.EMPTY:
            self._set_deadline()  # a charger that touched it lifts it off its safe level
        return [*switched]

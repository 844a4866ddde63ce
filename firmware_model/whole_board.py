"""The whole firmware: sleep and wake, rails, two batteries, a clock of its own, settings, the log, and emergencies."""

from __future__ import annotations

from firmware_model.actions import (
    Action,
    DropLog,
    Dropped,
    FeedFrom,
    LogSample,
    RunBuoyancy,
    SendAnswer,
    SendLog,
)
from firmware_model.board import Board, Timer
from firmware_model.config import BoardConfig, FullFirmware
from firmware_model.packets import (
    Beacon,
    Command,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
)
from firmware_model.packets.codec import Codec
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Battery
from firmware_model.power.charge_pin import Edge
from firmware_model.power.power_path import Level, PowerPath
from firmware_model.power.rails import Rail
from firmware_model.power.switchboard import Switchboard
from firmware_model.settings import SettingsStore, StoredSettings
from firmware_model.states import TABLE, State, Trigger
from firmware_model.stimuli import ClockJumped, ClockSkewed
from firmware_model.timers import Deadline, full_deadline, last_resort

_EMPTIED = {ActiveBattery.SECONDARY: Trigger.BATTERY_EMPTIED, ActiveBattery.NEITHER: Trigger.BOTH_EMPTIED}
_TIMERS = tuple(Timer)
_CLOCK_STATES = (State.SLEEPING, State.CHARGING, State.AWAITING_SLOT)
_NOT_SENT = "a status: no beacon came, and the clock may be off by more than the guard"
_OFFSETS_MS = (-(1 << 31), (1 << 31) - 1)


class WholeBoard(Board):
    """A board whose configuration has a `FullFirmware`."""

    _batteries: PowerPath

    def __init__(
        self,
        config: BoardConfig,
        codec: Codec,
        primary: Battery,
        secondary: Battery,
        now_ms: int,
        kept: StoredSettings | None = None,
    ) -> None:
        """`kept` holds the clock and the settings that outlived a reset; without it they are as delivered."""
        super().__init__(config, codec, primary, secondary, now_ms)
        assert config.whole is not None
        self._whole: FullFirmware = config.whole
        self._store = SettingsStore(config, kept, now_ms)
        self._batteries = PowerPath(
            config.charge,
            config.whole.power,
            primary,
            secondary,
            now_ms,
            config.agent_id,
            self._store.settings.levels,
        )
        self._switches = Switchboard(config.whole, self._batteries)
        self._last_resort_ms: int | None = None
        self._stays_down_until_ms = 0
        self._hover_mm: int | None = None
        self._answers_ms: int | None = None

    @property
    def rails(self) -> int:
        return self._switches.rails

    @property
    def is_modem_listening(self) -> bool:
        return self._switches.is_on(Rail.MODEM_LISTENING, Rail.MODEM_RECEIVING)

    @property
    def has_wifi(self) -> bool:
        return self._switches.is_on(Rail.WIFI)

    @property
    def kept(self) -> StoredSettings | None:
        return self._store.kept

    @property
    def clock_offset_ms(self) -> int:
        low_ms, high_ms = _OFFSETS_MS
        return max(low_ms, min(high_ms, self._store.clock.corrected_ms))

    def clock_ms(self, now_ms: int) -> int:
        return self._store.clock.reading_at(now_ms)

    def _next(self) -> tuple[int | None, Timer]:
        due_ms, first = self._pin.next_due_ms, 0
        deadline_ms = None if self._deadline is None else self._deadline[0]
        # In the order of Timer, after the pin.
        dues = self._batteries.due_ms, self._switches.due_ms, deadline_ms, self._answers_ms
        for place, other_ms in enumerate(dues, 1):
            if other_ms is not None and (due_ms is None or other_ms < due_ms):
                due_ms, first = other_ms, place
        return due_ms, _TIMERS[first]

    def _fire(self, timer: Timer, now_ms: int) -> list[Action]:
        if timer is Timer.BATTERIES:
            return self._level_reached(now_ms)
        if timer is Timer.PULSE:
            self._switches.due(now_ms)
            return self._set_rails()
        if timer is Timer.ANSWER:
            return self._answer(now_ms)
        return super()._fire(timer, now_ms)

    def _deadline_reached(self, trigger: Trigger) -> list[Action]:
        actions: list[Action] = []
        match self.state:
            case State.SAMPLING:
                actions.append(LogSample(self._now_ms))
            case State.AWAITING_BEACON:
                actions.append(Dropped(self._now_ms, _NOT_SENT))
        match trigger:
            case Trigger.LAST_RESORT_CALL | Trigger.LAST_RESORT_SURFACE:
                self._last_resort_ms = self._now_ms
            case Trigger.ALARM_RANG:
                self._store.clock.rang(self._store.settings.alarm_ms)
        return actions + super()._deadline_reached(trigger)

    def _pin_changed(self, high: bool, noticed: bool) -> list[Action]:
        """Also switches the chargers, which need no firmware and run for as long as the pin is high."""
        return super()._pin_changed(high, noticed) + self._set_rails()

    def _packet_received(self, data: bytes) -> list[Action]:
        if not self.is_modem_listening:
            return [Dropped(self._now_ms, "the modem is not listening")]
        self._switches.pulse(Rail.MODEM_RECEIVING, self._now_ms + self._whole.power.receive_ms)
        return self._set_rails() + super()._packet_received(data)

    def _modem_sends(self, lasting_ms: int) -> list[Action]:
        """The board sleeps on, but the modem draws its load; while it transmits it receives nothing."""
        self._switches.pulse(Rail.MODEM_TRANSMITTING, self._now_ms + lasting_ms)
        return [*self._set_rails()]

    def _pinged(self) -> list[Action]:
        """Wakes a sleeping board for as long as an answer takes; its state and its deadline stay as they are."""
        if self._answers_ms is not None:
            return [Dropped(self._now_ms, "a ping before the last one was answered")]
        self._answers_ms = self._now_ms + self._whole.turnaround_ms
        self._switches.pulse(Rail.MU_ACTIVE, self._answers_ms + self._whole.answer_ms)
        return [*self._set_rails()]

    def _answer(self, now_ms: int) -> list[Action]:
        self._answers_ms = None
        if (self.state, Trigger.PING_HEARD) not in TABLE:
            return [Dropped(now_ms, f"an answer: it is {self.state.name} by now")]
        return [*self._modem_sends(self._whole.answer_ms), SendAnswer(now_ms)]

    def _execute(self, command: Command) -> list[Action]:
        now_ms = self._now_ms
        match command:
            case Beacon(_, agent_ms):
                return self._set_clock(agent_ms)
            case SleepSchedule() | SlotAssignment() | SetThreshold():
                return self._change_setting(command)
            case LogAck(_, next_sequence):
                return self._extend_report(DropLog(now_ms, next_sequence))
        if command.kind is Kind.BACK_UP_LOG:
            return self._extend_report(SendLog(now_ms))
        if (self.state, TRIGGERS[command.kind]) in TABLE:
            if isinstance(command, HoverAt):
                self._hover_mm = round(command.depth_m * 1000)
            elif command.kind is Kind.HOVER:
                self._hover_mm = None
            elif command.kind is Kind.SINK:
                self._stays_down_until_ms = now_ms + self._whole.stay_down_ms
        return super()._execute(command)

    def _set_clock(self, agent_ms: int) -> list[Action]:
        self._store.set_clock(agent_ms, self._now_ms)
        self._renew_clock_deadline()
        return self._apply_if_allowed(Trigger.BEACON_HEARD)

    def _disturb_clock(self, stimulus: ClockJumped | ClockSkewed) -> list[Action]:
        if isinstance(stimulus, ClockJumped):
            self._store.jump_clock(stimulus.by_ms, self._now_ms)
        else:
            self._store.skew_clock(self.config.drift_ppb + stimulus.skew_ppb, self._now_ms)
        self._renew_clock_deadline()
        return []

    def _change_setting(self, command: SleepSchedule | SlotAssignment | SetThreshold) -> list[Action]:
        if not self._store.apply(command, self._now_ms):
            return [Dropped(self._now_ms, f"a {command.kind.name} that cannot be")]
        if isinstance(command, SetThreshold):
            self._batteries.set_levels(self._store.settings.levels, self._now_ms)
        self._renew_clock_deadline()
        return []

    def _renew_clock_deadline(self) -> None:
        if self.state in _CLOCK_STATES:
            self._deadline = self._deadline_of(self.state, self._now_ms)

    def _extend_report(self, action: Action) -> list[Action]:
        """A docked board stays awake for as long as an aPad takes its log."""
        if not self.has_wifi:
            return [Dropped(self._now_ms, "Wi-Fi is off")]
        if self.state is State.REPORTING:
            self._deadline = self._deadline_of(self.state, self._now_ms)
        return [action]

    def _pin_edge(self, edge: Edge) -> list[Action]:
        if edge is Edge.ROSE and self.state not in (State.OFF, State.BOOTING):
            self._last_resort_ms = None
        return super()._pin_edge(edge)

    def _level_reached(self, now_ms: int) -> list[Action]:
        """Takes a level that the batteries reached."""
        level, feed = self._batteries.due(now_ms), self._batteries.feed
        match level:
            case Level.EMPTIED:
                return [FeedFrom(now_ms, feed), *self._apply_if_allowed(_EMPTIED[feed])]
            case Level.SWITCH_BACK:
                return [FeedFrom(now_ms, feed)]
            case Level.SAFE_LEVEL if self.state is State.EMPTY:
                self._deadline = self._deadline_of(self.state, now_ms)
            case Level.LOW_LEVEL:
                return self._apply_if_allowed(Trigger.LOW_LEVEL_REACHED)
        return []

    def _motors(self) -> RunBuoyancy:
        self._switches.pulse(Rail.MOTORS, self._now_ms + self._whole.power.motor_run_ms)
        run = super()._motors()
        return RunBuoyancy(run.at_ms, run.to, self._hover_mm) if self.state is State.HOVERING else run

    def _power(self) -> list[Action]:
        self._store.clock.pass_over(self._now_ms)
        return self._set_rails()

    def _set_rails(self) -> list[Action]:
        is_charging = self._pin.wire_high and self._is_powered
        switched = self._switches.switch(self.state, is_charging, self._now_ms)
        if self.state is State.EMPTY:
            # A short contact with a charger ends the safe level.
            self._deadline = self._deadline_of(self.state, self._now_ms)
        return [*switched]

    def _report(self, by: Rail) -> list[Action]:
        sent = super()._report(by)
        return [*sent, SendLog(self._now_ms)] if self.state is State.REPORTING else sent

    def _deadline_of(self, state: State, now_ms: int) -> Deadline | None:
        feed = self._batteries.feed
        if feed is ActiveBattery.NEITHER and (state, Trigger.BOTH_EMPTIED) in TABLE:
            return now_ms, Trigger.BOTH_EMPTIED
        match state:
            case State.FLOATING if self._last_resort_ms is not None:
                return None  # after a last resort to the surface it does not sink again by itself
            case State.BOOTING | State.SURFACING | State.FLOATING | State.RELEASED:
                return super()._deadline_of(state, now_ms)
            case State.ACTIVE if feed is not ActiveBattery.PRIMARY:
                return now_ms, Trigger.BATTERY_EMPTIED
            case State.EMPTY:
                last_ms, until_ms = self._last_resort_ms, self._stays_down_until_ms
                return last_resort(self._whole, self._batteries, last_ms, until_ms, now_ms)
        return full_deadline(state, self._whole, self._store, now_ms)

"""The whole firmware: sleep and wake, rails, two batteries, a clock of its own, settings, the log, and emergencies.

`deadlines.py` has the times at which it sleeps, wakes and sends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from firmware_model.actions import (
    Action,
    DropLog,
    Dropped,
    FeedFrom,
    LogSample,
    SendAnswer,
    SendLog,
)
from firmware_model.base_firmware import Firmware
from firmware_model.config import BoardConfig, FullFirmware, LastResort
from firmware_model.deadlines import Deadline, after_work, full_deadline, last_resort
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
from firmware_model.port import Level, Timer, WholeHardware
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge_pin import Edge
from firmware_model.power.rails import Rail, switched_in
from firmware_model.settings_store import SettingsStore
from firmware_model.states import TABLE, State, Trigger

if TYPE_CHECKING:
    from firmware_model.port import Hardware

_EMPTIED = {ActiveBattery.SECONDARY: Trigger.BATTERY_EMPTIED, ActiveBattery.NEITHER: Trigger.BOTH_EMPTIED}
_CLOCK_STATES = (State.SLEEPING, State.CHARGING, State.AWAITING_SLOT)
_NOT_SENT = "a status: no beacon came, and the clock may be off by more than the guard"
_OFFSETS_MS = (-(1 << 31), (1 << 31) - 1)


class WholeFirmware(Firmware):
    """The program on a board whose configuration has a `FullFirmware`."""

    _hardware: WholeHardware

    def __init__(self, config: BoardConfig, codec: Codec, hardware: WholeHardware, now_ms: int) -> None:
        super().__init__(config, codec, hardware, now_ms)
        assert config.whole is not None
        self._whole: FullFirmware = config.whole
        self._store = SettingsStore(hardware, now_ms)
        self._last_resort_ms: int | None = None
        self._stays_down_until_ms = 0
        self._commanded_mm: int | None = None
        """The depth at which it was ordered to hover; None for the present one."""
        self._answers_ms: int | None = None

    def copy(self, hardware: Hardware) -> Firmware:
        """Raises TypeError: the log of a whole board is not its own."""
        raise TypeError("a whole board cannot be copied")

    @property
    def clock_offset_ms(self) -> int:
        low_ms, high_ms = _OFFSETS_MS
        return max(low_ms, min(high_ms, self._store.clock.corrected_ms))

    def next_timer(self) -> tuple[int | None, Timer]:
        due_ms, timer = super().next_timer()
        if self._answers_ms is not None and (due_ms is None or self._answers_ms < due_ms):
            return self._answers_ms, Timer.ANSWER
        return due_ms, timer

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        if timer is not Timer.ANSWER:
            return super().fire(timer, now_ms)
        self._now_ms = now_ms
        return self._answer(now_ms)

    def _deadline_reached(self, trigger: Trigger) -> list[Action]:
        actions: list[Action] = []
        if self.state is State.SAMPLING:
            actions.append(LogSample(self._now_ms))
        elif self.state is State.AWAITING_BEACON:
            actions.append(Dropped(self._now_ms, _NOT_SENT))
        if self.state in (State.SAMPLING, State.PROCESSING) and trigger is Trigger.WAKE_OVER:
            assert self._whole.cycle is not None
            trigger = after_work(self.state, self._whole.cycle, self._store.settings)
        match trigger:
            case Trigger.LAST_RESORT_CALL | Trigger.LAST_RESORT_SURFACE:
                self._last_resort_ms = self._now_ms
            case Trigger.ALARM_RANG:
                self._store.clock.rang(self._store.settings.alarm_ms)
        return actions + super()._deadline_reached(trigger)

    def pin_changed(self, noticed: bool, now_ms: int) -> list[Action]:
        actions = super().pin_changed(noticed, now_ms)
        self.power_changed(now_ms)
        return actions

    def power_changed(self, now_ms: int) -> None:
        """A short contact with a charger ends the safe level, and with it the wait for a last resort."""
        if self.state is State.EMPTY:
            self._deadline = self._deadline_of(self.state, now_ms)

    def _pinged(self) -> list[Action]:
        """Wakes a sleeping board for as long as an answer takes; its state and its deadline stay as they are."""
        if self._answers_ms is not None:
            return [Dropped(self._now_ms, "a ping before the last one was answered")]
        self._answers_ms = self._now_ms + self._whole.turnaround_ms
        switched = self._hardware.stay_awake(self._answers_ms + self._whole.answer_ms, self._now_ms)
        self.power_changed(self._now_ms)
        return [*switched]

    def _answer(self, now_ms: int) -> list[Action]:
        self._answers_ms = None
        if (self.state, Trigger.PING_HEARD) not in TABLE:
            return [Dropped(now_ms, f"an answer: it is {self.state.name} by now")]
        switched = self._hardware.transmit(self._whole.answer_ms, now_ms)
        self.power_changed(now_ms)
        return [*switched, SendAnswer(now_ms)]

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
                self._commanded_mm = round(command.depth_m * 1000)
            elif command.kind is Kind.HOVER:
                self._commanded_mm = None
            elif command.kind is Kind.SINK:
                self._stays_down_until_ms = now_ms + self._whole.stay_down_ms
        return super()._execute(command)

    def _set_clock(self, agent_ms: int) -> list[Action]:
        self._store.set_clock(agent_ms, self._now_ms)
        self._renew_clock_deadline()
        return self._apply_if_allowed(Trigger.BEACON_HEARD)

    def clock_disturbed(self, now_ms: int) -> None:
        self._now_ms = now_ms
        self._renew_clock_deadline()

    def _change_setting(self, command: SleepSchedule | SlotAssignment | SetThreshold) -> list[Action]:
        if not self._store.apply(command, self._now_ms):
            return [Dropped(self._now_ms, f"a {command.kind.name} that cannot be")]
        if isinstance(command, SetThreshold):
            self._hardware.watch_levels(self._store.settings.levels, self._now_ms)
        self._renew_clock_deadline()
        return []

    def _renew_clock_deadline(self) -> None:
        if self.state in _CLOCK_STATES:
            self._deadline = self._deadline_of(self.state, self._now_ms)

    def _extend_report(self, action: Action) -> list[Action]:
        """A docked board stays awake for as long as an aPad takes its log."""
        if not self._hardware.is_on(Rail.WIFI):
            return [Dropped(self._now_ms, "Wi-Fi is off")]
        if self.state is State.REPORTING:
            self._deadline = self._deadline_of(self.state, self._now_ms)
        return [action]

    def _pin_edge(self, edge: Edge) -> list[Action]:
        if edge is Edge.ROSE and self.state not in (State.OFF, State.BOOTING):
            self._last_resort_ms = None
        return super()._pin_edge(edge)

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        """Takes a level that the batteries reached."""
        self._now_ms = now_ms
        feed = self._hardware.feed
        match level:
            case Level.EMPTIED:
                emptied = [] if self._can_work else self._apply_if_allowed(_EMPTIED[feed])
                return [FeedFrom(now_ms, feed), *emptied]
            case Level.SWITCH_BACK:
                return [FeedFrom(now_ms, feed)]
            case Level.SAFE_LEVEL if self.state is State.EMPTY:
                self._deadline = self._deadline_of(self.state, now_ms)
            case Level.SAFE_LEVEL if not self._can_work:
                return self._apply_if_allowed(Trigger.BATTERY_EMPTIED)
            case Level.LOW_LEVEL:
                return self._apply_if_allowed(Trigger.LOW_LEVEL_REACHED)
        return []

    @property
    def _can_work(self) -> bool:
        """True while the feeding battery is one to work on: the primary, or a secondary in use above its reserve."""
        feed, power = self._hardware.feed, self._whole.power
        if feed is not ActiveBattery.SECONDARY:
            return feed is ActiveBattery.PRIMARY
        keeps_reserve = power.last_resort is not LastResort.WAIT
        return power.secondary_in_use and not (keeps_reserve and self._hardware.is_at_safe_level)

    def _hover_mm(self) -> int | None:
        return self._commanded_mm if self.state is State.HOVERING else None

    def _switch(self) -> Sequence[Action]:
        self._store.pass_alarms(self._now_ms)
        rails = switched_in(self.state, self._whole.cycle is None)
        return self._hardware.enter(self.state, rails, self._now_ms)

    def _report(self, by: Rail) -> list[Action]:
        sent = super()._report(by)
        return [*sent, SendLog(self._now_ms)] if self.state is State.REPORTING else sent

    def _deadline_of(self, state: State, now_ms: int) -> Deadline | None:
        if self._hardware.feed is ActiveBattery.NEITHER and (state, Trigger.BOTH_EMPTIED) in TABLE:
            return now_ms, Trigger.BOTH_EMPTIED
        match state:
            case State.FLOATING if self._last_resort_ms is not None:
                return None  # after a last resort to the surface it does not sink again by itself
            case State.BOOTING | State.SURFACING | State.FLOATING | State.RELEASED:
                return super()._deadline_of(state, now_ms)
            case State.ACTIVE if not self._can_work:
                return now_ms, Trigger.BATTERY_EMPTIED
            case State.EMPTY:
                last_ms, until_ms = self._last_resort_ms, self._stays_down_until_ms
                return last_resort(self._whole, self._hardware, last_ms, until_ms, now_ms)
        return full_deadline(state, self._whole, self._store, now_ms)

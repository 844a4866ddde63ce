"""When a whole board sleeps, wakes, samples and sends: the deadlines of its states, and the triggers that they fire."""

from __future__ import annotations

from firmware_model.clock import AlarmClock
from firmware_model.config import Cycle, FullFirmware, LastResort
from firmware_model.port import WholeHardware
from firmware_model.settings import Settings
from firmware_model.settings_store import SettingsStore
from firmware_model.states import State, Trigger

Deadline = tuple[int, Trigger]
"""The time at which a state ends by itself, and the trigger that it fires."""


def full_deadline(state: State, whole: FullFirmware, store: SettingsStore, now_ms: int) -> Deadline | None:
    """The deadlines that only the whole firmware has, except the last resort's; `state` was entered at `now_ms`."""
    settings, clock = store.settings, store.clock
    if state is State.HOVERING:
        return now_ms + whole.hover_ms, Trigger.HOVER_DUE
    if state in (State.TRANSMITTING, State.CALLING):
        return now_ms + whole.transmit_ms, Trigger.WAKE_OVER
    if whole.cycle is None:
        return None
    match state:
        case State.ACTIVE:
            return now_ms + whole.cycle.listen_ms, Trigger.WAKE_OVER
        case State.SLEEPING | State.CHARGING:
            return clock.alarm_ms(settings.alarm_ms, now_ms), Trigger.ALARM_RANG
        case State.SAMPLING:
            return now_ms + settings.sample_ms, Trigger.WAKE_OVER
        case State.REPORTING:
            return now_ms + whole.cycle.report_ms, Trigger.WAKE_OVER
        case State.PROCESSING:
            return now_ms + whole.cycle.processing_ms, Trigger.WAKE_OVER
        case State.AWAITING_SLOT:
            return _timeslot_deadline(whole, settings, clock, now_ms)
        case State.AWAITING_BEACON:
            assert whole.timekeeping is not None
            return now_ms + whole.timekeeping.beacon_wait_ms, Trigger.WAKE_OVER
    return None


def after_work(state: State, cycle: Cycle, settings: Settings) -> Trigger:
    """The trigger at the end of SAMPLING or PROCESSING, by the settings of that moment."""
    if state is State.SAMPLING and cycle.processing_ms:
        return Trigger.SAMPLES_TO_PROCESS
    if not settings.has_timeslot:
        return Trigger.WAKE_OVER
    return Trigger.SAMPLES_TO_SEND if state is State.SAMPLING else Trigger.PROCESSED


def _timeslot_deadline(whole: FullFirmware, settings: Settings, clock: AlarmClock, now_ms: int) -> Deadline:
    """The board's transmission time by its clock; or now, if the clock may then be off by more than the guard."""
    transmits_at_ms = settings.transmits_at_ms(clock.reading_at(now_ms))
    at_ms = max(now_ms, clock.clock.when(transmits_at_ms))
    timekeeping = whole.timekeeping
    if timekeeping is not None and clock.clock.doubt_ms(at_ms, timekeeping.bound_ppb) > settings.guard_ms:
        return now_ms, Trigger.CLOCK_DOUBTED
    return at_ms, Trigger.SLOT_OPENED


def last_resort(
    whole: FullFirmware, hardware: WholeHardware, last_ms: int | None, stays_down_until_ms: int, now_ms: int
) -> Deadline | None:
    """The deadline of EMPTY; `last_ms` is the time of the latest last resort since the charger was last seen."""
    action = whole.power.last_resort
    if action is LastResort.WAIT or not hardware.is_at_safe_level:
        return None
    at_ms = now_ms if last_ms is None else max(now_ms, last_ms + whole.call_ms)
    if action is LastResort.CALL:
        return at_ms, Trigger.LAST_RESORT_CALL
    return max(at_ms, stays_down_until_ms), Trigger.LAST_RESORT_SURFACE

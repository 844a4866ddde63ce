"""How long the board stays in a state by itself, and what ends it."""

from __future__ import annotations

from firmware_model.plan import BoardConfig, LastResort, Whole
from firmware_model.power_path import Feed, PowerPath, WorstCase
from firmware_model.states import TABLE, State, Trigger


def deadline_ms(
    state: State,
    config: BoardConfig,
    batteries: WorstCase | PowerPath,
    last_resort_ms: int | None,
    now_ms: int,
) -> int | None:
    """When the state, entered at `now_ms`, ends by itself; None when only a fact from outside ends it.

    `last_resort_ms` is when the last resort was last taken since the charger was last seen.
    """
    if batteries.feed is Feed.NEITHER and (state, Trigger.BOTH_EMPTIED) in TABLE:
        return now_ms
    match state:
        case State.BOOTING:
            return now_ms + config.boot_ms
        case State.FLOATING:
            # One that came up for its life does not go down again by itself.
            return None if last_resort_ms is not None else now_ms + config.float_timeout_ms
        case State.RELEASED:
            return now_ms + config.release_wait_ms
    if isinstance(batteries, WorstCase):
        if state is not State.ACTIVE:
            return None
        empty_at_ms = config.charge.empty_at_ms(batteries.primary)
        return None if empty_at_ms is None else max(now_ms, empty_at_ms)
    assert config.whole is not None
    if state is State.ACTIVE and batteries.feed is not Feed.PRIMARY:
        return now_ms
    if state is State.EMPTY:
        return _last_resort_due_ms(config.whole, batteries, last_resort_ms, now_ms)
    return _deadline_of_whole(state, config.whole, config.slot, now_ms)


def _deadline_of_whole(state: State, whole: Whole, slot: int, now_ms: int) -> int | None:
    if state is State.HOVERING:
        return now_ms + whole.hover_ms
    if state in (State.TRANSMITTING, State.CALLING):
        return now_ms + whole.transmit_ms
    cycle = whole.cycle
    if cycle is None:
        return None
    match state:
        case State.ACTIVE:
            return now_ms + cycle.listen_ms
        case State.SLEEPING | State.CHARGING:
            return cycle.alarm_after_ms(now_ms)
        case State.SAMPLING:
            return now_ms + cycle.sample_ms
        case State.REPORTING:
            return now_ms + cycle.report_ms
        case State.PROCESSING:
            return now_ms + cycle.processing_ms
        case State.AWAITING_SLOT:
            assert cycle.slots is not None
            return cycle.slots.next_ms(slot, now_ms)
    return None


def _last_resort_due_ms(
    whole: Whole, batteries: PowerPath, last_resort_ms: int | None, now_ms: int
) -> int | None:
    if whole.power.last_resort is LastResort.WAIT:
        return None
    if batteries.safe_ms is None:
        return None
    return now_ms if last_resort_ms is None else max(now_ms, last_resort_ms + whole.call_ms)


def deadline_trigger(state: State, whole: Whole | None, feed: Feed) -> Trigger:
    """What the end of the state's time means."""
    if feed is Feed.NEITHER and state is not State.BOOTING:
        return Trigger.BOTH_EMPTIED
    match state:
        case State.ACTIVE:
            idle = whole is not None and feed is Feed.PRIMARY
            return Trigger.WAKE_OVER if idle else Trigger.BATTERY_EMPTIED
        case State.FLOATING:
            return Trigger.FLOAT_TIMED_OUT
        case State.RELEASED:
            return Trigger.CLEAR_TO_SINK
        case State.SLEEPING | State.CHARGING:
            return Trigger.ALARM_RANG
        case State.AWAITING_SLOT:
            return Trigger.SLOT_OPENED
        case State.HOVERING:
            return Trigger.HOVER_DUE
        case State.EMPTY:
            surfaces = whole is not None and whole.power.last_resort is LastResort.SURFACE
            return Trigger.LAST_RESORT_SURFACE if surfaces else Trigger.LAST_RESORT_CALL
        case State.SAMPLING if whole is not None and whole.cycle is not None:
            if whole.cycle.processing_ms:
                return Trigger.SAMPLES_TO_PROCESS
            return Trigger.WAKE_OVER if whole.cycle.slots is None else Trigger.SAMPLES_TO_SEND
        case State.PROCESSING if whole is not None and whole.cycle is not None:
            return Trigger.WAKE_OVER if whole.cycle.slots is None else Trigger.PROCESSED
    return Trigger.WAKE_OVER

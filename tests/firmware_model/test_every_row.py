"""A running board takes every row of the table by stimuli and time alone: no row is dead, and none needs a direct call."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from firmware_model.actions import StateChanged
from firmware_model.bench import Bench
from firmware_model.config import BoardConfig, Cycle, LastResort, Timekeeping, Timeslots
from firmware_model.packets import Beacon, CommandPacket, Kind
from firmware_model.power.charge import FULL, fraction
from firmware_model.state_groups import DOCKED
from firmware_model.states import TABLE, State, Trigger
from firmware_model.stimuli import (
    BottomReached,
    ChargePinRose,
    ChargeVanished,
    ResetCause,
    SurfaceReached,
)
from firmware_model.table_one import board, power
from tests.firmware_model.conftest import lives

QUICK = Cycle(
    alarm_ms=20_000,
    sample_ms=3000,
    processing_ms=2000,
    slots=Timeslots(10_000, 1000),
    listen_ms=5000,
    report_ms=2000,
)
"""Boots until 2 s, listens until 7 s, wakes at 20 s, has its timeslot at 30 s."""
WITHOUT_SLOT = replace(QUICK, slots=None)
WITHOUT_PI = replace(QUICK, processing_ms=0)
NEITHER = replace(WITHOUT_PI, slots=None)
START = 0.1


def config(
    cycle: Cycle = QUICK,
    last_resort: LastResort = LastResort.CALL,
    doubts: bool = False,
    low_level: int = 0,
) -> BoardConfig:
    made = board(cycle, power(last_resort, low_level=low_level))
    assert made.whole is not None
    # A guard of 0 is less than the possible error of any clock.
    timekeeping = Timekeeping(1, beacon_wait_ms=4000) if doubts else None
    whole = replace(made.whole, hover_ms=4000, call_ms=5000, timekeeping=timekeeping)
    return replace(made, whole=whole, float_timeout_ms=15_000, release_wait_ms=4000)


def bench(made: BoardConfig, primary: float = START, secondary: float = 0.9, docked: bool = False) -> Bench:
    return Bench(made, primary=primary, secondary=secondary, docked=docked, travel_ms=6000)


def told(kind: Kind, at_ms: int, until_ms: int) -> Callable[[Bench], None]:
    def play(it: Bench) -> None:
        it.run_until(at_ms)
        it.hear(CommandPacket(kind, 1))
        it.run_until(until_ms)

    return play


def until(at_ms: int) -> Callable[[Bench], None]:
    return lambda it: it.run_until(at_ms) and None


def released(until_ms: int) -> Callable[[Bench], None]:
    def play(it: Bench) -> None:
        told(Kind.PERMISSION, 10_000, 17_000)(it)
        lives(it, "rises 100ms falls")
        it.run_until(until_ms)

    return play


WAYS: dict[State, Callable[[Bench], None]] = {
    State.BOOTING: until(1000),
    State.ACTIVE: until(4000),
    State.SLEEPING: until(15_000),
    State.SAMPLING: until(21_000),
    State.PROCESSING: until(24_000),
    State.AWAITING_SLOT: until(27_000),
    State.TRANSMITTING: until(30_500),
    State.AWAITING_BEACON: until(27_000),
    State.SURFACING: told(Kind.PERMISSION, 10_000, 13_000),
    State.FLOATING: told(Kind.PERMISSION, 10_000, 18_000),
    State.RELEASED: released(18_000),
    State.SINKING: released(23_000),
    State.HOVERING: told(Kind.HOVER, 10_000, 12_000),
    State.CHARGING: until(5000),
    State.REPORTING: until(21_000),
    State.EMPTY: until(4000),
    State.CALLING: until(2500),
    State.LOST: until(4000),
}
"""The stimuli from power-on into the middle of each state."""
STARTS: dict[State, dict[str, float | bool]] = {
    State.CHARGING: {"docked": True},
    State.REPORTING: {"docked": True},
    State.EMPTY: {"primary": 0.0},
    State.CALLING: {"primary": 0.0, "secondary": 0.1},
    State.LOST: {"primary": 0.0, "secondary": 0.0},
}
CONFIGS: dict[tuple[State, Trigger], BoardConfig] = {
    (State.SAMPLING, Trigger.WAKE_OVER): config(NEITHER),
    (State.SAMPLING, Trigger.SAMPLES_TO_SEND): config(WITHOUT_PI),
    (State.PROCESSING, Trigger.WAKE_OVER): config(WITHOUT_SLOT),
    (State.AWAITING_SLOT, Trigger.CLOCK_DOUBTED): config(doubts=True),
    (State.SURFACING, Trigger.SURFACING_TIMED_OUT): replace(config(), surfacing_timeout_ms=4000),
    (State.EMPTY, Trigger.BOTH_EMPTIED): config(last_resort=LastResort.WAIT),
    (State.EMPTY, Trigger.LAST_RESORT_SURFACE): config(last_resort=LastResort.SURFACE),
}
FACTS: dict[Trigger, Callable[[Bench], object]] = {
    Trigger.PERMISSION_HEARD: lambda it: it.command(Kind.PERMISSION),
    Trigger.PING_HEARD: lambda it: it.command(Kind.PING),
    Trigger.HOVER_ORDERED: lambda it: it.command(Kind.HOVER),
    Trigger.SINK_ORDERED: lambda it: it.command(Kind.SINK),
    # Commands go by Wi-Fi at the surface, and by sound below.
    Trigger.CLEAR_TO_SINK: lambda it: (it.command(Kind.RELEASE), it.hear(CommandPacket(Kind.RELEASE, 1))),
    Trigger.BEACON_HEARD: lambda it: it.hear(Beacon(1, it.now_ms)),
    Trigger.SURFACE_REACHED: lambda it: it.tell(SurfaceReached()),
    Trigger.BOTTOM_REACHED: lambda it: it.tell(BottomReached()),
    Trigger.CHARGE_EDGE_ROSE: lambda it: it.charge_pin_rises(),
    Trigger.CHARGE_EDGE_FELL: lambda it: it.charge_pin_falls(),
}
_EMPTIED = (Trigger.BATTERY_EMPTIED, Trigger.BOTH_EMPTIED)


def in_the_middle_of(state: State, made: BoardConfig, **start: float | bool) -> Bench:
    it = bench(made, **{**STARTS.get(state, {}), **start})  # type: ignore[arg-type]
    WAYS[state](it)
    return it


def emptied(state: State, trigger: Trigger, made: BoardConfig) -> Bench:
    """Empties its battery just there: it starts with the charge that another run has drawn by then."""
    other = in_the_middle_of(state, made)
    assert other.state is state
    if state in (State.EMPTY, State.CALLING):
        secondary = fraction(round(FULL * float(STARTS[state].get("secondary", 0.9))) - other.secondary)
        return in_the_middle_of(state, made, secondary=round(secondary, 10))
    primary = round(START - other.primary_fraction, 10)
    secondary = 0.0 if trigger is Trigger.BOTH_EMPTIED else 0.9
    return in_the_middle_of(state, made, primary=primary, secondary=secondary)


def caused(state: State, trigger: Trigger) -> Bench:
    made = CONFIGS.get((state, trigger), config(doubts=state is State.AWAITING_BEACON))
    if state is State.OFF:
        return bench(made)
    if (state, trigger) == (State.BOOTING, Trigger.BOTH_EMPTIED):
        it = bench(made, primary=0.0, secondary=0.0)
    elif state is State.BOOTING:
        it = bench(made, docked=trigger is Trigger.BOOTED_ON_CHARGER)
        if trigger is Trigger.BOOTED_AT_SURFACE:
            told(Kind.PERMISSION, 10_000, 18_000)(it)
            it.reset(ResetCause.BROWN_OUT)
    elif state is State.EMPTY and trigger in (Trigger.LAST_RESORT_CALL, Trigger.LAST_RESORT_SURFACE):
        it = bench(made, primary=0.0, secondary=0.1)
    elif trigger is Trigger.LOW_LEVEL_REACHED:
        level = in_the_middle_of(state, made).primary
        it = in_the_middle_of(state, config(low_level=level))
    elif trigger is Trigger.BOTH_EMPTIED and state in DOCKED:
        it = in_the_middle_of(state, made)
        it.tell(ChargePinRose(powered=False))
        it.tell(ChargeVanished(FULL, FULL))
    elif trigger in _EMPTIED:
        it = emptied(state, trigger, made)
    else:
        it = in_the_middle_of(state, made)
        if state is not State.AWAITING_SLOT or trigger is not Trigger.CLOCK_DOUBTED:
            assert it.state is state
        FACTS.get(trigger, lambda _: None)(it)
    it.run(ms=100 if trigger in FACTS else 21_000)
    return it


@pytest.mark.parametrize(("state", "trigger"), TABLE, ids=lambda it: it.name)
def test_a_running_board_takes_this_row(state: State, trigger: Trigger) -> None:
    taken = {
        (it.old, it.trigger): it.new for it in caused(state, trigger).trace if isinstance(it, StateChanged)
    }
    assert taken.get((state, trigger)) is TABLE[state, trigger]

"""Stories of a board that sleeps, as golden traces; and the laws of its time and its energy."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.actions import FeedFrom, LogSample, RunBuoyancy, SendStatus, StateChanged
from firmware_model.bench import Bench
from firmware_model.board import Board
from firmware_model.config import BoardConfig, Cycle, LastResort, Metering, Timekeeping
from firmware_model.packets import (
    PLAIN,
    Beacon,
    CommandPacket,
    HoverAt,
    Kind,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import FULL, Battery, Flow, grains
from firmware_model.power.rails import Rail
from firmware_model.states import State
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
from firmware_model.table_one import FIELD, HOURLY, LOADS, METERING, MODEL, board, power, worst_case_board
from tests.firmware_model.conftest import asleep, lines_of, lives

told = partial(lines_of, kinds=(StateChanged, RunBuoyancy, FeedFrom, LogSample, SendStatus))
"""The trace without the rails."""


STORIES = {
    "a short wake samples for ten seconds every hour": (
        HOURLY,
        "2h",
        [
            "3600000 SLEEPING -ALARM_RANG-> SAMPLING",
            "3610000 sample",
            "3610000 SAMPLING -WAKE_OVER-> SLEEPING",
            "7200000 SLEEPING -ALARM_RANG-> SAMPLING",
            "7210000 sample",
            "7210000 SAMPLING -WAKE_OVER-> SLEEPING",
        ],
    ),
    "a long wake processes, awaits its slot and transmits": (
        FIELD,
        "90min",
        [
            "3600000 SLEEPING -ALARM_RANG-> SAMPLING",
            "3610000 sample",
            "3610000 SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
            "3670000 PROCESSING -PROCESSED-> AWAITING_SLOT",
            # Frames of five minutes: the next one begins at 65 minutes.
            "3900000 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "3900000 send by MODEM_TRANSMITTING",
            "3901000 TRANSMITTING -WAKE_OVER-> SLEEPING",
        ],
    ),
    "one service with reports in the dock": (
        HOURLY,
        "permission 4min rises 1h falls 100ms release 3min",
        [
            "120000 SLEEPING -PERMISSION_HEARD-> SURFACING",
            "120000 motors FLOAT",
            "180000 SURFACING -SURFACE_REACHED-> FLOATING",
            "360050 FLOATING -CHARGE_EDGE_ROSE-> CHARGING",
            "3600000 CHARGING -ALARM_RANG-> REPORTING",
            "3600000 send by WIFI",
            "3610000 REPORTING -WAKE_OVER-> CHARGING",
            "3960050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
            "3960100 RELEASED -CLEAR_TO_SINK-> SINKING",
            "3960100 motors SINK",
            "4020100 SINKING -BOTTOM_REACHED-> ACTIVE",
            "4080100 ACTIVE -WAKE_OVER-> SLEEPING",
        ],
    ),
}


@pytest.mark.parametrize("name", STORIES)
def test_a_story_of_a_board_that_sleeps(name: str) -> None:
    cycle, script, lines = STORIES[name]
    bench = asleep(cycle)
    lives(bench, script)
    assert told(bench.trace) == lines


def test_it_hovers_by_a_motor_run_every_ten_minutes_and_sinks_when_told(bench: Bench) -> None:
    lives(bench, "hover 15min")
    bench.tell(PacketHeard(CommandPacket(Kind.RELEASE, 1).encode()))
    assert told(bench.trace) == [
        "120000 SLEEPING -HOVER_ORDERED-> HOVERING",
        "120000 motors HOVER",
        "720000 HOVERING -HOVER_DUE-> HOVERING",
        "720000 motors HOVER",
        "1020000 HOVERING -CLEAR_TO_SINK-> SINKING",
        "1020000 motors SINK",
    ]


def test_an_emptied_primary_wakes_it_into_the_emergency_and_the_dock_brings_it_back() -> None:
    bench = asleep(primary=0.003, secondary=0.9)
    *_, feeds, empties = (line.split(" ", 1)[1] for line in told(bench.run(hours=40)))
    assert (feeds, empties, bench.primary) == ("feed SECONDARY", "SLEEPING -BATTERY_EMPTIED-> EMPTY", 0)
    bench.charge_pin_rises()
    lines = told(bench.run(hours=2))
    (switch_back,) = (line for line in lines if line.endswith("feed PRIMARY"))
    # One tenth at 1.2435 times equation (2)'s first rate: 76.95 min after the edge, without any load.
    edge_ms, back_ms = (int(line.split()[0]) for line in (lines[0], switch_back))
    assert (back_ms - edge_ms) / 60_000 == pytest.approx(0.1 / (1.2435 * 0.001045), abs=0.01)


@pytest.mark.parametrize(
    ("last_resort", "after"),
    [
        (LastResort.WAIT, ["EMPTY -BOTH_EMPTIED-> LOST"]),
        (LastResort.CALL, ["EMPTY -LAST_RESORT_CALL-> CALLING", "CALLING -WAKE_OVER-> EMPTY"]),
        (
            LastResort.SURFACE,
            ["EMPTY -LAST_RESORT_SURFACE-> SURFACING", "SURFACING -SURFACE_REACHED-> FLOATING"],
        ),
    ],
)
def test_the_last_resort_is_taken_at_the_safe_level(last_resort: LastResort, after: list[str]) -> None:
    bench = asleep(last_resort=last_resort, primary=0.002, secondary=0.201)
    bench.run(hours=1000)
    changes = [action for action in bench.trace if isinstance(action, StateChanged)]
    emptied = next(n for n, change in enumerate(changes) if change.new is State.EMPTY)
    following = [f"{a.old.name} -{a.trigger.name}-> {a.new.name}" for a in changes[emptied + 1 :]]
    assert following[: len(after)] == after and following[-1].endswith("-BOTH_EMPTIED-> LOST")
    assert (bench.primary, bench.secondary) == (0, 0)
    if last_resort is not LastResort.WAIT:
        # 0.001 above the safe level at the sleeping load: about 14.8 min after the primary was empty.
        took_ms = changes[emptied + 1].at_ms - changes[emptied].at_ms
        assert took_ms / 60_000 == pytest.approx(0.001 / (0.0000392756 + 0.0000281532), rel=0.01)


def test_calls_repeat_and_between_them_it_can_be_permitted_to_surface() -> None:
    bench = asleep(last_resort=LastResort.CALL, primary=0.0002, secondary=0.15)
    bench.run(hours=1)
    calls = [a.at_ms for a in bench.trace if isinstance(a, SendStatus)]
    assert len(calls) >= 4 and {b - a for a, b in pairwise(calls)} == {600_000}
    bench.command(Kind.PERMISSION)
    assert bench.state is State.SURFACING


@pytest.mark.parametrize("metering", [None, replace(METERING, noise=0)])
def test_the_low_level_wakes_a_sleeper_once_and_it_reports_in_its_slot(metering: Metering | None) -> None:
    bench = Bench(board(FIELD, power(metering=metering, low_level=grains(0.5))), primary=0.5035)
    bench.run(minutes=50)
    lines = told(bench.trace)
    wake = next(n for n, line in enumerate(lines) if "LOW_LEVEL_REACHED" in line)
    at_ms = int(lines[wake].split()[0])
    # Asleep since 62 s at 0.0000674288 a minute; metered, two minutes of samples more.
    crossed_ms = 62_000 + (0.5035 - 0.0010427134 * 62 / 60 - 0.5) / 0.0000674288 * 60_000
    later_ms = 0 if metering is None else 125_000
    assert at_ms == pytest.approx(crossed_ms + later_ms, abs=5000)
    assert [line.split(" ", 1)[1] for line in lines[wake : wake + 7]] == [
        "SLEEPING -LOW_LEVEL_REACHED-> SAMPLING",
        "sample",
        "SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
        "PROCESSING -PROCESSED-> AWAITING_SLOT",
        "AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
        "send by MODEM_TRANSMITTING",
        "TRANSMITTING -WAKE_OVER-> SLEEPING",
    ]
    bench.run(hours=20)
    assert sum("LOW_LEVEL_REACHED" in line for line in told(bench.trace)) == 1


FIGURES: dict[str, Callable[[Bench], Any]] = {
    "state": lambda it: it.state,
    "rails": lambda it: it.board.rails,
    "reset": lambda it: it.board.reset_cause,
    "flow": lambda it: it.board.secondary.flow,
    "charge": lambda it: it.primary / FULL,
    "charged": lambda it: min(it.primary, it.secondary) > grains(0.05),
}
ON_ITS_BACKUP = {"state": State.EMPTY, "flow": Flow.DISCHARGING}
SCENES: dict[str, tuple[Callable[[], Bench], dict[str, dict[str, Any]]]] = {
    # Without power no code runs, so the charger's feed is a reset.
    "a lost one that is docked all the same boots and charges": (
        lambda: asleep(primary=0.0001, secondary=0.0001),
        {
            "1h": {"state": State.LOST, "rails": 0},
            "rises": {"state": State.BOOTING, "reset": ResetCause.BROWN_OUT},
            "60min": {"state": State.CHARGING, "charged": True},
        },
    ),
    "a reset does not turn the switch between the batteries": (
        lambda: asleep(primary=0.0, secondary=0.5),
        {
            "rises 10min falls 10min": {
                **ON_ITS_BACKUP,
                "charge": pytest.approx(10 * 1.2435 * 0.001045, rel=0.1),
            },
            "brown_out 1min": ON_ITS_BACKUP,
            "watchdog 1min": ON_ITS_BACKUP,
        },
    ),
    "never asleep it stays active on the idle load": (
        lambda: Bench(board(None, power())),
        {"5h": {"state": State.ACTIVE, "charge": pytest.approx(1 - 300 * 0.0010427134, abs=1e-6)}},
    ),
}


@pytest.mark.parametrize(("begins", "steps"), SCENES.values(), ids=SCENES)
def test_scene(begins: Callable[[], Bench], steps: dict[str, dict[str, Any]]) -> None:
    bench = begins()
    for script, wanted in steps.items():
        lives(bench, script)
        assert {name: FIGURES[name](bench) for name in wanted} == wanted, script


def test_what_its_radios_are_not_on_for_is_dropped() -> None:
    bench = asleep()
    assert "Wi-Fi is off" in str(bench.command(Kind.RELEASE))
    bench = asleep(FIELD)
    bench.run_until(3_900_500)
    assert bench.state is State.TRANSMITTING
    assert "the modem is not listening" in str(bench.command(Kind.PERMISSION))


@pytest.mark.parametrize("cause", ResetCause)
def test_a_reset_says_its_cause_and_leaves_the_batteries(cause: ResetCause) -> None:
    bench = asleep(primary=0.8)
    before = bench.primary
    bench.reset(cause)
    assert (bench.board.reset_cause, bench.primary, bench.state) == (cause, before, State.BOOTING)
    bench.run(minutes=2)
    assert bench.state is State.SLEEPING


# The laws.

QUICK = Cycle(
    alarm_ms=20_000, sample_ms=3000, processing_ms=2000, slots=FIELD.slots, listen_ms=5000, report_ms=3000
)
COMMANDS = [CommandPacket(kind, 1).encode() for kind in sorted(PLAIN)]
WORDS = [
    *(Beacon(1, agent_ms).encode() for agent_ms in (0, 290_000, 310_000, 700_000)),
    SleepSchedule(1, 45_000, 5000).encode(),
    SlotAssignment(1, 30_000, 2000, 200, 3, -90).encode(),
    *(SetThreshold(1, which, 0.02).encode() for which in Threshold),
    HoverAt(1, 1.5).encode(),
]
STIMULI: st.SearchStrategy[Stimulus] = st.one_of(
    st.sampled_from(
        [
            *(edge(noticed) for edge in (ChargePinRose, ChargePinFell) for noticed in (True, False)),
            SurfaceReached(),
            BottomReached(),
            PacketHeard(b"noise"),
            ModemSpoke(105),
        ]
    ),
    st.sampled_from([PacketHeard(data) for data in COMMANDS] + [WifiReceived(data) for data in COMMANDS]),
    st.sampled_from([PacketHeard(data) for data in WORDS]),
)
FACTS = st.lists(st.tuples(st.integers(0, 900_000), STIMULI), max_size=12)


def drifting(config: BoardConfig, drift_ppb: int, timekeeping: Timekeeping | None) -> BoardConfig:
    assert config.whole is not None
    return replace(config, drift_ppb=drift_ppb, whole=replace(config.whole, timekeeping=timekeeping))


CONFIGS = st.builds(
    lambda cycle, last_resort, kept_on, metering, drift_ppb, timekeeping: drifting(
        board(cycle, power(last_resort, kept_on, metering, FULL // 100)), drift_ppb, timekeeping
    ),
    st.sampled_from([None, HOURLY, FIELD, QUICK, replace(QUICK, slots=None)]),
    st.sampled_from(LastResort),
    st.sampled_from([0, 1 << Rail.PI]),
    st.sampled_from([None, METERING, replace(METERING, settle_ms=0, noise=FULL // 50)]),
    st.sampled_from([0, 500_000, -20_000_000]),
    st.sampled_from([None, Timekeeping(20_000, 30_000)]),
)


def made(config: BoardConfig, primary: float, secondary: float) -> Board:
    batteries = (Battery(0, grains(round(charge, 10)), Flow.RESTING) for charge in (primary, secondary))
    return Board(config, MusselbedCodec(), *batteries, 0)


@settings(deadline=None)
@given(
    CONFIGS | st.just(worst_case_board()),
    st.floats(0, 0.02),
    st.floats(0, 0.25),
    FACTS,
    st.lists(st.integers(0, 1_500_000), max_size=12),
)
def test_cutting_time_does_not_change_the_trace(
    config: BoardConfig, primary: float, secondary: float, raw: list[tuple[int, Stimulus]], cuts: list[int]
) -> None:
    moments: list[tuple[int, Stimulus | None]] = [*sorted(raw, key=lambda it: it[0])]
    boards, traces = [], []
    for at_cuts in ([], cuts):
        mu = made(config, primary, secondary)
        trace = mu.receive(PowerCameOn(ResetCause.POWER_ON, at_surface=False, pin_high=False), 0)
        cut_moments: list[tuple[int, Stimulus | None]] = [(at_ms, None) for at_ms in at_cuts]
        for at_ms, fact in sorted([*moments, *cut_moments], key=lambda it: it[0]):
            trace += mu.advance(at_ms) if fact is None else mu.receive(fact, at_ms)
        trace += mu.advance(1_500_000)
        boards.append(mu)
        traces.append(trace)
    assert traces[0] == traces[1]
    whole, pieces = ((it.state, it.primary, it.secondary, it.rails, it.next_due_ms) for it in boards)
    assert whole == pieces


@settings(deadline=None)
@given(CONFIGS, FACTS, st.lists(st.integers(0, 900_000), max_size=2))
def test_what_the_modules_drew_is_what_the_batteries_lost(
    config: BoardConfig, raw: list[tuple[int, Stimulus]], resets: list[int]
) -> None:
    """Equal to the grain, by module and by state, while no battery charges or is empty."""
    bench = Bench(config)
    moments: list[tuple[int, Stimulus | None]] = [*raw, *((at_ms, None) for at_ms in resets)]
    for at_ms, fact in sorted(moments, key=lambda it: it[0]):
        bench.run_until(at_ms)
        if fact is None:
            bench.reset(ResetCause.WATCHDOG)
        elif not isinstance(fact, ChargePinRose):
            bench.tell(fact)
    bench.run_until(1_000_000)
    bench.ledger.settle(1_000_000)
    lost = FULL - bench.primary
    assert bench.secondary == FULL
    assert sum(bench.ledger.by_rail().values()) == sum(bench.ledger.by_state().values()) == lost > 0


@settings(deadline=None)
@given(CONFIGS, st.floats(0, 1), st.floats(0, 1), FACTS)
def test_charges_stay_on_the_scale_and_what_is_on_is_what_the_batteries_feel(
    config: BoardConfig, primary: float, secondary: float, raw: list[tuple[int, Stimulus]]
) -> None:
    mu = made(config, primary, secondary)
    mu.receive(PowerCameOn(ResetCause.POWER_ON, at_surface=False, pin_high=False), 0)
    for at_ms, fact in sorted(raw, key=lambda it: it[0]):
        mu.receive(fact, at_ms)
        for battery in (mu.primary, mu.secondary):
            assert 0 <= MODEL.charge_at(battery, at_ms) <= FULL
        drawn = mu.primary.load + mu.secondary.load
        if Flow.CHARGING in (mu.primary.flow, mu.secondary.flow):
            assert drawn == LOADS.total(mu.rails) * 6037 // 10_000
        elif mu.feed is not ActiveBattery.NEITHER:
            assert drawn == LOADS.total(mu.rails)

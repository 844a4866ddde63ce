"""Stories of one board of the worst case as golden traces."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.actions import Action, Buoyancy, Dropped, MotorsStalled, RunBuoyancy, StateChanged
from firmware_model.bench import Bench
from firmware_model.board import Board
from firmware_model.config import BoardConfig
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow, grains
from firmware_model.states import State
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
from tests.firmware_model.conftest import lines_of, lives

MODEL = ChargeModel.from_minutes(0.0010427134, ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)))
CONFIG = BoardConfig(
    agent_id=24,
    charge=MODEL,
    pin_debounce_ms=50,
    boot_ms=2000,
    float_timeout_ms=600_000,
    release_wait_ms=120_000,
)
PERMISSION = PacketHeard(CommandPacket(Kind.PERMISSION, 24).encode())
RELEASE = WifiReceived(CommandPacket(Kind.RELEASE, 24).encode())
POWER = PowerCameOn(ResetCause.POWER_ON, at_surface=False, pin_high=False)
MIN = 60_000


def board(charge: float = 0.9, config: BoardConfig = CONFIG) -> Board:
    return Board(
        config,
        MusselbedCodec(),
        Battery(0, grains(charge), Flow.DISCHARGING),
        Battery(0, FULL, Flow.RESTING),
        0,
    )


told = partial(lines_of, kinds=(StateChanged, RunBuoyancy, Dropped))


def story(mu: Board, facts: list[tuple[int, Stimulus]], until_ms: int) -> list[str]:
    actions: list[Action] = []
    for at_ms, stimulus in facts:
        actions += mu.receive(stimulus, at_ms)
    return told(actions + mu.advance(until_ms))


def charging_board() -> Board:
    mu = board()
    facts = (0, POWER), (10_000, PERMISSION), (70_000, SurfaceReached()), (100_000, ChargePinRose())
    story(mu, [*facts], 200_000)
    assert mu.state is State.CHARGING
    return mu


BOOTED = ["0 OFF -POWER_CAME_ON-> BOOTING", "2000 BOOTING -BOOTED_ON_BOTTOM-> ACTIVE"]
UP: list[tuple[int, Stimulus]] = [(0, POWER), (10_000, PERMISSION), (70_000, SurfaceReached())]
WENT_UP = [
    *BOOTED,
    "10000 ACTIVE -PERMISSION_HEARD-> SURFACING",
    "10000 motors FLOAT",
    "70000 SURFACING -SURFACE_REACHED-> FLOATING",
]


@pytest.mark.parametrize(
    ("begins", "facts", "until_ms", "lines"),
    [
        pytest.param(
            board,
            [
                *UP,
                (100_000, ChargePinRose()),
                (9_000_000, ChargePinFell()),
                (9_000_400, RELEASE),
                (9_060_000, BottomReached()),
            ],
            10_000_000,
            [
                *WENT_UP,
                "100050 FLOATING -CHARGE_EDGE_ROSE-> CHARGING",
                "9000050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
                "9000400 RELEASED -CLEAR_TO_SINK-> SINKING",
                "9000400 motors SINK",
                "9060000 SINKING -BOTTOM_REACHED-> ACTIVE",
            ],
            id="one service from the bottom to the bottom",
        ),
        pytest.param(
            charging_board,
            [(300_000, ChargePinFell())],
            500_000,
            [
                "300050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
                "420050 RELEASED -CLEAR_TO_SINK-> SINKING",
                "420050 motors SINK",
            ],
            id="without a release packet it sinks after the stated wait",
        ),
        pytest.param(
            charging_board,
            [(300_000, ChargePinFell()), (300_010, RELEASE)],
            300_060,
            [
                "300050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
                "300050 RELEASED -CLEAR_TO_SINK-> SINKING",
                "300050 motors SINK",
            ],
            id="a release packet that outruns the falling edge is kept",
        ),
        pytest.param(
            charging_board,
            [(300_000, ChargePinFell()), (300_049, ChargePinRose())],
            400_000,
            [],
            id="a pin that bounces while docked does not release",
        ),
        # 0.001 / 0.0010427134 a minute = 57542.2 ms: empty at the millisecond that ends above it.
        pytest.param(
            partial(board, 0.001),
            [(0, POWER), (10 * MIN, PERMISSION)],
            10 * MIN,
            [
                *BOOTED,
                "57543 ACTIVE -BATTERY_EMPTIED-> EMPTY",
                "600000 EMPTY -PERMISSION_HEARD-> SURFACING",
                "600000 motors FLOAT",
            ],
            id="an emptied aMussel stops measuring and still surfaces on its backup",
        ),
        pytest.param(
            board,
            UP,
            700_000,
            [*WENT_UP, "670000 FLOATING -FLOAT_TIMED_OUT-> SINKING", "670000 motors SINK"],
            id="floating unserved it sinks again",
        ),
        *(
            pytest.param(
                board,
                [(0, POWER), (5000, stimulus)],
                6000,
                [*BOOTED, f"5000 dropped: {reason}"],
                id=f"what it cannot use is dropped: {reason}",
            )
            for stimulus, reason in (
                (PacketHeard(b"\x00garbage"), "not a command"),
                (PacketHeard(CommandPacket(Kind.PERMISSION, 25).encode()), "for another aMussel"),
                (RELEASE, "ACTIVE does not take CLEAR_TO_SINK"),
            )
        ),
    ],
)
def test_story(
    begins: Callable[[], Board], facts: list[tuple[int, Stimulus]], until_ms: int, lines: list[str]
) -> None:
    assert story(begins(), facts, until_ms) == lines


def test_the_charge_follows_the_edges() -> None:
    """0.9 falls for 100.05 s, then 10 min 0.05 s at equation (2)'s upper rate, from 0.898."""
    mu = charging_board()
    story(mu, [(100_050 + 10 * MIN, ChargePinFell())], 100_050 + 10 * MIN + 50)
    low = 0.9 - 0.0010427134 * 100_050 / MIN
    assert mu.primary.charge / FULL == pytest.approx(low + 0.002911 * (10 + 50 / MIN), abs=1e-9)


def test_a_reset_on_the_charger_does_not_interrupt_the_charge() -> None:
    primary = Battery(0, grains(0.7), Flow.CHARGING)
    mu = Board(CONFIG, MusselbedCodec(), primary, Battery(0, FULL, Flow.RESTING), 0)
    mu.receive(PowerCameOn(ResetCause.BROWN_OUT, at_surface=True, pin_high=True), 0)
    mu.advance(5 * MIN)
    assert mu.primary == primary


def test_time_going_back_is_refused() -> None:
    mu = board()
    mu.advance(10)
    with pytest.raises(ValueError, match="time went back"):
        mu.advance(9)


UP_AND_DOWN: list[tuple[int, Stimulus]] = [
    (0, POWER),
    (10_000, PERMISSION),
    (20_000, SurfaceReached()),
    (30_000, WifiReceived(CommandPacket(Kind.RELEASE, 24).encode())),
]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(1, FULL // 10))
def test_the_backup_battery_gives_a_motor_run_what_the_primary_lacks(
    charge: float, backup: float, run: int
) -> None:
    """Two runs, each with the primary's charge of that second; nothing else draws from the backup."""
    config = replace(CONFIG, motor_run=run)
    paid = Board(
        config,
        MusselbedCodec(),
        Battery(0, grains(charge), Flow.DISCHARGING),
        Battery(0, grains(backup), Flow.RESTING),
        0,
    )
    primary, secondary, moved = grains(charge), grains(backup), []
    story(paid, UP_AND_DOWN[:1], 9_999)
    for begins_ms, facts in ((10_000, UP_AND_DOWN[1:3]), (30_000, UP_AND_DOWN[3:])):
        primary = max(0, primary - MODEL.discharge * (begins_ms - (0 if not moved else 10_000)))
        lacking = max(0, run - primary)
        can_move = lacking <= secondary
        if can_move:
            primary, secondary = max(0, primary - run), secondary - lacking
        did = [action for at_ms, fact in facts for action in paid.receive(fact, at_ms)]
        moved.append(any(isinstance(it, RunBuoyancy) for it in did))
        assert moved[-1] is can_move and any(isinstance(it, MotorsStalled) for it in did) is not can_move
        left = [MODEL.charge_at(it, begins_ms) for it in (paid.primary, paid.secondary)]
        assert left == [primary, secondary]


def test_a_dock_fills_both_batteries_of_a_board_whose_motors_cost_charge() -> None:
    """By hand: an hour of equation (2)'s slowest part, 0.001045 a minute, for each battery."""
    bench = Bench(replace(CONFIG, motor_run=grains(0.05)), primary=0.0, secondary=0.05)
    lives(bench, "1min permission 2min")
    assert (bench.state, bench.primary, bench.secondary) == (State.FLOATING, 0, 0)
    lives(bench, f"rises {CONFIG.pin_debounce_ms}ms 60min")
    assert bench.primary_fraction == bench.secondary_fraction == pytest.approx(60 * 0.001045)


def test_a_board_that_no_battery_can_lift_stays_where_it_is() -> None:
    """On the bottom it gives the surfacing up and is EMPTY again; afloat it cannot sink, and stays to be docked."""
    config = replace(CONFIG, motor_run=grains(0.05), surfacing_timeout_ms=60_000, float_timeout_ms=60_000)
    below, afloat = (Bench(config, primary=0.0, secondary=it) for it in (0.04, 0.05))
    lives(below, "1min permission 5min")
    assert below.state is State.EMPTY and not below.did(RunBuoyancy)
    lives(afloat, "1min permission 10min")
    assert [it.to for it in afloat.did(RunBuoyancy)] == [Buoyancy.FLOAT] and afloat.state is State.FLOATING
    lives(afloat, "rises 1min")
    assert afloat.state is State.CHARGING

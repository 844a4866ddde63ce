"""The paper's Table I and Fig. 4 as runs of a board, each until a battery is empty or full."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from firmware_model.actions import FeedFrom
from firmware_model.bench.bench import Bench
from firmware_model.config import Metering
from firmware_model.packets import Kind
from firmware_model.power.charge import FULL, MS_PER_MIN, Battery
from firmware_model.power.rails import Rail, bits
from firmware_model.table_one import HOURLY, board, power


@dataclass(frozen=True, slots=True)
class Row:
    """A run and the paper's time for it, in simulated minutes: it must end between `low_min` and `high_min`."""

    mode: str
    paper_min: float
    run: Callable[[], float]
    low_min: float
    high_min: float


def _row(mode: str, paper_min: float, run: Callable[[], float]) -> Row:
    """A row whose run must end within 1 % of the paper's time."""
    return Row(mode, paper_min, run, 0.99 * paper_min, 1.01 * paper_min)


def _minutes_to_empty(bench: Bench) -> float:
    """The minutes until the board leaves its primary battery."""
    while True:
        due_ms = bench.board.next_due_ms
        assert due_ms is not None
        for action in bench.run_until(due_ms):
            if isinstance(action, FeedFrom):
                return action.at_ms / MS_PER_MIN


def _minutes_to_full(bench: Bench, battery: Callable[[], Battery]) -> float:
    while True:
        due_ms = bench.board.next_due_ms
        full_ms = bench.config.charge.reaches_at_ms(battery(), FULL)
        if full_ms is not None and (due_ms is None or full_ms <= due_ms):
            return full_ms / MS_PER_MIN
        assert due_ms is not None
        bench.run_until(due_ms)


def _discharge_idle(metering: Metering | None) -> float:
    return _minutes_to_empty(Bench(board(None, power(metering=metering))))


def _discharge_hourly(metering: Metering | None) -> float:
    return _minutes_to_empty(Bench(board(HOURLY, power(metering=metering))))


def _charge_idle(metering: Metering | None) -> float:
    bench = Bench(board(None, power(metering=metering)), primary=0.0, docked=True)
    return _minutes_to_full(bench, lambda: bench.board.primary)


def _charge_hourly(metering: Metering | None) -> float:
    bench = Bench(board(HOURLY, power(metering=metering)), primary=0.0, docked=True)
    return _minutes_to_full(bench, lambda: bench.board.primary)


def _charge_secondary(metering: Metering | None) -> float:
    bench = Bench(board(HOURLY, power(metering=metering)), secondary=0.0, docked=True)
    return _minutes_to_full(bench, lambda: bench.board.secondary)


def _heavy(metering: Metering | None) -> float:
    bench = Bench(board(None, power(kept_on=bits(Rail.PI), metering=metering)))
    bench.run(ms=bench.config.boot_ms)
    bench.command(Kind.HOVER)
    return _minutes_to_empty(bench)


def rows(metering: Metering | None = None) -> tuple[Row, ...]:
    """Table I, and the heavy run that takes "within 3 hours" in the paper; `metering` None for exactly known charges."""
    return (
        _row("discharging, idle", 962, partial(_discharge_idle, metering)),
        _row("discharging, asleep, hourly wakes", 14057, partial(_discharge_hourly, metering)),
        _row("charging, primary, idle", 575, partial(_charge_idle, metering)),
        _row("charging, primary, hourly wakes", 398, partial(_charge_hourly, metering)),
        _row("charging, secondary", 485, partial(_charge_secondary, metering)),
        Row("Pi on, motors every 10 min (Fig. 4 a)", 180, partial(_heavy, metering), 150, 180),
    )


ROWS = rows()

"""One board that sleeps and wakes every hour for 10 s: simulated hours a second, and the cost of an event."""

from __future__ import annotations

import statistics
import time
from typing import Any

from rich.console import Console

from benchmarks.rows import told
from firmware_model.actions import StateChanged
from firmware_model.bench import Bench
from firmware_model.table_one import HOURLY, board, power

HOURS = 20
REPEATS, SHORT_REPEATS = 50, 5


def measure(short: bool = False) -> dict[str, Any]:
    """Medians of 20-hour runs of a fresh board with its trace and energy ledger; an event is a change of state."""
    took_s, events = [], 0
    repeats = SHORT_REPEATS if short else REPEATS
    for _ in range(repeats):
        began_s = time.perf_counter()
        bench = Bench(board(HOURLY, power()))
        bench.run(hours=HOURS)
        took_s.append(time.perf_counter() - began_s)
        told({"ms_per_20_hours": 1000 * took_s[-1]})
        events = sum(isinstance(action, StateChanged) for action in bench.trace)
    median_s = statistics.median(took_s)
    return {
        "hours_per_s": HOURS / median_s,
        "us_per_event": 1e6 * median_s / events,
        "ms_per_20_hours": 1000 * median_s,
        "events": events,
        "repeats": repeats,
    }


def show(result: dict[str, Any], console: Console) -> None:
    console.print(
        f"{HOURS} h of one board with hourly wakes: {result['ms_per_20_hours']:.2f} ms "
        f"({result['hours_per_s']:.0f} h/s, {result['us_per_event']:.1f} us an event, {result['events']} events)"
    )

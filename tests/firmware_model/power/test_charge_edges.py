"""Stories of a charger's pin that bounces, chatters, or has a missed edge, on a board that sleeps."""

from collections.abc import Callable
from functools import partial

import pytest

from firmware_model.actions import Dropped, StateChanged
from firmware_model.bench import Bench
from firmware_model.power.charge import Flow
from firmware_model.states import State
from firmware_model.table_one import FIELD, HOURLY, board, power
from tests.firmware_model.conftest import asleep as after_boot
from tests.firmware_model.conftest import lines_of, lives

MISSED = "dropped: an edge of the charger's pin was missed: its level told"
CHATTER = "dropped: the charger's pin chatters: the greater part of the time decided"


told = partial(lines_of, kinds=(StateChanged, Dropped))


def asleep(**start: float) -> Bench:
    """A sleeping board at 2 min and 1 ms."""
    bench = after_boot(**start)  # type: ignore[arg-type]
    bench.run(ms=1)
    assert bench.state is State.SLEEPING
    return bench


def test_a_missed_rising_edge_is_found_by_the_next_sample_of_the_level() -> None:
    bench = asleep(primary=0.5)
    bench.charge_pin_rises(noticed=False)
    assert told(bench.run(minutes=3)) == [
        f"180000 {MISSED}",
        "180050 SLEEPING -CHARGE_EDGE_ROSE-> CHARGING",
    ]
    # The charger did not wait for the firmware: 3 min at the two coils' second rate, less a part of the load.
    assert bench.primary_fraction == pytest.approx(0.5 + 3 * 1.2435 * 0.00223, abs=0.0015)


# It still waits for the word to sink. The wake's next step, to the Pi, reads the pin.
MISSES = {
    "a missed falling edge is found too": (
        *(asleep, "rises 2min", "charge_pin_falls", 4),
        [
            f"300000 {MISSED}",
            "300050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
            "420050 RELEASED -CLEAR_TO_SINK-> SINKING",
        ],
    ),
    "a wake finds a missed edge before the period does": (
        *(lambda: Bench(board(FIELD, power())), "3605000ms", "charge_pin_rises", 1),
        [
            "3610000 SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
            f"3610000 {MISSED}",
            "3610050 PROCESSING -CHARGE_EDGE_ROSE-> CHARGING",
        ],
    ),
}


@pytest.mark.parametrize(("begins", "script", "edge", "minutes", "lines"), MISSES.values(), ids=MISSES)
def test_a_missed_edge(
    begins: Callable[[], Bench], script: str, edge: str, minutes: int, lines: list[str]
) -> None:
    bench = begins()
    lives(bench, script)
    bench.trace.clear()
    getattr(bench, edge)(noticed=False)
    assert (bench.board.primary.flow is Flow.CHARGING) is (edge == "charge_pin_rises")
    assert told(bench.run(minutes=minutes)) == lines


def test_chatter_in_the_dock_is_no_release_while_the_charger_runs_for_most_of_it() -> None:
    bench = asleep()
    lives(bench, "rises 1min")
    bench.trace.clear()
    chatter = told(bench.charge_pin_chatters(high_ms=30, low_ms=10, times=250))
    assert len(chatter) == 4 and all(line.endswith(CHATTER) for line in chatter)
    lives(bench, "rises 5min")
    assert bench.state is State.CHARGING


def test_chatter_of_a_charger_that_hardly_runs_is_no_dock() -> None:
    bench = asleep()
    bench.charge_pin_chatters(high_ms=10, low_ms=30, times=250)
    bench.run(minutes=1)
    assert not any(isinstance(action, StateChanged) for action in bench.trace)
    # The battery does not charge either: its gain in those 2.5 s of 10 s is 0.0001.
    assert bench.state is State.SLEEPING and bench.board.primary.flow is not Flow.CHARGING


def test_an_edge_while_it_boots_is_known_once_it_has_booted() -> None:
    bench = Bench(board(HOURLY, power()))
    bench.run(ms=1000)
    bench.charge_pin_rises(noticed=False)
    bench.run(ms=2000)
    assert bench.state is State.CHARGING

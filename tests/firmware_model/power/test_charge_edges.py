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


def in_the_field() -> Bench:
    return Bench(board(FIELD, power()))


CHARGES, RESTS = {"flow": True}, {"flow": False}
STORIES: dict[str, tuple[Callable[[], Bench], str, str, list[str], dict[str, object]]] = {
    # The charger did not wait for the firmware: 3 min at the two coils' second rate, less a part of the load.
    "a missed rising edge is found by the next sample of the level": (
        lambda: asleep(primary=0.5),
        "0ms",
        "rises_unseen 3min",
        [f"180000 {MISSED}", "180050 SLEEPING -CHARGE_EDGE_ROSE-> CHARGING"],
        {"charge": pytest.approx(0.5 + 3 * 1.2435 * 0.00223, abs=0.0015)},
    ),
    "a missed falling edge charges no more": (asleep, "rises 2min", "falls_unseen", [], RESTS),
    "a missed falling edge is found too and it still waits for the word to sink": (
        asleep,
        "rises 2min",
        "falls_unseen 4min",
        [
            f"300000 {MISSED}",
            "300050 CHARGING -CHARGE_EDGE_FELL-> RELEASED",
            "420050 RELEASED -CLEAR_TO_SINK-> SINKING",
        ],
        RESTS,
    ),
    # The wake's next step, to the Pi, reads the pin.
    "a wake finds a missed edge before the period does": (
        in_the_field,
        "3605000ms",
        "rises_unseen 1min",
        [
            "3610000 SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
            f"3610000 {MISSED}",
            "3610050 PROCESSING -CHARGE_EDGE_ROSE-> CHARGING",
        ],
        CHARGES,
    ),
    "chatter in the dock is no release while the charger runs for most of it": (
        asleep,
        "rises 1min",
        "chatter:30:10:250 rises 5min",
        [f"{180_001 + 2000 * n + 30} {CHATTER}" for n in (1, 2, 3, 4, 5)],
        {"state": State.CHARGING},
    ),
    # The battery does not charge either: its gain in those 2.5 s of 10 s is 0.0001.
    "chatter of a charger that hardly runs is no dock": (
        asleep,
        "0ms",
        "chatter:10:30:250 1min",
        [f"{120_001 + 2000 * n} {CHATTER}" for n in (1, 2, 3, 4, 5)],
        {**RESTS, "state": State.SLEEPING},
    ),
    "an edge while it boots is known once it has booted": (
        lambda: Bench(board(HOURLY, power())),
        "1000ms",
        "rises_unseen 2000ms",
        [
            "2000 BOOTING -BOOTED_ON_BOTTOM-> ACTIVE",
            f"2000 {MISSED}",
            "2050 ACTIVE -CHARGE_EDGE_ROSE-> CHARGING",
        ],
        CHARGES,
    ),
}


@pytest.mark.parametrize(("begins", "before", "script", "lines", "figures"), STORIES.values(), ids=STORIES)
def test_story(
    begins: Callable[[], Bench], before: str, script: str, lines: list[str], figures: dict[str, object]
) -> None:
    bench = begins()
    lives(bench, before)
    bench.trace.clear()
    lives(bench, script)
    flows = bench.board.primary.flow is Flow.CHARGING
    found = {"flow": flows, "state": bench.state, "charge": bench.primary_fraction}
    assert told(bench.trace) == lines
    assert {name: found[name] for name in figures} == figures

"""The life of a board on its bench, told in the words of a conformance script, and the lines of what it does."""

from collections.abc import Iterable

import pytest

from firmware_model.actions import (
    Action,
    Dropped,
    FeedFrom,
    LogSample,
    RunBuoyancy,
    SendStatus,
    StateChanged,
)
from firmware_model.bench import Bench
from firmware_model.bench.rigs import BenchRig
from firmware_model.config import Cycle, LastResort
from firmware_model.packets import Kind
from firmware_model.table_one import HOURLY, board, power

LINES: dict[type[Action], str] = {
    StateChanged: "{0.old.name} -{0.trigger.name}-> {0.new.name}",
    RunBuoyancy: "motors {0.to.name}",
    FeedFrom: "feed {0.feed.name}",
    LogSample: "sample",
    SendStatus: "send by {0.by.name}",
    Dropped: "dropped: {0.reason}",
}


def lines_of(actions: Iterable[Action], kinds: tuple[type[Action], ...]) -> list[str]:
    """The actions of these kinds, each behind its time in ms."""
    return [f"{it.at_ms} {LINES[type(it)].format(it)}" for it in actions if type(it) in kinds]


def asleep(
    cycle: Cycle | None = HOURLY,
    last_resort: LastResort = LastResort.WAIT,
    minutes: float = 2,
    **start: float,
) -> Bench:
    """A bench of a whole board after its boot and its minute of listening, its trace empty."""
    bench = Bench(board(cycle, power(last_resort)), **start)  # type: ignore[arg-type]
    bench.run(minutes=minutes)
    bench.trace.clear()
    return bench


@pytest.fixture
def bench() -> Bench:
    return asleep()


class RigOfAnyId(BenchRig):
    """Its board need not be aMussel 1, as that of a case is."""

    def command(self, kind: Kind) -> None:
        self.bench.command(kind)


def lives(bench: Bench, script: str) -> None:
    """Plays waits, commands, edges of the charger's pin and resets, such as `permission 2min rises 500ms`."""
    for word in script.split():
        RigOfAnyId(bench).play(word)

"""The watch of a run's own master: it tells that the master stands still, and answers again, but not that it has ended."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from killing import standing_still

from apad_bridge.ros.system.master import Master, start_master
from apad_bridge.runs import watched_services

PATIENCE_S = 180.0
LOOKS = 20
"""More than the master's queue holds, of six."""


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", PATIENCE_S)
    yield running
    running.stop()


class Watching:
    """The lines that were told, the number of questions to the master, and the looks that had a line to write."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.told: queue.Queue[str] = queue.Queue()
        self.asked = 0
        self.looked = threading.Semaphore(0)
        ask = watched_services._ask

        def counted(*arguments: object) -> None:
            self.asked += 1
            ask(*arguments)  # type: ignore[arg-type]

        def listens(_: Path) -> bool:
            self.looked.release()
            return False

        monkeypatch.setattr(watched_services, "_ask", counted)
        monkeypatch.setattr(watched_services, "listens", listens)

    def begin(self, stack: ExitStack, master: Master) -> None:
        watch = watched_services.watched_master(master.uri, Path(), self.told.put, period_s=0.01, still_s=0.1)
        stack.enter_context(watch)

    def look(self) -> None:
        """Returns after some further looks."""
        for _ in range(LOOKS):
            assert self.looked.acquire(timeout=PATIENCE_S)


def test_a_master_that_stands_still_is_told_once_and_asked_once(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    watching = Watching(monkeypatch)
    with ExitStack() as stack:
        with standing_still(master.pid):
            watching.begin(stack, master)
            still = watching.told.get(timeout=PATIENCE_S)
            watching.look()
            assert watching.asked == 1 and watching.told.empty()
        again = watching.told.get(timeout=PATIENCE_S)
    assert still.startswith("the run's own ROS master stands still, so no ROS tool finds the run: http://")
    assert again == "the run's own ROS master answers again"


def test_a_master_that_ends_while_it_stands_still_is_not_told_to_answer_again(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    watching = Watching(monkeypatch)
    with ExitStack() as stack:
        with standing_still(master.pid):
            watching.begin(stack, master)
            watching.told.get(timeout=PATIENCE_S)
            master.stop()
        while watching.asked < 3:
            watching.look()
        assert watching.told.empty()

"""A show of a run, second by second, to a stand-in for the process on ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from apad_bridge.records.run_directory import RunDirectoryError
from apad_bridge.ros2 import ros2_process
from apad_bridge.ros2.ros2_process import serve
from apad_bridge.ros2.topics import TopicMessage
from apad_bridge.scenario.run_options import TimeSource


class Desk:
    """Has the wall's clock and takes what is published. At each wait a tenth of a second passes, and a step is done."""

    def __init__(self, *steps: Callable[[], object]) -> None:
        self.steps = list(steps)
        self.now_s = 100.0
        self.came: list[list[str]] = [[]]
        """The topics, in order, by the wait after which they came."""
        self.is_closed = False
        self.niceness = 0
        self.told: list[str] = []

    def __call__(self, node: str) -> Desk:
        self.node = node
        return self

    def publish(self, it: TopicMessage) -> None:
        self.came[-1].append(it.topic)

    def close(self) -> None:
        self.is_closed = True

    def wait(self, seconds: float) -> bool:
        self.now_s += seconds
        self.came.append([])
        if not self.steps:
            return True
        self.steps.pop(0)()
        return False

    def show(self, run_dir: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
        event = SimpleNamespace(set=lambda: None, is_set=lambda: False, wait=self.wait)
        monkeypatch.setattr(ros2_process, "Ros2Process", self)
        monkeypatch.setattr(ros2_process, "threading", SimpleNamespace(Event=lambda: event))
        monkeypatch.setattr(ros2_process, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        monkeypatch.setattr(
            ros2_process, "os", SimpleNamespace(nice=lambda by: setattr(self, "niceness", by))
        )
        serve(run_dir, lambda topics: self.told.append(topics.summary), self.told.append)
        return self.came


def nothing() -> None:
    pass


def test_all_topics_have_a_message_before_a_person_is_told(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story.apad(1000, 0.0, 0.0)
    story.belief(1000, 7)
    desk = Desk()
    first, last = desk.show(tmp_path, monkeypatch)
    assert {"/clock", "/tf", "/tf_static", "/diagnostics", "/apad1/odometry", "/amussel7/fix"} <= set(first)
    assert first[0] == "/clock" and last == []
    assert desk.told == ["apad1 and 12 aMussels; stamps are mission time, by /clock"]
    assert (desk.node, desk.is_closed, desk.niceness) == ("musselbed_apad1", True, 5)


def test_the_clock_and_events_come_at_once_and_a_state_each_second(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story.belief(1000, 7)

    def tick() -> None:
        story.belief(2000, 7)

    def alarm() -> None:
        story.write(3000, "docks_disagree", id=7, reason="test")

    desk = Desk(tick, alarm, *[nothing] * 12)
    came = desk.show(tmp_path, monkeypatch)
    assert came[1] == ["/clock"] and came[2] == ["/clock", "/apad1/events"]
    assert came[3:9] == [[]] * 6
    # After ten waits of a tenth each, which do not add up to a second exactly.
    states = [at for at, topics in enumerate(came) if "/tf" in topics]
    assert states in ([0, 10], [0, 11])
    assert came[states[1]][0] == "/clock"


def test_the_end_is_told_once_and_shown(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wall: SimpleNamespace
) -> None:
    story.belief(1000, 7)
    story.write(3000, "end", reason="mission time", end_reason="mission time")

    def pass_time() -> None:
        wall.now_s += 0.1

    desk = Desk(*[pass_time] * 35)
    came = desk.show(tmp_path, monkeypatch)
    assert desk.told[1:] == ["the run has ended: mission time; its end is shown until Ctrl-C"]
    assert sum("/tf" in topics for topics in came) == 4


def test_one_time_is_shown_once(story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    story.belief(1000, 7)
    came = Desk(*[nothing] * 35).show(tmp_path, monkeypatch)
    assert [at for at, topics in enumerate(came) if topics] == [0]


def test_seconds_that_passed_while_it_stood_still_are_not_made_up_for(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story.belief(1000, 7)
    seconds = iter(range(2, 100))

    def tick() -> None:
        story.belief(1000 * next(seconds), 7)

    def stand_still() -> None:
        desk.now_s += 60
        tick()

    desk = Desk(stand_still, *[tick] * 12)
    states = [at for at, topics in enumerate(desk.show(tmp_path, monkeypatch)) if "/tf" in topics]
    assert states[:2] == [0, 1] and len(states) in (3, 4)


def test_a_run_by_the_walls_time_has_no_clock(
    begin: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story = begin(TimeSource.WALL)
    story.belief(1000, 7)
    desk = Desk(lambda: story.belief(2000, 7), *[nothing] * 11)
    assert not any("/clock" in topics for topics in desk.show(tmp_path, monkeypatch))
    assert desk.told == ["apad1 and 12 aMussels; stamps are the wall clock's"]


def test_of_a_long_run_the_newest_hundred_events_come(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for at in range(150):
        story.write(1000 * at, "docks_disagree", id=7, reason="test")
    first, _ = Desk().show(tmp_path, monkeypatch)
    assert first.count("/apad1/events") == 100


def test_what_cannot_be_shown_is_told_in_a_line(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RunDirectoryError, match=r"no run: it has no scenario\.yaml"):
        Desk().show(tmp_path / "none", monkeypatch)
    story.belief(1000, 7)
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(RunDirectoryError, match=r"cannot be shown: .*run\.json is damaged"):
        Desk().show(tmp_path, monkeypatch)
    (tmp_path / "run.json").unlink()
    with pytest.raises(RunDirectoryError, match=r"cannot be shown: .*No such file"):
        Desk().show(tmp_path, monkeypatch)
    (tmp_path / "scenario.yaml").write_text("no: scenario")
    with pytest.raises(RunDirectoryError):
        Desk().show(tmp_path, monkeypatch)


def test_a_person_ends_it_while_it_waits_for_the_beginning(
    story: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal is empty. The signal comes as soon as it is received."""

    @contextmanager
    def signalled(act: Callable[[], object]) -> Iterator[None]:
        act()
        yield

    monkeypatch.setattr(ros2_process, "received_by", signalled)
    monkeypatch.setattr(ros2_process, "os", SimpleNamespace(nice=lambda by: None))
    told: list[object] = []
    serve(tmp_path, told.append, told.append)
    assert told == []

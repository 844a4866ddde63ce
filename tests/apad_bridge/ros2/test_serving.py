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
    """Has the wall's clock and takes what is published. At each wait a tenth of a second passes, and a step is
    done, which may last some seconds."""

    def __init__(self, *steps: Callable[[], float | None]) -> None:
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
        self.now_s += self.steps.pop(0)() or 0.0
        return False


@pytest.fixture
def shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Desk]:
    """Shows the run to a desk with these steps, which has then taken all of it."""

    def show(*steps: Callable[[], float | None]) -> Desk:
        desk = Desk(*steps)
        event = SimpleNamespace(set=lambda: None, is_set=lambda: False, wait=desk.wait)
        monkeypatch.setattr(ros2_process, "Ros2Process", desk)
        monkeypatch.setattr(ros2_process, "threading", SimpleNamespace(Event=lambda: event))
        monkeypatch.setattr(ros2_process, "time", SimpleNamespace(monotonic=lambda: desk.now_s))
        nice = SimpleNamespace(nice=lambda by: setattr(desk, "niceness", by))
        monkeypatch.setattr(ros2_process, "os", nice)
        serve(tmp_path, lambda topics: desk.told.append(topics.summary), desk.told.append)
        return desk

    return show


def nothing() -> None:
    pass


def states(desk: Desk) -> list[int]:
    """The waits after which a whole state came."""
    return [at for at, topics in enumerate(desk.came) if "/tf" in topics]


def test_all_topics_have_a_message_before_a_person_is_told(story: Any, shows: Callable[..., Desk]) -> None:
    story.apad(1000, 0.0, 0.0)
    story.belief(1000, 7)
    desk = shows()
    first, last = desk.came
    assert {"/clock", "/tf", "/tf_static", "/diagnostics", "/apad1/odometry", "/amussel7/fix"} <= set(first)
    assert first[0] == "/clock" and last == []
    assert desk.told == ["apad1 and 12 aMussels; stamps are mission time, by /clock"]
    assert (desk.node, desk.is_closed, desk.niceness) == ("musselbed_apad1", True, 5)


def test_the_clock_and_events_come_at_once_and_a_state_each_second(
    story: Any, shows: Callable[..., Desk]
) -> None:
    story.belief(1000, 7)
    desk = shows(
        lambda: story.belief(2000, 7),
        lambda: story.write(3000, "docks_disagree", id=7, reason="test"),
        *[nothing] * 12,
    )
    assert desk.came[1:9] == [["/clock"], ["/clock", "/apad1/events"], *[[]] * 6]
    # After ten waits of a tenth each, which do not add up to a second exactly.
    assert states(desk) in ([0, 10], [0, 11]) and desk.came[states(desk)[1]][0] == "/clock"


def test_the_end_is_told_once_and_shown(
    story: Any, shows: Callable[..., Desk], wall: SimpleNamespace
) -> None:
    story.belief(1000, 7)
    story.write(3000, "end", reason="mission time", end_reason="mission time")
    desk = shows(*[lambda: setattr(wall, "now_s", wall.now_s + 0.1)] * 35)
    assert desk.told[1:] == ["the run has ended: mission time; its end is shown until Ctrl-C"]
    assert len(states(desk)) == 4


def test_one_time_is_shown_once(story: Any, shows: Callable[..., Desk]) -> None:
    story.belief(1000, 7)
    assert [at for at, topics in enumerate(shows(*[nothing] * 35).came) if topics] == [0]


def test_seconds_that_passed_while_it_stood_still_are_not_made_up_for(
    story: Any, shows: Callable[..., Desk]
) -> None:
    """Its clock is a minute on after the first step."""
    story.belief(1000, 7)
    ticks = [lambda at=at: story.belief(1000 * at, 7) for at in range(2, 15)]

    shown = states(shows(lambda: ticks[0]() or 60.0, *ticks[1:]))
    assert shown[:2] == [0, 1] and len(shown) in (3, 4)


def test_a_run_by_the_walls_time_has_no_clock(begin: Callable[..., Any], shows: Callable[..., Desk]) -> None:
    story = begin(TimeSource.WALL)
    story.belief(1000, 7)
    desk = shows(lambda: story.belief(2000, 7), *[nothing] * 11)
    assert not any("/clock" in topics for topics in desk.came)
    assert desk.told == ["apad1 and 12 aMussels; stamps are the wall clock's"]


def test_of_a_long_run_the_newest_hundred_events_come(story: Any, shows: Callable[..., Desk]) -> None:
    for at in range(150):
        story.write(1000 * at, "docks_disagree", id=7, reason="test")
    assert shows().came[0].count("/apad1/events") == 100


@pytest.mark.parametrize(
    ("file", "text", "why"),
    [
        ("scenario.yaml", None, r"no run: it has no scenario\.yaml"),
        ("run.json", "{", r"cannot be shown: .*run\.json is damaged"),
        ("run.json", None, r"cannot be shown: .*No such file"),
        ("scenario.yaml", "no: scenario", "."),
    ],
)
def test_what_cannot_be_shown_is_told_in_a_line(
    story: Any, tmp_path: Path, shows: Callable[..., Desk], file: str, text: str | None, why: str
) -> None:
    story.belief(1000, 7)
    (tmp_path / file).unlink()
    if text is not None:
        (tmp_path / file).write_text(text)
    with pytest.raises(RunDirectoryError, match=why):
        shows()


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

"""Mission time on ROS without rospy's threads: our own /clock in step with the aPad's node, and somebody else's."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

ros_pace = pytest.importorskip("apad_bridge.ros.system.ros_pace")


Topic = Any
"""Stands in for rospy's Publisher and Subscriber: keeps published messages, and lets a test deliver others."""


class Vehicle:
    """A vehicle that has reached `done_ms` and records calls. Its first `lost` answers do not arrive."""

    name = "apad1"

    def __init__(self, done_ms: int = 10**9, lost: int = 0) -> None:
        self.done_ms = done_ms
        self.lost = lost
        self.calls: list[str] = []

    def wait_until_taken(self, timeout_s: float) -> list[str]:
        self.calls.append("taken")
        return []

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool:
        """Waits only a moment when it is behind, so that the caller's patience can end."""
        self.calls.append(f"done {now_ms}")
        if self.lost > 0 or self.done_ms < now_ms:
            self.lost -= 1
            threading.Event().wait(min(timeout_s, 0.05))
            return False
        return True

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        self.calls.append(f"heard {now_ms}")
        return []


@pytest.fixture(autouse=True)
def topics(monkeypatch: pytest.MonkeyPatch) -> list[Topic]:
    made: list[Topic] = []

    def make(name: str, kind: Any, take: Any = None, **options: Any) -> Topic:
        topic: Topic = SimpleNamespace(name=name, take=take, options=options, is_open=True, readers=0)
        topic.published_ms = []
        topic.publish = lambda message: topic.published_ms.append(ros_pace.to_ms(message.clock))
        topic.get_num_connections = lambda: topic.readers
        topic.unregister = lambda: setattr(topic, "is_open", False)
        made.append(topic)
        return topic

    monkeypatch.setattr(ros_pace.rospy, "Publisher", make)
    monkeypatch.setattr(ros_pace.rospy, "Subscriber", make)
    return made


def tick(now_ms: int) -> list[str]:
    """What the link is asked for in a tick that is reached at once."""
    return ["taken", f"done {now_ms}", f"heard {now_ms}"]


OWN: dict[str, tuple[float | None, int, dict[str, int], list[int], list[int], list[str]]] = {
    "a tick is over when goals are taken, the node is done and all is heard": (
        None,
        0,
        {},
        [0, 1_000],
        [0, 1_000],
        [*tick(0), *tick(1_000)],
    ),
    "between ticks the clock comes every half second, at 20 times": (
        20.0,
        5_000,
        {},
        [5_000, 6_000],
        [5_000, 5_500, 6_000],
        [*tick(5_000), *tick(6_000)],
    ),
    "at 1000 times it comes each tick: no oftener than 50 times a second": (
        1000.0,
        5_000,
        {},
        [5_000, 6_000],
        [5_000, 6_000],
        [*tick(5_000), *tick(6_000)],
    ),
    "an answer that was lost is asked for again at the same time": (
        None,
        0,
        {"lost": 2},
        [1_000],
        [1_000] * 3,
        ["taken", *["done 1000"] * 3, "heard 1000"],
    ),
    "when stopped the vehicle still comes to the tick": (
        0.001,
        0,
        {},
        [0, -1_000],
        [0, 1_000],
        [*tick(0), *tick(1_000)],
    ),
    "a stopped flight waits no minute for a node that is silent": (
        None,
        0,
        {"done_ms": 0},
        [-1_000],
        [1_000],
        ["taken", "done 1000"],
    ),
}


@pytest.mark.parametrize(("speed", "start_ms", "made", "ticks", "published", "calls"), OWN.values(), ids=OWN)
def test_the_own_clock_publishes_and_waits(
    topics: list[Topic],
    speed: float | None,
    start_ms: int,
    made: dict[str, int],
    ticks: list[int],
    published: list[int],
    calls: list[str],
) -> None:
    """A tick below zero is one of a flight that has been stopped. On the way the clock tells each time but the ticks'."""
    vehicle, stopped, between_ms = Vehicle(**made), threading.Event(), list[int]()
    clock = ros_pace.OwnMasterClock(speed, vehicle, start_ms)
    for now_ms in ticks:
        if now_ms < 0:
            stopped.set()
        clock.reach(abs(now_ms), stopped, between_ms.append)
    assert (topics[0].published_ms, vehicle.calls) == (published, calls)
    assert topics[0].options["latch"] and 0 < topics[0].options["queue_size"] <= 1000
    assert set(published) - set(map(abs, ticks)) <= set(between_ms) and between_ms == sorted(between_ms)
    assert not set(map(abs, ticks)) & set(between_ms)


def gone() -> str:
    return "the ROS master is gone (refused)"


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ({"patience_s": 0.5}, r"/apad1 did not say within 0.5 s.* come to 2 s of mission time"),
        ({"why_gone": gone}, "the ROS master is gone"),
    ],
    ids=["who does not come along is named", "without a master nobody is waited for"],
)
def test_a_clock_that_cannot_go_on_says_why(topics: list[Topic], how: dict[str, Any], why: str) -> None:
    vehicle = Vehicle(done_ms=1_000)
    clock = ros_pace.OwnMasterClock(None, vehicle, **how)
    clock.reach(1_000, threading.Event())
    with pytest.raises(ros_pace.ClockLost, match=why):
        clock.reach(2_000, threading.Event())
    assert vehicle.calls.count("done 2000") == 1 or "patience_s" in how


def deliver(topics: list[Topic], clock_ms: int) -> None:
    (clock,) = (it for it in topics if it.take is not None)
    clock.take(ros_pace.Clock(ros_pace.to_ros(clock_ms)))


def reached_ms(topics: list[Topic]) -> list[int]:
    (reached,) = (it for it in topics if it.name == "/clock_reached")
    return reached.published_ms


Act = Callable[["Followed"], object]


class Followed:
    """Somebody else's clock, and a vehicle."""

    def __init__(self, topics: list[Topic], start_ms: int) -> None:
        self.topics, self.vehicle, self.stopped = topics, Vehicle(), threading.Event()
        self.clock = ros_pace.FollowedClock(start_ms=start_ms, link=self.vehicle, standstill_s=0.2)

    def shown(self, act: Callable[[Followed], object]) -> str:
        """What an act tells, or why it fails; and the times that are told to who publishes the clock."""
        before = len(reached_ms(self.topics))
        try:
            said = act(self)
        except TimeoutError as error:
            said = next(it for it in ("no /clock came", "paused, gone or started anew") if it in str(error))
        return " ".join(map(str, [*([] if said is None else [said]), *reached_ms(self.topics)[before:]]))


def delivers(clock_ms: int) -> Act:
    return lambda it: deliver(it.topics, clock_ms)


def reaches(now_ms: int) -> Act:
    return lambda it: it.clock.reach(now_ms, it.stopped)


def behind_s(it: Followed) -> object:
    return it.clock.behind_s


FOLLOWED: dict[str, tuple[int, list[tuple[Act, str]]]] = {
    "it counts from the newest time at the first tick": (
        2_000,
        [
            (delivers(1_000_000), ""),  # the flight's other parts open until the first tick
            (delivers(7_000_000), ""),
            (reaches(2_000), "7000000"),
            (behind_s, "0.0"),
            (delivers(7_005_000), ""),
            (reaches(3_000), "7001000"),
            (behind_s, "4.0"),
            (lambda it: it.clock.close(), ""),
            (lambda it: any(topic.is_open for topic in it.topics), "False"),
        ],
    ),
    # A supervisor that resumes is at the others' time, whatever the time of its own first tick.
    "it begins where several missions agreed": (
        2_000,
        [
            (lambda it: it.clock.clock_ms(), "no /clock came"),
            (delivers(7_000_000), ""),
            (lambda it: it.clock.clock_ms(), "7000000"),
            (lambda it: it.clock.begin_at(6_990_000), ""),
            (reaches(9_000), "6999000"),
            (behind_s, "1.0"),
            (reaches(11_000), "paused, gone or started anew 7001000"),
        ],
    ),
    "who publishes the clock learns before which time everything is handled": (
        2_000,
        [
            (delivers(6_000_000), ""),  # the flight has not begun
            (delivers(7_000_000), ""),
            (reaches(2_000), "7000000"),
            (reaches(3_000), "paused, gone or started anew 7001000"),
            (delivers(7_000_400), ""),
        ],
    ),
    "a flight that waits for the first clock begins with it": (
        0,
        [
            (lambda it: it.stopped.set(), ""),
            (reaches(0), ""),
            (delivers(7_000_000), "7000000"),
            (lambda it: it.stopped.clear(), ""),
            (reaches(0), "7000000"),
            (behind_s, "0.0"),
        ],
    ),
    "a clock that waits passes no tick before the vehicle's answers": (
        0,
        [
            (delivers(7_000_000), ""),
            (reaches(0), "7000000"),
            (lambda it: it.vehicle.calls, "[]"),  # nobody waits on somebody else's clock: it would run on
            (lambda it: setattr(it.topics[0], "readers", 1), ""),
            (reaches(0), "7000000"),
            (lambda it: it.vehicle.calls, "['taken']"),
        ],
    ),
    "no clock and one that stands still are told apart": (
        0,
        [
            (reaches(0), "no /clock came"),
            (delivers(500), "500"),
            (reaches(1_000), "paused, gone or started anew 1500"),
        ],
    ),
    "a stopped flight does not wait for somebody else's clock": (
        0,
        [(lambda it: it.stopped.set(), ""), (reaches(1_000), "")],
    ),
}


@pytest.mark.parametrize(("start_ms", "steps"), FOLLOWED.values(), ids=FOLLOWED)
def test_a_followed_clock(topics: list[Topic], start_ms: int, steps: list[tuple[Act, str]]) -> None:
    followed = Followed(topics, start_ms)
    assert [followed.shown(act) for act, _ in steps] == [shown for _, shown in steps]


def test_a_followed_clock_wakes_who_waits_for_it_and_tells_what_has_come_between(topics: list[Topic]) -> None:
    times_ms: list[int] = []

    def between(now_ms: int) -> None:
        times_ms.append(now_ms)
        deliver(topics, now_ms + 400)

    clock = ros_pace.FollowedClock(standstill_s=20.0)
    deliver(topics, 0)
    clock.reach(0, threading.Event())
    waiter = threading.Thread(target=clock.reach, args=(1_000, threading.Event(), between))
    waiter.start()
    deliver(topics, 100)
    waiter.join(10)
    assert not waiter.is_alive() and times_ms == [100, 500, 900]


class BusyVehicle(Vehicle):
    """It reaches nothing before `free_s` of a clock of its own, which goes on while somebody waits for it."""

    def __init__(self, free_s: float) -> None:
        super().__init__()
        self.free_s, self.now_s = free_s, 0.0

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool:
        self.now_s += max(timeout_s, 0.001)
        return self.now_s >= self.free_s


def test_a_busy_node_has_a_minute(topics: list[Topic], monkeypatch: pytest.MonkeyPatch) -> None:
    """After 5 s a busy machine ended a run without its records."""
    busy, gone = BusyVehicle(59.0), BusyVehicle(600.0)
    for vehicle in (busy, gone):
        monkeypatch.setattr(ros_pace, "time", SimpleNamespace(monotonic=lambda it=vehicle: it.now_s))
        late = pytest.raises(ros_pace.ClockLost, match="did not say within 60 s")
        with nullcontext() if vehicle is busy else late:
            ros_pace.OwnMasterClock(None, vehicle).reach(1_000, threading.Event())
    assert 59.0 <= busy.now_s < 60.0 <= gone.now_s < 61.0

"""Mission time on ROS without rospy's threads: our own /clock in step with the aPad's node, and somebody else's."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

ros_pace = pytest.importorskip("apad_bridge.ros.system.ros_pace")


class Topic:
    """Stands in for rospy's Publisher and Subscriber: keeps published messages, and lets a test deliver others."""

    def __init__(self, name: str, kind: Any, take: Any = None, **options: Any) -> None:
        self.name, self.take, self.options = name, take, options
        self.published_ms: list[int] = []
        self.is_open = True
        self.readers = 0

    def get_num_connections(self) -> int:
        return self.readers

    def publish(self, message: Any) -> None:
        self.published_ms.append(ros_pace.to_ms(message.clock))

    def unregister(self) -> None:
        self.is_open = False


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

    def make(*arguments: Any, **options: Any) -> Topic:
        made.append(Topic(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(ros_pace.rospy, "Publisher", make)
    monkeypatch.setattr(ros_pace.rospy, "Subscriber", make)
    return made


def test_a_tick_is_over_when_goals_are_taken_the_node_is_done_and_all_is_heard(topics: list[Topic]) -> None:
    vehicle = Vehicle()
    clock = ros_pace.OwnMasterClock(None, vehicle)
    for now_ms in (0, 1_000):
        clock.reach(now_ms, threading.Event())
    assert topics[0].published_ms == [0, 1_000]
    assert vehicle.calls == ["taken", "done 0", "heard 0", "taken", "done 1000", "heard 1000"]


@pytest.mark.parametrize(("speed", "steps"), [(1000.0, [5_000, 6_000]), (20.0, [5_000, 5_500, 6_000])])
def test_between_ticks_the_clock_comes_no_oftener_than_50_times_a_second(
    topics: list[Topic], speed: float, steps: list[int]
) -> None:
    clock = ros_pace.OwnMasterClock(speed, Vehicle(), start_ms=5_000)
    clock.reach(5_000, threading.Event())
    clock.reach(6_000, threading.Event())
    assert topics[0].published_ms == steps


def test_who_does_not_come_along_is_named(topics: list[Topic]) -> None:
    clock = ros_pace.OwnMasterClock(None, Vehicle(done_ms=1_000), patience_s=0.5)
    clock.reach(1_000, threading.Event())
    with pytest.raises(TimeoutError, match=r"/apad1 did not say within 0.5 s.* come to 2 s of mission time"):
        clock.reach(2_000, threading.Event())


def test_an_answer_that_was_lost_is_asked_for_again_at_the_same_time(topics: list[Topic]) -> None:
    ros_pace.OwnMasterClock(None, Vehicle(lost=2)).reach(1_000, threading.Event())
    assert topics[0].published_ms == [1_000] * 3


def test_the_own_clock_is_latched_and_bounded(topics: list[Topic]) -> None:
    ros_pace.OwnMasterClock(None, Vehicle())
    assert topics[0].options["latch"] and 0 < topics[0].options["queue_size"] <= 1000


def test_when_stopped_the_vehicle_still_comes_to_the_tick(topics: list[Topic]) -> None:
    stopped = threading.Event()
    clock = ros_pace.OwnMasterClock(0.001, Vehicle())
    clock.reach(0, stopped)
    stopped.set()
    clock.reach(1_000, stopped)
    assert topics[0].published_ms == [0, 1_000]


def deliver(topics: list[Topic], clock_ms: int) -> None:
    (clock,) = (it for it in topics if it.take is not None)
    clock.take(ros_pace.Clock(ros_pace.to_ros(clock_ms)))


def reached_ms(topics: list[Topic]) -> list[int]:
    (reached,) = (it for it in topics if it.name == "/clock_reached")
    return reached.published_ms


def test_a_followed_clock_counts_from_the_newest_one_at_the_first_tick(topics: list[Topic]) -> None:
    clock = ros_pace.FollowedClock(start_ms=2_000, standstill_s=0.3)
    deliver(topics, 1_000_000)  # the flight's other parts open until the first tick
    deliver(topics, 7_000_000)
    clock.reach(2_000, threading.Event())
    assert clock.behind_s == 0.0
    deliver(topics, 7_005_000)
    clock.reach(3_000, threading.Event())
    assert clock.behind_s == 4.0
    clock.close()
    assert not any(it.is_open for it in topics)


def test_a_followed_clock_begins_where_several_missions_agreed(topics: list[Topic]) -> None:
    """A supervisor that resumes is at the others' time, whatever the time of its own first tick."""
    clock = ros_pace.FollowedClock(start_ms=2_000, standstill_s=0.1)
    with pytest.raises(TimeoutError, match="no /clock came"):
        clock.clock_ms()
    deliver(topics, 7_000_000)
    assert clock.clock_ms() == 7_000_000
    clock.begin_at(6_990_000)
    clock.reach(9_000, threading.Event())
    assert clock.behind_s == 1.0
    assert reached_ms(topics) == [6_999_000]
    with pytest.raises(TimeoutError):
        clock.reach(11_000, threading.Event())


def test_a_followed_clock_wakes_who_waits_for_it(topics: list[Topic]) -> None:
    clock = ros_pace.FollowedClock(standstill_s=20.0)
    deliver(topics, 500)
    clock.reach(0, threading.Event())
    waiter = threading.Thread(target=clock.reach, args=(1_000, threading.Event()))
    waiter.start()
    deliver(topics, 1_500)
    waiter.join(10)
    assert not waiter.is_alive()


def test_who_publishes_the_clock_learns_before_which_time_everything_is_handled(topics: list[Topic]) -> None:
    clock = ros_pace.FollowedClock(start_ms=2_000, standstill_s=0.1)
    deliver(topics, 6_000_000)
    assert reached_ms(topics) == []  # the flight has not begun
    deliver(topics, 7_000_000)
    clock.reach(2_000, threading.Event())
    with pytest.raises(TimeoutError):
        clock.reach(3_000, threading.Event())
    deliver(topics, 7_000_400)
    assert reached_ms(topics) == [7_000_000, 7_001_000]


def test_a_flight_that_waits_for_the_first_clock_begins_with_it(topics: list[Topic]) -> None:
    clock = ros_pace.FollowedClock(standstill_s=20.0)
    stopped = threading.Event()
    stopped.set()
    clock.reach(0, stopped)
    deliver(topics, 7_000_000)
    assert reached_ms(topics) == [7_000_000]
    clock.reach(0, threading.Event())
    assert clock.behind_s == 0.0


def test_a_clock_that_waits_passes_no_tick_before_the_vehicles_answers(topics: list[Topic]) -> None:
    vehicle = Vehicle()
    clock = ros_pace.FollowedClock(link=vehicle, standstill_s=20.0)
    deliver(topics, 7_000_000)
    clock.reach(0, threading.Event())
    assert vehicle.calls == []  # nobody waits on somebody else's clock: it would run on
    topics[0].readers = 1
    clock.reach(0, threading.Event())
    assert vehicle.calls == ["taken"]


def test_no_clock_and_one_that_stands_still_are_told_apart(topics: list[Topic]) -> None:
    clock = ros_pace.FollowedClock(standstill_s=0.2)
    with pytest.raises(TimeoutError, match="no /clock came"):
        clock.reach(0, threading.Event())
    deliver(topics, 500)
    with pytest.raises(TimeoutError, match="paused, gone or started anew"):
        clock.reach(1_000, threading.Event())


def test_a_stopped_flight_does_not_wait_for_somebody_elses_clock(topics: list[Topic]) -> None:
    stopped = threading.Event()
    stopped.set()
    ros_pace.FollowedClock(standstill_s=20.0).reach(1_000, stopped)


def test_on_the_way_it_tells_the_time_that_has_come(topics: list[Topic]) -> None:
    times_ms: list[int] = []
    clock = ros_pace.OwnMasterClock(20.0, Vehicle())
    clock.reach(0, threading.Event(), times_ms.append)
    clock.reach(4_000, threading.Event(), times_ms.append)
    assert times_ms and times_ms == sorted(times_ms) and all(0 < it < 4_000 for it in times_ms)


def test_a_followed_clock_tells_what_has_come_between(topics: list[Topic]) -> None:
    times_ms: list[int] = []

    def between(now_ms: int) -> None:
        times_ms.append(now_ms)
        deliver(topics, now_ms + 400)

    clock = ros_pace.FollowedClock(standstill_s=20.0)
    deliver(topics, 0)
    clock.reach(0, threading.Event())
    deliver(topics, 100)
    clock.reach(1_000, threading.Event(), between)
    assert times_ms == [100, 500, 900]


def test_a_stopped_flight_waits_no_minute_for_a_node_that_is_silent(topics: list[Topic]) -> None:
    vehicle, stopped = Vehicle(done_ms=0), threading.Event()
    stopped.set()
    ros_pace.OwnMasterClock(None, vehicle).reach(1_000, stopped)
    assert vehicle.calls.count("done 1000") == 1


def test_without_a_master_nobody_is_waited_for_and_the_master_is_named(topics: list[Topic]) -> None:
    vehicle = Vehicle(done_ms=0)
    clock = ros_pace.OwnMasterClock(None, vehicle, why_gone=lambda: "the ROS master is gone (refused)")
    with pytest.raises(ros_pace.ClockLost, match="the ROS master is gone"):
        clock.reach(1_000, threading.Event())
    assert vehicle.calls.count("done 1000") == 1


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
    assert ros_pace.STANDSTILL_S == 60  # of a clock that we follow
    busy, gone = BusyVehicle(59.0), BusyVehicle(600.0)
    for vehicle in (busy, gone):
        monkeypatch.setattr(ros_pace, "time", SimpleNamespace(monotonic=lambda it=vehicle: it.now_s))
        clock = ros_pace.OwnMasterClock(None, vehicle)
        if vehicle is busy:
            clock.reach(1_000, threading.Event())
            continue
        with pytest.raises(ros_pace.ClockLost, match="did not say within 60 s"):
            clock.reach(1_000, threading.Event())
    assert 59.0 <= busy.now_s < 60.0 <= gone.now_s < 61.0

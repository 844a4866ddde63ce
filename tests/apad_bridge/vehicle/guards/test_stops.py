"""A stop outlives its supervisor: the journal gives back what was in force, and what goes out again because of it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import HoldRepeated, StopChanged, StopEnded, StopKind
from apad_bridge.vehicle.commands import (
    CommandFailed,
    GoTo,
    Hold,
    HoldWanted,
    OrderCut,
    Stop,
)
from apad_bridge.vehicle.guards.guarded_vehicle import HOLD_AGAIN_MS
from apad_bridge.vehicle.guards.stop_enforcer import AFTER_CUT_MS, REPEAT_MS
from apad_bridge.vehicle.guards.stops import NO_STOPS, Latch, Stops, StopsEnded, StopsState
from tests.apad_bridge.vehicle.guards.test_gate import Guarded


class Journaled(Guarded):
    """Keeps the lines of stops with their times, as the journal does."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, Event]] = []
        super().__init__(is_real=True)

    def note(self) -> None:
        self.lines += [(self.now_ms, it) for it in self.vehicle.gate.take_events()]

    @property
    def restored(self) -> StopsState:
        stops = NO_STOPS
        for at_ms, it in self.lines:
            if isinstance(it, StopChanged | StopEnded):
                stops = stops.after(at_ms, it)
        return stops


def resumed(restored: StopsState) -> Guarded:
    """A new supervisor, which has heard nothing yet."""
    bench = Guarded(is_real=True, place=None)
    bench.vehicle.gate.stops.restore(restored)
    vehicle = type(bench.vehicle)(bench.wire, bench.vehicle._safety)
    bench.vehicle = vehicle
    return bench


acts = st.lists(
    st.sampled_from(["stop", "off", "hands", "continue", "tick", "drift", "deaf", "hears", "nan"]),
    max_size=12,
)


def test_a_persons_stop_keeps_still_once_its_hull_rests_and_until_it_may_move() -> None:
    """A guard's stop never does, and OFF does as soon as it is obeyed: the water may carry such a hull for ever."""
    bench = Journaled()
    stops = bench.vehicle.gate.stops
    bench.stop()
    came_to_rest = []
    for _ in range(5):
        bench.at(5.0, 5.0)
        came_to_rest.append(stops.keeps_still)
    assert came_to_rest == [False, False, False, True, True]  # 3 s after the first look
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    assert not stops.keeps_still

    bench.stop(off=True)
    for step in range(1, 4):
        bench.at(5.0 + 0.2 * step, 5.0)
    assert stops.in_force is not None and stops.in_force.rest_ms is None
    assert stops.keeps_still
    bench.vehicle.allow_motion("Anna", bench.now_ms)

    bench.at(-0.03, 5.0)  # outside the fence: the guard's stop
    bench.at(-0.03, 5.0, ticks=5)
    assert stops.in_force is not None and not stops.keeps_still
    bench.stop()
    bench.at(-0.03, 5.0, ticks=5)
    assert stops.keeps_still
    bench.vehicle.go_back_in("Anna", "Bo", bench.now_ms)
    assert not stops.keeps_still


@given(acts)
def test_the_journal_gives_back_the_stop_that_was_in_force(names: list[str]) -> None:
    bench, north_m = Journaled(), 5.0
    for name in names:
        match name:
            case "stop" | "off" | "hands":
                bench.stop(off=name == "off", hands=name == "hands")
            case "continue":
                bench.vehicle.allow_motion("Anna", bench.now_ms)
            case "deaf" | "hears":
                bench.wire.takes = name == "hears"
            case "drift":
                north_m += 0.7
                bench.at(north_m, 5.0)
            case "nan":
                bench.silent(4)
            case _:
                bench.at(north_m, 5.0)
    bench.note()
    live, again = bench.vehicle.gate.stops.in_force, bench.restored.in_force
    if live is None:
        assert again is None
        return
    wanted = ("number", "kind", "by", "is_persons", "stills_arms", "ordered_ms", "place_m", "not_obeyed")
    assert {it: getattr(again, it) for it in wanted} == {it: getattr(live, it) for it in wanted}
    assert (again.taken_ms is None) == (live.taken_ms is None)


def test_a_refused_stop_keeps_its_number_while_an_older_one_goes_on() -> None:
    stops = Stops([], Latch())
    stops.begin(StopKind.HOLD, "Anna", "", 0)
    stops.sent(-1, 0, (1.0, 2.0))
    stops.taken(1_000)
    stops.refuse(StopKind.OFF, "Bo", "a pilot steers", 2_000)
    stops.obeyed(3_000)
    assert stops.newest is not None and (stops.newest.number, stops.newest.refused) == (2, "a pilot steers")
    stops.begin(StopKind.OFF, "Bo", "", 4_000)
    assert stops.in_force is not None and stops.in_force.number == 3


def crashed(*, off: bool = False, hands: bool = False, takes: bool = True) -> StopsState:
    """What a supervisor left that died some seconds after a person's stop, or before the vehicle had taken it."""
    bench = Journaled()
    bench.wire.takes = takes
    bench.stop(off=off, hands=hands)
    if takes:
        bench.at(5.0, 5.0, ticks=4)
    return bench.restored


@pytest.mark.parametrize(
    ("how", "sent"),
    [
        ({"off": True}, [Stop]),
        ({"hands": True}, [Stop]),
        ({}, []),
        ({"takes": False}, [Hold]),
        ({"off": True, "takes": False}, [Stop]),
    ],
    ids=["off", "hands", "hold", "hold, not taken", "off, not taken"],
)
def test_a_resumed_run_sends_an_off_again_a_hold_that_was_not_taken_and_nothing_else(
    how: dict[str, bool], sent: list[type]
) -> None:
    bench = resumed(crashed(**how))
    bench.at(5.0, 5.0, ticks=4)
    assert [type(it) for it in bench.wire.out[:1]] == sent
    bench.wire.out = []
    for order in (GoTo(1, 9.0, 5.0, 0.5, 0.5), Hold(2, 5.0, 5.0)):
        bench.vehicle.command(order, bench.now_ms)
    bench.at(5.0, 5.0, HoldWanted(bench.now_ms, 9.0, 5.0))
    assert not any(isinstance(it, GoTo | Hold) for it in bench.wire.out)
    bench.vehicle.allow_motion("Anna", bench.now_ms, ends=StopsEnded.PERSONS_HOLD)
    assert bench.vehicle.gate.awaits_person, "another order of a person is no word to continue after a crash"
    bench.vehicle.allow_motion("Anna", bench.now_ms)
    go = GoTo(3, 9.0, 5.0, 0.5, 0.5)
    assert go in bench.command(go)


@pytest.mark.parametrize(("away_m", "sent"), [(1.0, Hold), (6.0, Stop)])
def test_a_hull_that_has_left_the_place_of_a_hold_not_taken_gets_off(away_m: float, sent: type) -> None:
    """A watchdog may have switched it off meanwhile, and it drifts: a way back would be a motion that nobody ordered."""
    bench = resumed(crashed(takes=False))
    bench.at(5.0 + away_m, 5.0, ticks=3)
    assert type(bench.wire.out[0]) is sent
    assert sent is Stop or all(isinstance(it, Hold) and it.north_m == 5.0 for it in bench.wire.out)


@pytest.mark.parametrize(
    ("said", "sent"),
    [("OFF", Stop), ("SILENT", Stop), ("WATCHING", Hold), ("HELD", Hold), (None, Hold)],
    ids=str,
)
def test_a_hold_not_taken_does_not_follow_the_off_of_the_vehicle_s_watchdog(
    said: str | None, sent: type
) -> None:
    """The watchdog's word is waited for, and counts also when the new supervisor's heartbeats have ended its OFF."""
    bench = resumed(crashed(takes=False))
    bench.at(5.0, 5.0)
    assert bench.wire.out == []
    for it in (said, "WATCHING"):
        bench.vehicle.gate.hear_watchdog([] if said is None or it is None else [it], bench.now_ms)
    bench.at(5.0, 5.0)
    bench.at(5.0, 5.0)
    assert {type(it) for it in bench.wire.out} == {sent}


def test_a_restored_hold_waits_for_a_position_and_becomes_off_without_one() -> None:
    bench = resumed(crashed(takes=False))
    bench.silent(2)
    assert bench.wire.out == []
    bench.silent(3)
    assert {type(it) for it in bench.wire.out} == {Stop}


@pytest.mark.parametrize("how", [{"hands": True}, {}])
def test_the_person_who_resumes_is_told(how: dict[str, bool]) -> None:
    what = "hands at the docks" if how else "stopped (hold)"
    assert crashed(**how).text() == (
        f"{what}, by Anna, since 0:00:01 of mission time: nothing moves until `musselbed continue`"
    )
    assert replace(crashed(), in_force=None).text() == ""


def test_a_stop_is_repeated_until_the_newest_order_that_it_cut_lies_back() -> None:
    bench = Journaled()
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    bench.stop(off=True)
    bench.wire.facts.append(OrderCut(bench.now_ms))
    begun_ms, sent = bench.now_ms, []
    for _ in range(12):
        bench.wire.out = []
        bench.at(5.0, 5.0, after_ms=REPEAT_MS)
        sent.append(bool(bench.wire.out))
    assert sent[: AFTER_CUT_MS // REPEAT_MS - 1] == [True] * (AFTER_CUT_MS // REPEAT_MS - 1)
    assert not any(sent[AFTER_CUT_MS // REPEAT_MS + 1 :]) and bench.now_ms > begun_ms


def test_a_deaf_hull_gets_off_in_place_of_a_hold_and_the_alarm() -> None:
    bench, north_m = Journaled(), 5.0
    for _ in range(5):
        north_m += 0.6
        bench.at(north_m, 5.0)
    bench.stop()
    while len(bench.wire.out) < 2:
        north_m += 0.6
        bench.at(north_m, 5.0)
        assert north_m < 15.0
    assert [type(it) for it in bench.wire.out] == [Hold, Stop]
    bench.note()
    alarm = next(it for _, it in bench.lines if isinstance(it, StopChanged) and it.state == "not obeyed")
    assert alarm.text().startswith("the aPad does not obey: cut its power by hand: stop 1")
    stop = bench.vehicle.gate.stops.in_force
    assert stop is not None and stop.state.value == "not obeyed"


def test_a_guards_finding_gives_a_hull_that_does_not_obey_no_new_time() -> None:
    """Reversed thrusters drive it ever faster, so that the speed guard speaks before the hull is judged."""
    bench, north_m = Guarded(is_real=True, most_m_s=0.8, place=None), 5.0
    for _ in range(5):
        north_m += 0.6
        bench.at(north_m, 5.0)
    bench.stop()
    stopped_ms = bench.now_ms
    while not any(isinstance(it, Stop) for it in bench.wire.out):
        north_m += 0.95
        bench.at(north_m, 5.0)
        assert bench.now_ms - stopped_ms <= 4_500
    assert ("guard", "speed") in bench.events()
    assert [type(it) for it in bench.wire.out] == [Hold, Stop]


def test_a_hold_that_was_not_taken_is_ordered_again_and_told() -> None:
    bench = Journaled()
    bench.wire.takes = False
    bench.command(Hold(1, 5.0, 5.0))
    bench.wire.facts.append(CommandFailed(bench.now_ms, 1, "no action server took the goal within 5 s"))
    bench.wire.out = []
    for _ in range(HOLD_AGAIN_MS // 1_000 + 1):
        assert bench.wire.out == []
        bench.at(5.0, 5.0)
    (again,) = bench.wire.out
    assert isinstance(again, Hold) and (again.north_m, again.east_m) == (5.0, 5.0)
    bench.note()
    assert [type(it) for _, it in bench.lines if isinstance(it, HoldRepeated)] == [HoldRepeated]

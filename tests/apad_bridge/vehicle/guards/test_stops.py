"""A stop outlives its supervisor: the journal gives back what was in force, and what goes out again because of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import StopChanged, StopEnded, StopKind
from apad_bridge.vehicle.commands import CommandFailed, Hold, HoldWanted, OrderCut
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.stops import NO_STOPS, Latch, Stops, StopsEnded, StopsState
from tests.apad_bridge.vehicle.guards.test_gate import (
    Act,
    Guarded,
    at,
    continues,
    go,
    goes_back_in,
    hears,
    orders,
    silent,
    stop,
)


class Journaled(Guarded):
    """Keeps the lines of stops with their times, as the journal does."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, Event]] = []
        super().__init__(is_real=True)

    def note(self) -> None:
        self.lines += [(self.now_ms, it) for it in self.gate.take_events()]

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
    bench.gate.stops.restore(restored)
    bench.vehicle = GuardedVehicle(bench.wire, bench.vehicle._safety)
    return bench


def drifts(by_m: float, ticks: int = 1) -> Act:
    """The hull makes so much way to the north each tick."""

    def drift(it: Guarded) -> list[Any]:
        return [fact for _ in range(ticks) for fact in it.at(it.gate.watch.place_m[0] + by_m, 5.0)]

    return drift


def hearing(*, takes: bool) -> Act:
    return lambda it: setattr(it.wire, "takes", takes)


ACTS: dict[str, Act] = {
    "stop": stop(),
    "off": stop(off=True),
    "hands": stop(hands=True),
    "continue": continues(),
    "tick": drifts(0.0),
    "drift": drifts(0.7),
    "deaf": hearing(takes=False),
    "hears": hearing(takes=True),
    "nan": silent(4),
}


@given(st.lists(st.sampled_from(sorted(ACTS)), max_size=12))
def test_the_journal_gives_back_the_stop_that_was_in_force(names: list[str]) -> None:
    bench = Journaled()
    for name in names:
        ACTS[name](bench)
    bench.note()
    live, again = bench.gate.stops.in_force, bench.restored.in_force
    wanted = ("number", "kind", "by", "is_persons", "stills_arms", "ordered_ms", "place_m", "not_obeyed")
    assert [getattr(again, it, None) for it in wanted] == [getattr(live, it, None) for it in wanted]
    assert live is None or (again.taken_ms is None) == (live.taken_ms is None)


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


def watchdog_says(*said: str) -> Act:
    return lambda it: [it.gate.hear_watchdog([word], it.now_ms) for word in said] and None


def keeps_still(it: Guarded) -> str:
    return str(it.gate.stops.keeps_still)


def awaits_person(it: Guarded) -> str:
    return str(bool(it.gate.awaits_person))


def started(crash: dict[str, bool] | None = None, **how: Any) -> Guarded:
    return Guarded(is_real=True, **how) if crash is None else resumed(crashed(**crash))


OFF_AGAIN, HOLD_AGAIN = "Stop; 1 off ordered; 1 off sent", "Hold! (5, 5)"
NOT_TAKEN: dict[str, Any] = {"crash": {"takes": False}}
SCENES: dict[str, tuple[dict[str, Any], list[tuple[Act, str]]]] = {
    # An OFF goes out again, and a hold that was not taken, and nothing else. Another order of a person is no word to
    # continue after a crash.
    "a resumed run after a person's off": (
        {"crash": {"off": True}},
        [
            (at(5.0, ticks=4), "Stop"),
            (go(1, 9.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (hears(HoldWanted, 9.0, 5.0), "1 failed; 2 failed"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (awaits_person, "True"),
            (continues(), "continued"),
            (go(3, 9.0), "GoTo (9, 5)"),
        ],
    ),
    "a resumed run after a person's off for hands": (
        {"crash": {"hands": True}},
        [
            (at(5.0, ticks=4), "Stop"),
            (go(1, 9.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (hears(HoldWanted, 9.0, 5.0), "1 failed; 2 failed"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (awaits_person, "True"),
            (continues(), "continued"),
            (go(3, 9.0), "GoTo (9, 5)"),
        ],
    ),
    "a resumed run after a person's hold": (
        {"crash": {}},
        [
            (at(5.0, ticks=4), ""),
            (go(1, 9.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (hears(HoldWanted, 9.0, 5.0), "1 failed"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (awaits_person, "True"),
            (continues(), "continued"),
            (go(3, 9.0), "GoTo (9, 5)"),
        ],
    ),
    "a resumed run after a person's hold that was not taken": (
        {"crash": {"takes": False}},
        [
            (at(5.0, ticks=4), "Hold! (5, 5); 1 hold taken; 1 hold obeyed; 1 hold at rest"),
            (go(1, 9.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (hears(HoldWanted, 9.0, 5.0), "1 failed"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (awaits_person, "True"),
            (continues(), "continued"),
            (go(3, 9.0), "GoTo (9, 5)"),
        ],
    ),
    "a resumed run after a person's off that was not taken": (
        {"crash": {"off": True, "takes": False}},
        [
            (at(5.0, ticks=4), "Stop; 1 off taken; 1 off obeyed; 1 off at rest"),
            (go(1, 9.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (hears(HoldWanted, 9.0, 5.0), "1 failed; 2 failed"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (awaits_person, "True"),
            (continues(), "continued"),
            (go(3, 9.0), "GoTo (9, 5)"),
        ],
    ),
    # A watchdog may have switched the hull off, and it drifts: a way back would be a motion that nobody ordered.
    "a hull 1 m off a hold that was not taken holds at the old place": (
        NOT_TAKEN,
        [(at(6.0, ticks=3), "Hold! (5, 5)")],
    ),
    "a hull 6 m off a hold that was not taken gets off": (
        NOT_TAKEN,
        [(at(11.0, ticks=3), "Stop; 1 off ordered; 1 off sent")],
    ),
    # The watchdog's word is waited for, and counts also when the new supervisor's heartbeats have ended its OFF.
    **{
        f"a hold that was not taken, after the watchdog's {said}": (
            NOT_TAKEN,
            [(at(5.0), ""), (watchdog_says(said), ""), (watchdog_says("WATCHING"), ""), (at(5.0), sent)],
        )
        for said, sent in {
            "OFF": OFF_AGAIN,
            "SILENT": OFF_AGAIN,
            "WATCHING": HOLD_AGAIN,
            "HELD": HOLD_AGAIN,
        }.items()
    },
    "a hold that was not taken, where no watchdog speaks": (
        NOT_TAKEN,
        [(at(5.0), ""), (at(5.0, ticks=2), "Hold! (5, 5)")],
    ),
    "a restored hold waits for a position and becomes off without one": (
        NOT_TAKEN,
        [(silent(2), ""), (silent(3), "Stop; Stop; 1 off ordered; 1 off sent; 1 off taken")],
    ),
    "a stop is repeated until the newest order that it cut lies 5 s back": (
        {},
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (stop(off=True), "Stop; 1 off ordered; 1 off sent"),
            (hears(OrderCut), "Stop; 1 failed; 1 off taken"),
            (at(5.0), "Stop"),
            (at(5.0), "Stop"),
            (at(5.0), "Stop"),
            (at(5.0), "Stop"),
            (at(5.0), "1 off obeyed; 1 off at rest"),
            (at(5.0, ticks=6), ""),
        ],
    ),
    "a deaf hull gets off in place of a hold, and the alarm": (
        {},
        [
            (drifts(0.6, ticks=5), ""),
            (stop(), "Hold! (8, 5); 1 hold ordered; 1 hold sent"),
            (drifts(0.6, ticks=3), "1 hold taken"),
            (drifts(0.6), "Stop; 1 hold not obeyed; 1 off ordered; 1 off sent"),
            (drifts(0.6), "Stop; 1 off taken"),
        ],
    ),
    # Reversed thrusters drive it ever faster, so that the speed guard speaks before the hull is judged.
    "a guard's finding gives a hull that does not obey no new time": (
        {"most_m_s": 0.8},
        [
            (drifts(0.6, ticks=5), ""),
            (stop(), "Hold! (8, 5); 1 hold ordered; 1 hold sent"),
            (drifts(0.95), "1 hold taken"),
            (drifts(0.95), ""),
            (drifts(0.95), "guard: speed"),
            (drifts(0.95), "Stop; 1 hold not obeyed; 1 off ordered; 1 off sent"),
        ],
    ),
    "a hold that was not taken is ordered again and told after 10 s": (
        {"takes": False},
        [
            (orders(Hold(1, 5.0, 5.0)), "Hold (5, 5)"),
            (hears(CommandFailed, 1, "no action server took the goal within 5 s"), "1 failed"),
            (at(5.0, ticks=9), ""),
            (at(5.0), "Hold (5, 5); hold_again"),
        ],
    ),
    # A guard's stop never keeps still, and OFF does as soon as it is obeyed: the water may carry such a hull for ever.
    "a person's hold keeps still once its hull rests and until it may move": (
        {},
        [
            (stop(), "Hold! (5, 5); 1 hold ordered; 1 hold sent"),
            (at(5.0, ticks=3), "1 hold taken; 1 hold obeyed"),
            (keeps_still, "False"),
            (at(5.0), "1 hold at rest"),
            (keeps_still, "True"),
            (continues(), "continued"),
            (keeps_still, "False"),
        ],
    ),
    "a person's off keeps still though the water carries the hull": (
        {},
        [
            (stop(off=True), "Stop; 1 off ordered; 1 off sent"),
            (drifts(0.2, ticks=3), "Stop; 1 off taken; 1 off obeyed"),
            (keeps_still, "True"),
        ],
    ),
    "a guard's stop does not keep still, and a person's after it does": (
        {},
        [
            (at(-0.03), "Stop; guard: outside the fence; 1 off ordered; 1 off sent"),
            (at(-0.03, ticks=5), "Stop; 1 off taken; 1 off obeyed; 1 off at rest"),
            (keeps_still, "False"),
            (stop(), "Stop; 2 off ordered; 2 off sent"),
            (at(-0.03, ticks=5), "2 off taken; 2 off obeyed; 2 off at rest"),
            (keeps_still, "True"),
            (goes_back_in, "GoTo (1, 5); back_in"),
            (keeps_still, "False"),
        ],
    ),
}


@pytest.mark.parametrize(("how", "steps"), SCENES.values(), ids=SCENES)
def test_what_goes_out_and_what_is_told(how: dict[str, Any], steps: list[tuple[Act, str]]) -> None:
    bench = started(**how)
    assert [bench.shown(act) for act, _ in steps] == [shown for _, shown in steps]


def test_the_person_who_resumes_is_told() -> None:
    for what, how in {"hands at the docks": {"hands": True}, "stopped (hold)": {}}.items():
        assert crashed(**how).text() == (
            f"{what}, by Anna, since 0:00:01 of mission time: nothing moves until `musselbed continue`"
        )
    assert replace(crashed(), in_force=None).text() == ""

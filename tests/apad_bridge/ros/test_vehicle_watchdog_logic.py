"""The vehicle's watchdog without ROS: what it orders when the heartbeat ends, and what it refuses to believe."""

from __future__ import annotations

import ast
import importlib
import itertools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from watchdog_script import SCRIPT, WATCHDOG

SQUARE = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)]


class Orders:
    """Takes every order, unless it is told not to; `refuses` is the exception that it raises."""

    hold_tries = 3

    def __init__(self) -> None:
        self.tried: list[str] = []
        """Each order; one that was not taken has a question mark."""
        self.refuses: Exception | None = None
        self.is_told = self.is_cut = self.keeps_place = False

    def forget_cut(self) -> None:
        self.is_cut = False

    def hold(self, north: float, east: float) -> None:
        self._take(f"hold {north:g} {east:g}")

    def go(self, north: float, east: float, speed: float) -> None:
        self._take(f"go {north:g} {east:g}")

    def off(self) -> None:
        self._take("off")

    def _take(self, order: str) -> None:
        self.tried.append(order if self.refuses is None else f"{order}?")
        if self.refuses is not None:
            raise self.refuses


@dataclass
class Position:
    """What the vehicle publishes as its position."""

    north_m: float = 10.0
    east_m: float = 10.0
    yaw_rad: float = 0.5
    speed_m_s: float = 0.0
    late_s: float = 0.3
    """Its stamp lies so far before the watchdog's clock."""

    def message(self, now_s: float) -> Any:
        return SimpleNamespace(
            header=SimpleNamespace(stamp=SimpleNamespace(to_sec=lambda: now_s - self.late_s)),
            position=SimpleNamespace(north=self.north_m, east=self.east_m),
            gbody_velocity=SimpleNamespace(x=self.speed_m_s, y=0.0),
            orientation=SimpleNamespace(yaw=self.yaw_rad),
        )


class Vessel:
    """The watchdog of an aPad that tells its position each beat, and of a bench that sends a heartbeat each second."""

    def __init__(self, home: Any = None, corners: Any = None, silence_s: float = 5.0) -> None:
        self.orders, self.said, self.pilots_nodes = Orders(), list[str](), [1]
        check, flag = WATCHDOG.PositionCheck(10.0, 2.0), WATCHDOG.PilotFlag(lambda: len(self.pilots_nodes))
        self.watchdog = WATCHDOG.Watchdog(
            self.orders, check, silence_s, home, self.said.append, flag, corners
        )
        self.position: Position | None = Position()
        self.each_beat: Callable[[], None] = lambda: None
        self.age_s: float | None = 0.1
        """The heartbeat's number; None for no heartbeat."""
        self._beats = 2_000

    def seconds(self, count: float, **changes: Any) -> Vessel:
        """So much time passes, with these attributes of the vessel and of its `orders` from now on."""
        for name, value in changes.items():
            setattr(self if hasattr(self, name) else self.orders, name, value)
        for _ in range(round(count / WATCHDOG.BEAT_S)):
            self._beats += 1
            self.each_beat()
            if self.position is not None:
                now_s = self._beats * WATCHDOG.BEAT_S
                self.watchdog.hear_position(self.position.message(now_s), now_s)
            if self.age_s is not None and self._beats % 2 == 0:
                self.watchdog.hear_heartbeat(SimpleNamespace(data=self.age_s))
            self.watchdog.beat()
            if self.watchdog._call is not None:
                self.watchdog._call.join(10)
        return self

    def shown(self, act: Act) -> str:
        """The watchdog's state after an act, and what was ordered in it."""
        before = len(self.orders.tried)
        said = act(self)
        counted = ((order, len(list(same))) for order, same in itertools.groupby(self.orders.tried[before:]))
        orders = ", ".join(order if count == 1 else f"{count} x {order}" for order, count in counted)
        return said if isinstance(said, str) else f"{self.watchdog.state}: {orders}".removesuffix(": ")


Act = Callable[[Vessel], Any]


def passes(seconds: float, act: Act = lambda it: None, **changes: Any) -> Act:
    """So much time passes, after an act and with these attributes from now on."""
    return lambda it: (act(it), it.seconds(seconds, **changes))


def silence(seconds: float, act: Act = lambda it: None, **changes: Any) -> Act:
    """The bench is silent for so long."""
    return passes(seconds, act, age_s=None, **changes)


def pilot(*, steers: bool) -> Act:
    return lambda it: it.watchdog.hear_pilot(SimpleNamespace(data=steers))


def charge(percent: float) -> Act:
    return lambda it: it.watchdog.hear_battery(SimpleNamespace(data=percent))


def newest_line(vessel: Vessel) -> str:
    return vessel.said[-1]


def fault(vessel: Vessel) -> str:
    return str(vessel.watchdog._position.fault())


def refused(text: str = "no", **how: bool) -> dict[str, Any]:
    return {"refuses": WATCHDOG.NotTaken(text, **how)}


def burst(vessel: Vessel) -> None:
    for _ in range(50):
        vessel.watchdog.hear_heartbeat(SimpleNamespace(data=0.1))


def way_to_28_m(vessel: Vessel) -> None:
    for north_m in range(10, 30):
        vessel.seconds(1, position=Position(float(north_m), speed_m_s=1.0), is_told=True)


def unstamped(vessel: Vessel) -> None:
    vessel.each_beat = lambda: setattr(vessel, "position", Position(late_s=vessel._beats * WATCHDOG.BEAT_S))


def vanished(vessel: Vessel) -> None:
    vessel.position = None


def home(place: tuple[float, float] = (30.0, 10.0), after_s: float = 60.0) -> Any:
    return WATCHDOG.Home(place, after_s, SQUARE, 30.0, 0.5)


WATCHES, AWAY, HOME = (passes(20), "WATCHING"), Position(60.0), {"home": home()}
LOW = "its charge is not known, or below 30 %"
SCENES: dict[str, tuple[dict[str, Any], list[tuple[Act, str]]]] = {
    "it waits, watches, and holds once when the heartbeat ends": (
        {},
        [(silence(60), "WAITING"), (passes(60, age_s=0.5), "WATCHING"), (silence(60), "HELD: hold 10 10")],
    ),
    "one that was started while the bench is silent orders nothing whatever happens": (
        {},
        [
            (silence(30), "WAITING"),
            (silence(30, position=Position(500.0)), "WAITING"),
            (silence(600, position=None), "WAITING"),
        ],
    ),
    **{
        f"a bench whose position is {age_s} s old counts as silent": (
            {},
            [WATCHES, (passes(8, age_s=age_s), "HELD: hold 10 10")],
        )
        for age_s in (3.1, math.inf, -math.inf, -0.5)
    },
    "a bench that does not trust the position makes it a bad one": (
        {},
        [WATCHES, (passes(8, age_s=math.nan), "OFF: off")],
    ),
    "after an off of the bench a silence means off too, until a person has continued": (
        {},
        [
            WATCHES,
            (passes(60, age_s=-1.0), "WATCHING"),
            (silence(60), "OFF: off"),
            (passes(10, age_s=0.1), "WATCHING"),
            (silence(8), "HELD: hold 10 10"),
        ],
    ),
    # Of two connections one may bring what the bench sent before its OFF, when the other has told of the OFF.
    **{
        f"heartbeats of {held_back_s} s that were held back do not end an off": (
            {},
            [
                WATCHES,
                (passes(3, age_s=-1.0), "WATCHING"),
                (passes(held_back_s, age_s=0.1), "WATCHING"),
                (silence(60), "OFF: off"),
            ],
        )
        for held_back_s in (2, 4)
    },
    "a short silence does not shorten the time for which the other connection may hold one back": (
        {"silence_s": 2.0},
        [
            WATCHES,
            (passes(3, age_s=-1.0), "WATCHING"),
            (passes(2.5, age_s=0.1), "WATCHING"),
            (silence(60), "OFF: off"),
        ],
    ),
    # Over a poor link a person's OFF arrives, and the heartbeats that would tell of it do not.
    "a way that somebody ended in the silence is not followed by a hold": (
        {},
        [
            WATCHES,
            (silence(3), "WATCHING"),
            (silence(60, is_cut=True), "OFF: off"),
            (newest_line, "OFF: somebody ended its way in the silence"),
        ],
    ),
    "a way that ended before a heartbeat is judged by the heartbeat": (
        {},
        [WATCHES, (passes(6, is_cut=True), "WATCHING"), (silence(30), "HELD: hold 10 10")],
    ),
    # The OFF overtook it. A link that holds heartbeats back for longer than a silence has led to OFF before.
    **{
        f"heartbeats of {held_back_s} s from before an off do not excuse the end of the way": (
            {},
            [WATCHES, (passes(held_back_s, is_cut=True), "WATCHING"), (silence(30), "OFF: off")],
        )
        for held_back_s in (3, 4)
    },
    # It may be off: the thrusters must not turn because heartbeats are lost.
    "an aPad that keeps its place by itself is left as it is": (
        HOME,
        [WATCHES, (silence(900, keeps_place=True), "LEFT"), (passes(3, age_s=0.1), "WATCHING")],
    ),
    "one that was left is stopped when it sets out": (
        {},
        [
            WATCHES,
            (silence(8, keeps_place=True), "LEFT"),
            (silence(3, keeps_place=False, is_told=True), "HELD: hold 10 10"),
        ],
    ),
    "one that was left is off when its position turns bad": (
        {},
        [WATCHES, (silence(8, keeps_place=True), "LEFT"), (silence(3, position=AWAY), "OFF: off")],
    ),
    "the watchdog's own hold is not somebody's end of a way": (
        {},
        [WATCHES, (silence(8), "HELD: hold 10 10"), (silence(30, is_cut=True), "HELD")],
    ),
    "an off after the watchdog's own hold keeps it from going home": (
        HOME,
        [
            (passes(20, charge(80.0)), "WATCHING"),
            (silence(6), "HELD: hold 10 10"),
            (silence(30, is_cut=True), "HELD"),
            (lambda it: str(it.orders.is_cut), "False"),  # it was by the watchdog's own hold
            (silence(120, is_cut=True), "HELD"),
            (newest_line, "not ordered yet: somebody ended its hold in the silence"),
        ],
    ),
    "an off on the way home is not followed by a hold": (
        HOME,
        [
            (passes(20, charge(80.0)), "WATCHING"),
            (silence(75), "HOMEWARD: hold 10 10, go 30 10"),
            (silence(3, is_cut=True), "OFF: off"),
        ],
    ),
    "a heartbeat of an off trusts no position": (
        {},
        [
            WATCHES,
            (passes(60, age_s=-1.0, position=AWAY), "WATCHING"),
            (fault, "the aPad's position has jumped"),
            (passes(5, age_s=0.1), "WATCHING"),
            (fault, ""),
        ],
    ),
    "what is not taken is ordered again each second": (
        {},
        [
            WATCHES,
            (silence(15, hold_tries=60, **refused("not now")), "SILENT: 11 x hold 10 10?"),
            (newest_line, "not ordered yet: not now"),
            (silence(2, refuses=None), "HELD: hold 10 10"),
        ],
    ),
    "a hold that nobody takes three times gives way to off": (
        {},
        [
            WATCHES,
            (silence(14, **refused()), "SILENT: 3 x hold 10 10?, 7 x off?"),
            (silence(2, refuses=None), "OFF: off"),
        ],
    ),
    "a hold that is refused once gives way to off": (
        {},
        [
            WATCHES,
            (silence(14, **refused(is_refused=True)), "SILENT: hold 10 10?, 9 x off?"),
            (silence(2, refuses=None), "OFF: off"),
        ],
    ),
    # The old one may be carried out later than the first that is taken.
    "after an order that nobody answered the newest is given twice": (
        {},
        [
            WATCHES,
            (silence(6, **refused(is_late=True)), "SILENT: 2 x hold 10 10?"),
            (silence(1, refuses=None), "SILENT: hold 10 10"),
            (silence(1, position=Position(11.0)), "HELD: hold 11 10"),
        ],
    ),
    "three heartbeats and not a burst of old ones end a silence": (
        {},
        [
            WATCHES,
            (silence(10), "HELD: hold 10 10"),
            (silence(10, burst), "HELD"),
            (passes(3, age_s=0.1), "WATCHING"),
        ],
    ),
    "it tells beforehand that a silence would mean off": (
        {},
        [
            WATCHES,
            (passes(5, position=AWAY), "WATCHING"),
            (newest_line, "a silence would mean OFF: the aPad's position has jumped"),
            (passes(10), "WATCHING"),
            (newest_line, "a silence would mean HOLD"),
        ],
    ),
    "nothing is ordered while heartbeats come again": (
        {},
        [
            WATCHES,
            (silence(6, **refused()), "SILENT: 2 x hold 10 10?"),
            (passes(10, refuses=None, age_s=0.1), "WATCHING"),
        ],
    ),
    "a jump just before the silence is not forgotten with a heartbeat that was under way": (
        {},
        [WATCHES, (passes(1, position=AWAY), "WATCHING"), (silence(8), "OFF: off")],
    ),
    "a jump that the bench has trusted is forgotten": (
        {},
        [WATCHES, (passes(15, position=AWAY), "WATCHING"), (silence(8), "HELD: hold 60 10")],
    ),
    "a clock that is off by a constant is none of its business": (
        {},
        [(passes(20, position=Position(late_s=-3_600.0)), "WATCHING"), (silence(8), "HELD: hold 10 10")],
    ),
    "positions without stamps are judged by their arrival": (
        {},
        [(passes(20, unstamped), "WATCHING"), (silence(8), "HELD: hold 10 10")],
    ),
    "a pilot is not fought before the heartbeat is back": (
        HOME,
        [
            WATCHES,
            (silence(10, pilot(steers=True)), "PILOTED"),
            (silence(600, pilot(steers=False)), "PILOTED"),
            (passes(3, age_s=0.1), "WATCHING"),
        ],
    ),
    "a pilot who said so once steers until he says otherwise": (
        {},
        [
            WATCHES,
            (passes(3_600, pilot(steers=True)), "WATCHING"),
            (silence(600), "PILOTED"),
            (silence(600, vanished), "PILOTED"),
        ],
    ),
    "a flag that fell silent moves nothing and leaves the off": (
        {},
        [
            (lambda it: it.seconds(20, each_beat=lambda: pilot(steers=False)(it)), "WATCHING"),
            (silence(10, each_beat=lambda: None), "OFF: off"),
            (newest_line, "OFF: the flag that tells whether a pilot steers fell silent"),
        ],
    ),
    "a pilot's node that has gone moves nothing and leaves the off": (
        {},
        [
            WATCHES,
            (passes(1, pilot(steers=False)), "WATCHING"),
            (silence(10, lambda it: it.pilots_nodes.clear()), "OFF: off"),
        ],
    ),
    "a flag that is told once and never again is still known": (
        {},
        [WATCHES, (passes(60, pilot(steers=False)), "WATCHING"), (silence(10), "HELD: hold 10 10")],
    ),
    "inside the fence it is held": ({"corners": SQUARE}, [WATCHES, (silence(8), "HELD: hold 10 10")]),
    "outside the fence it is not held": (
        {"corners": [(20.0, 0.0), (40.0, 0.0), (40.0, 40.0)]},
        [WATCHES, (silence(8), "OFF: off"), (newest_line, "OFF: the aPad is outside the fence")],
    ),
    "it goes home once after the stated time and holds there": (
        HOME,
        [
            (passes(20, charge(50.0)), "WATCHING"),
            (silence(20), "HELD: hold 10 10"),
            (silence(30), "HELD"),
            (silence(30), "HOMEWARD: go 30 10"),
            (way_to_28_m, "HOME: hold 28 10"),
            (silence(600, is_told=False, position=Position(29.0)), "HOME"),
        ],
    ),
    # 60 s and three times the 40 s that the way takes are over.
    "a way home that does not end is held": (
        HOME,
        [
            (passes(20, charge(50.0)), "WATCHING"),
            (silence(80), "HOMEWARD: hold 10 10, go 30 10"),
            (silence(200), "HELD: hold 10 10"),
        ],
    ),
    **{
        f"it stays where charge or fence forbid the way: {name}": (
            {"home": at},
            [
                (passes(20, act), "WATCHING"),
                (silence(320), "HELD: hold 10 10"),
                (newest_line, f"not ordered yet: {why}"),
            ],
        )
        for name, act, at, why in [
            ("29 %", charge(29.0), home(), LOW),
            ("nan %", charge(math.nan), home(), LOW),
            ("unknown charge", lambda it: None, home(), LOW),
            ("a home outside", charge(90.0), home((50.0, 10.0)), "the aPad or its home is outside the fence"),
        ]
    },
}


@pytest.mark.parametrize(("how", "steps"), SCENES.values(), ids=SCENES)
def test_its_state_and_what_it_orders(how: dict[str, Any], steps: list[tuple[Act, str]]) -> None:
    vessel = Vessel(**how)
    assert [vessel.shown(act) for act, _ in steps] == [shown for _, shown in steps]


RUNNING, PREEMPTED, DONE, IDLE = 1, 2, 3, 0


@pytest.mark.parametrize(
    ("told", "is_cut"),
    [
        ([("end",)], True),  # of a hold: an order alone ends it
        ([("goto", RUNNING), ("goto", PREEMPTED), ("end",)], True),
        ([("goto", RUNNING), ("goto", DONE), ("end",)], False),
        ([("goto", RUNNING), ("end",), ("goto", DONE)], False),
        ([("docking", RUNNING), ("docking", DONE), ("end",)], False),
        ([("docking", RUNNING), ("docking", PREEMPTED), ("end",)], True),
        ([("end",), ("goto", RUNNING)], False),
        ([("goto", RUNNING), ("goto", DONE), ("end",), ("end",)], True),  # the hold that followed
        ([("goto", DONE), ("docking", PREEMPTED)], False),  # of before the watchdog came
        ([("goto", RUNNING), ("goto", PREEMPTED)], True),
        ([("goto", RUNNING), ("goto", DONE)], False),
        ([("goto", RUNNING), ("goto", IDLE)], False),
        ([("goto", RUNNING), ("goto", PREEMPTED), ("goto", RUNNING)], False),
        ([("goto", RUNNING), ("goto", PREEMPTED), ("goto", IDLE)], True),
    ],
)
def test_generation_b_tells_of_each_end_that_an_order_made(told: list[tuple[Any, ...]], is_cut: bool) -> None:
    """`stop_mission` ends a hold without a status; `eventString` tells of it as of every end. Statuses are the stack's."""
    orders = object.__new__(WATCHDOG.Primitives)
    orders.is_told = orders._docks = False
    orders.forget_cut()
    hear = {"goto": orders._hear_status, "docking": orders._hear_docking, "end": orders._hear_end}
    for topic, *status in told:
        hear[topic](SimpleNamespace(data=status[0] if status else "/PRIMITIVE_FINISHED"))
    assert orders.is_cut is is_cut and orders.is_told is (told[-1] == ("goto", RUNNING))
    orders.forget_cut()
    assert not orders.is_cut


BAD: list[tuple[Callable[[int], Position | None], bool, str]] = [
    # The position of each beat, by its number from then on; if the vehicle is under way; and the fault.
    (lambda n: None, False, "tells no position"),
    (lambda n: Position(math.nan), False, "not finite"),
    (lambda n: Position(east_m=math.inf), False, "not finite"),
    (lambda n: Position(yaw_rad=math.nan), False, "not finite"),
    (lambda n: AWAY, False, "has jumped"),
    (lambda n: Position(-10.0), False, "has jumped"),
    (lambda n: Position(late_s=5.3), False, "go back"),
    (lambda n: Position(late_s=-2.7), False, "step or fall behind"),
    (lambda n: Position(10.0 if n % 2 else 60.0), False, "has jumped"),
    # Half a second for each second: the stamps still go on.
    (lambda n: Position(late_s=0.3 + 0.25 * n), False, "fall behind"),
    (lambda n: Position(late_s=0.3 if n % 2 else 30.3), False, "the stamps"),
    (lambda n: Position(), True, "frozen"),
    # 3 mm of noise, and half a metre a second by the velocity.
    (lambda n: Position(10.0 + 0.003 * (-1) ** n, speed_m_s=0.5), False, "frozen"),
]


# A bench needs 3 s; two of these heartbeats may be under way, and a frozen one shows after 5 s. Afterwards all is well
# again, as far as the watchdog can see.
@pytest.mark.parametrize(("place", "is_under_way", "why"), BAD)
def test_a_bad_position_means_off_and_is_not_believed_again_before_heartbeats_come(
    place: Callable[[int], Position | None], is_under_way: bool, why: str
) -> None:
    def spoil(vessel: Vessel) -> None:
        beats, vessel.orders.is_told = itertools.count(), is_under_way
        vessel.each_beat = lambda: setattr(vessel, "position", place(next(beats)))

    again = {"each_beat": lambda: None, "is_told": False}
    in_flight = [
        WATCHES,
        (passes(6, spoil), "WATCHING"),
        (silence(8), "OFF: off"),
        (lambda it: str(why in it.said[-1]), "True"),
        (silence(900, position=AWAY, **again), "OFF"),
        (passes(4, age_s=0.1), "WATCHING"),
        (silence(8), "HELD: hold 60 10"),
    ]
    held = [WATCHES, (silence(8), "HELD: hold 10 10"), (silence(10, spoil), "OFF: off")]
    homeward = [
        (passes(20, charge(50.0)), "WATCHING"),
        (silence(80), "HOMEWARD: hold 10 10, go 30 10"),
        (silence(10, spoil), "OFF: off"),
        (silence(300, position=Position(), **again), "OFF"),
    ]
    for steps in (in_flight, held, homeward):
        vessel = Vessel(home() if steps is homeward else None)
        assert [vessel.shown(act) for act, _ in steps] == [shown for _, shown in steps]
        assert any(why in it for it in vessel.said)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.floats(0.0, 0.3), st.booleans())
def test_a_healthy_position_never_turns_bad(
    seed: int, noise_m: float, wave_m: float, is_under_way: bool
) -> None:
    """Noise, waves of 4 s, stamps late by another half second each time, gaps of 1 s and a clock that is 50 ppm fast."""
    vessel, at, random = Vessel().seconds(20), itertools.count(), Random(seed)

    def sail() -> None:
        t_s = next(at) * WATCHDOG.BEAT_S
        way_m = 0.5 * t_s if is_under_way else 0.0
        speed_m_s = 0.5 * is_under_way + wave_m * math.tau / 4 * abs(math.cos(math.tau * t_s / 4))
        place_m = 10.0 + way_m + wave_m * math.sin(math.tau * t_s / 4)
        vessel.position = Position(
            place_m + random.gauss(0, noise_m),
            10.0 + random.gauss(0, noise_m),
            speed_m_s=speed_m_s,
            late_s=0.3 + random.uniform(0, WATCHDOG.BEAT_S) + 50e-6 * t_s,
        )
        if int(t_s) % 40 == 30:
            vessel.position = None

    vessel.seconds(120, each_beat=sail, is_told=is_under_way and noise_m > 0.001)
    assert vessel.watchdog._position.fault() == ""


@settings(deadline=None, max_examples=120)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("age"), st.sampled_from([0.1, 9.0, math.nan, None])),
            st.tuples(st.just("pilot"), st.booleans()),
            st.tuples(st.just("refuses"), st.sampled_from(["no", "late", ""])),
            st.tuples(
                st.just("spoil"), st.sampled_from([(60.0, 10.0), (10.0, math.nan), (10.0, 10.0, math.inf)])
            ),
            st.tuples(st.just("seconds"), st.integers(1, 20)),
        ),
        max_size=15,
    )
)
def test_whatever_happens_it_moves_nothing_at_a_bad_position_under_a_pilot_or_while_it_waits(
    history: list[tuple[str, Any]],
) -> None:
    """The bench trusts the position in each heartbeat of 0.1 s, so that such a heartbeat ends what came before it."""
    vessel = Vessel(home(after_s=10.0))
    charge(90.0)(vessel)
    is_bad, steers, was_heard = False, False, False
    acts: dict[str, Callable[[Any], object]] = {
        "age": lambda it: setattr(vessel, "age_s", it),
        "pilot": lambda it: pilot(steers=it)(vessel),
        "refuses": lambda it: setattr(
            vessel.orders, "refuses", WATCHDOG.NotTaken(it, is_late=it == "late") if it else None
        ),
        "spoil": lambda it: vessel.seconds(0.5, each_beat=lambda: None, position=Position(*it)),
        "seconds": vessel.seconds,
    }
    for kind, value in history:
        before = len(vessel.orders.tried)
        acts[kind](value)
        steers, is_bad = value if kind == "pilot" else steers, is_bad or kind == "spoil"
        if vessel.age_s == 0.1:
            is_bad, was_heard = False, True
        new = vessel.orders.tried[before:]
        assert not (new and steers), "a pilot is fought"
        assert not new or was_heard, "it orders before the first heartbeat"
        assert not (is_bad and any(it.rstrip("?") != "off" for it in new)), "a place from a bad position"


@given(st.tuples(st.floats(-10, 50), st.floats(-10, 50)), st.tuples(st.floats(-10, 50), st.floats(-10, 50)))
def test_no_way_that_leaves_a_fence_with_a_notch_is_good(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """An L: the square without its corner beyond (20, 20). Judged by many places on the way."""
    corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (20.0, 20.0), (20.0, 40.0), (0.0, 40.0)]
    if WATCHDOG.way_fault(start, goal, corners):
        return
    for n in range(101):
        north_m, east_m = (a + n / 100 * (b - a) for a, b in zip(start, goal, strict=True))
        assert 0 <= north_m <= 40 and 0 <= east_m <= 40 and not (north_m > 20 and east_m > 20)
    assert WATCHDOG.way_fault((5.0, 5.0), (35.0, 5.0), corners) == ""
    assert "crosses" in WATCHDOG.way_fault((35.0, 15.0), (15.0, 35.0), corners)


@pytest.mark.parametrize("text", ["", "0,0 1,1", "0,0 1,1 2", "a,b 1,2 3,4"])
def test_corners_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(ValueError):
        WATCHDOG.corners_of(text)
    assert WATCHDOG.corners_of("0,0 30,0 30,-20.5") == [(0.0, 0.0), (30.0, 0.0), (30.0, -20.5)]


def starred(nodes: list[ast.expr]) -> int:
    return len([it for it in nodes if isinstance(it, ast.Starred)])


AS_IN_PYTHON_2: dict[type, Callable[[Any], bool]] = {
    ast.FunctionDef: lambda it: (
        not (
            it.returns or it.args.kwonlyargs or any(a.annotation for a in it.args.posonlyargs + it.args.args)
        )
    ),
    ast.ClassDef: lambda it: bool(it.bases) and not it.keywords,  # without a base it is of the old kind
    ast.Raise: lambda it: it.cause is None,
    **dict.fromkeys((ast.List, ast.Tuple, ast.Set), lambda it: not starred(it.elts)),
    ast.Call: lambda it: starred(it.args) < 2 and (ast.unparse(it.func) != "super" or bool(it.args)),
}


def test_it_keeps_to_the_syntax_of_python_2_7() -> None:
    """By a parser of that grammar, which also takes some of Python 3; those constructs are looked for by themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        pygram = pytest.importorskip(
            "lib2to3.pygram", reason="this Python has no parser of Python 2's grammar"
        )
        driver, pytree = (importlib.import_module(f"lib2to3.{it}") for it in ("pgen2.driver", "pytree"))
    text = SCRIPT.read_text(encoding="ascii")  # other text would need a coding line
    driver.Driver(pygram.python_grammar, convert=pytree.convert).parse_string(text)
    newer = (ast.JoinedStr, ast.AnnAssign, ast.Nonlocal, ast.YieldFrom, ast.NamedExpr, ast.MatMult)
    newer += (ast.AsyncFunctionDef, ast.Match)
    for node in ast.walk(ast.parse(text)):
        is_old = not isinstance(node, newer) and AS_IN_PYTHON_2.get(type(node), lambda it: True)(node)
        assert is_old, ast.unparse(node)


@pytest.mark.parametrize(
    ("told", "is_cut"),
    [
        ([{"a": 1}, {"a": 2}], True),
        ([{"a": 1}, {"a": 3}], False),
        ([{"a": 1}, {"a": 2, "b": 1}, {"a": 2, "b": 3}], False),
        ([{"a": 1}, {"a": 2, "b": 1}, {"a": 2, "b": 2}], True),
        ([{"a": 2}], False),
    ],
)
def test_generation_a_tells_it_by_the_status_of_its_goals(told: list[dict[str, int]], is_cut: bool) -> None:
    """actionlib_msgs/GoalStatus: 1 ACTIVE, 2 PREEMPTED, 3 SUCCEEDED."""
    orders = object.__new__(WATCHDOG.Goals)
    orders.is_told, orders.is_cut, orders._active, orders._name = False, False, (), None
    orders._taken = SimpleNamespace(set=lambda: None)
    for statuses in told:
        rows = [
            SimpleNamespace(goal_id=SimpleNamespace(id=it), status=status) for it, status in statuses.items()
        ]
        orders._hear_status(SimpleNamespace(status_list=rows))
    assert orders.is_cut is is_cut
    assert orders.keeps_place is not any(status == 1 for status in told[-1].values())
    orders.forget_cut()
    orders._hear_status(SimpleNamespace(status_list=rows))
    assert not orders.is_cut

"""The vehicle's watchdog without ROS: what it orders when the heartbeat ends, and what it refuses to believe."""

from __future__ import annotations

import ast
import importlib
import itertools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
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
        self.taken: list[str] = []
        self.tried: list[str] = []
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
        self.tried.append(order)
        if self.refuses is not None:
            raise self.refuses
        self.taken.append(order)


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

    def __init__(self, home: Any = None, corners: Any = None, pilot: Any = None) -> None:
        self.orders, self.said = Orders(), list[str]()
        check = WATCHDOG.PositionCheck(10.0, 2.0)
        self.watchdog = WATCHDOG.Watchdog(self.orders, check, 5.0, home, self.said.append, pilot, corners)
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

    def pilot(self, steers: bool) -> None:
        self.watchdog.hear_pilot(SimpleNamespace(data=steers))

    @property
    def state(self) -> str:
        return str(self.watchdog.state)

    @property
    def taken(self) -> list[str]:
        return self.orders.taken


def watched(**made: Any) -> Vessel:
    vessel = Vessel(**made).seconds(20)
    assert vessel.state == "WATCHING" and not vessel.orders.tried
    return vessel


@pytest.fixture
def new() -> Vessel:
    return Vessel()


def test_it_waits_watches_and_holds_once_when_the_heartbeat_ends(new: Vessel) -> None:
    assert new.seconds(60, age_s=None).state == "WAITING" and not new.orders.tried
    assert new.seconds(60, age_s=0.5).state == "WATCHING" and not new.orders.tried
    assert new.seconds(60, age_s=None).state == "HELD" and new.orders.tried == ["hold 10 10"]


def test_a_watchdog_that_was_started_while_the_bench_is_silent_orders_nothing_whatever_happens(
    new: Vessel,
) -> None:
    new.seconds(30, age_s=None)
    new.seconds(30, position=Position(north_m=500.0))
    assert new.seconds(600, position=None).state == "WAITING" and not new.orders.tried


@pytest.mark.parametrize("age_s", [3.1, math.inf, -math.inf, -0.5])
def test_a_bench_that_has_no_fresh_position_counts_as_silent(age_s: float) -> None:
    assert watched().seconds(8, age_s=age_s).state == "HELD"


@pytest.fixture
def vessel() -> Vessel:
    return watched()


def test_a_bench_that_does_not_trust_the_position_makes_it_a_bad_one(vessel: Vessel) -> None:
    assert vessel.seconds(8, age_s=math.nan).state == "OFF" and vessel.taken == ["off"]


def test_after_an_off_of_the_bench_a_silence_means_off_too(vessel: Vessel) -> None:
    assert vessel.seconds(60, age_s=-1.0).state == "WATCHING" and not vessel.orders.tried
    assert vessel.seconds(60, age_s=None).state == "OFF" and vessel.taken == ["off"]
    vessel.age_s = 0.1  # a person has continued
    vessel.seconds(10)
    assert vessel.seconds(8, age_s=None).state == "HELD" and vessel.taken == ["off", "hold 10 10"]


@pytest.mark.parametrize("held_back_s", [2, 4])
def test_a_heartbeat_that_was_held_back_does_not_end_an_off(vessel: Vessel, held_back_s: int) -> None:
    """Of two connections one may bring what the bench sent before its OFF, when the other has told of the OFF."""
    vessel.seconds(3, age_s=-1.0)
    vessel.seconds(held_back_s, age_s=0.1)
    assert vessel.seconds(60, age_s=None).state == "OFF" and vessel.taken == ["off"]


def test_a_way_that_somebody_ended_in_the_silence_is_not_followed_by_a_hold(vessel: Vessel) -> None:
    """Over a poor link a person's OFF arrives, and the heartbeats that would tell of it do not."""
    vessel.seconds(3, age_s=None)
    assert vessel.seconds(60, is_cut=True).state == "OFF" and set(vessel.taken) == {"off"}
    assert "somebody ended its way in the silence" in vessel.said[-1]


def test_a_way_that_ended_before_a_heartbeat_is_judged_by_the_heartbeat(vessel: Vessel) -> None:
    vessel.seconds(6, is_cut=True)
    assert vessel.seconds(30, age_s=None).state == "HELD" and set(vessel.taken) == {"hold 10 10"}


@pytest.mark.parametrize("held_back_s", [3, 4])
def test_a_heartbeat_that_was_sent_before_an_off_does_not_excuse_the_end_of_the_way(
    vessel: Vessel, held_back_s: int
) -> None:
    """The OFF overtook it. A link that holds heartbeats back for longer than a silence has led to OFF before."""
    vessel.seconds(held_back_s, is_cut=True)
    assert vessel.seconds(30, age_s=None).state == "OFF" and set(vessel.taken) == {"off"}


def test_a_short_silence_does_not_shorten_the_time_for_which_the_other_connection_may_hold_one_back() -> None:
    vessel = watched()
    vessel.watchdog._silence_s = 2.0
    vessel.seconds(3, age_s=-1.0)
    vessel.seconds(2.5, age_s=0.1)
    assert vessel.seconds(60, age_s=None).state == "OFF" and vessel.taken == ["off"]


@pytest.fixture
def with_home() -> Vessel:
    return watched(home=home())


def test_an_aPad_that_keeps_its_place_by_itself_is_left_as_it_is(with_home: Vessel) -> None:
    """It may be off: the thrusters must not turn because heartbeats are lost."""
    assert (
        with_home.seconds(900, keeps_place=True, age_s=None).state == "LEFT" and with_home.orders.tried == []
    )
    assert with_home.seconds(3, age_s=0.1).state == "WATCHING"


def test_an_aPad_that_was_left_is_stopped_when_it_sets_out_and_off_when_its_position_turns_bad() -> None:
    vessel = watched()
    vessel.seconds(8, keeps_place=True, age_s=None)
    assert vessel.seconds(3, keeps_place=False, is_told=True).state == "HELD" and set(vessel.taken) == {
        "hold 10 10"
    }
    vessel = watched()
    vessel.seconds(8, keeps_place=True, age_s=None)
    assert vessel.seconds(3, position=Position(60.0)).state == "OFF" and set(vessel.taken) == {"off"}


def test_the_watchdog_s_own_hold_is_not_somebody_s_end_of_a_way(vessel: Vessel) -> None:
    vessel.seconds(8, age_s=None)
    vessel.orders.is_cut = True  # by the hold, which was given meanwhile
    assert vessel.seconds(30).state == "HELD" and set(vessel.taken) == {"hold 10 10"}


RUNNING, PREEMPTED, DONE = 1, 2, 3


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
    ],
)
def test_generation_b_tells_of_each_end_that_an_order_made(told: list[tuple[Any, ...]], is_cut: bool) -> None:
    """`stop_mission` ends a hold without a status; `eventString` tells of it as of every end."""
    orders = primitives()
    hear = {"goto": orders._hear_status, "docking": orders._hear_docking, "end": orders._hear_end}
    for topic, *status in told:
        hear[topic](SimpleNamespace(data=status[0] if status else "/PRIMITIVE_FINISHED"))
    assert orders.is_cut is is_cut and orders.is_told is (told[-1] == ("goto", RUNNING))
    orders.forget_cut()
    assert not orders.is_cut


def test_an_off_after_the_watchdog_s_own_hold_keeps_it_from_going_home(with_home: Vessel) -> None:
    with_home.watchdog.hear_battery(SimpleNamespace(data=80.0))
    with_home.seconds(6, age_s=None)
    with_home.orders.is_cut = True  # by the watchdog's own hold
    assert with_home.seconds(30).state == "HELD" and not with_home.orders.is_cut
    with_home.orders.is_cut = True  # by somebody's order
    assert with_home.seconds(120).state == "HELD" and with_home.taken == ["hold 10 10"]
    assert "somebody ended its hold in the silence" in with_home.said[-1]


def test_an_off_on_the_way_home_is_not_followed_by_a_hold(with_home: Vessel) -> None:
    with_home.watchdog.hear_battery(SimpleNamespace(data=80.0))
    assert with_home.seconds(75, age_s=None).state == "HOMEWARD"
    assert with_home.seconds(3, is_cut=True).state == "OFF" and with_home.taken[-1] == "off"


def test_a_heartbeat_of_an_off_trusts_no_position() -> None:
    vessel = watched()
    vessel.seconds(60, age_s=-1.0, position=Position(60.0))
    assert vessel.seconds(5, age_s=0.1).watchdog._position.fault() == ""
    vessel = watched()
    vessel.seconds(60, age_s=-1.0, position=Position(60.0))
    assert "jumped" in vessel.watchdog._position.fault()


def test_what_is_not_taken_is_ordered_again_each_second(vessel: Vessel) -> None:
    assert (
        vessel.seconds(15, hold_tries=60, age_s=None, refuses=WATCHDOG.NotTaken("not now")).state == "SILENT"
        and "not ordered yet: not now" in vessel.said
    )
    assert len(vessel.orders.tried) == pytest.approx(10, abs=1)
    assert vessel.seconds(2, refuses=None).state == "HELD"


@pytest.mark.parametrize(("tries", "is_refused"), [(3, False), (1, True)])
def test_a_hold_that_nobody_takes_gives_way_to_off(vessel: Vessel, tries: int, is_refused: bool) -> None:
    vessel.seconds(14, age_s=None, refuses=WATCHDOG.NotTaken("no", is_refused=is_refused))
    assert vessel.orders.tried[: tries + 1] == ["hold 10 10"] * tries + ["off"]
    assert set(vessel.orders.tried[tries:]) == {"off"}
    assert vessel.seconds(2, refuses=None).state == "OFF"


def test_after_an_order_that_nobody_answered_the_newest_is_given_twice(vessel: Vessel) -> None:
    """The old one may be carried out later than the first that is taken."""
    vessel.seconds(6, age_s=None, refuses=WATCHDOG.NotTaken("no answer", is_late=True))
    assert vessel.orders.tried
    assert (vessel.seconds(1, refuses=None).state, vessel.taken) == ("SILENT", ["hold 10 10"])
    vessel.seconds(1, position=Position(11.0))
    assert (vessel.state, vessel.taken) == ("HELD", ["hold 10 10", "hold 11 10"])


def test_three_heartbeats_and_not_a_burst_of_old_ones_end_a_silence(vessel: Vessel) -> None:
    assert vessel.seconds(10, age_s=None).state == "HELD"
    for _ in range(50):
        vessel.watchdog.hear_heartbeat(SimpleNamespace(data=0.1))
    assert vessel.seconds(10).state == "HELD"
    assert vessel.seconds(3, age_s=0.1).state == "WATCHING" and vessel.taken == ["hold 10 10"]


def test_it_tells_beforehand_that_a_silence_would_mean_off(vessel: Vessel) -> None:
    vessel.seconds(5, position=Position(60.0))
    assert vessel.said[-1] == "a silence would mean OFF: the aPad's position has jumped"
    assert vessel.seconds(10).said[-1] == "a silence would mean HOLD" and not vessel.orders.tried


def test_nothing_is_ordered_while_heartbeats_come_again(vessel: Vessel) -> None:
    vessel.seconds(6, age_s=None, refuses=WATCHDOG.NotTaken("not now"))
    assert vessel.seconds(10, refuses=None, age_s=0.1).state == "WATCHING" and not vessel.taken


def spoiled(**changes: float) -> Callable[[Vessel], None]:
    def spoil(vessel: Vessel) -> None:
        vessel.position = replace(Position(), **changes)

    return spoil


def vanished(vessel: Vessel) -> None:
    vessel.position = None


def two_places(vessel: Vessel) -> None:
    vessel.each_beat = lambda: setattr(
        vessel, "position", Position(60.0 if vessel.position == Position() else 10.0)
    )


def late_and_later(vessel: Vessel) -> None:
    """Half a second for each second: the stamps still go on."""
    beats = itertools.count()
    vessel.each_beat = lambda: setattr(vessel, "position", Position(late_s=0.3 + 0.25 * next(beats)))


def two_clocks(vessel: Vessel) -> None:
    vessel.each_beat = lambda: setattr(
        vessel, "position", Position(late_s=30.3 if vessel.position == Position() else 0.3)
    )


def frozen_on_the_way(vessel: Vessel) -> None:
    vessel.orders.is_told = True


def frozen_with_noise(vessel: Vessel) -> None:
    """3 mm of noise and half a metre a second by the velocity."""
    beats = itertools.count()

    def shake() -> None:
        vessel.position = Position(10.0 + 0.003 * (-1) ** next(beats), speed_m_s=0.5)

    vessel.each_beat = shake


BAD = [
    (vanished, "tells no position"),
    (spoiled(north_m=math.nan), "not finite"),
    (spoiled(east_m=math.inf), "not finite"),
    (spoiled(yaw_rad=math.nan), "not finite"),
    (spoiled(north_m=60.0), "has jumped"),
    (spoiled(north_m=-10.0), "has jumped"),
    (spoiled(late_s=5.3), "go back"),
    (spoiled(late_s=-2.7), "step or fall behind"),
    (two_places, "has jumped"),
    (late_and_later, "fall behind"),
    (two_clocks, "the stamps"),
    (frozen_on_the_way, "frozen"),
    (frozen_with_noise, "frozen"),
]


@pytest.mark.parametrize(("spoil", "why"), BAD)
def test_a_bad_position_means_off_and_is_not_believed_again_before_heartbeats_come(
    vessel: Vessel, spoil: Callable[[Vessel], None], why: str
) -> None:
    spoil(vessel)
    vessel.seconds(
        6
    )  # a bench needs 3 s; two of these heartbeats may be under way, and a frozen one shows after 5 s
    assert vessel.seconds(8, age_s=None).state == "OFF" and vessel.taken == ["off"]
    assert why in vessel.said[-1]
    vessel.seconds(
        900, each_beat=lambda: None, is_told=False, position=Position(60.0)
    )  # all is well again, as far as the watchdog can see
    assert vessel.state == "OFF" and vessel.taken == ["off"]
    assert vessel.seconds(4, age_s=0.1).state == "WATCHING"
    assert vessel.seconds(8, age_s=None).state == "HELD" and vessel.taken == ["off", "hold 60 10"]


@pytest.mark.parametrize(("spoil", "why"), BAD)
def test_of_a_position_that_turns_bad_the_hold_ends(
    vessel: Vessel, spoil: Callable[[Vessel], None], why: str
) -> None:
    assert vessel.seconds(8, age_s=None).state == "HELD"
    spoil(vessel)
    assert vessel.seconds(10).state == "OFF" and vessel.taken == ["hold 10 10", "off"]
    assert any(why in it for it in vessel.said)


def test_a_jump_just_before_the_silence_is_not_forgotten_with_a_heartbeat_that_was_under_way() -> None:
    vessel = watched()
    vessel.seconds(1, position=Position(60.0))
    assert vessel.seconds(8, age_s=None).state == "OFF"
    vessel = watched()
    vessel.seconds(15, position=Position(60.0))  # the bench trusts it
    assert vessel.seconds(8, age_s=None).state == "HELD"


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.floats(0.0, 0.3), st.booleans())
def test_a_healthy_position_never_turns_bad(
    seed: int, noise_m: float, wave_m: float, is_under_way: bool
) -> None:
    """Noise, waves of 4 s, stamps late by another half second each time, gaps of 1 s and a clock that is 50 ppm fast."""
    vessel, at, random = watched(), itertools.count(), Random(seed)

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


def test_a_clock_that_is_off_by_a_constant_is_none_of_its_business(new: Vessel) -> None:
    new.seconds(20, position=Position(late_s=-3_600.0))
    assert new.seconds(8, age_s=None).state == "HELD"


def test_positions_without_stamps_are_judged_by_their_arrival(new: Vessel) -> None:
    made = new.position
    assert made is not None
    new.seconds(
        20,
        each_beat=lambda: setattr(new, "position", replace(made, late_s=(new._beats) * WATCHDOG.BEAT_S)),
    )
    assert new.seconds(8, age_s=None).state == "HELD"


def test_a_pilot_is_not_fought_before_the_heartbeat_is_back(with_home: Vessel) -> None:
    with_home.age_s = None
    with_home.pilot(True)
    with_home.seconds(10)
    with_home.pilot(False)
    assert with_home.seconds(600).state == "PILOTED" and not with_home.orders.tried
    assert with_home.seconds(3, age_s=0.1).state == "WATCHING"


@pytest.mark.parametrize("spoil", [None, vanished])
def test_a_pilot_who_said_so_once_steers_until_he_says_otherwise(vessel: Vessel, spoil: Any) -> None:
    vessel.pilot(True)
    vessel.seconds(3_600)
    vessel.age_s = None
    if spoil is not None:
        spoil(vessel)
    assert vessel.seconds(600).state == "PILOTED" and not vessel.orders.tried


def test_a_flag_that_fell_silent_moves_nothing_and_leaves_the_off(new: Vessel) -> None:
    new.seconds(20, each_beat=lambda: new.pilot(False))
    assert new.seconds(10, each_beat=lambda: None, age_s=None).state == "OFF" and new.taken == ["off"]
    assert "fell silent" in new.said[-1]


def test_a_pilot_s_node_that_has_gone_moves_nothing_and_leaves_the_off() -> None:
    nodes = [1]
    vessel = Vessel(pilot=WATCHDOG.PilotFlag(lambda: nodes[0]))
    vessel.seconds(10)
    vessel.pilot(False)
    nodes[0], vessel.age_s = 0, None
    assert vessel.seconds(10).state == "OFF" and vessel.taken == ["off"]


def test_a_flag_that_is_told_once_and_never_again_is_still_known_and_no_flag_is_no_pilot() -> None:
    for tell in (lambda it: it.pilot(False), lambda it: None):
        vessel = Vessel().seconds(10)
        tell(vessel)
        vessel.seconds(60)
        assert vessel.seconds(10, age_s=None).state == "HELD"


def test_outside_the_fence_it_is_not_held() -> None:
    vessel = watched(corners=SQUARE)
    assert vessel.seconds(8, age_s=None).state == "HELD"
    vessel = watched(corners=[(20.0, 0.0), (40.0, 0.0), (40.0, 40.0)])
    assert vessel.seconds(8, age_s=None).state == "OFF" and "outside the fence" in vessel.said[-1]


def home(place: tuple[float, float] = (30.0, 10.0), after_s: float = 60.0) -> Any:
    return WATCHDOG.Home(place, after_s, SQUARE, 30.0, 0.5)


def silent_with(percent: float | None, at: Any) -> Vessel:
    vessel = Vessel(at)
    if percent is not None:
        vessel.watchdog.hear_battery(SimpleNamespace(data=percent))
    vessel.seconds(20)
    assert vessel.seconds(20, age_s=None).state == "HELD"
    return vessel


def test_it_goes_home_once_after_the_stated_time_and_holds_there() -> None:
    vessel = silent_with(50.0, home())
    assert vessel.seconds(30).taken == ["hold 10 10"]
    assert vessel.seconds(30).state == "HOMEWARD" and vessel.taken[1:] == ["go 30 10"]
    vessel.orders.is_told = True
    for north_m in range(10, 30):
        vessel.seconds(1, position=Position(float(north_m), speed_m_s=1.0))
    assert vessel.state == "HOME" and vessel.taken[2:] == ["hold 28 10"]
    assert len(vessel.seconds(600, is_told=False, position=Position(29.0)).taken) == 3


@pytest.mark.parametrize(
    ("percent", "at", "why"),
    [
        (29.0, home(), "below 30 %"),
        (math.nan, home(), "below 30 %"),
        (None, home(), "not known"),
        (90.0, home((50.0, 10.0)), "outside the fence"),
    ],
)
def test_it_stays_where_charge_or_fence_forbid_the_way(percent: float | None, at: Any, why: str) -> None:
    vessel = silent_with(percent, at)
    assert vessel.seconds(300).state == "HELD" and len(vessel.taken) == 1
    assert any(why in it for it in vessel.said)


@pytest.mark.parametrize(("spoil", "why"), BAD)
def test_a_bad_position_on_the_way_home_means_off(spoil: Callable[[Vessel], None], why: str) -> None:
    vessel = silent_with(50.0, home()).seconds(60)
    assert vessel.state == "HOMEWARD"
    spoil(vessel)
    vessel.seconds(10)
    assert vessel.seconds(
        300, each_beat=lambda: None, position=Position(), is_told=False
    ).state == "OFF" and vessel.taken[1:] == ["go 30 10", "off"]


def test_a_way_home_that_does_not_end_is_held() -> None:
    vessel = silent_with(50.0, home()).seconds(60)
    assert vessel.state == "HOMEWARD"
    vessel.seconds(200)  # 60 s and three times the 40 s that the way takes are over
    assert vessel.state == "HELD" and vessel.taken[-1] == "hold 10 10"


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
    vessel = Vessel(home(after_s=10.0))
    vessel.watchdog.hear_battery(SimpleNamespace(data=90.0))
    """The bench trusts the position in each heartbeat of 0.1 s, so that such a heartbeat ends what came before it."""
    is_bad, steers, was_heard = False, False, False
    for kind, value in history:
        before = len(vessel.orders.tried)
        if kind == "age":
            vessel.age_s = value
        elif kind == "pilot":
            vessel.pilot(value)
            steers = value
        elif kind == "refuses":
            vessel.orders.refuses = WATCHDOG.NotTaken(value, is_late=value == "late") if value else None
        elif kind == "spoil":
            vessel.seconds(0.5, each_beat=lambda: None, position=Position(*value))
            is_bad = True
        else:
            vessel.seconds(value)
        if vessel.age_s == 0.1:
            is_bad, was_heard = False, True
        new = vessel.orders.tried[before:]
        assert not (new and steers), "a pilot is fought"
        assert not new or was_heard, "it orders before the first heartbeat"
        assert not (is_bad and any(it != "off" for it in new)), "a place from a bad position"


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
        assert not isinstance(node, newer), ast.unparse(node)
        if isinstance(node, ast.FunctionDef):
            arguments = node.args.posonlyargs + node.args.args
            assert node.returns is None and not node.args.kwonlyargs, node.name
            assert not any(it.annotation for it in arguments), node.name
        if isinstance(node, ast.ClassDef):
            assert node.bases and not node.keywords, f"{node.name} is a class of the old kind in Python 2"
        if isinstance(node, ast.Raise):
            assert node.cause is None
        if isinstance(node, ast.List | ast.Tuple | ast.Set):
            assert not any(isinstance(it, ast.Starred) for it in node.elts)
        if isinstance(node, ast.Call):
            assert sum(isinstance(it, ast.Starred) for it in node.args) < 2
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super":
            assert node.args


def primitives() -> Any:
    orders = object.__new__(WATCHDOG.Primitives)
    orders.is_told = orders._docks = False
    orders.forget_cut()
    return orders


def goals() -> Any:
    orders = object.__new__(WATCHDOG.Goals)
    orders.is_told, orders.is_cut, orders._active, orders._name = False, False, (), None
    orders._taken = SimpleNamespace(set=lambda: None)
    return orders


@pytest.mark.parametrize(
    ("told", "is_cut"),
    [([1, 2], True), ([1, 3], False), ([1, 0], False), ([1, 2, 1], False), ([1, 2, 0], True), ([2], False)],
)
def test_generation_b_tells_a_way_that_was_ended_by_its_goto_status(told: list[int], is_cut: bool) -> None:
    """Of the published stack: 0 idle, 1 running, 2 pre-empted, 3 done."""
    orders = primitives()
    for status in told:
        orders._hear_status(SimpleNamespace(data=status))
    assert orders.is_cut is is_cut


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
    orders = goals()
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

"""The judge of a vehicle's stops: histories made by hand, whose verdict a person can see."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from safety.campaign import jobs
from safety.judge import Case, Kind, Told, Verdict, joined, judge
from safety.rows import ROWS
from safety.track import Fact, Track, is_inside, out_m, way_out_m
from shapely import Point, Polygon

FENCE = ((0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0))
BENCH, WATCHDOG, STRANGER = "/musselbed_1", "/musselbed_watchdog_9", "/actor_stranger"
HULL = "/apad1_simulated"
BEGUN_S, STOPS_S = 10.0, 12.0
SPEED_M_S = 0.5


def sailing(stops_s: float = math.inf, until_s: float = 40.0) -> list[Fact]:
    """The truth: north from (10, 30) at half a metre a second, with a metre of coasting after `stops_s`."""
    facts = []
    for tenth in range(round(10 * until_s) + 1):
        at_s = tenth / 10
        north = 10 + SPEED_M_S * min(at_s, stops_s + 2.0)
        facts.append({"fact": "truth", "at_s": at_s, "north": north, "east": 30.0, "yaw": 0.0, "stamp": at_s})
    return facts


def call(
    at_s: float, order: str, place: tuple[float, float] | None = None, by: str = BENCH, **more: Any
) -> list[Fact]:
    """A call that the vehicle takes 0.1 s later; `took_s` None: it never answers."""
    took_s = more.pop("took_s", at_s + 0.1)
    number = round(1000 * at_s)
    made = {"fact": "call", "at_s": at_s, "number": number, "order": order, "by": by, **more}
    answer = {"fact": "answer", "at_s": took_s, "number": number, "order": order, "took": True}
    return [made | ({} if place is None else {"place": list(place)}), *([] if took_s is None else [answer])]


def goal(at_s: float, place: tuple[float, float], by: str = BENCH, kind: int = 0) -> list[Fact]:
    key = f"{by}-{at_s}"
    made = {"fact": "goal", "at_s": at_s, "by": by, "key": key, "kind": kind, "place": list(place)}
    return [made, {"fact": "status", "at_s": at_s + 0.1, "goals": {key: 1}}]


def go(at_s: float = 1.0, place: tuple[float, float] = (50.0, 30.0), by: str = BENCH) -> list[Fact]:
    return call(at_s, "commander/primitive/go2point", place, by)


def hold(at_s: float, place: tuple[float, float], by: str = BENCH) -> list[Fact]:
    return call(at_s, "commander/primitive/dynamic_positioning", place, by)


def off(at_s: float, by: str = BENCH, **more: Any) -> list[Fact]:
    return call(at_s, "commander/stop_mission", None, by, **more)


def judged(facts: list[Fact], case: Case | None = None, **how: Any) -> Verdict:
    given_ = Case("b", FENCE, BEGUN_S, **how) if case is None else case
    return judge(sorted(facts, key=lambda it: it["at_s"]), given_)


def test_a_stop_in_time_is_good_and_its_coasting_is_measured() -> None:
    verdict = judged([*sailing(STOPS_S), *go(), *off(STOPS_S)])
    assert verdict.failures == []
    assert (verdict.stop_s, verdict.stop_kind, verdict.stop_by, verdict.taken_s) == (2.0, "off", BENCH, 2.1)
    assert verdict.coasting_m == pytest.approx(1.0, abs=0.16) and verdict.orders == 2
    assert verdict.rest_s is not None and verdict.rest_s < 2.5 and verdict.furthest_out_m == 0


def test_none_and_a_late_one_are_bad() -> None:
    never = judged([*sailing(), *go()])
    assert never.failures == ["no stop on the wire"] and never.stop_s is None
    late = judged([*sailing(14.0), *go(), *off(14.0)])
    assert late.failures == ["the first stop came after 4.0 s, more than 3"]
    assert judged([*sailing(14.0), *go(), *off(14.0)], limit_s=12.0).failures == []
    on = judged([*sailing(), *go(), *off(12.0)])
    assert on.failures == ["the vehicle did not come to rest"]


def test_a_hold_is_a_stop_where_the_vehicle_truly_is_and_while_it_was_told_so() -> None:
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    assert judged([*sailing(STOPS_S), *go(), *hold(STOPS_S, here)]).stop_kind == "hold"
    far = judged([*sailing(STOPS_S), *go(), *hold(STOPS_S, (here[0] + 1.2, 30.0))])
    assert far.stop_s is None
    assert (
        judged([*sailing(STOPS_S), *go(), *hold(STOPS_S, (here[0] + 1.2, 30.0))], at_place_m=2.0).stop_s
        == 2.0
    )
    lied = judged([*sailing(STOPS_S), *go(), *hold(STOPS_S, here)], lies=True)
    assert lied.stop_s is None and "no stop on the wire" in lied.failures
    must = judged([*sailing(STOPS_S), *go(), *off(STOPS_S)], must_be=Kind.HOLD)
    assert must.failures == ["no hold on the wire"]


def test_an_arm_a_cancel_or_half_an_off_is_no_stop_of_generation_a() -> None:
    case = Case("a", FENCE, BEGUN_S)
    under_way = [*sailing(STOPS_S), *goal(1.0, (50.0, 30.0))]
    cancel = [{"fact": "cancel", "at_s": 11.0, "by": BENCH, "key": ""}]
    switch = call(11.4, "VelCon_enable", enable=False)
    arm = [{"fact": "arms", "at_s": 10.5, "by": BENCH, "open": -1}]
    for some in ([], cancel, switch, arm, call(11.4, "FADP_enable", enable=False)):
        assert judged([*under_way, *some], case).stop_s is None
    whole = judged([*under_way, *cancel, *switch], case)
    assert whole.stop_s == 1.4 and whole.stop_kind == "off" and whole.failures == []
    # The switch alone came first: the OFF is whole with the cancel.
    assert judged([*under_way, *call(10.5, "VelCon_enable", enable=False), *cancel], case).stop_s == 1.0
    assert judged([*under_way, *goal(12.0, (16.0, 30.0))], case).stop_kind == "hold"


def test_another_clients_orders_are_not_ours() -> None:
    verdict = judged([*sailing(STOPS_S), *go(), *go(10.0, (75.0, 30.0), STRANGER), *off(STOPS_S)])
    assert verdict.failures == [] and verdict.orders == 2
    assert judged([*sailing(STOPS_S), *off(STOPS_S, STRANGER)]).stop_s is None


def test_a_place_outside_and_a_way_that_leaves_the_fence_are_counted() -> None:
    bad = judged([*sailing(STOPS_S), *go(1.0, (75.0, 30.0)), *off(STOPS_S)])
    assert bad.outside == 1 and "15.0 m outside" in bad.failures[0]
    notch = (
        (0.0, 0.0),
        (60.0, 0.0),
        (60.0, 60.0),
        (40.0, 60.0),
        (40.0, 20.0),
        (30.0, 20.0),
        (30.0, 60.0),
        (0.0, 60.0),
    )
    across = judged([*sailing(STOPS_S), *go(1.0, (50.0, 30.0)), *off(STOPS_S)], Case("b", notch, BEGUN_S))
    assert across.outside == 1
    nan = judged([*sailing(STOPS_S), *go(1.0, (math.nan, 30.0)), *off(STOPS_S)])
    assert nan.outside == 1


def test_a_vehicle_that_truly_leaves_the_fence_is_bad_however_it_was_stopped() -> None:
    narrow = ((0.0, 0.0), (16.5, 0.0), (16.5, 60.0), (0.0, 60.0))
    verdict = judged([*sailing(STOPS_S), *off(STOPS_S)], Case("b", narrow, BEGUN_S))
    assert verdict.failures == ["the vehicle was truly 0.5 m outside the fence"] and verdict.outside == 0


def test_orders_while_a_pilot_steers_are_counted_until_the_pilot_lets_go() -> None:
    flag = [{"fact": "pilot", "at_s": 10.0, "steers": True, "by": STRANGER}]
    let_go = [{"fact": "pilot", "at_s": 20.0, "steers": False, "by": STRANGER}]
    idle = {"is_stop_due": False, "is_rest_due": False}
    late = [*go(10.3), *go(15.0), *off(16.0), *go(25.0)]
    assert judged([*sailing(), *flag, *let_go, *late], **idle).against_pilot == 2
    assert (
        judged([*sailing(), *flag, *late], **idle).against_pilot == 3
    )  # a source that fell silent still steers
    assert judged([*sailing(), *flag, *go(10.3)], **idle).failures == []


def test_motion_after_a_stop_needs_a_word() -> None:
    again = [*sailing(STOPS_S), *go(), *off(STOPS_S), *go(20.0)]
    assert judged(again).unasked == 1
    assert judged(again, words_s=(19.0,)).unasked == 0
    assert judged([*sailing(STOPS_S), *go(), *off(STOPS_S), *hold(20.0, (17.0, 30.0))]).unasked == 1
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    repeated = [*hold(STOPS_S, here), *hold(13.0, here), *hold(25.0, here)]
    assert judged([*sailing(STOPS_S), *go(), *repeated]).failures == []
    assert judged([*sailing(STOPS_S), *go(), *off(STOPS_S), *off(30.0)]).failures == []
    going = judged(again, words_s=(19.0,), must_move=True)
    assert going.failures == []
    stuck = judged([*sailing(STOPS_S), *go(), *off(STOPS_S)], words_s=(19.0,), must_move=True)
    assert stuck.failures == ["`continue` did not make the mission go on"]


def test_orders_by_a_false_place_count_even_where_no_stop_came() -> None:
    verdict = judged([*sailing(), *go(), *go(20.0)], lies=True)
    assert verdict.unasked == 1 and verdict.stop_s is None
    assert judged([*sailing(), *go(), *go(20.0)]).unasked == 0


def beat(at_s: float, *, says_off: bool = False) -> Fact:
    return {"fact": "heartbeat", "at_s": at_s, "says_off": says_off}


@pytest.mark.parametrize(
    ("beats", "says_silence"),
    [
        ([beat(9.0), beat(10.0)], True),
        ([beat(9.0), beat(10.0), beat(13.0)], False),
        ([beat(9.0), beat(10.0, says_off=True)], False),
        ([], False),
    ],
    ids=["ten seconds of silence", "a heartbeat seven seconds ago", "the last told of an off", "never one"],
)
def test_a_watchdogs_hold_after_an_off_is_bad_and_a_silence_before_it_is_said(
    beats: list[Fact], says_silence: bool
) -> None:
    held = hold(20.2, (16.9, 30.0), WATCHDOG)
    verdict = judged([*sailing(STOPS_S), *go(), *off(STOPS_S), *beats, *held])
    assert verdict.unasked == 1
    assert ("without a heartbeat" in verdict.failures[0]) is says_silence


def test_after_a_silence_the_watchdog_may_hold_and_the_bench_nothing() -> None:
    here = (10 + SPEED_M_S * 20.0, 30.0)
    held = [*sailing(20.0), *go(), *hold(20.0, here, WATCHDOG)]
    how = {"limit_s": 12.0, "deaf": (BEGUN_S, 30.0), "must_be": Kind.HOLD}
    assert judged([*held, *hold(31.0, here, WATCHDOG)], **how).failures == []
    assert judged([*held, *hold(31.0, here)], **how).unasked == 1
    assert judged([*held, *off(31.0)], **how).failures == []


def test_a_vehicle_at_rest_may_be_left_in_a_silence_and_one_that_goes_on_may_not() -> None:
    says = [{"fact": "watchdog", "at_s": 20.5, "state": "LEFT"}]
    how = {"limit_s": 12.0, "deaf": (BEGUN_S, 30.0), "must_be": Kind.HOLD}
    assert judged([*sailing(15.0), *go(), *says], **how).failures == []
    assert judged([*sailing(), *go(), *says], **how).failures == ["no hold on the wire"]
    assert judged([*sailing(27.0), *go(), *says], **how).failures == ["no hold on the wire"]
    assert judged([*sailing(15.0), *go()], **how).failures == ["no hold on the wire"]
    assert judged([*sailing(15.0), *go(), *says], limit_s=12.0, must_be=Kind.HOLD).failures != []
    late = "the first stop came after 21.0 s, more than 12"
    how = {"limit_s": 12.0, "deaf": (BEGUN_S, 30.0)}
    after = [{**says[0], "at_s": 30.5}]
    rows = (
        (15.0, says, []),
        (15.0, after, []),
        (27.0, says, [late]),
        (27.0, after, [late]),
        (15.0, [], [late]),
    )
    for stands_s, left, failures in rows:
        assert judged([*sailing(stands_s), *go(), *left, *off(31.0)], **how).failures == failures
    # Nobody holds it, and from 26 s on the water takes it away.
    rests = sailing(15.0)
    taken = [it | {"east": 30.0 + max(0.0, it["at_s"] - 26.0)} for it in rests]
    assert late in judged([*taken, *go(), *says, *off(31.0)], **how).failures


def test_after_a_power_cycle_nobody_moves_it() -> None:
    how = {"is_stop_due": False, "nothing_after_s": BEGUN_S}
    assert judged([*sailing(10.0), *go(), *hold(30.0, (16.0, 30.0), WATCHDOG)], **how).unasked == 1
    assert judged([*sailing(10.0), *go(), *off(30.0)], **how).failures == []


def test_a_persons_stop_that_is_not_taken_is_bad_where_the_vehicle_is_within_reach() -> None:
    stands = [*sailing(8.0), *go(), *off(8.0)]
    refused = {"told": (told(12.0, code=3),)}
    assert len(judged([*sailing(STOPS_S), *go(), *off(STOPS_S)], **refused).failures) == 1
    assert judged(stands, must_take=False, **refused).failures == ["no stop on the wire"]
    assert judged(stands, must_take=False, may_stand=True, **refused).failures == []
    held = [*sailing(8.0), *go(), *hold(8.0, (10 + SPEED_M_S * 8.0, 30.0))]
    later = [*held, *hold(16.0, (10 + SPEED_M_S * 8.0, 30.0), WATCHDOG)]
    assert judged(later, must_take=False, **refused).stop_s == 6.0
    assert judged(later, must_take=False, may_stand=True, **refused).stop_s == 0.0
    gone_on = [*stands, *go(9.0)]
    assert judged(gone_on, must_take=False, may_stand=True, **refused).stop_s is None


def told(answered_s: float, *, code: int = 0) -> Told:
    return Told("stop", 11.0, answered_s, code, code == 0)


def test_done_means_that_the_vehicle_has_taken_it() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S)]
    assert judged(flight, told=(told(14.7),)).failures == []
    assert judged(flight, told=(told(12.05),)).untaken == 1  # on the wire, and not answered yet
    assert judged(flight, told=(told(12.05, code=3),)).untaken == 0
    deaf = [*sailing(STOPS_S), *go(), *off(STOPS_S, took_s=None)]
    assert judged(deaf, told=(told(20.0),)).untaken == 1
    moved_on = [*flight, *go(13.0, by=STRANGER)]
    assert judged(moved_on, told=(told(14.0),)).untaken == 1


def test_a_hold_that_is_ordered_again_is_a_stop_though_the_hull_has_gone_past_its_place() -> None:
    """It goes on for 2 s at half a metre a second, and comes to rest a metre behind the place."""
    place = (10 + SPEED_M_S * STOPS_S, 30.0)
    held = [*sailing(STOPS_S + 2.0), *go(), *hold(STOPS_S, place)]
    asked = {"told": (told(20.0),), "at_place_m": 0.5}
    assert judged([*held, *hold(16.5, place)], **asked).failures == []
    elsewhere = (place[0] + 4.0, place[1])
    assert judged([*held, *hold(16.5, elsewhere)], **asked).untaken == 1
    assert judged([*held, *go(16.5, place)], **asked).untaken == 1


def test_done_means_that_the_hull_truly_slows() -> None:
    flight = [
        *sailing(STOPS_S),
        *go(),
        *off(STOPS_S),
    ]  # half a metre a second until 14 s, and none from then on
    early = judged(flight, told=(told(13.0),))
    assert early.failures == ["`stop` said done at 0.50 m/s; the stop was taken at 0.50 m/s"]
    assert judged(flight, told=(told(13.0, code=3),)).untaken == 0
    assert judged([*sailing(), *go(), *off(STOPS_S)], told=(told(30.0),), is_rest_due=False).untaken == 1
    # It took the stop before 14 s, and answered at 16 s; it is carried on at 0.32 m/s, less than 70 % of its speed before.
    slower = sailing(14.0 - 2.0)
    for it in slower:
        it["north"] += 0.32 * max(0.0, it["at_s"] - 14.0)
    late = judged([*slower, *go(), *off(STOPS_S, took_s=16.0)], told=(told(17.0),), is_rest_due=False)
    assert late.untaken == 0
    assert judged([*slower, *go(), *off(15.0)], told=(told(17.0),), is_rest_due=False).untaken == 1
    back = sailing(STOPS_S)
    for it in back:
        it["north"] -= 0.45 * max(
            0.0, it["at_s"] - 14.0
        )  # it has overshot the place of its HOLD, and comes back
    assert judged([*back, *go(), *off(STOPS_S)], told=(told(15.0),), is_rest_due=False).untaken == 0
    # Half of its speed is the water's, which carries it along for good.
    carried = {"told": (told(30.0),), "is_rest_due": False, "current_m_s": (SPEED_M_S - 0.2, 0.0)}
    assert judged([*sailing(), *go(), *off(STOPS_S)], **carried).failures == []


def test_a_hung_node_tells_its_speed_afterwards() -> None:
    """All that a node of a hull at half a metre a second tells of 10 to 30 s arrives at 30 s."""
    facts = [dict(it, at_s=30.0) if 10 < it["at_s"] < 30 else it for it in sailing()]
    track = Track(sorted(facts, key=lambda it: it["at_s"]))
    assert track.speed_m_s(20.0) == pytest.approx(SPEED_M_S, abs=0.06)


def test_a_hold_after_an_off_is_bad_though_a_hold_came_first() -> None:
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    held = [*sailing(STOPS_S), *go(), *hold(STOPS_S, here)]
    assert judged([*held, *off(12.5)]).failures == []
    late = judged([*held, *off(12.5), *hold(12.6, here)])
    assert late.unasked == 1 and "after the OFF" in late.failures[0]
    assert judged([*held, *off(12.5), *hold(20.0, here)], words_s=(19.0,)).failures == []
    assert judged([*held, *hold(12.4, here), *off(12.5)]).failures == []


def test_a_hold_that_has_one_place_is_not_ordered_elsewhere() -> None:
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    held = [*sailing(STOPS_S), *go(), *hold(STOPS_S, here)]
    walked = [*held, *hold(20.0, (here[0] + 0.5, 30.0))]
    assert judged(walked).failures == []
    assert judged(walked, one_place=True).unasked == 1
    assert judged([*held, *hold(20.0, here)], one_place=True).failures == []


def test_a_hull_that_moves_at_the_end_is_bad_where_it_has_to_rest() -> None:
    again = sailing(STOPS_S)
    for it in again:
        it["north"] += max(0.0, it["at_s"] - 30.0)
    how = {"ends_at_rest": True, "is_rest_due": False}
    assert judged([*again, *off(STOPS_S)], **how).failures == ["the vehicle moves at the end"]
    assert judged([*sailing(STOPS_S), *off(STOPS_S)], **how).failures == []


def test_a_hull_that_disobeys_has_to_be_switched_off_and_told() -> None:
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    on = [*sailing(), *go(), *hold(STOPS_S, here)]
    how = {"disobeys": True, "is_rest_due": False, "must_take": False}
    how["said"] = "ALARM: the aPad does not obey its stop: Cut its power by hand"
    refused = (told(17.0, code=3),)
    assert judged([*on, *off(16.0)], told=refused, **how).failures == []
    assert len(judged([*on, *off(17.0)], told=refused, **how).failures) == 1  # it came too late
    assert judged(on, told=refused, **how).failures == [
        "no OFF went out within 4.5 s after a stop that it disobeys"
    ]
    quiet = judged([*on, *off(16.0)], told=refused, **(how | {"said": "it does not obey"}))
    assert quiet.failures == ["nobody was told that it `cut its power by hand`"]
    lied = judged([*on, *off(16.0)], told=(told(17.0),), **how)
    assert "`stop` said done of a hull that disobeys" in lied.failures


def test_a_hull_that_leaves_its_place_has_to_be_switched_off_once_it_is_farther_than_it_coasts() -> None:
    here = (10 + SPEED_M_S * STOPS_S, 30.0)
    on = [*sailing(), *go(), *hold(STOPS_S, here)]  # it is 4.2 m away at 20.5 s
    how = {"strays": True, "is_rest_due": False, "said": "it does not obey; cut its power by hand"}
    assert judged([*on, *off(24.9)], **how).failures == []
    assert len(judged([*on, *off(25.2)], **how).failures) == 1


def test_an_off_in_force_is_owed_again() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S)]
    how: dict[str, Any] = {"deaf": (20.0, 24.0), "off_again": (20.0, 27.0)}
    assert judged(flight, **how).failures == ["the OFF in force was not sent again"]
    assert judged([*flight, *off(28.0)], **how).failures == ["the OFF in force was not sent again"]
    assert judged([*flight, *off(25.0)], **how).failures == []


def test_no_arm_moves_while_hands_are_at_the_docks() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S)]
    arm = {"fact": "arms", "at_s": 13.0, "by": BENCH, "open": -1}
    assert len(judged([*flight, arm], arms_rest=True).failures) == 1
    assert judged([*flight, arm]).failures == []
    assert judged([*flight, arm | {"at_s": 11.0}, arm | {"by": HULL}], arms_rest=True).failures == []


def test_the_way_after_a_stop_has_a_length() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S)]  # a metre
    assert judged(flight, longest_way_m=1.2).failures == []
    assert judged(flight, longest_way_m=0.8).failures == ["it went on for 1.0 m after the stop"]


def test_a_second_bench_may_not_order() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S), *off(20.0)]
    assert judged(flight, newcomers_s=BEGUN_S).failures == []
    assert judged([*flight, *off(25.0, WATCHDOG)], newcomers_s=BEGUN_S).failures == []
    assert judged([*flight, *off(25.0, "/musselbed_5")], newcomers_s=BEGUN_S).failures == [
        "/musselbed_5 orders, too"
    ]


def test_a_fence_that_is_drawn_closer_holds_from_then_on() -> None:
    flight = [*sailing(STOPS_S), *go(), *off(STOPS_S), *go(30.0, (50.0, 30.0))]
    how = {"words_s": (29.0,)}
    closer = ((0.0, 0.0), (40.0, 0.0), (40.0, 60.0), (0.0, 60.0))
    assert judged(flight, **how).failures == []
    assert judged(flight, later_fence=(20.0, closer), **how).outside == 1
    assert judged(flight, later_fence=(31.0, closer), **how).failures == []


def test_a_healthy_vehicle_may_not_be_stopped() -> None:
    how = {"is_stop_due": False, "is_rest_due": False, "may_stop": False}
    assert judged([*sailing(), *go(), *hold(20.0, (20.0, 30.0))], **how).failures == []
    assert judged([*sailing(), *go(), *off(20.0)], **how).nuisances == 1
    assert judged([*sailing(), *go(), *hold(20.0, (20.0, 30.0), WATCHDOG)], **how).nuisances == 1
    assert judged([*sailing(), *go(20.0)], goes_on_s=25.0, **how).failures == []
    assert judged([*sailing(), *go()], goes_on_s=25.0, **how).failures == [], "its leg is a long one"
    assert judged([*sailing(30.0), *go()], goes_on_s=25.0, **how).failures == [
        "no way was ordered in the last 39 s"
    ]


def test_several_apads_have_one_verdict() -> None:
    good = judged([*sailing(STOPS_S), *go(), *off(STOPS_S)])
    late = judged([*sailing(14.0), *go(), *off(14.0)])
    whole = joined({"apad1": good, "apad2": late})
    assert whole.failures == ["apad2: the first stop came after 4.0 s, more than 3"]
    assert (whole.stop_s, whole.stop_by, whole.orders) == (4.0, BENCH, 4)
    assert joined({"apad1": good}) is good


CORNERS = st.lists(st.tuples(st.integers(-30, 30), st.integers(-30, 30)), min_size=3, max_size=7, unique=True)


@given(
    CORNERS,
    st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
    st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
)
def test_the_judges_geometry_agrees_with_a_library(
    corners: list[tuple[int, int]], place: tuple[float, float], goal_: tuple[float, float]
) -> None:
    area = Polygon(corners)
    if not area.is_valid or area.area < 1 or area.exterior.distance(Point(place)) < 1e-6:
        return
    fence = tuple((float(n), float(e)) for n, e in corners)
    assert is_inside(place, fence) == area.contains(Point(place))
    assert out_m(place, fence) == pytest.approx(area.distance(Point(place)), abs=1e-6)
    assert way_out_m(place, goal_, fence) >= out_m(place, fence) - 1e-9
    assert out_m((math.nan, 0.0), fence) == math.inf


def test_each_row_says_why_a_generation_is_missing() -> None:
    assert all(row.why_not or set(row.generations) == {"a", "b"} for row in ROWS.values())
    short = {it.row for it in jobs([], ["a", "b"], None, short=True)}
    assert short == {name for name, row in ROWS.items() if row.is_short} and 5 < len(short) < len(ROWS)
    assert replace(ROWS["nan"], tries=1).tries == 1

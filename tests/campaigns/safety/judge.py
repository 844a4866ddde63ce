"""Judges the facts that `wire.py` printed: stops, orders that should not have come, and what the operator was told.

All geometry is its own (`track.py`), from the vehicle's true position: standard library only, and no module of what it
judges.

A stop, by generation:

    B off    commander/stop_mission
    B hold   dynamic positioning within a metre of where the vehicle truly is, while its position was told truly
    A off    a cancel and VelCon_enable false
    A hold   a go-to within a metre of where the vehicle truly is, while its position was told truly

After an OFF nobody holds the vehicle before a person's word. A person may be told `done` only when the hull truly slows.
An arm is no stop, nor is a cancel alone: generation A goes on to its old goal after it. The vehicle has taken a service's
request when it answers it well, and a goal when its status is active or beyond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import Enum
from itertools import pairwise

from safety.track import REST_M, Fact, Place, Track, out_m, way_out_m

AT_PLACE_M = 1.0
"""A hold so near to the true place is a stop: 0.6 m/s, and a look each second."""
FENCE_ERROR_M = 0.01
"""float32 in the published scripts, and rounding."""
OFF_PARTS_S = 5.0
"""Generation A's cancel and its switch belong together within so long."""
PILOT_GRACE_S = 0.5
"""An order may be under way while the pilot's flag arrives."""
SILENCE_S = 10.0
"""A watchdog's hold after so long without a heartbeat has a known cause (docs/failures.md). It is a failure, too."""
BEAT_S = 0.5
"""The watchdog looks so often."""
TAKEN = (1, 3)
"""actionlib_msgs/GoalStatus: ACTIVE, SUCCEEDED."""
SLOW_M_S, SLOW_SHARE = 0.3, 0.7
"""A stop is done when the true speed through water is below the one, or that share of the speed when it was taken."""
COASTING_M = 4.2
"""`guards.coasting_m` of the scenario that flies."""
OBEYS_S, LOOK_S = 3.0, 1.5
"""The speed of a hull that obeys has fallen so long after it took the stop; the bench looks and orders within the other."""
ALARM = ("does not obey", "cut its power by hand")
SAME_PLACE_M = 0.1
PERCH, RELEASE = 1, 2
LIMIT_S = 3.0


class Kind(Enum):
    """Orders by what they do to the vehicle."""

    MOVE = "move"
    DOCK = "dock"
    HOLD = "hold"
    OFF = "off"
    OTHER = "other"
    """A cancel, a switch that is half of an order, an arm."""


STOPS = (Kind.HOLD, Kind.OFF)


@dataclass(slots=True)
class Order:
    at_s: float
    by: str
    kind: Kind
    what: str
    place: Place | None = None
    number: int | None = None
    key: str | None = None
    taken_s: float | None = None


@dataclass(frozen=True, slots=True)
class Told:
    """An operator's command: when it was given and answered, and whether the answer says that the vehicle has taken it."""

    what: str
    asked_s: float
    answered_s: float
    code: int | None
    """The command's exit code; None for one that did not end."""
    says_taken: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One flight's disturbance, and the rules that hold in it. Times are the monotonic clock's."""

    generation: str
    fence: tuple[Place, ...]
    begun_s: float
    """The disturbance, or the person's order."""
    is_stop_due: bool = True
    limit_s: float = LIMIT_S
    lies: bool = False
    """From `begun_s` on the position that is told is not the truth: no place may be ordered."""
    deaf: tuple[float, float] | None = None
    """Nobody could reach the vehicle between these times. Later only the watchdog may hold it, and the bench nothing."""
    nothing_after_s: float = math.inf
    """From then on even a hold is too much: the vehicle was away, and hands may be in its docks."""
    must_be: Kind | None = None
    """The stop that it has to be; None for either."""
    words_s: tuple[float, ...] = ()
    """A person allowed it to move on."""
    told: tuple[Told, ...] = ()
    strangers: tuple[str, ...] = ("/actor_",)
    """Nodes with names that begin so are neither the bench nor its watchdog."""
    is_rest_due: bool = True
    """False where the water carries the vehicle along."""
    rest_m: float = REST_M
    """A vehicle that comes no farther in REST_S is at rest."""
    may_stop: bool = True
    """False for a healthy flight: neither may the bench switch the controllers off, nor the watchdog order anything."""
    must_take: bool = True
    """Each `stop` and `hands` has to end with 0; False where the vehicle, or the run, may be out of reach."""
    may_stand: bool = False
    """A stop that the vehicle had taken before `begun_s`, and still follows, counts as one at once."""
    goes_on_s: float = math.inf
    """A healthy mission whose hull rests at the last fact ordered a way, or a dock, at most so long before."""
    must_move: bool = False
    """After the last word the bench orders a way again."""
    at_place_m: float = AT_PLACE_M
    """A hold so near to the true place is a stop: a late link has the bench know of an older place."""
    current_m_s: Place = (0.0, 0.0)
    """The water's velocity over ground."""
    one_place: bool = False
    """No hold is ordered at another place than that of the first one."""
    ends_at_rest: bool = False
    """The hull truly rests at the end, whatever waited at its services."""
    disobeys: bool = False
    """The hull takes a stop and does not follow it: OFF and an alarm are due, and nobody may be told `done`."""
    strays: bool = False
    """The hull leaves the place that it holds: OFF and an alarm are due when it is farther than it coasts, and goes on."""
    said: str = ""
    """All that the bench has told, for an alarm that is due."""
    off_again: tuple[float, float] | None = None
    """From this time on, and until that one, an OFF in force has to be sent again."""
    arms_rest: bool = False
    """No arm moves after the stop: hands are at the docks."""
    longest_way_m: float = math.inf
    """The hull goes at most so far after the stop."""
    newcomers_s: float = math.inf
    """No node of the bench that orders for the first time after this time may order anything."""
    later_fence: tuple[float, tuple[Place, ...]] | None = None
    """From this time on the other fence holds, too."""
    other_faults: tuple[str, ...] = ()
    """Faults that the row itself saw."""
    during_s: tuple[float, float] = (-math.inf, math.inf)
    """Facts of these times alone count: a flight may have several disturbances, one after the other."""


@dataclass(slots=True)
class Verdict:
    """One flight. `failures` is empty for a good one."""

    stop_s: float | None = None
    """Seconds from the disturbance to the first stop on the wire."""
    stop_kind: str | None = None
    stop_by: str | None = None
    taken_s: float | None = None
    outside: int = 0
    against_pilot: int = 0
    unasked: int = 0
    answer_s: float | None = None
    """The longest that an operator waited for an answer."""
    untaken: int = 0
    """Times that an operator was told `taken` or `done` while the vehicle had accepted no stop."""
    nuisances: int = 0
    """Stops of a healthy vehicle."""
    coasting_m: float | None = None
    rest_s: float | None = None
    furthest_out_m: float = 0.0
    """The vehicle's greatest true distance outside the fence, after the disturbance."""
    moved_m: float = 0.0
    """The true way from the disturbance on."""
    orders: int = 0
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def orders_of(facts: list[Fact], case: Case, track: Track) -> list[Order]:
    """The orders in the order of their arrival, with the time at which the vehicle took each."""
    orders: list[Order] = []
    by_number: dict[int, Order] = {}
    by_key: dict[str, Order] = {}
    for it in facts:
        match it["fact"]:
            case "call":
                place = None if it.get("place") is None else (it["place"][0], it["place"][1])
                order = Order(it["at_s"], it["by"], Kind.OTHER, it["order"], place, it["number"])
                order.kind = _kind_of_call(order, it.get("enable"), case, track)
                if "enable" in it:
                    order.what += " true" if it["enable"] else " false"
                orders.append(order)
                by_number[it["number"]] = order
            case "goal":
                place = None if it["place"] is None else (it["place"][0], it["place"][1])
                kind = (
                    Kind.DOCK
                    if it["kind"] in (PERCH, RELEASE)
                    else _kind_of_place(it["at_s"], place, case, track)
                )
                order = Order(it["at_s"], it["by"], kind, f"goal {it['kind']}", place, key=it["key"])
                orders.append(order)
                by_key[it["key"]] = order
            case "cancel":
                orders.append(Order(it["at_s"], it["by"], Kind.OTHER, "cancel", taken_s=it["at_s"]))
            case "arms":
                if it["by"] and "/musselbed" in it["by"]:
                    orders.append(Order(it["at_s"], it["by"], Kind.OTHER, f"arm {it['open']}"))
            case "answer":
                if it["took"] and (asked := by_number.get(it["number"])) is not None:
                    asked.taken_s = it["at_s"]
            case "status":
                for key, code in it["goals"].items():
                    if code in TAKEN and (asked := by_key.get(key)) is not None and asked.taken_s is None:
                        asked.taken_s = it["at_s"]
    _join_off_of_a(orders)
    return orders


def _kind_of_call(order: Order, enable: bool | None, case: Case, track: Track) -> Kind:
    match order.what:
        case "commander/stop_mission":
            return Kind.OFF
        case "commander/primitive/dynamic_positioning":
            return _kind_of_place(order.at_s, order.place, case, track)
        case "commander/primitive/go2point" | "commander/go2point" | "commander/continue_mission":
            return Kind.MOVE
        case "commander/primitive/docking" | "commander/docking":
            return Kind.DOCK
        case "VelCon_enable" | "FADP_enable":
            return Kind.MOVE if enable else Kind.OTHER
    return Kind.OTHER


def _kind_of_place(at_s: float, place: Place | None, case: Case, track: Track) -> Kind:
    here = track.at(at_s)
    is_told_truly = not case.lies or at_s < case.begun_s
    if is_told_truly and here is not None and place is not None and math.dist(here, place) <= case.at_place_m:
        return Kind.HOLD
    return Kind.MOVE


def _join_off_of_a(orders: list[Order]) -> None:
    """The switch of generation A is an OFF with a cancel near it: whichever comes later is when the OFF is whole."""
    cancels = [it.at_s for it in orders if it.what == "cancel"]
    for it in orders:
        if it.what == "VelCon_enable false":
            near = [at_s for at_s in cancels if abs(at_s - it.at_s) <= OFF_PARTS_S]
            if near:
                it.kind = Kind.OFF
                it.at_s = max(it.at_s, min(near))


def judge(facts: list[Fact], case: Case) -> Verdict:
    from_s, until_s = case.during_s
    facts = [it for it in facts if from_s <= it["at_s"] <= until_s]
    track = Track(facts)
    orders = orders_of(facts, case, track)
    ours = [it for it in orders if not it.by.startswith(case.strangers)]
    verdict = Verdict(orders=len(ours))
    verdict.notes += [f"unread on the wire: {it['what']}" for it in facts if it["fact"] == "unread"]
    kinds = STOPS if case.must_be is None else (case.must_be,)
    stops = (it for it in ours if it.at_s >= case.begun_s and it.kind in kinds)
    stop = min(stops, key=lambda it: it.at_s, default=None) if case.is_stop_due else None
    known = _followed(orders, case.begun_s) if case.may_stand else None
    if known is not None and known.kind in kinds:
        stop = known
    verdict.failures += case.other_faults
    if not _is_left_at_rest(facts, stop, case, track):
        _judge_stop(verdict, stop, case, track)
    _judge_places(verdict, ours, case, track)
    _judge_pilot(verdict, ours, facts)
    beats = [(it["at_s"], it["says_off"]) for it in facts if it["fact"] == "heartbeat"]
    _judge_motion(verdict, ours, stop, case, beats)
    _judge_going_on(verdict, ours, case, track)
    for it in case.told:
        _judge_told(verdict, orders, it, case, track)
        if case.is_stop_due and case.must_take and it.code != 0 and it.what.startswith(("stop", "hands")):
            verdict.failures.append(f"`{it.what}` ended with {it.code}: {it.text.strip()[:160]}")
    _judge_way(verdict, case, track)
    _judge_hull(verdict, ours, stop, case, track)
    _judge_others(verdict, ours, stop, case)
    return verdict


def _is_left_at_rest(facts: list[Fact], stop: Order | None, case: Case, track: Track) -> bool:
    """Its way had ended in the silence, so the watchdog orders nothing, and the hull stays where it is until its end.

    The watchdog's word may cross only after the silence; where the hull truly is decides. A stop of the bench may follow.
    """
    if case.deaf is None or (stop is not None and stop.at_s <= case.deaf[1]):
        return False
    heard_by_s = case.deaf[1] + case.limit_s
    says = [it["at_s"] for it in facts if it["fact"] == "watchdog" and it["state"] == "LEFT"]
    rest = track.rest(case.begun_s, case.rest_m)
    if not any(case.begun_s <= it <= heard_by_s for it in says) or rest is None or rest[0] > case.limit_s:
        return False
    return track.leaves_s(case.begun_s + rest[0], case.at_place_m) > case.deaf[1]


def joined(verdicts: dict[str, Verdict]) -> Verdict:
    """One verdict of a flight's cases, by name: the longest times and ways, the sums of counts, and each one's failures."""
    if len(verdicts) == 1:
        return next(iter(verdicts.values()))
    whole = Verdict()
    for it in fields(Verdict):
        values = [value for one in verdicts.values() if (value := getattr(one, it.name)) is not None]
        if not values:
            continue
        if it.name in ("failures", "notes"):
            said = [f"{apad}: {text}" for apad, one in verdicts.items() for text in getattr(one, it.name)]
            setattr(whole, it.name, said)
        elif isinstance(values[0], str):
            setattr(whole, it.name, ", ".join(sorted(set(values))))
        else:
            setattr(whole, it.name, sum(values) if isinstance(values[0], int) else max(values))
    return whole


def _judge_stop(verdict: Verdict, stop: Order | None, case: Case, track: Track) -> None:
    if stop is not None:
        verdict.stop_s = round(max(0.0, stop.at_s - case.begun_s), 2)
        verdict.stop_kind, verdict.stop_by = stop.kind.value, stop.by
        verdict.taken_s = None if stop.taken_s is None else round(stop.taken_s - case.begun_s, 2)
        if (rest := track.rest(stop.at_s, case.rest_m)) is not None:
            verdict.rest_s, verdict.coasting_m = round(rest[0], 1), round(rest[1], 2)
    if not case.is_stop_due:
        return
    if stop is None:
        kind = "stop" if case.must_be is None else case.must_be.value
        verdict.failures.append(f"no {kind} on the wire")
        return
    if stop.at_s - case.begun_s > case.limit_s:
        verdict.failures.append(f"the first stop came after {verdict.stop_s} s, more than {case.limit_s:g}")
    if case.is_rest_due and verdict.coasting_m is None:
        verdict.failures.append("the vehicle did not come to rest")


def _judge_places(verdict: Verdict, ours: list[Order], case: Case, track: Track) -> None:
    for it in ours:
        here = track.at(it.at_s)
        if it.place is None or here is None:
            continue
        lies_out_m = out_m(it.place, case.fence)
        if out_m(here, case.fence) <= FENCE_ERROR_M:
            lies_out_m = way_out_m(here, it.place, case.fence)
        if lies_out_m > FENCE_ERROR_M:
            verdict.outside += 1
            verdict.failures.append(f"{_said(it, case)} leads {lies_out_m:.1f} m outside the fence")


def _judge_pilot(verdict: Verdict, ours: list[Order], facts: list[Fact]) -> None:
    steering_s: float | None = None
    turns = [(it["at_s"], it["steers"]) for it in facts if it["fact"] == "pilot"]
    for begin_s, steers in turns:
        if steers and steering_s is None:
            steering_s = begin_s
        elif not steers and steering_s is not None:
            _count_against(verdict, ours, steering_s, begin_s)
            steering_s = None
    if steering_s is not None:
        _count_against(verdict, ours, steering_s, math.inf)


def _count_against(verdict: Verdict, ours: list[Order], begin_s: float, end_s: float) -> None:
    against = [it for it in ours if begin_s + PILOT_GRACE_S < it.at_s < end_s]
    verdict.against_pilot += len(against)
    verdict.failures += [f"{it.what} by {it.by} while a pilot steers" for it in against[:3]]


def _judge_motion(
    verdict: Verdict,
    ours: list[Order],
    stop: Order | None,
    case: Case,
    beats: list[tuple[float, bool]],
) -> None:
    """Counts what moves the vehicle after it was stopped, or should have been, until a person's word."""
    stopped_s = math.inf if stop is None else stop.at_s
    if case.is_stop_due and case.lies:
        stopped_s = min(stopped_s, case.begun_s + case.limit_s)
    off_s = math.inf
    for it in sorted(ours, key=lambda it: it.at_s):
        if it.kind is Kind.OFF and it.at_s >= case.begun_s:
            off_s = min(off_s, it.at_s)
        if it is stop or it.kind in (Kind.OFF, Kind.OTHER):
            continue
        reason = ""
        if it.at_s > case.nothing_after_s:
            reason = "after the vehicle was away"
        elif case.deaf is not None and it.at_s > case.deaf[1] and "watchdog" not in it.by:
            reason = "after a silence"
        elif it.at_s > off_s:
            reason = "after the OFF"
            if _answers_silence(it, beats):
                reason += " and ten seconds without a heartbeat"
        elif it.at_s > stopped_s and not _repeats(it, stop, case):
            reason = "after the stop" if stop is not None else "when it should have stopped"
            if _answers_silence(it, beats):
                reason += " and ten seconds without a heartbeat"
        if reason and not any(word_s < it.at_s for word_s in case.words_s):
            verdict.unasked += 1
            verdict.failures.append(f"{_said(it, case)} {reason}, without a person's word")
    if case.must_move and not any(it.kind is Kind.MOVE and it.at_s > max(case.words_s) for it in ours):
        verdict.failures.append("`continue` did not make the mission go on")


def _judge_going_on(verdict: Verdict, ours: list[Order], case: Case, track: Track) -> None:
    """A healthy vehicle is on a way, or gets one again before long, and nobody stops it."""
    ends_s = track.times_s[-1] if track.times_s else case.begun_s
    way_s = max((it.at_s for it in ours if it.kind in (Kind.MOVE, Kind.DOCK)), default=case.begun_s)
    if ends_s - way_s > case.goes_on_s and track.ends_at_rest(case.rest_m):
        verdict.failures.append(f"no way was ordered in the last {ends_s - way_s:.0f} s")
    if not case.may_stop:
        for it in ours:
            if it.at_s > case.begun_s and (it.kind is Kind.OFF or "watchdog" in it.by):
                verdict.nuisances += 1
                verdict.failures.append(f"{_said(it, case)}, though all was well")


def _repeats(it: Order, stop: Order | None, case: Case) -> bool:
    """A hold may be ordered again: where it was held, or where the vehicle is by then, unless it has one place."""
    if stop is None or stop.kind is not Kind.HOLD:
        return False
    far_m = math.inf if it.place is None or stop.place is None else math.dist(it.place, stop.place)
    if case.one_place:
        return far_m <= SAME_PLACE_M
    return it.kind is Kind.HOLD or far_m <= AT_PLACE_M


def _is_again(it: Order, stop: Order | None, case: Case) -> bool:
    """A HOLD of the same place: a hull that takes it late may have gone past that place meanwhile."""
    return stop is not None and it.what == stop.what and _repeats(it, stop, case)


def _answers_silence(it: Order, beats: list[tuple[float, bool]]) -> bool:
    """The watchdog's hold where no heartbeat had come for so long, and the last one told of no OFF.

    A stop and the heartbeat go over two connections. A link that loses packets may deliver the one, and not the other.
    """
    last_s, says_off = max((beat for beat in beats if beat[0] <= it.at_s), default=(-math.inf, False))
    is_silent = it.at_s - last_s > SILENCE_S - BEAT_S
    return (
        it.kind is Kind.HOLD and "watchdog" in it.by and is_silent and not says_off and math.isfinite(last_s)
    )


def _followed(orders: list[Order], at_s: float) -> Order | None:
    """The order that the vehicle had taken last at that time."""
    taken = [
        it for it in orders if it.kind is not Kind.OTHER and it.taken_s is not None and it.taken_s <= at_s
    ]
    return max(taken, key=lambda it: it.taken_s or 0.0, default=None)


def _judge_told(verdict: Verdict, orders: list[Order], told: Told, case: Case, track: Track) -> None:
    waited_s = round(told.answered_s - told.asked_s, 2)
    verdict.answer_s = max(waited_s, verdict.answer_s or 0.0)
    verdict.notes.append(f"{told.what}: exit {told.code} after {waited_s:.1f} s: {told.text.strip()[:160]}")
    last = _followed(orders, told.answered_s)
    stop = next((it for it in orders if it.kind in STOPS and it.at_s >= told.asked_s), None)
    if told.says_taken and not (last and (last.kind in STOPS or _is_again(last, stop, case))):
        verdict.untaken += 1
        verdict.failures.append(
            f"`{told.what}` said done, and the last order that the vehicle has taken is {last.what if last else 'none'}"
        )
    elif told.says_taken and last is not None:
        _judge_done(verdict, orders, told, last, case, track)


def _judge_done(
    verdict: Verdict, orders: list[Order], told: Told, last: Order, case: Case, track: Track
) -> None:
    """The hull slows by the time when somebody is told that a stop is done.

    A service that answers late took the order at some time before: the greatest speed since its arrival counts. A hull that
    comes back to the place of a HOLD has slowed: its speed counts along the way that it made then.
    """
    taken = [it for it in orders if it.kind in STOPS and it.taken_s is not None]
    first = min(
        (it for it in taken if it.at_s >= told.asked_s), key=lambda it: it.taken_s or 0.0, default=last
    )
    assert first.taken_s is not None
    times_s = [first.at_s, first.taken_s, *(it for it, _ in track.since(first.at_s) if it < first.taken_s)]
    before = max((track.velocity_m_s(it, case.current_m_s) for it in times_s), key=lambda it: math.hypot(*it))
    before_m_s = math.hypot(*before)
    then = track.velocity_m_s(told.answered_s, case.current_m_s)
    along = then[0] * before[0] + then[1] * before[1]
    speed_m_s = along / before_m_s if before_m_s > 0 else math.hypot(*then)
    if speed_m_s >= SLOW_M_S and speed_m_s > SLOW_SHARE * before_m_s:
        verdict.untaken += 1
        verdict.failures.append(
            f"`{told.what}` said done at {speed_m_s:.2f} m/s; the stop was taken at {before_m_s:.2f} m/s"
        )


def _judge_hull(verdict: Verdict, ours: list[Order], stop: Order | None, case: Case, track: Track) -> None:
    """Judges the hull's true motion, and the debts of the bench where it disobeys."""
    if case.ends_at_rest and not track.ends_at_rest(case.rest_m):
        verdict.failures.append("the vehicle moves at the end")
    if stop is not None and case.longest_way_m < math.inf:
        places = [track.at(stop.at_s), *(place for _, place in track.since(stop.at_s))]
        way_m = sum(math.dist(a, b) for a, b in pairwise(it for it in places if it is not None))
        if way_m > case.longest_way_m:
            verdict.failures.append(f"it went on for {way_m:.1f} m after the stop")
    if not (case.disobeys or case.strays):
        return
    if stop is None or stop.taken_s is None:
        verdict.failures.append("the hull took no stop that it could disobey")
        return
    since_s = stop.taken_s if case.disobeys else track.leaves_s(stop.taken_s, COASTING_M)
    due_s = since_s + OBEYS_S + LOOK_S
    if not any(it.kind is Kind.OFF and stop.taken_s < it.at_s <= due_s for it in ours):
        verdict.failures.append(
            f"no OFF went out within {due_s - stop.taken_s:.1f} s after a stop that it disobeys"
        )
    if missing := [it for it in ALARM if it not in case.said.lower()]:
        verdict.failures.append(f"nobody was told that it `{'`, `'.join(missing)}`")
    verdict.failures += [
        f"`{it.what}` said done of a hull that disobeys"
        for it in case.told
        if it.says_taken and case.disobeys
    ]


def _judge_others(verdict: Verdict, ours: list[Order], stop: Order | None, case: Case) -> None:
    """The stop that is owed again, arms that must not move, and a bench that must not order."""
    if case.off_again is not None:
        from_s, until_s = case.off_again
        if not any(it.kind is Kind.OFF and from_s <= it.at_s <= until_s for it in ours):
            verdict.failures.append("the OFF in force was not sent again")
    if case.arms_rest and stop is not None:
        moved = [it for it in ours if it.what.startswith("arm") and it.at_s > stop.at_s]
        verdict.failures += [f"{_said(it, case)} while hands are at the docks" for it in moved[:3]]
    first_s: dict[str, float] = {}
    for it in ours:
        first_s.setdefault(it.by, it.at_s)
    late = sorted(it for it, at_s in first_s.items() if at_s > case.newcomers_s and "watchdog" not in it)
    verdict.failures += [f"{it} orders, too" for it in late]
    if case.later_fence is not None:
        from_s, corners = case.later_fence
        for it in ours:
            if it.at_s > from_s and it.place is not None and out_m(it.place, corners) > FENCE_ERROR_M:
                verdict.outside += 1
                verdict.failures.append(f"{_said(it, case)} leads outside the fence of the time")


def _judge_way(verdict: Verdict, case: Case, track: Track) -> None:
    rows = track.since(case.begun_s)
    places = [place for _, place in rows]
    verdict.moved_m = round(sum(math.dist(a, b) for a, b in pairwise(places)), 1)
    verdict.furthest_out_m = round(max((out_m(it, case.fence) for it in places), default=0.0), 2)
    if verdict.furthest_out_m > FENCE_ERROR_M:
        verdict.failures.append(f"the vehicle was truly {verdict.furthest_out_m:g} m outside the fence")


def _said(it: Order, case: Case) -> str:
    place = "" if it.place is None else f" to ({it.place[0]:.1f}, {it.place[1]:.1f})"
    return f"{it.what}{place} by {it.by} at {it.at_s - case.begun_s:+.1f} s"

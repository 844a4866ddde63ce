"""Rows of several aPads in one run."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

from safety.flight import FENCE, START_M, Flight, Setup
from safety.judge import Case, Kind
from safety.person import says_done
from safety.row import AFTER_S, SHOWN_S, WATCHDOG_LIMIT_S, Act, Row, Try, unless
from safety.track import Track

BODIES_M = 3.0
"""`guards.bodies_m`, as it is without a word in the scenario."""
STEP_S = 0.25
SPEED_M_S = 0.5
"""A deaf hull goes so fast for a quarter of a minute, towards the middle."""
SETTLES_S = 10.0
READY_S = 45.0


def stop_all(*words: str, one: str = "", hangs: str = "") -> Act:
    """`stop RUN` stops each aPad and tells of each; that of `one` stops it alone; the node of `hangs` hangs meanwhile."""

    def act(it: Try) -> dict[str, Case]:
        flight = it.flight
        pressed = flight.person(*words, "--by", "judge", one=one)
        if hangs:
            flight.signal_vehicle(signal.SIGSTOP, hangs)
        flight.pause(0.3)
        pressed.press()
        told = pressed.answer()
        flight.pause(AFTER_S)
        if hangs:
            flight.signal_vehicle(signal.SIGCONT, hangs)
            flight.pause(AFTER_S)
        untold = [] if one else [name for name in flight.names if f"{name}:" not in told.text]
        cases = {}
        for name in flight.names:
            is_asked = name == (one or name)
            is_heard = is_asked and name != hangs
            cases[name] = Case(
                flight.generation,
                FENCE,
                pressed.asked_s,
                is_stop_due=is_heard,
                is_rest_due=is_heard,
                ends_at_rest=is_asked,
                may_stop=is_asked,
                goes_on_s=math.inf if is_asked else 2 * AFTER_S,
                must_take=is_heard and not hangs,
                told=(told,) if is_heard else (),
                other_faults=unless(name not in untold, "the answer does not tell of it"),
            )
        return cases

    return act


def any_acts(acts: int) -> Act:
    """So many acts in a row, drawn from ACTS, and one of LAST_ACTS; each is judged of each aPad. Hulls keep apart."""

    def act(it: Try) -> dict[str, Case]:
        flight = it.flight
        chosen = [flight.rng.choice(list(ACTS)) for _ in range(acts - 1)]
        last = list(LAST_ACTS)[it.number % len(LAST_ACTS)]
        cases: dict[str, Case] = {}
        deaf: list[tuple[float, float, str]] = []
        for number, name in enumerate((*chosen, last), 1):
            one = flight.rng.choice(flight.names)
            with suppress(
                TimeoutError
            ):  # all may be charging: an act that meets a vehicle at rest counts, too
                flight.wait(lambda one=one: flight.is_under_way(one), READY_S, "")  # type: ignore[misc]
            begun_s = time.monotonic()
            of_each = (ACTS | LAST_ACTS)[name](flight, one)
            ended_s = time.monotonic()
            if name == DEAF:
                deaf.append((begun_s, ended_s, one))
            window = (begun_s - AFTER_S, ended_s)
            cases |= {
                f"{apad}, {number} {name} {one}": _within(case, window) for apad, case in of_each.items()
            }
            if name in ACTS:
                _continue(flight, one, of_each)
        near = _nearer_than_allowed(flight, deaf)
        first = next(iter(cases))
        return cases | {first: replace(cases[first], other_faults=cases[first].other_faults + near)}

    return act


def _within(case: Case, window: tuple[float, float]) -> Case:
    return replace(case, during_s=window)


def _continue(flight: Flight, one: str, of_each: dict[str, Case]) -> None:
    """A person's word for whoever was stopped. The mission orders ways again, which the next act's judge sees."""
    all_stopped = sum(case.is_stop_due for case in of_each.values()) > 1
    pressed = flight.person("continue", "--by", "judge", one="" if all_stopped else one)
    pressed.press()
    pressed.answer()
    flight.pause(SETTLES_S)


def _undisturbed(flight: Flight, begun_s: float) -> Case:
    return Case(flight.generation, FENCE, begun_s, is_stop_due=False, is_rest_due=False, may_stop=False)


def _of_all(flight: Flight, begun_s: float, one: str, case: Case) -> dict[str, Case]:
    return {name: case if name == one else _undisturbed(flight, begun_s) for name in flight.names}


def _stop(*words: str, everyone: bool = False) -> Callable[[Flight, str], dict[str, Case]]:
    """A person's stop of one or of all. The answer tells of each that it is about."""

    def act(flight: Flight, one: str) -> dict[str, Case]:
        pressed = flight.person(*words, "--by", "judge", one="" if everyone else one)
        pressed.press()
        told = pressed.answer()
        flight.pause(AFTER_S)
        is_off = words != ("stop",)

        def case(name: str) -> Case:
            return Case(
                flight.generation,
                FENCE,
                pressed.asked_s,
                must_be=Kind.OFF if is_off else None,
                may_stand=True,
                ends_at_rest=True,
                told=(told,),
                other_faults=unless(
                    not everyone or f"{name}:" in told.text, "the answer does not tell of it"
                ),
            )

        if everyone:
            return {name: case(name) for name in flight.names}
        return _of_all(flight, pressed.asked_s, one, case(one))

    return act


def _deaf(flight: Flight, one: str) -> dict[str, Case]:
    """A hull that goes on under a `stop`: OFF and an alarm are due, and nobody is told `done`."""
    before = len(flight.said_by_bench())
    pressed = flight.person("stop", "--by", "judge", one=one)
    truth = next(it for it in reversed(flight.look(one)) if it["fact"] == "truth")
    speed_m_s = SPEED_M_S if truth["east"] < START_M[1] else -SPEED_M_S
    flight.spoil(one, hull="deaf", velocity_m_s=[0.0, speed_m_s])
    flight.pause(SHOWN_S / 4)  # no hull moves at once, and the bench cannot know a speed at once
    pressed.press()
    told = pressed.answer()
    flight.pause(AFTER_S)
    said = flight.said_by_bench()[before:] + told.text
    flight.spoil(one, hull="obeys")
    case = Case(
        flight.generation,
        FENCE,
        pressed.asked_s,
        must_take=False,
        is_rest_due=False,
        told=(told,),
        other_faults=unless(not says_done(told.text), "`stop` said done of a hull that goes on"),
        disobeys=True,
        said=said,
    )
    return _of_all(flight, pressed.asked_s, one, case)


def _hangs(flight: Flight, one: str) -> dict[str, Case]:
    """The node of one is silent for a while: nothing reaches it meanwhile, and nobody moves it afterwards."""
    begun_s = time.monotonic()
    flight.signal_vehicle(signal.SIGSTOP, one)
    flight.pause(SHOWN_S / 2)
    awake_s = time.monotonic()
    flight.signal_vehicle(signal.SIGCONT, one)
    flight.pause(2 * AFTER_S)
    case = Case(flight.generation, FENCE, awake_s, must_be=Kind.OFF, may_stand=True, limit_s=WATCHDOG_LIMIT_S)
    return _of_all(flight, begun_s, one, case)


def _killed(flight: Flight, one: str) -> dict[str, Case]:
    """The supervisor of one is killed: its watchdog or its successor holds it, and nobody else's mission ends."""
    begun_s = time.monotonic()
    flight.signal_bench(signal.SIGKILL, f"supervisor_process {flight.run / one}")
    flight.pause(WATCHDOG_LIMIT_S + AFTER_S)
    case = Case(
        flight.generation,
        FENCE,
        begun_s,
        limit_s=WATCHDOG_LIMIT_S,
        must_be=Kind.HOLD,
    )
    return _of_all(flight, begun_s, one, case)


def _cut(flight: Flight, one: str) -> dict[str, Case]:
    """The Wi-Fi of all is away for 25 s: each one's watchdog holds it, or puts it OFF where its way has just ended."""
    begun_s = time.monotonic()
    flight.link(1.0)
    flight.pause(25.0)
    healed_s = time.monotonic()
    flight.link(0.0)
    flight.pause(AFTER_S)
    case = Case(
        flight.generation,
        FENCE,
        begun_s,
        limit_s=WATCHDOG_LIMIT_S,
        deaf=(begun_s, healed_s),
    )
    return dict.fromkeys(flight.names, case)


def _nearer_than_allowed(flight: Flight, deaf: list[tuple[float, float, str]]) -> tuple[str, ...]:
    """Each pair of hulls that truly came too near, but for one that obeyed nobody at the time."""
    tracks = {name: Track(flight.look(name)) for name in flight.names}
    found: dict[tuple[str, str], float] = {}
    for pair in combinations(flight.names, 2):
        begin_s = max(tracks[name].times_s[0] for name in pair)
        end_s = min(tracks[name].times_s[-1] for name in pair)
        for step in range(int((end_s - begin_s) / STEP_S)):
            at_s = begin_s + STEP_S * step
            if any(from_s <= at_s <= until_s and one in pair for from_s, until_s, one in deaf):
                continue
            a, b = (tracks[name].at(at_s) for name in pair)
            if a is not None and b is not None and (apart_m := math.dist(a, b)) < BODIES_M:
                found[pair] = min(apart_m, found.get(pair, math.inf))
    return tuple(f"{a} and {b} were {apart_m:.1f} m apart" for (a, b), apart_m in found.items())


DEAF = "deaf"
ACTS: dict[str, Callable[[Flight, str], dict[str, Case]]] = {
    "stop of": _stop("stop"),
    "off of": _stop("stop", "--off"),
    "hands at": _stop("hands"),
    "stop of all, not only": _stop("stop", everyone=True),
    "off of all, not only": _stop("stop", "--off", everyone=True),
    DEAF: _deaf,
    "silent": _hangs,
}
"""A person's word heals each."""
LAST_ACTS: dict[str, Callable[[Flight, str], dict[str, Case]]] = {"killed": _killed, "cut": _cut}
"""A flight ends with each."""
ACTS_IN_A_FLIGHT = 8
FIVE = Setup(apads=5, watchdog=False)
CROWD = Setup(apads=5, amussels=120)
ROWS: dict[str, Row] = {
    "five": Row("`stop RUN` of five aPads", stop_all("stop"), FIVE),
    "five, off": Row("`stop RUN --off` of five aPads", stop_all("stop", "--off"), FIVE),
    "five, one": Row("`stop RUN/apad3` of five aPads", stop_all("stop", one="apad3"), FIVE),
    "five, one hangs": Row(
        "`stop RUN` of five aPads, one of whose nodes hangs", stop_all("stop", hangs="apad2"), FIVE
    ),
    "five, any acts": Row(
        f"{ACTS_IN_A_FLIGHT} acts in a row at five aPads with 120 aMussels: stop, OFF, hands, deaf, silent, killed, cut",
        any_acts(ACTS_IN_A_FLIGHT),
        CROWD,
        tries=19,
    ),
}

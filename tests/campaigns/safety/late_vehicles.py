"""Rows of vehicles that answer late or hang, and of clients and people who go on ordering."""

from __future__ import annotations

import signal
import time
from typing import Any

from safety.judge import LIMIT_S, Case, Kind
from safety.row import AFTER_S, CALLS, LATE, LOSSY_LIMIT_S, SCRIPT, Act, Before, Row, Try, nothing, stopped


def late_link(it: Try) -> None:
    """1.2 s there and back."""
    it.flight.link(0.0, 0.6)
    it.flight.pause(5.0)


def losing_link(it: Try) -> None:
    it.flight.link(0.25)
    it.flight.pause(5.0)


def slow_answers(answer_s: float) -> Before:
    """Even tries take an order before that time, and odd ones after it. Orders wait at the services by then."""

    def before(it: Try) -> None:
        it.flight.spoil(answer_s=answer_s, takes_first=it.heals)
        it.flight.pause(3 * answer_s)

    return before


def stopped_for_good(
    *words: str, before: Before = nothing, limit_s: float = LIMIT_S, after_s: float = 2 * AFTER_S, **how: Any
) -> Act:
    """A person's stop; nothing that was ordered before or after it moves the vehicle in the end."""
    must_be = Kind.OFF if "--off" in words or words[0] == "hands" else None
    how |= {"must_be": must_be, "limit_s": limit_s, "ends_at_rest": True, "one_place": True}
    return stopped(*words, before=before, after_s=after_s, **how)


def hung_for(seconds: float, *words: str) -> Act:
    """The vehicle's node stands still when the stop comes. Its hull goes on meanwhile."""

    def act(it: Try) -> Case:
        it.flight.signal_vehicle(signal.SIGSTOP, "hull")
        it.flight.pause(0.3)
        pressed = it.flight.person(*words, "--by", "judge")
        hung_s = time.monotonic()
        pressed.press()
        it.flight.pause(max(0.0, seconds - (time.monotonic() - hung_s)))
        it.flight.signal_vehicle(signal.SIGCONT, "hull")
        it.told.append(pressed.answer())
        it.flight.pause(2 * AFTER_S)
        return it.case(
            pressed.asked_s,
            limit_s=max(LIMIT_S, seconds),
            must_take=False,
            is_rest_due=False,
            ends_at_rest=True,
        )

    return act


def stop_and_hands(before: Before = nothing, limit_s: float = LIMIT_S, **how: Any) -> Act:
    """Two people at one instant, or in odd tries with a tick between them: after the OFF no hold arrives."""

    def act(it: Try) -> Case:
        before(it)
        pressed = [it.flight.person(word, "--by", word) for word in ("stop", "hands")]
        for one in pressed:
            one.press()
            it.flight.pause(0.0 if it.heals else it.flight.rng.uniform(0.5, 1.5))
        it.told += [one.answer() for one in pressed]
        it.flight.pause(AFTER_S)
        begun_s = pressed[-1].asked_s
        return it.case(begun_s, must_be=Kind.OFF, limit_s=limit_s, arms_rest=True, ends_at_rest=True, **how)

    return act


def busy(it: Try) -> None:
    it.flight.spoil(busy_s=2.0)


ROWS: dict[str, Row] = {}
for _answer_s in (1.5, 3.0):
    for _flies in (SCRIPT, CALLS):
        for _words in (("stop",), ("stop", "--off")):
            ROWS[f"answers {_answer_s:g} s, {_flies.flies}, {' '.join(_words)}"] = Row(
                f"`{' '.join(_words)}` where services answer after {_answer_s:g} s, and {_flies.flies} go on",
                stopped_for_good(
                    *_words,
                    before=slow_answers(_answer_s),
                    limit_s=LIMIT_S,
                    must_take=False,
                    is_rest_due=False,
                ),
                _flies,
                generations=("b",),
                why_not=LATE,
            )
ROWS |= {
    "late link": Row(
        "`stop` over a round trip of 1.2 s, while a script goes on",
        stopped_for_good("stop", before=late_link, limit_s=LIMIT_S + 1.2, at_place_m=2.0),
        SCRIPT,
    ),
    "losing link": Row(
        "`stop` over 25 % loss, while a script goes on",
        stopped_for_good("stop", before=losing_link, limit_s=LOSSY_LIMIT_S, must_take=False, may_stand=True),
        SCRIPT,
    ),
    "hung 2 s": Row("`stop` while the vehicle's node hangs for 2 s", hung_for(2.0, "stop"), SCRIPT),
    "hung 20 s": Row("`stop` while the vehicle's node hangs for 20 s", hung_for(20.0, "stop"), SCRIPT),
    "hung 20 s, off": Row(
        "`stop --off` while the vehicle's node hangs for 20 s", hung_for(20.0, "stop", "--off"), CALLS
    ),
    "script goes on": Row("`stop` of a script that goes on", stopped_for_good("stop"), SCRIPT),
    "calls go on": Row("`stop`, and calls by hand go on", stopped_for_good("stop"), CALLS),
    "calls go on, off": Row(
        "`stop --off`, and calls by hand go on", stopped_for_good("stop", "--off"), CALLS
    ),
    "stop and hands": Row("`stop` and `hands` at once", stop_and_hands()),
    "stop and hands, busy": Row(
        "`stop` and `hands` at once, while the vehicle takes nothing for 2 s",
        stop_and_hands(busy, must_take=False),
        generations=("b",),
        why_not=LATE,
    ),
    "stop and hands, late": Row(
        "`stop` and `hands` at once, over a round trip of 1.2 s",
        stop_and_hands(late_link, LIMIT_S + 1.2, must_take=False),
    ),
    "stop and hands, losing": Row(
        "`stop` and `hands` at once, over 25 % loss",
        stop_and_hands(losing_link, LOSSY_LIMIT_S, must_take=False, is_rest_due=False, may_stand=True),
    ),
}

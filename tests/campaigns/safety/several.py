"""Rows of several aPads in one run."""

from __future__ import annotations

import math
import signal

from safety.flight import FENCE, Setup
from safety.judge import Case
from safety.row import AFTER_S, Act, Row, Try, unless


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


FIVE = Setup(apads=5, watchdog=False)
ROWS: dict[str, Row] = {
    "five": Row("`stop RUN` of five aPads", stop_all("stop"), FIVE),
    "five, off": Row("`stop RUN --off` of five aPads", stop_all("stop", "--off"), FIVE),
    "five, one": Row("`stop RUN/apad3` of five aPads", stop_all("stop", one="apad3"), FIVE),
    "five, one hangs": Row(
        "`stop RUN` of five aPads, one of whose nodes hangs", stop_all("stop", hangs="apad2"), FIVE
    ),
}

"""Rows of stops that stay in force while the bench is gone: dead, asleep, carried elsewhere, restarted."""

from __future__ import annotations

import shutil
import signal
import time
from collections.abc import Callable
from typing import Any

from tries import NoFlight

from safety.flight import START_M, Setup
from safety.judge import Case, Kind
from safety.row import (
    AFTER_S,
    LATCH_TRIES,
    LATE,
    SHOWN_S,
    SUPERVISOR,
    TETHER_LIMIT_S,
    WATCHDOG_LIMIT_S,
    Act,
    Row,
    Try,
    unless,
)

FAILED = 4
"""The status of a go-to that was accepted, and that a guard then refused."""
AGAIN_S = 3.0
"""An OFF goes out again so soon after a supervisor takes orders."""


Latch = Callable[[Try], tuple[float, dict[str, Any]]]
"""Brings the vehicle under a stop; returns its beginning, and how it is judged."""
Gap = Callable[[Try], tuple[float, float]]
"""The bench is gone for a time; returns when it went and when it was back."""


def by_person(*words: str) -> Latch:
    def latch(it: Try) -> tuple[float, dict[str, Any]]:
        begun_s = it.order(*words)
        it.flight.pause(6.0)
        return begun_s, {
            "must_be": None if words == ("stop",) else Kind.OFF,
            "arms_rest": words[0] == "hands",
        }

    return latch


def off_by_guard(it: Try) -> tuple[float, dict[str, Any]]:
    begun_s = time.monotonic()
    it.flight.falsify("nan")
    it.flight.pause(6.0)
    it.flight.falsify("good")
    it.flight.pause(6.0)
    return begun_s, {"must_be": Kind.OFF}


def hold_by_guard(it: Try) -> tuple[float, dict[str, Any]]:
    it.flight.falsify("rough", noise_m=0.05, gap_s=0.0, waves_m=0.0)
    it.flight.pause(SHOWN_S)
    begun_s = time.monotonic()
    it.flight.spoil(hull="tied")
    it.flight.pause(TETHER_LIMIT_S + 6.0)
    return begun_s, {"must_be": Kind.HOLD, "limit_s": TETHER_LIMIT_S + 2.0}


def by_watchdog(kind: Kind) -> Latch:
    """The cable is cut for 20 s; for an OFF the position is no number meanwhile."""

    def latch(it: Try) -> tuple[float, dict[str, Any]]:
        begun_s = time.monotonic()
        it.flight.link(1.0)
        it.flight.pause(2.0)
        if kind is Kind.OFF:
            it.flight.falsify("nan")
        it.flight.pause(18.0)
        it.flight.falsify("good")
        it.flight.link(0.0)
        it.flight.pause(12.0)
        return begun_s, {"must_be": kind, "limit_s": WATCHDOG_LIMIT_S}

    return latch


def not_taken(it: Try) -> tuple[float, dict[str, Any]]:
    """A hold that was sent, and whose answer the supervisor does not live to see."""
    it.flight.spoil(answer_s=4.0, takes_first=it.heals)
    pressed = it.flight.person("stop", "--by", "judge")
    pressed.press()
    it.flight.wait(
        lambda: any(one["at_s"] > pressed.asked_s for one in it.flight.orders()), 10.0, "no stop went out"
    )
    return pressed.asked_s, {"one_place": True}


def supervisor_dies(it: Try) -> tuple[float, float]:
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    it.flight.pause(2.0)
    return gone_s, it.flight.resume()


def copied(it: Try) -> tuple[float, float]:
    """All of the laptop's programs die, and the run's directory flies on at another place."""
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGKILL)
    it.flight.pause(1.0)
    other = it.flight.run.with_name("carried")
    shutil.copytree(it.flight.run, other, ignore=lambda _, names: [it for it in names if ".sock" in it])
    return gone_s, it.flight.resume(other)


def asleep(it: Try) -> tuple[float, float]:
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGSTOP)
    it.flight.pause(30.0)
    it.flight.signal_bench(signal.SIGCONT)
    return gone_s, time.monotonic()


def latched(latch: Latch, gap: Gap = supervisor_dies, *, off_again: bool = False, holds: bool = False) -> Act:
    """A stop outlives the bench's gap: an OFF goes out again at once, a taken hold does not, and a go-to is refused."""

    def act(it: Try) -> Case:
        begun_s, how = latch(it)
        gone_s, back_s = gap(it)
        it.flight.pause(6.0)
        answer = it.flight.called("go_to_point", north_m=START_M[0], east_m=START_M[1])
        it.flight.pause(AFTER_S)
        is_refused = not answer["accepted"] or any(
            told["status"] == FAILED and told["answered_s"] >= answer["asked_s"]
            for told in it.flight.answers("goto_status")
        )
        if off_again:
            how["off_again"] = (gone_s, back_s + AGAIN_S)
        if not holds:
            how["deaf"] = (gone_s, back_s)
        return it.case(
            begun_s,
            is_rest_due=False,
            ends_at_rest=True,
            other_faults=unless(is_refused, "a go-to was accepted after the gap, and did not fail"),
            **how,
        )

    return act


def fence_edited(it: Try) -> Case:
    """Somebody draws the fence closer in the run's records while no supervisor lives: the way on stays inside it."""
    begun_s = it.order("stop")
    it.flight.pause(6.0)
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    here = it.flight.place()
    corners = tuple((here[0] + n, here[1] + e) for n, e in ((-14, -14), (14, -14), (14, 14), (-14, 14)))
    it.flight.draw_fence(corners)
    edited_s = time.monotonic()
    try:
        it.flight.resume()
    except NoFlight:
        it.flight.pause(AFTER_S)
        return it.case(begun_s, later_fence=(edited_s, corners))
    it.flight.pause(4.0)
    word_s = it.order("continue")
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, words_s=(word_s,), later_fence=(edited_s, corners), is_rest_due=False)


def restarted_by_parent(*words: str) -> Act:
    """The run's own parent starts another supervisor under the stop, and nothing moves before `continue`."""

    def act(it: Try) -> Case:
        begun_s = it.order(*words)
        it.flight.pause(6.0)
        gone_s = time.monotonic()
        it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
        it.flight.wait(lambda: not it.flight.takes_orders(), 10.0, "the supervisor lives")
        it.flight.wait(it.flight.takes_orders, 60.0, "the parent starts no other supervisor")
        back_s = time.monotonic()
        it.flight.pause(2 * AFTER_S)
        off = "--off" in words or words[0] == "hands"
        return it.case(
            begun_s,
            must_be=Kind.OFF if off else None,
            off_again=(gone_s, back_s + AGAIN_S) if off else None,
            deaf=(gone_s, back_s),
            ends_at_rest=True,
        )

    return act


ROWS: dict[str, Row] = {
    "fence edited": Row("the fence is drawn closer between death and resume", fence_edited),
}
LATCHES: dict[str, tuple[Latch, bool]] = {
    "hold": (by_person("stop"), False),
    "off": (by_person("stop", "--off"), True),
    "hands": (by_person("hands"), True),
    "guard's hold": (hold_by_guard, False),
    "guard's off": (off_by_guard, True),
    "watchdog's hold": (by_watchdog(Kind.HOLD), False),
    "watchdog's off": (by_watchdog(Kind.OFF), False),
}
"""Each with whether an OFF of the bench is in force, which goes out again."""
for _name, (_latch, _off_again) in LATCHES.items():
    ROWS[f"resumed, {_name}"] = Row(
        f"supervisor killed and resumed under a {_name}",
        latched(_latch, off_again=_off_again),
        tries=LATCH_TRIES,
    )
for _name in ("hold", "off", "hands"):
    _latch, _off_again = LATCHES[_name]
    ROWS[f"asleep, {_name}"] = Row(
        f"the laptop asleep for 30 s under a {_name}", latched(_latch, asleep), tries=LATCH_TRIES
    )
    ROWS[f"carried, {_name}"] = Row(
        f"the run's directory carried elsewhere and resumed under a {_name}",
        latched(_latch, copied, off_again=_off_again),
        tries=LATCH_TRIES,
    )
ROWS["resumed, not taken"] = Row(
    "supervisor killed and resumed after a hold whose answer it did not live to see",
    latched(not_taken, holds=True),
    generations=("b",),
    why_not=LATE,
    tries=LATCH_TRIES,
)
OWN = Setup(is_our_own=True)
for _name, _order in (("hold", "stop"), ("off", "stop --off"), ("hands", "hands")):
    ROWS[f"parent, {_name}"] = Row(
        f"the run's parent restarts a killed supervisor under a {_name}",
        restarted_by_parent(*_order.split()),
        OWN,
        tries=LATCH_TRIES,
    )

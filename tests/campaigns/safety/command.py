"""Rows of who commands the vehicle: people, consoles, watchdogs, a second bench."""

from __future__ import annotations

import signal
import time
from contextlib import suppress
from typing import Any

from safety.flight import Flight, Setup
from safety.judge import Case, Kind
from safety.row import (
    AFTER_S,
    CONSOLES,
    WATCHDOG_LIMIT_S,
    Act,
    Row,
    Try,
    stopped,
    unless,
)

NOTICED_S = 18.0
"""15 s without a word of the watchdog, and 3 s (docs/guards.md)."""
IMC_GOAL_DEG = (43.9334, 15.4450)
"""Some 40 m from the start, inside the fence."""


def taken_over(it: Try) -> Case:
    """A person who took over stops and continues: the person commands on, and the mission only after `give_back`."""
    flight = it.flight
    refused = [name for name in ("take_over", "hold_position") if not _accepted(flight, name)]
    flight.pause(4.0)
    begun_s = time.monotonic()
    refused += [] if _accepted(flight, "stop") else ["stop"]
    flight.pause(4.0)
    refused += [] if _accepted(flight, "continue", stop=1) else ["continue"]
    flight.pause(AFTER_S)
    word_s = time.monotonic()
    refused += [] if _accepted(flight, "give_back") else ["give_back"]
    flight.pause(AFTER_S)
    return it.case(
        begun_s,
        words_s=(word_s,),
        must_move=True,
        is_rest_due=False,
        other_faults=tuple(f"`{name}` was refused" for name in refused),
    )


def _accepted(flight: Flight, name: str, **request: Any) -> bool:
    request |= {"here": True} if name == "hold_position" else {}
    return bool(flight.called(name, **request)["accepted"])


def stopped_and_continued(it: Try) -> Case:
    """Without a person who has taken over, `continue` is the mission's."""
    it.flight.actor("caller")  # a person has it at hand: its start is no part of the stop
    begun_s = time.monotonic()
    refused = [] if _accepted(it.flight, "stop") else ["`stop` was refused"]
    it.flight.pause(6.0)
    word_s = time.monotonic()
    refused += [] if _accepted(it.flight, "continue", stop=1) else ["`continue` was refused"]
    it.flight.pause(AFTER_S)
    return it.case(begun_s, words_s=(word_s,), must_move=True, is_rest_due=False, other_faults=tuple(refused))


def ordered_by_imc(it: Try) -> Case:
    """Under a guard's stop an IMC console starts a plan: it is refused."""
    pressed = it.flight.order_by_imc(*IMC_GOAL_DEG)
    begun_s = time.monotonic()
    it.flight.falsify("nan")
    it.flight.pause(4.0)
    it.flight.falsify("good")
    it.flight.pause(13.0)
    pressed.press()
    answer = pressed.answer()
    it.flight.pause(AFTER_S)
    return it.case(
        begun_s,
        lies=True,
        must_be=Kind.OFF,
        ends_at_rest=True,
        other_faults=unless(answer.code != 0, "an IMC console's plan was accepted under a guard's stop"),
    )


def console_frozen(it: Try) -> None:
    it.flight.signal_bench(signal.SIGSTOP, "commands.main console")
    it.flight.pause(3.0)


def hands_at_arm(it: Try) -> Case:
    """`hands` comes at any time of a docking whose arm stands open, or closes: it stays as it is."""
    it.flight.wait(it.flight.arm_is_open, 120.0, "no arm was opened")
    it.flight.pause(it.flight.rng.uniform(0.5, 14.0))
    begun_s = it.order("hands")
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, must_be=Kind.OFF, arms_rest=True, ends_at_rest=True)


def watchdog_dead(it: Try) -> Case:
    """Nobody is left to stop it in a silence: the bench tells that, and orders nothing after the silence."""
    begun_s = time.monotonic()
    it.flight.signal_vehicle(signal.SIGKILL, "watchdog")
    it.flight.pause(NOTICED_S)
    said = it.flight.said_by_bench().lower()
    it.flight.link(1.0)
    it.flight.pause(20.0)
    healed_s = time.monotonic()
    it.flight.link(0.0)
    it.flight.pause(20.0)
    told = unless("watchdog" in said, f"nobody was told within {NOTICED_S:g} s that the watchdog is dead")
    return it.case(begun_s, is_stop_due=False, is_rest_due=False, deaf=(begun_s, healed_s), other_faults=told)


def held_without_watchdog(it: Try) -> Case:
    """The scenario has the bench hold the vehicle where its watchdog is dead."""
    begun_s = time.monotonic()
    it.flight.signal_vehicle(signal.SIGKILL, "watchdog")
    it.flight.pause(NOTICED_S + AFTER_S)
    return it.case(begun_s, must_be=Kind.HOLD, limit_s=NOTICED_S)


def watchdog_deaf(it: Try) -> Case:
    """The watchdog hangs, the cable is cut, and the watchdog wakes: it counts no old heartbeat, and stops the vehicle."""
    it.flight.signal_vehicle(signal.SIGSTOP, "watchdog")
    it.flight.pause(4.0)
    cut_s = time.monotonic()
    it.flight.link(1.0)
    it.flight.pause(8.0)
    it.flight.signal_vehicle(signal.SIGCONT, "watchdog")
    awake_s = time.monotonic()
    it.flight.pause(25.0)
    healed_s = time.monotonic()
    it.flight.link(0.0)
    it.flight.pause(AFTER_S)
    return it.case(
        awake_s, limit_s=WATCHDOG_LIMIT_S + 2.0, deaf=(cut_s, healed_s), must_be=None, is_rest_due=False
    )


def watchdog_restarted(*words: str) -> Act:
    """Under a latch the watchdog starts anew, and the cable is cut: neither it nor the bench moves the vehicle."""

    def act(it: Try) -> Case:
        begun_s = it.order(*words)
        it.flight.pause(4.0)
        it.flight.kill("watchdog")
        it.flight.start_watchdog()
        it.flight.pause(8.0)
        cut_s = time.monotonic()
        it.flight.link(1.0)
        it.flight.pause(20.0)
        healed_s = time.monotonic()
        it.flight.link(0.0)
        it.flight.pause(AFTER_S)
        must_be = None if words == ("stop",) else Kind.OFF
        return it.case(begun_s, must_be=must_be, deaf=(cut_s, healed_s), ends_at_rest=True)

    return act


def second_bench(it: Try) -> Case:
    """A second command that flies is refused, and orders nothing."""
    begun_s = time.monotonic()
    other = it.flight.start_bench(it.flight.run.with_name("second"))
    with suppress(TimeoutError):
        it.flight.wait(lambda: other.poll() is not None, 60.0, "")
    fault = unless(other.poll() not in (None, 0), "the second bench was not refused")
    it.flight.pause(AFTER_S)
    return it.case(
        begun_s, is_stop_due=False, is_rest_due=False, may_stop=False, newcomers_s=begun_s, other_faults=fault
    )


ROWS: dict[str, Row] = {
    "taken over": Row("`take_over`, `hold_position`, `stop`, `continue`, `give_back`", taken_over),
    "continue": Row("`stop` and `continue` by ROS", stopped_and_continued),
    "arm": Row(
        "`hands` while an arm is open or closes",
        hands_at_arm,
        Setup(near_m=8.0, ahead_m=2.0, arm_moves=True),
        generations=("b",),
        why_not="generation A moves its docks itself",
    ),
    "imc under a latch": Row("an IMC console's plan under a guard's OFF", ordered_by_imc, CONSOLES),
    "console frozen": Row("`stop` with a frozen console", stopped("stop", before=console_frozen), CONSOLES),
    "watchdog dead": Row("watchdog killed, then the cable is cut", watchdog_dead),
    "watchdog dead, hold": Row(
        "watchdog killed, where the bench has to hold then",
        held_without_watchdog,
        Setup(guards={"watchdog": "hold"}),
    ),
    "watchdog deaf": Row("watchdog hangs while the cable is cut", watchdog_deaf),
    "watchdog anew, hold": Row("watchdog starts anew under a hold", watchdog_restarted("stop")),
    "watchdog anew, off": Row("watchdog starts anew under an OFF", watchdog_restarted("stop", "--off")),
    "second bench": Row("a second bench on the same vehicle", second_bench),
}

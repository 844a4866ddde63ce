"""Rows of hulls and positions that do not do what the vehicle has taken."""

from __future__ import annotations

import time

from safety.judge import Case, Kind
from safety.row import AFTER_S, Act, Row, Try

MUX_LIMIT_S = 10.0


def disobeyed(kind: str, *words: str) -> Act:
    """OFF and an alarm are due, and nobody is told `done`."""

    def act(it: Try) -> Case:
        pressed = it.flight.person(*words, "--by", "judge")
        it.flight.spoil(hull=kind)
        pressed.press()
        it.told.append(pressed.answer())
        it.flight.pause(AFTER_S)
        said = it.flight.said_by_bench() + it.told[-1].text
        return it.case(
            pressed.asked_s, must_take=False, is_rest_due=False, one_place=True, disobeys=True, said=said
        )

    return act


def held_by_walking_position(it: Try) -> Case:
    """Under a hold the position walks off; each hold that is ordered keeps the first one's place."""
    begun_s = it.order("stop")
    it.flight.pause(6.0)
    it.flight.falsify("walks", speed_m_s=0.4)
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, one_place=True)


def held_by_deaf_hull(it: Try) -> Case:
    """The hull leaves a place that it had held."""
    begun_s = it.order("stop")
    it.flight.pause(4.0)
    it.flight.spoil(hull="deaf", velocity_m_s=[0.3, -0.2])
    it.flight.pause(2 * AFTER_S)
    said = it.flight.said_by_bench()
    return it.case(begun_s, is_rest_due=False, one_place=True, strays=True, said=said)


def two_places(it: Try) -> Case:
    """One node publishes two places 3 m apart, in turns."""
    begun_s = time.monotonic()
    it.flight.falsify("mux", apart_m=3.0)
    it.flight.pause(MUX_LIMIT_S + AFTER_S)
    return it.case(
        begun_s, lies=True, limit_s=MUX_LIMIT_S, must_be=Kind.OFF, longest_way_m=2.0, ends_at_rest=True
    )


ROWS: dict[str, Row] = {
    "deaf": Row("`stop` of a hull that goes on", disobeyed("deaf", "stop")),
    "deaf, off": Row("`stop --off` of a hull that goes on", disobeyed("deaf", "stop", "--off")),
    "reversed": Row("`stop` of a hull whose thrusters push the other way", disobeyed("reversed", "stop")),
    "hold, walking": Row(
        "the position walks off at 0.4 m/s under a hold",
        held_by_walking_position,
        generations=("b",),
        why_not="generation A has no hold but a go-to",
    ),
    "hold, deaf": Row(
        "a hull goes on under a hold",
        held_by_deaf_hull,
        generations=("b",),
        why_not="generation A has no hold but a go-to",
    ),
    "mux": Row("one node with two places 3 m apart", two_places),
}

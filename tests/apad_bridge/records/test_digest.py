"""Tests the digest of a run on lines made by hand: what counts, and what does not."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from journals import journal_of

from apad_bridge.events.all_events import EVENTS
from apad_bridge.events.event import Uncounted, fields_of
from apad_bridge.records.digest import COUNTED, RunDigest, combined_digest, counted_events

TRUTH = {
    "id": 3,
    "agent_ms": 30_500,
    "state": "FLOATING",
    "primary": [30_500, 300_000_000_000_000, 1, 0, 0],
    "secondary": [0, 600_000_000_000_000, 0, 0, 0],
    "north_um": 12_345_678,
    "east_um": -7_000_000,
    "depth": [0, 0],
    "buoyancy": "FLOAT",
    "docked": False,
}
PACKET = {
    "from": 2,
    "address": None,
    "what": "status",
    "bytes": 20,
    "began_ms": 900,
    "lasted_ms": 105,
    "timeslot": 1,
    "unsent": None,
    "heard": [[0, "received", 12.5, 1020, 10.0, 15.1], [3, "collided", 3.5, 1021, 11.0, 17.0]],
    "data": "0a0b",
}
LINES: list[dict[str, Any]] = [
    {"t": 0, "kind": "mission", "phase": "idle wait", "snapshot": {"cost_m": 0.0}},
    {"t": 1000, "kind": "plan", "what": "collect", "strategy": "greedy", "steps": [{"agent": 3, "dock": 0}]}
    | {"costs": {}, "beliefs": []},
    {
        "t": 1000,
        "kind": "primitive",
        "name": "go to point",
        "phase": "started",
        "north_m": 12.34,
        "east_m": 1.0,
    },
    {"t": 1000, "kind": "leg", "metres": 12.34},
    {"t": 1017, "kind": "truth", **TRUTH},
    {"t": 2000, "kind": "packet", **PACKET},
    {"t": 3000, "kind": "range", "id": 3, "range_m": 10.5},
    {"t": 3000, "kind": "fix", "id": 3, "north_m": 4.0, "east_m": 5.0, "ranges": 3, "hdop": 1.2}
    | {"covariance": [1.0, 0.0, 1.0], "residual_m": 0.2},
    {"t": 4000, "kind": "dock", "dock": 0, "agent": 3, "closed": True},
]


def digest_of(lines: list[dict[str, Any]]) -> str:
    return counted_events(journal_of(lines).entries)[1]


def changed(number: int, **fields: Any) -> list[dict[str, Any]]:
    return [line | fields if n == number else line for n, line in enumerate(LINES)]


def test_every_kind_of_event_counts_or_is_left_out_for_a_reason() -> None:
    for kind in EVENTS.values():
        counted = kind.counted
        if isinstance(counted, Uncounted):
            assert counted.reason and kind.kind not in COUNTED
        else:
            assert set(counted) <= {it.name for it in fields_of(kind)} and kind.kind in COUNTED


DECIDED = [
    (0, {"phase": "dock"}),
    (0, {"t": 1}),
    (1, {"steps": [{"agent": 3, "dock": 1}]}),
    (1, {"steps": [{"agent": 3, "dock": 0}, {"agent": 4, "dock": 1}]}),
    (1, {"strategy": "cautious"}),
    (1, {"exchanged": [{"released": 1, "collected": 3}]}),
    (2, {"phase": "failed"}),
    (2, {"north_m": 12.36}),
    (3, {"metres": 12.36}),
    (4, {"state": "SURFACING"}),
    (4, {"agent_ms": 30_501}),
    (4, {"docked": True}),
    (4, {"north_um": 12_365_678}),
    (4, {"primary": [30_500, 301_000_000_000_000, 1, 0, 0]}),
    (5, {"unsent": "the modem was busy"}),
    (5, {"heard": [[0, "received", 12.5, 1020, 10.0, 15.1]]}),
    (5, {"began_ms": 901}),
    (6, {"range_m": None}),
    (7, {"east_m": 5.02}),
    (8, {"closed": False}),
]
"""What is decided or happens: the number of a line, and the fields that differ."""
ESTIMATED = [
    (0, {"snapshot": {"cost_m": 1.0, "a_new_field": 2}}),
    (1, {"costs": {"distance_m": 27.9}, "beliefs": [], "a_new_field": 1}),
    (2, {"reason": "3.141 m short"}),
    (5, {"data": "0c"}),
    (6, {"range_m": 10.6}),
    (7, {"hdop": 1.3, "residual_m": 0.1}),
]
"""Estimates, texts and new fields."""
FURTHER: list[dict[str, Any]] = [
    {"t": 0, "kind": "run", "format": 99, "scenario": "another name", "theta": 1, "seed": 1, "agents": []}
    | {"duration_s": 9.0, "pool_threshold": 0.8, "full_threshold": 0.99},
    {"t": 2000, "kind": "remark", "text": "a whale", "by": "mate"},
    {"t": 2000, "kind": "master_back", "uri": "http://elsewhere", "gone_s": 3.2, "registered": 7},
    {"t": 2000, "kind": "of another version", "agent": 3},
    {"t": 3000, "kind": "tick"},
]
"""The clock of the machine, notes and unknown kinds."""
DRIFTED = {"t": 1500, "kind": "truth", **TRUTH, "north_um": 13_000_000, "agent_ms": 45_000}


@pytest.mark.parametrize(
    ("lines", "counts"),
    [
        *(pytest.param(changed(n, **fields), True, id=f"{n} {fields}") for n, fields in DECIDED),
        *(pytest.param(changed(n, **fields), False, id=f"{n} {fields}") for n, fields in ESTIMATED),
        pytest.param([*LINES, *FURTHER], False, id="the machine's clock, notes and unknown kinds"),
        pytest.param([*LINES[:5], DRIFTED, *LINES[5:]], False, id="a truth in which nothing changes"),
        pytest.param(
            [*LINES[:5], DRIFTED | {"state": "SINKING"}, *LINES[5:]], True, id="a truth of another state"
        ),
        pytest.param([*LINES, LINES[-1]], True, id="the same event twice"),
    ],
)
def test_what_counts(lines: list[dict[str, Any]], counts: bool) -> None:
    assert (digest_of(lines) != digest_of(LINES)) is counts


@given(st.permutations(LINES[1:4]), st.permutations(LINES[6:8]))
def test_the_order_of_lines_of_one_time_does_not_count(
    plans: list[dict[str, Any]], ranges: list[dict[str, Any]]
) -> None:
    assert digest_of([LINES[0], *plans, *LINES[4:6], *ranges, LINES[8]]) == digest_of(LINES)


@given(st.integers(-(10**6), 10**6), st.integers(-4, 4))
def test_the_last_bits_of_a_place_do_not_count(millimetres: int, steps: int) -> None:
    """Places are given to the millimetre in scenarios; processors differ by some steps of a float."""
    place_m = other_m = millimetres / 1000
    for _ in range(abs(steps)):
        other_m = math.nextafter(other_m, math.copysign(math.inf, steps))
    assert digest_of(changed(2, north_m=place_m)) == digest_of(changed(2, north_m=other_m))


def test_a_run_that_is_taken_line_by_line_has_the_digest_of_its_journal() -> None:
    digest = RunDigest()
    for at_ms, event in journal_of(LINES).entries:
        digest.take(at_ms, event)
    assert str(digest) == digest_of(LINES) and len(str(digest)) == 16


def test_several_apads_have_one_digest_that_does_not_follow_their_order() -> None:
    one, other = digest_of(LINES), digest_of(LINES[:4])
    assert combined_digest([one, other]) == combined_digest([other, one]) != combined_digest([one, one])
    assert combined_digest([one]) == one

"""A supervisor is killed at any tick of a flight with failures: the next supervisor names the same first cause."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

from journals import facts_of, state_of
from scenario_files import POOL_FILE

from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import load

PRE_EMPTED = {
    "t": 1000,
    "kind": "primitive",
    "name": "go to point",
    "phase": "failed",
    "reason": "pre-empted",
}


def test_the_first_cause_is_the_same_after_a_kill_at_any_tick() -> None:
    scenario = load(POOL_FILE)
    apad = replace(scenario.apad, dock_miss_probability=0.6)
    flight, recorder = open_flight(replace(scenario, apad=apad, duration_s=600.0))
    ticks: list[tuple[int, str | None]] = []

    def tick(*_: Any, **__: Any) -> None:
        latched = flight.supervisor.port.first_failure
        ticks.append((len(facts_of(recorder)), None if latched is None else latched.reason))

    recorder.tick = tick  # type: ignore[method-assign]
    flight.run()
    lines = [{"t": at_ms, "kind": kind, **data} for at_ms, kind, data in facts_of(recorder)]
    for until, reason in dict.fromkeys(ticks):  # a tick without a new line is as the one before
        found = state_of(it for it in lines[:until] if it["kind"] == "primitive").first_failure
        assert (None if found is None else found.reason) == reason
    told = [reason for _, reason in ticks]
    changes = sum(one != other for one, other in pairwise(told))
    assert len({*told}) > 1 and changes >= 3, "it failed, succeeded and failed again"


def test_who_makes_way_for_another_has_not_failed() -> None:
    failed = PRE_EMPTED | {"t": 2000, "reason": "it does not come nearer"}
    held = {"t": 3000, "kind": "primitive", "name": "hold position", "phase": "succeeded"}
    assert state_of([PRE_EMPTED]).first_failure is None
    found = state_of([PRE_EMPTED, failed, failed | {"reason": "another"}, held]).first_failure
    assert found is not None and (found.at_ms, found.reason) == (2000, "it does not come nearer")
    assert state_of([failed, PRE_EMPTED | {"phase": "succeeded"}]).first_failure is None

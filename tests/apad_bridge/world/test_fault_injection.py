"""Every row of the table in a flight: it begins, it ends, both are in the journal, and nothing of it is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from flying import Flying
from journals import facts_of, state_of

from agents.mussel.stimuli import PinDisturbed, to_json
from apad_bridge.runs.start_state import ongoing_faults
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.timed_faults import TABLE, FaultAt, Faults, TimedFault, injection
from apad_bridge.world.fault_injection import FaultInjection, Ongoing
from apad_bridge.world.world import World


def flown(pool: Scenario, *faults: FaultAt) -> Flying:
    return Flying(replace(pool, faults=Faults(at=faults)))


def at(fault: TimedFault, at_s: float, for_s: float | None = None, value: float | None = None) -> FaultAt:
    return FaultAt(
        fault=fault, at_s=at_s, id=None if TABLE[fault].is_of_apad else 3, for_s=for_s, value=value
    )


@pytest.mark.parametrize("fault", [it for it in TimedFault if not TABLE[it].needs_process])
def test_a_fault_begins_and_heals_and_leaves_nothing(pool: Scenario, fault: TimedFault) -> None:
    row = TABLE[fault]
    flying = flown(pool, at(fault, 5, 4 if row.span_s else None))
    flying.seconds(15)
    (begun,) = flying.events("fault")
    assert begun["fault"] == fault and begun.get("id") == (None if row.is_of_apad else 3)
    if row.needs_dock:
        assert begun["refused"] == f"aMussel 3 is in no dock, by its reports: {fault} happens only there"
        return
    assert begun["until_ms"] == 5_000 + 1000 * (4 if row.span_s else 0) and "refused" not in begun
    over = [(at_ms, data["fault"]) for at_ms, kind, data in facts_of(flying.records) if kind == "fault_over"]
    assert over == ([(9_000, fault)] if row.span_s else [])
    faults = flying.flight._world.faults
    host, link = faults._host, faults._link
    assert not host._defects and not faults._active
    assert (link.is_frozen, link.north_error_m, link.jammed_docks) == (False, 0.0, frozenset())


def refusals(flying: Flying) -> list[str | None]:
    return [it.get("refused") for it in flying.events("fault")]


def wires(flying: Flying, kind: int) -> list[list[int]]:
    return [it["wire"] for it in flying.events("stimulus") if it["wire"][0] == kind]


CUT = TimedFault.LINK_CUT
TOLD: dict[str, tuple[list[FaultAt], Callable[[Flying], Any], list[Any]]] = {
    **{
        f"{fault} is refused without a process": (
            [at(fault, 1)],
            refusals,
            [f"aMussel 3 has no process of its own: {fault} needs one"],
        )
        for fault in TimedFault
        if TABLE[fault].needs_process
    },
    "a fault happens once at a time": (
        [at(CUT, 1, 10), at(CUT, 5, 10), at(CUT, 12, 10)],
        refusals,
        [None, "aMussel 3 has the fault link_cut already", None],
    ),
    "the two defects of a pin keep each other": (
        [at(TimedFault.EDGE_FALSE, 1, 20), at(TimedFault.EDGE_MISSED, 5, 5)],
        lambda it: wires(it, to_json(PinDisturbed(1, 0))[0]),
        [to_json(PinDisturbed(*it)) for it in ((1, 0), (1, 1), (1, 0), (0, 0))],
    ),
    # A process that was killed is told again, so that the jam lasts as long as it should.
    "a defect of the body outlives its process": (
        [at(TimedFault.BUOYANCY_STUCK, 1, 60), at(TimedFault.KILLED, 5)],
        lambda it: [*(data["id"] for data in it.events("died")), *wires(it, 13)],
        [3, [13, 1], [13, 1]],
    ),
}


@pytest.mark.parametrize(("faults", "what", "told"), TOLD.values(), ids=TOLD)
def test_what_a_flight_tells(
    pool: Scenario, faults: list[FaultAt], what: Callable[[Flying], Any], told: list[Any]
) -> None:
    flying = flown(pool, *faults)
    flying.seconds(25)
    assert what(flying) == told


def test_each_dock_jams_and_moves_again_by_itself(pool: Scenario) -> None:
    jams = [
        at(TimedFault.DOCK_JAMMED, at_s, for_s, dock_index)
        for at_s, dock_index, for_s in ((1, 1, 10), (2, 3, 20), (3, 1, 30))
    ]
    flying = flown(pool, *jams)
    jammed = []
    for _ in range(3):
        flying.seconds(8)
        jammed.append(flying.flight._world.faults._link.jammed_docks)
    assert jammed == [{1, 3}, {3}, set()]
    assert refusals(flying) == [None, None, "the aPad has the fault dock_jammed already"]


def test_a_jam_that_is_over_ends_no_other_in_a_resumed_run() -> None:
    jam = {"kind": "fault", "fault": "dock_jammed"}
    lines = [
        {"t": 1000, **jam, "value": 1.0, "until_ms": 9_000},
        {"t": 2000, **jam, "value": 3.0, "until_ms": 62_000},
        {"t": 9000, "kind": "fault_over", "fault": "dock_jammed"},
    ]
    jammed = injection(TimedFault.DOCK_JAMMED, None, 3.0, 60)
    assert ongoing_faults(state_of(lines)) == [Ongoing(jammed, 62_000)]


def test_a_leak_takes_as_much_as_it_says(pool: Scenario) -> None:
    lossy, sound = (flown(pool, *faults) for faults in ([at(TimedFault.BATTERY_AGEING, 0, 60, 0.1)], []))
    for flying in (lossy, sound):
        flying.seconds(62)
    low, high = (it.flight.supervisor.beliefs.get(3).primary for it in (lossy, sound))
    assert high - low == pytest.approx(0.1, abs=1e-4)  # a packet has 16 bits for it


def test_a_supervisor_goes_on_with_the_faults_that_another_began(pool: Scenario) -> None:
    lines = [
        {"t": 1000, "kind": "fault", "id": 3, "fault": "link_delay", "value": 2.0, "until_ms": 61_000},
        {"t": 2000, "kind": "fault", "id": 4, "fault": "link_cut", "until_ms": 9_000},
        {"t": 3000, "kind": "fault", "id": 5, "fault": "brown_out", "until_ms": 3000},
        {"t": 3000, "kind": "fault", "fault": "apad_lies", "value": 5.0, "until_ms": 33_000},
        {"t": 4000, "kind": "fault", "id": 6, "fault": "link_cut", "until_ms": 64_000, "refused": "why"},
        {"t": 9000, "kind": "fault_over", "id": 4, "fault": "link_cut"},
    ]
    ongoing = ongoing_faults(state_of(lines))
    assert ongoing == [
        Ongoing(injection(TimedFault.LINK_DELAY, 3, 2.0, 60), 61_000),
        Ongoing(injection(TimedFault.APAD_LIES, None, 5.0, 30), 33_000),
    ]

    def resumed(context):  # type: ignore[no-untyped-def]
        fleet = context.world.fleet
        return replace(context, world=World(fleet, FaultInjection(fleet.host, pool.time_scale, (), ongoing)))

    flying = Flying(pool, resumed)
    faults, has = flying.flight._world.faults, []
    for seconds in (20, 50):
        flying.seconds(seconds)
        has.append((bool(faults._host._defects), faults._link.north_error_m))
    assert has == [(True, 5.0), (False, 0.0)] and flying.events("fault") == []
    assert [it["fault"] for it in flying.events("fault_over")] == ["apad_lies", "link_delay"]

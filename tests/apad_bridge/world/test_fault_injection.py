"""Every row of the table in a flight: it begins, it ends, both are in the journal, and nothing of it is left."""

from __future__ import annotations

from dataclasses import replace

import pytest
from flying import Flying
from journals import facts_of, state_of

from agents.mussel.stimuli import PinDisturbed, from_json
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


@pytest.mark.parametrize("fault", [it for it in TimedFault if TABLE[it].needs_process])
def test_what_needs_a_process_is_refused_without_one(pool: Scenario, fault: TimedFault) -> None:
    flying = flown(pool, at(fault, 1))
    flying.seconds(2)
    (begun,) = flying.events("fault")
    assert begun["refused"] == f"aMussel 3 has no process of its own: {fault} needs one"


def test_a_fault_happens_once_at_a_time(pool: Scenario) -> None:
    flying = flown(
        pool, at(TimedFault.LINK_CUT, 1, 10), at(TimedFault.LINK_CUT, 5, 10), at(TimedFault.LINK_CUT, 12, 10)
    )
    flying.seconds(15)
    assert [it.get("refused") for it in flying.events("fault")] == [
        None,
        "aMussel 3 has the fault link_cut already",
        None,
    ]


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
    refused = "the aPad has the fault dock_jammed already"
    assert [it.get("refused") for it in flying.events("fault")] == [None, None, refused]


def test_a_jam_that_is_over_ends_no_other_in_a_resumed_run() -> None:
    jam = {"kind": "fault", "fault": "dock_jammed"}
    lines = [
        {"t": 1000, **jam, "value": 1.0, "until_ms": 9_000},
        {"t": 2000, **jam, "value": 3.0, "until_ms": 62_000},
        {"t": 9000, "kind": "fault_over", "fault": "dock_jammed"},
    ]
    jammed = injection(TimedFault.DOCK_JAMMED, None, 3.0, 60)
    assert ongoing_faults(state_of(lines)) == [Ongoing(jammed, 62_000)]


def test_the_two_defects_of_a_pin_keep_each_other(pool: Scenario) -> None:
    flying = flown(pool, at(TimedFault.EDGE_FALSE, 1, 20), at(TimedFault.EDGE_MISSED, 5, 5))
    flying.seconds(25)
    disturbed = [
        it for data in flying.events("stimulus") if isinstance(it := from_json(data["wire"]), PinDisturbed)
    ]
    assert disturbed == [PinDisturbed(1, 0), PinDisturbed(1, 1), PinDisturbed(1, 0), PinDisturbed(0, 0)]


def test_a_defect_of_the_body_outlives_its_process(pool: Scenario) -> None:
    """A process that was killed is told again, so that the jam lasts as long as it should."""
    flying = flown(pool, at(TimedFault.BUOYANCY_STUCK, 1, 60), at(TimedFault.KILLED, 5))
    flying.seconds(10)
    assert [data["id"] for data in flying.events("died")] == [3]
    jams = [data["wire"] for data in flying.events("stimulus") if data["wire"][0] == 13]
    assert jams == [[13, 1], [13, 1]]


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
        faults = FaultInjection(fleet.host, pool.time_scale, (), ongoing)
        return replace(context, world=World(fleet, faults))

    flying = Flying(pool, resumed)
    flying.seconds(20)
    faults = flying.flight._world.faults
    assert faults._host._defects and faults._link.north_error_m == 5.0
    flying.seconds(50)
    assert not faults._host._defects and faults._link.north_error_m == 0.0
    assert flying.events("fault") == []
    assert [it["fault"] for it in flying.events("fault_over")] == ["apad_lies", "link_delay"]

"""The table of timed faults, and the faults of a scenario."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from scenario_files import POOL_FILE

from apad_bridge.scenario.cross_checks import contradictions
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.flight_readiness import problems_with_real_vehicle
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.timed_faults import (
    TABLE,
    FaultAt,
    FaultMix,
    Faults,
    TimedFault,
    injection,
    mixed,
    planned,
)

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("fault", TimedFault)
def test_every_fault_has_a_row_whose_defaults_are_allowed(fault: TimedFault) -> None:
    row = TABLE[fault]
    asked = injection(fault, None if row.is_of_apad else 3)
    assert asked.span_ms == 1000 * row.span_s
    if row.parameter is not None:
        assert row.parameter.least <= asked.value <= row.parameter.most


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ({"fault": "bit_flip", "at_s": 1}, "bit_flip needs the aMussel's id"),
        ({"fault": "apad_frozen", "at_s": 1, "id": 3}, "apad_frozen is a fault of the aPad: leave id out"),
        ({"fault": "bit_flip", "at_s": 1, "id": 3, "value": 2}, "probability is 0 to 1 (each bit), not 2"),
        ({"fault": "link_cut", "at_s": 1, "id": 3, "value": 2}, "link_cut has no value"),
        (
            {"fault": "brown_out", "at_s": 1, "id": 3, "for_s": 2},
            "brown_out is over at once: leave for_s out",
        ),
        ({"fault": "kraken", "at_s": 1, "id": 3}, "faults.at[0].fault"),
        ({"fault": "brown_out", "at_s": 1, "id": 99}, "faults.at[0].id: aMussel 99 is not of the fleet"),
        ({"fault": "dock_jammed", "at_s": 1, "value": 4}, "faults.at[0].value: the docks are 0 to 3"),
    ],
)
def test_what_no_row_allows_is_refused_with_its_reason(row: dict[str, Any], why: str) -> None:
    data = {**resolve(load(POOL_FILE)), "faults": {"at": [row]}}
    with pytest.raises(ScenarioError) as refused:
        from_data(data, "pool")
    assert why in "\n".join(refused.value.lines)


def test_a_real_apad_takes_no_scenario_with_faults() -> None:
    faulty = replace(load(POOL_FILE), faults=Faults(mix=FaultMix(seed=1, count=3)))
    assert contradictions(faulty) == []
    assert "no fault is injected into a real aPad: leave faults out" in problems_with_real_vehicle(faulty)


def test_a_mix_is_the_same_for_its_seed_and_lies_within_the_mission() -> None:
    first, again, other = (list(mixed(seed, 200, TimedFault, range(1, 13), 900.0)) for seed in (7, 7, 8))
    assert first == again != other and len(first) == 200
    assert all(0 <= at_ms < 900_000 for at_ms, _ in first)
    assert {it.fault for _, it in first} == set(TimedFault)


def test_a_mix_keeps_to_what_a_fleet_can_have() -> None:
    faults = Faults(at=(FaultAt(fault=TimedFault.STOPPED, at_s=1, id=3),), mix=FaultMix(seed=1, count=300))
    due = planned(faults, range(1, 13), 900.0, processes=False)
    assert [it.fault for _, it in due].count(TimedFault.STOPPED) == 1  # the one that somebody named
    assert due == sorted(due, key=lambda it: it[0])
    nobody = planned(Faults(mix=FaultMix(seed=1, count=20)), (), 900.0, processes=True)
    assert {TABLE[it.fault].is_of_apad for _, it in nobody} == {True}
    assert (
        planned(
            Faults(mix=FaultMix(seed=1, count=2, of=(TimedFault.STOPPED,))), range(3), 9.0, processes=False
        )
        == []
    )


def test_the_faults_of_a_scenario_outlive_its_file() -> None:
    text = "{at: [{fault: link_delay, id: 3, at_s: 60, for_s: 30, value: 2}], mix: {seed: 1, count: 5, of: [killed]}}"
    scenario = from_data({**resolve(load(POOL_FILE)), "faults": yaml.safe_load(text)}, "pool")
    assert from_data(resolve(scenario), "pool").faults == scenario.faults

"""The figures of several flights together, by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from apad_bridge.commands.outcome import report
from apad_bridge.events.run_events import EndReason
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.several.joint_summary import combined_summary


def flight(agents: int, mean: float, **more: Any) -> dict[str, Any]:
    spread = {"mean": mean, "max": mean + 10, "min": mean - 10}
    figures = {
        **{"theta": 30, "seed": 1, "agents": agents, "mission_s": 100.0, "ended_by": "mission time"},
        **{"uptime_paper": spread, "uptime_submerged": spread, "active_mean": agents * mean / 100},
        **{"end_reason": "mission time", "stopped_s": 0.0, "failed_docks": [1]},
        **{
            "amussels_lost": 0,
            "emptied": 1,
            "dead_time_s": 5.0,
            "services": 4,
            "gave_up": 0,
            "latest_tick_s": None,
        },
        **{
            "stopped_s": 0.0,
            "cost_m": 12.5,
            "planned_m": 13.0,
            "steps_given_up": 1,
            "causes": {"missed": 1},
            "left_alone": [],
            "beyond_reach": [],
        },
        **{"samples_taken": None, "samples_uploaded": None, "samples_waiting": None, "samples_lost": None},
        **{"counted_s": agents * 100.0, "counted_at_end": agents, "excluded": None, "amussels": {}},
        **{
            "final_charge_mean": mean / 100,
            "apad_energy_fraction": 0.2,
            "apad_energy_missing": None,
            "first_cause": None,
            "dropped": {},
            "digest": "00000000000000ff",
        },
    }
    return {**figures, **more}


APART = {"amussels": 1, "beside_real_s": 50.0, "retired_s": 0.0, "samples_taken": 0}
KNOWN = {"uptime_paper": 60.0, "final_charge": 0.5, "lost": False}
UNKNOWN = dict.fromkeys(KNOWN)


@pytest.mark.parametrize(
    ("first", "second", "whole"),
    [
        pytest.param(
            flight(3, 60.0),
            flight(1, 80.0, mission_s=90.0, dropped={"late": 2}),
            {
                "uptime_paper": pytest.approx({"mean": 65.0, "max": 90.0, "min": 50.0}),
                "final_charge_mean": pytest.approx(0.65),
                "active_mean": pytest.approx(2.6),
                **{"agents": 4, "services": 8, "cost_m": 25.0, "emptied": 2, "planned_m": 26.0},
                **{"steps_given_up": 2, "causes": {"missed": 2}, "mission_s": 100.0, "dropped": {"late": 2}},
                **{"samples_taken": None, "digest": "00000000000001fe"},
            },
            id="every aMussel counts alike",
        ),
        pytest.param(
            flight(3, 60.0),
            flight(1, 80.0, counted_s=50.0, counted_at_end=0, final_charge_mean=None, excluded=APART),
            {
                "uptime_paper": pytest.approx({"mean": (3 * 60 + 80 / 2) / 3.5, "max": 90.0, "min": 50.0}),
                "final_charge_mean": pytest.approx(0.6),
                "excluded": APART,
            },
            id="who was a twin for half the time counts half",
        ),
        pytest.param(
            flight(3, 60.0),
            flight(1, 80.0, counted_s=None, emptied=None),
            {"uptime_paper": None, "emptied": None, "services": 8},
            id="what one does not know nobody knows",
        ),
        pytest.param(
            flight(3, 60.0),
            flight(1, 80.0, ended_by="x", first_cause="stalled"),
            {"ended_by": "a: mission time; b: x", "first_cause": "b: stalled"},
            id="words stand with whom they are of",
        ),
        pytest.param(
            flight(1, 60.0, amussels={"10": {**UNKNOWN, "services": 2}, "9": {**KNOWN, "services": 1}}),
            flight(1, 80.0, amussels={"10": {**KNOWN, "services": 3}}),
            {"amussels": {"9": {**KNOWN, "services": 1}, "10": {**KNOWN, "services": 5}}},
            id="figures from where it is simulated, and services from all",
        ),
    ],
)
def test_the_figures_of_two_flights_together(
    first: dict[str, Any], second: dict[str, Any], whole: dict[str, Any]
) -> None:
    found = combined_summary("two", {"a": first, "b": second})
    assert {key: found[key] for key in whole} == whole


DONE, STOPPED, FAILED = EndReason.MISSION_TIME, EndReason.OPERATOR, EndReason.STRATEGY_FAILED


@pytest.mark.parametrize(
    ("reasons", "code"),
    [
        ((DONE, DONE), Exit.DONE),
        ((DONE, FAILED), Exit.PEER_FAILED),
        ((STOPPED, DONE), Exit.INTERRUPTED),
        ((STOPPED, FAILED), Exit.PEER_FAILED),
    ],
)
def test_of_several_apads_a_failure_decides_the_exit_code(
    reasons: tuple[EndReason, EndReason], code: Exit, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = combined_summary(
        "two", {it: flight(1, 60.0, end_reason=why.value) for it, why in zip("ab", reasons, strict=True)}
    )
    assert whole["end_reason"] == (DONE if set(reasons) == {DONE} else None)
    assert report("two", "greedy", RunDirectory(Path("run")), whole, as_json=True) is code

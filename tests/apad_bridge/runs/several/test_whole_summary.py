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


def test_every_aMussel_counts_alike() -> None:
    whole = combined_summary(
        "two", {"a": flight(3, 60.0), "b": flight(1, 80.0, mission_s=90.0, dropped={"late": 2})}
    )
    assert whole["uptime_paper"] == {"mean": pytest.approx(65.0), "max": 90.0, "min": 50.0}
    assert whole["final_charge_mean"] == pytest.approx(0.65)
    assert whole["active_mean"] == pytest.approx(2.6)
    assert (whole["agents"], whole["services"], whole["cost_m"], whole["emptied"]) == (4, 8, 25.0, 2)
    assert (whole["planned_m"], whole["steps_given_up"], whole["causes"]) == (26.0, 2, {"missed": 2})
    assert (whole["mission_s"], whole["dropped"]) == (100.0, {"late": 2})
    assert whole["samples_taken"] is None and whole["digest"] == "00000000000001fe"


def test_who_was_a_twin_for_half_the_time_counts_half() -> None:
    apart = {"amussels": 1, "beside_real_s": 50.0, "retired_s": 0.0, "samples_taken": 0}
    twin = flight(1, 80.0, counted_s=50.0, counted_at_end=0, final_charge_mean=None, excluded=apart)
    whole = combined_summary("two", {"a": flight(3, 60.0), "b": twin})
    assert whole["uptime_paper"]["mean"] == pytest.approx((3 * 60 + 80 / 2) / 3.5)
    assert (whole["final_charge_mean"], whole["excluded"]) == (pytest.approx(0.6), apart)


def test_what_one_does_not_know_nobody_knows() -> None:
    whole = combined_summary(
        "two", {"a": flight(3, 60.0), "b": flight(1, 80.0, counted_s=None, emptied=None)}
    )
    assert whole["uptime_paper"] is None and whole["emptied"] is None
    assert whole["services"] == 8


def test_words_stand_with_whom_they_are_of() -> None:
    whole = combined_summary(
        "two", {"a": flight(3, 60.0), "b": flight(1, 80.0, ended_by="x", first_cause="stalled")}
    )
    assert (whole["ended_by"], whole["first_cause"]) == ("a: mission time; b: x", "b: stalled")


def test_an_aMussel_has_its_figures_from_where_it_is_simulated_and_its_services_from_all() -> None:
    known = {"uptime_paper": 60.0, "final_charge": 0.5, "lost": False}
    unknown = dict.fromkeys(known)
    whole = combined_summary(
        "two",
        {
            "a": flight(1, 60.0, amussels={"10": {**unknown, "services": 2}, "9": {**known, "services": 1}}),
            "b": flight(1, 80.0, amussels={"10": {**known, "services": 3}}),
        },
    )
    assert whole["amussels"] == {"9": {**known, "services": 1}, "10": {**known, "services": 5}}


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

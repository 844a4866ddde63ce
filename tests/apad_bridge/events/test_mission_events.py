"""The mission's state in the journal: its form, and that it comes back as it was."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from flying import journaled
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.mission_events import (
    ExchangePhase,
    Leg,
    MissionChanged,
    MissionEnd,
    MissionState,
    Phase,
)
from apad_bridge.events.run_events import EndReason
from apad_bridge.planning.solution import Step, StepKind

PLANS = st.lists(
    st.builds(Step, st.sampled_from(StepKind), st.integers(1, 20000), st.integers(0, 3)), max_size=5
).map(tuple)
STATE = MissionState(
    Phase.GO_COLLECT,
    2000,
    (Step(StepKind.COLLECT, 7, 0), Step(StepKind.DEPLOY, 12, 3)),
    docked=((3, 12),),
    homes=((7, 1.5, -2.0),),
    primitive_id=4,
    leg=Leg(4, (0.0, 0.0), (1.5, -2.0), (0.5, 0.25)),
    cost_m=0.5,
    planned_m=2.5,
    exchanged=((12, 7, ExchangePhase.PLANNED),),
)
LINE = {
    "phase": "go to aMussel",
    "since_ms": 2000,
    "plan": [["collect", 7, 0], ["deploy", 12, 3]],
    "dock_count": 4,
    "docked": [[3, 12]],
    "homes": [[7, 1.5, -2.0]],
    "primitive_id": 4,
    "leg": {"primitive_id": 4, "start": [0.0, 0.0], "goal": [1.5, -2.0], "counted": [0.5, 0.25]},
    "cost_m": 0.5,
    "planned_m": 2.5,
    "services": 0,
    "leaves_full": False,
    "failed_tries": [],
    "failed_undockings": [],
    "released": [],
    "exchanged": [[12, 7, "planned"]],
    "ended_by": None,
    "end_reason": None,
}


def test_a_line_has_the_whole_state() -> None:
    line = json.loads(json.dumps(MissionChanged(STATE.phase, STATE).data))
    assert line == {"phase": "go to aMussel", "snapshot": LINE} and list(line["snapshot"]) == list(LINE)
    assert MissionChanged.of(line) == MissionChanged(STATE.phase, STATE)


@given(PLANS)
def test_a_plan_outlives_the_journal(plan: tuple[Step, ...]) -> None:
    assert journaled(replace(STATE, plan=plan)).plan == plan


@pytest.mark.parametrize("row", [["fetch", 1, 0], ["collect", 1], ["collect", 1, 0, 0], ["collect", "x", 0]])
def test_a_row_that_is_no_step_is_refused(row: list[str | int]) -> None:
    with pytest.raises(ValueError):
        MissionChanged.of({"phase": "dock", "snapshot": {**LINE, "plan": [row]}})


@pytest.mark.parametrize("reason", EndReason)
def test_an_end_outlives_the_journal(reason: EndReason) -> None:
    end = MissionEnd(reason, f"{reason}: so it was")
    assert journaled(replace(STATE, ended_by=str(end), end_reason=reason)).end == end
    assert STATE.end is None

"""Why a mission ended decides the exit code, and is restored from records of any age."""

import json
from pathlib import Path

import pytest

from apad_bridge.commands.outcome import report
from apad_bridge.mission.ending import EndReason, MissionEnd
from apad_bridge.mission.state import MissionState, Phase
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit

FAILED = MissionEnd(EndReason.STRATEGY_FAILED, "failure of strategy 'x': ValueError: no")


def code_of(summary: dict[str, object]) -> int:
    return report("a", "greedy", RunDirectory(Path("run")), summary, as_json=True)


def summary_of(end: MissionEnd) -> dict[str, object]:
    return {"ended_by": str(end), "end_reason": end.reason.value}


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (MissionEnd(EndReason.MISSION_TIME), Exit.DONE),
        (MissionEnd(EndReason.OPERATOR), Exit.INTERRUPTED),
        (FAILED, Exit.PEER_FAILED),
        (MissionEnd(EndReason.SCRIPT_FAILED, "failure of the script: x"), Exit.PEER_FAILED),
        # The words are the script's own, and decide nothing.
        (MissionEnd(EndReason.SCRIPT_ABORTED, "the operator"), Exit.DONE),
        (MissionEnd(EndReason.SCRIPT_ABORTED, "failure of strategy"), Exit.DONE),
    ],
)
def test_the_reason_decides_the_exit_code_and_not_its_text(
    end: MissionEnd, code: Exit, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of(summary_of(end)) is code


@pytest.mark.parametrize("reason", EndReason)
def test_an_end_outlives_the_journal(reason: EndReason) -> None:
    state = MissionState(phase=Phase.ENDED, ended_by=MissionEnd(reason, f"{reason}: so it was"))
    assert MissionState.from_json(json.loads(json.dumps(state.to_json()))) == state
    assert MissionState.from_json(MissionState().to_json()).ended_by is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [*((it.value, it) for it in EndReason), (FAILED.text, FAILED.reason), ("seen enough", "the script")],
)
def test_an_end_of_an_older_version_is_known_by_its_text(text: str, reason: str) -> None:
    data = MissionState().to_json() | {"ended_by": text}
    del data["end_reason"]
    end = MissionState.from_json(data).ended_by
    assert (end is not None and end.reason, str(end)) == (reason, text)

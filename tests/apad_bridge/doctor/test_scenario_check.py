"""The doctor's check of a scenario."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from scenario_files import POOL_FILE

from apad_bridge.doctor import scenario_check
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.planning.registry import Trust

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"


@pytest.mark.parametrize("name", ["pool-12", "bay-24", "bay-120", "no-charging", "demo"])
def test_the_shipped_ones_are_fine(name: str) -> None:
    scenario, findings = scenario_check.read(SCENARIOS / f"{name}.yaml")
    assert scenario is not None and scenario.name == name
    assert {finding.status for finding in findings} == {CheckStatus.OK}
    assert [finding.check for finding in findings] == ["scenario", "starts", "codec"]


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = POOL_FILE.read_text().replace("pool.csv", str(POOL_FILE.with_name("pool.csv")))
    assert old in text
    path = tmp_path / "changed.yaml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "check", "told"),
    [
        ("  batch: 4", "  batsch: 4", "scenario", ["mission.batsch"]),
        ("count: 12", "count: 13", "starts", []),
        ("report_period_s: 1}", "report_period_s: 1, codec: ours-9}", "codec", ["ours-9", "musselbed-1"]),
    ],
    ids=["a wrong key is named with its path", "more aMussels than starts", "a codec that nobody brings"],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, check: str, told: list[str]) -> None:
    scenario, findings = scenario_check.read(changed(tmp_path, old, new))
    assert (scenario is None) is (check == "scenario")
    failed = [it for it in findings if it.status is CheckStatus.FAIL]
    assert {it.check for it in failed} == {check}
    assert all(any(words in it.found for it in failed) for words in told)


def test_a_strategy_in_a_file_is_left_out_and_told_and_the_others_are_checked(tmp_path: Path) -> None:
    marks = tmp_path / "executed"
    (tmp_path / "mine.py").write_text(
        f"open({str(marks)!r}, 'w').close()\n"
        "from apad_bridge.planning.strategies.paper_strategies import Greedy as Mine\n"
    )
    path = changed(tmp_path, "collection: cautious", "collection: mine.py:Mine")
    scenario, findings = scenario_check.read(path)
    assert scenario is not None and not marks.exists()
    (told,) = [it for it in findings if it.status is CheckStatus.WARN]
    assert (
        "mission.collection was left out: strategy mine.py:Mine is code in a file: add --trust" in told.found
    )
    path.write_text(path.read_text().replace("greedy-redeploy", "home"))
    _, findings = scenario_check.read(path)
    assert next(it.found for it in findings if it.status is CheckStatus.FAIL).startswith(
        "mission.redeployment: unknown strategy 'home'"
    )
    assert not marks.exists()
    scenario_check.read(path, Trust())
    assert marks.exists()


def test_aMussels_in_and_behind_a_keep_out_zone_are_named_with_the_place(tmp_path: Path) -> None:
    """The aPad starts at (2, 2). By hand: the way to (12, 12) meets the zone of 6 to 8 m at (6, 6)."""
    (tmp_path / "starts.csv").write_text("id,north,east,charge\n1,7,7,0.9\n2,12,12,0.9\n3,2,12,0.9\n")
    data = yaml.safe_load(POOL_FILE.read_text())
    data["area"]["fence"] = [[-2, -2], [30, -2], [30, 23], [-2, 23]]
    data["area"]["keep_out"] = [[[6, 6], [8, 6], [8, 8], [6, 8]]]
    data["fleet"].update(count=3, start="starts.csv")
    data["apad"]["start_m"] = [2, 2]
    path = tmp_path / "yacht.yaml"
    path.write_text(yaml.safe_dump(data))
    _, findings = scenario_check.read(path)
    warned = [it.found for it in findings if it.status is CheckStatus.WARN]
    assert warned == [
        "aMussel 1 cannot be served: (7.0 m north, 7.0 m east) lies in a keep-out zone",
        "aMussel 2 is out of the aPad's reach from its start: the way crosses a keep-out zone at "
        "(6.0 m north, 6.0 m east), and the aPad goes straight",
    ]
    # Another aPad reaches what lies behind the zone for the first one.
    data["apads"] = [{"name": "apad2", "start_m": [20, 12]}]
    path.write_text(yaml.safe_dump(data))
    _, findings = scenario_check.read(path)
    assert [it.found for it in findings if it.status is CheckStatus.WARN] == warned[:1]

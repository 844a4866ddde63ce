"""A scenario with several aPads, divided and flown in virtual time, one by one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import lines_in
from scenario_files import POOL_FILE

from apad_bridge.assembly.division import members, with_apad
from apad_bridge.commands.main import main
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve, with_overrides
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"


@pytest.fixture(scope="module")
def bay() -> Scenario:
    return load(SCENARIOS / "bay-120.yaml")


def test_five_aPads_serve_twenty_four_each(bay: Scenario) -> None:
    starts = starts_of(bay)
    fleet_members = members(bay, starts)
    assert [member.name for member in fleet_members] == ["apad1", "apad2", "apad3", "apad4", "apad5"]
    assert [len(member.starts) for member in fleet_members] == [24] * 5
    assert {start for member in fleet_members for start in member.starts} == set(starts)
    for member in fleet_members:
        # A member's scenario alone, as its supervisor has it, gives the same aMussels at the same places.
        assert starts_of(member.scenario) == member.starts
        assert from_data(resolve(member.scenario), "again") == member.scenario
        assert member.scenario.apad.name == member.name and member.scenario.apads == ()


def test_in_water_each_has_its_turn_to_send(bay: Scenario) -> None:
    data = small(bay)
    data["water"] = {}
    by_sound = from_data(data, "by sound")
    each = members(by_sound, starts_of(by_sound))
    turns = [it.scenario.water.talk.turn for it in each if it.scenario.water is not None]
    assert turns == [(1, 2), (2, 2)]


def test_one_that_stands_in_another_namespace_has_files_of_a_plain_name() -> None:
    data = resolve(load(POOL_FILE))
    data["apad"]["name"] = "/lab/boat"
    alone = with_apad(from_data(data, "far"), "/lab/boat")
    assert (alone.name, alone.apad.name) == ("pool-lab_boat", "/lab/boat")


def small(bay: Scenario) -> dict[str, Any]:
    data = resolve(with_overrides(bay, agents=8))
    data.update(name="small", duration_s=1200)
    data["apads"] = data["apads"][3:]
    data["fleet"]["hosting"] = "one_process"
    data["mission"]["batch"] = 2
    return data


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"apads": [{"name": "apad1", "start_m": [0, 0]}]}, "names must differ"),
        ({"apads": [{"name": f"b{n}", "start_m": [0, 0]} for n in range(8)]}, "9 aPads have no work with 8"),
        ({"apads": [{"name": "b", "start_m": [0, 0], "speed": 1}]}, r"apads\[0\].speed: unknown key"),
        ({"apads": [{"name": "b", "start_m": [0, 0], "fault": "hangs"}]}, "of another generation"),
        ({"apad": {"name": "/apad1"}}, r"apad\.name: with `apads` it is a plain name"),
        # A share is of the fleet.
        *(({"apads": [], "fleet": {"share": it}}, "share") for it in ([3, 2], [2, 2], [9], [0])),
        # In water each has its turn to send.
        ({"water": {"talk": {"turn": [3, 2]}}}, "there is no part 3 of 2"),
    ],
)
def test_what_several_aPads_cannot_be(bay: Scenario, change: dict[str, Any], message: str) -> None:
    data = small(bay)
    for key, value in change.items():
        data[key] = {**(data[key] or {}), **value} if isinstance(value, dict) else value
    with pytest.raises(ScenarioError, match=message):
        from_data(data, "changed")


def test_a_run_of_several_is_the_runs_of_each(
    bay: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, run = tmp_path / "small.yaml", tmp_path / "run"
    path.write_text(yaml.safe_dump(small(bay)))
    assert main(["run", str(path), "--time", "asap", "--out", str(run), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    each = {name: json.loads((run / name / "summary.json").read_text()) for name in ("apad1", "apad5")}
    assert summary["apads"] == each

    alone = {name: fly_in_memory(load(run / name / "scenario.yaml"))[0] for name in each}
    for name, figures in alone.items():
        figures.pop("samples_taken")  # None in a run whose boards take no samples
        assert {key: each[name][key] for key in figures} == figures
    assert summary["services"] == sum(it["services"] for it in alone.values()) > 0
    for key in ("cost_m", "planned_m"):
        assert summary[key] == pytest.approx(sum(it[key] for it in alone.values())), key
    # The shares are equal: the mean over aMussels is the mean of the two means.
    means = [it["uptime_paper"]["mean"] for it in alone.values()]
    assert summary["uptime_paper"]["mean"] == pytest.approx(sum(means) / 2)
    assert summary["uptime_paper"]["min"] == min(it["uptime_paper"]["min"] for it in alone.values())
    assert summary["ended_by"] == "mission time"

    # A supervisor belongs to one aPad; a replay page shows all.
    assert main(["resume", str(run)]) == 2
    assert f"one for each: {run}/apad1, {run}/apad5" in capsys.readouterr().err
    assert main(["replay", str(run)]) == 0

    # Another run can begin at the ends of all of them.
    data = small(bay)
    data["fleet"]["start"] = str(run)
    ended = {start.agent_id: start.primary for start in starts_of(from_data(data, "again"))}
    assert list(ended) == list(range(1, 9))
    assert ended != {start.agent_id: start.primary for start in starts_of(load(path))}


def test_a_run_in_which_one_fails_counts_each_aMussel_once(
    bay: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small(bay)
    data["apads"][0]["battery_start_fraction"] = 0.005
    path, run = tmp_path / "small.yaml", tmp_path / "run"
    path.write_text(yaml.safe_dump(data))
    assert main(["run", str(path), "--time", "asap", "--out", str(run), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["counted_s"] == 8 * 1200 and summary["ended_by"] == "mission time"
    journals = {name: lines_in(run / name / "journal.jsonl") for name in ("apad1", "apad5")}
    took, handed = (
        [line["id"] for line in journals[name] if line["kind"] == kind]
        for name, kind in (("apad1", "took_on"), ("apad5", "handed_on"))
    )
    assert took == handed and summary["handed_on"] == len(took) > 0
    truths = {name: {line["id"] for line in it if line["kind"] == "truth"} for name, it in journals.items()}
    assert truths["apad1"] | truths["apad5"] == set(range(1, 9)) and not truths["apad1"] & truths["apad5"]
    ends = (run / "ends.csv").read_text().splitlines()[1:]
    assert [line.split(",")[0] for line in ends] == list("12345678")
    # The page shows the one aPad's docks, also with aMussels that another aPad serves.
    assert main(["replay", str(run / "apad1")]) == 0


def test_a_dry_run_says_who_serves_whom(
    bay: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(small(bay)))
    assert main(["run", str(path), "--dry-run", "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert sorted(output["apad1"]["serves"] + output["apad5"]["serves"]) == list(range(1, 9))
    for name in ("apad1", "apad5"):
        assert {step["agent"] for step in output[name]["plan"]["steps"]} <= set(output[name]["serves"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fleet", "SCENARIO", "--time", "wall"], "`musselbed run` flies them"),
        (["mission", "SCENARIO", "--time", "wall"], "`musselbed run` flies them"),
        (["run", "SCENARIO", "--dry-run", "--apad", "ros"], "leave out --apad ros"),
        (["script", "FILE", "--scenario", "SCENARIO", "--time", "asap"], "a script flies one aPad"),
        (["run", "BY_SOUND", "--open-modem", "1"], "opens a modem beside one aPad"),
        (["run", "AGREEING", "--time", "wall"], "aPads agree in virtual time alone: add --time asap"),
    ],
)
def test_what_is_for_one_aPad_says_so(
    bay: Scenario, tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    further = {"SCENARIO": {}, "BY_SOUND": {"water": {}}, "AGREEING": {"sharing": {"consensus": {}}}}
    for name, change in further.items():
        (tmp_path / name).write_text(yaml.safe_dump({**small(bay), **change}))
    (tmp_path / "FILE").write_text("pass\n")
    paths = [str(tmp_path / word) if word.replace("_", "").isupper() else word for word in words]
    assert main(paths) == 2
    complaint = capsys.readouterr().err
    assert message in complaint and complaint.count("\n") == 1

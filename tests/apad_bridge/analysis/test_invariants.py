"""The rules of every run: they hold in runs of all kinds, and each is broken by a line that breaks it."""

from __future__ import annotations

import copy
import json
import math
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import journal_of, lines_in
from scenario_files import POOL_FILE

from apad_bridge.analysis.invariants import Invariants, check_run
from apad_bridge.commands.main import main
from apad_bridge.mission.facts import SampleSource
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.loader import load

Lines = list[dict[str, Any]]
ENERGY = "energy is neither made nor lost"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rules") / "run"
    command = ["run", str(POOL_FILE), "--time", "asap", "--hosting", "one_process", "--out", str(out)]
    assert main([*command, "--check"]) == 0
    return out


@pytest.fixture(scope="module")
def journal(run: Path) -> Lines:
    return lines_in(run / "journal.jsonl")


def checked(lines: Lines, scenario: Path = POOL_FILE) -> tuple[Invariants, set[str]]:
    """What has seen these lines, and the rules that they break."""
    checker = Invariants(load(scenario))
    return checker, {it.rule for entry in journal_of(lines).entries for it in checker.take(entry)}


def rules_broken_in(lines: Lines, summary: dict[str, Any]) -> set[str]:
    checker, broken = checked(lines)
    return broken | {it.rule for it in checker.end(summary, {})}


def of_kind(lines: Lines, kind: str, **wanted: Any) -> list[int]:
    return [n for n, line in enumerate(lines) if line["kind"] == kind and line | wanted == line]


def one_grain_more(line: dict[str, Any]) -> dict[str, Any]:
    anchor_ms, charge, *rest = line["primary"]
    return line | {"primary": [anchor_ms, charge + 1, *rest]}


def opened_before(line: dict[str, Any], lines: Lines) -> Lines:
    """The line of the aMussel's last stimulus before it, made one of a dock that opens."""
    stimuli = [lines[n] for n in of_kind(lines, "stimulus", id=line["id"]) if lines[n]["t"] <= line["t"]]
    return [stimuli[-1] | {"wire": [2]}, line]


Breaks = Callable[[dict[str, Any], Lines], Lines]
BREAKS: dict[str, tuple[str, str, dict[str, Any], int, Breaks]] = {
    "a battery gains a grain": (ENERGY, "truth", {"id": 1}, 1, lambda it, _: [one_grain_more(it)]),
    "fuller than full": (
        "a charge lies in 0 to 1",
        "truth",
        {"id": 1},
        0,
        lambda it, _: [it | {"secondary": [it["secondary"][0], 6 * 10**14 + 1, *it["secondary"][2:]]}],
    ),
    "back in agent time": (
        "time never falls",
        "truth",
        {"id": 1},
        1,
        lambda it, _: [it | {"agent_ms": -1}],
    ),
    "a line from the past": ("time never falls", "end", {}, -1, lambda it, _: [it | {"t": 0}]),
    "in two docks": (
        "an aMussel is in one dock",
        "dock",
        {"closed": True},
        0,
        lambda it, _: [it, it | {"dock": it["dock"] + 1}],
    ),
    "two in a dock": (
        "a dock holds one aMussel",
        "dock",
        {"closed": True},
        0,
        lambda it, _: [it, it | {"agent": it["agent"] % 12 + 1}],
    ),
    "held twice": (
        "an aMussel is in one dock",
        "apad",
        {},
        -1,
        lambda it, _: [it | {"docks": [3, 3, -1, -1]}],
    ),
    "docked far away": (
        "a docked aMussel is at the aPad",
        "truth",
        {"docked": True},
        0,
        lambda it, _: [it | {"north_um": it["north_um"] + 50_000_000}],
    ),
    "docked in an open dock": (
        "a dock that closed holds the aMussel",
        "truth",
        {"docked": True},
        -1,
        opened_before,
    ),
    "a stranger": ("every aMussel is of the fleet", "truth", {}, -1, lambda it, _: [it | {"id": 99}]),
    "two of an id": (
        "ids are unique",
        "run",
        {},
        0,
        lambda it, _: [it | {"agents": [*it["agents"], it["agents"][0]]}],
    ),
    "a belief of NaN": ("a belief is finite", "belief", {}, 5, lambda it, _: [it | {"charge": math.nan}]),
    "heard before it was sent": (
        "a packet is older than the belief of it",
        "belief",
        {},
        5,
        lambda it, _: [it | {"heard": it["t"] + 1}],
    ),
    "an interval the wrong way": (
        "an interval has an order",
        "belief",
        {},
        5,
        lambda it, _: [it | {"low": 0.9, "high": 0.8}],
    ),
    "a forgetful log": (
        "a log forgets nothing",
        "truth",
        {"id": 1},
        0,
        lambda it, _: [it | {"log": [10, 5]}, it | {"log": [9, 5]}],
    ),
    "acknowledged before it was taken": (
        "a sample is taken before it is acknowledged",
        "truth",
        {"id": 1},
        -1,
        lambda it, _: [it | {"log": [3, 4]}],
    ),
}
"""The rule, which line breaks it (its kind, fields and number), and the lines that come in its place."""


@pytest.mark.parametrize("name", BREAKS)
def test_a_broken_rule_is_found(journal: Lines, name: str) -> None:
    rule, kind, wanted, number, breaks = BREAKS[name]
    at = of_kind(journal, kind, **wanted)[number]
    assert rule in checked([*journal[:at], *breaks(journal[at], journal), *journal[at + 1 :]])[1]


def test_the_cost_is_the_way_driven(run: Path, journal: Lines) -> None:
    summary = json.loads((run / "summary.json").read_text())
    for changed, broken in (
        ({}, set()),
        ({"cost_m": 1.2 * summary["cost_m"]}, {"the cost is the way driven"}),
        ({"planned_m": 1.2 * summary["planned_m"]}, {"the planned way is that of the legs"}),
    ):
        assert rules_broken_in(journal, summary | changed) == broken


@pytest.mark.parametrize(
    ("kept", "broken"),
    [
        ({0: 1, 1: 1, 2: 1}, []),
        ({1: 2}, ["a sample is kept once"]),
        ({3: 1}, ["a sample is taken before it is kept"]),
    ],
)
def test_a_sample_is_kept_once_and_was_taken(
    journal: Lines, run: Path, kept: dict[int, int], broken: list[str]
) -> None:
    last = of_kind(journal, "truth", id=1)[-1]
    checker, _ = checked([*journal[:last], journal[last] | {"log": [3, 1]}, *journal[last + 1 :]])
    summary = json.loads((run / "summary.json").read_text())
    assert [
        it.rule
        for it in checker.end(
            summary, {SampleSource(1): Counter(kept), SampleSource(1, 60_000): Counter(range(9))}
        )
    ] == broken


def flown(folder: Path, source: Path, **changes: Any) -> Path:
    """The run of a scenario in one process, with some blocks of it changed."""
    data = yaml.safe_load(source.read_text())
    data["fleet"]["start"] = str(source.parent / data["fleet"]["start"])
    scenario, out = folder / source.name, folder / "run"
    scenario.write_text(yaml.safe_dump(data | changes))
    command = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(out)]
    assert main(command) == 0
    return out


@pytest.fixture(scope="module")
def sound_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Whole boards that sample and speak through the water."""
    source = Path(__file__).parents[3] / "launch_scripts/scenarios/sound-12.yaml"
    return flown(tmp_path_factory.mktemp("sound"), source, duration_s=600)


def test_a_whole_board_in_sound_obeys_them(sound_run: Path) -> None:
    assert any(line["kind"] == "packet" for line in lines_in(sound_run / "journal.jsonl"))
    assert check_run(RunDirectory.open(sound_run)) == []


@pytest.mark.parametrize(
    ("resumes", "vanished", "broken"),
    [(True, 0, set()), (False, 0, {ENERGY}), (True, 5 * 10**13, {ENERGY})],
    ids=["killed in the tick of a transmission", "not killed", "killed, and a leak beside"],
)
def test_a_kill_loses_the_truths_of_a_tick_and_not_more(
    sound_run: Path, resumes: bool, vanished: int, broken: set[str]
) -> None:
    """A transmission of a second took charge, and its line was not on disk yet."""
    lines = copy.deepcopy(lines_in(sound_run / "journal.jsonl"))
    lost = of_kind(lines, "truth", id=3, state="TRANSMITTING")[0]
    after = next(n for n in of_kind(lines, "truth", id=3) if n > lost)
    lines[after]["primary"][1] -= vanished
    resumed = {"t": lines[lost]["t"], "kind": "resumed", "journal_dropped": 0, "journal_torn_bytes": 0}
    lines[lost : lost + 1] = [resumed | {"bag_repaired": None, "bag_lost_ms": 0}] if resumes else []
    until = [line for line in lines if line["t"] <= lines[after]["t"]]
    assert checked(until, sound_run / "scenario.yaml")[1] == broken


@pytest.fixture(scope="module")
def motor_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pool whose motor runs cost a hundredth of a battery each, with resets and leaks among them."""
    board = yaml.safe_load(POOL_FILE.read_text())["board"] | {"motor_run_charge": 0.01}
    mix = {"seed": 5, "count": 40, "of": ["brown_out", "battery_loss", "battery_ageing"]}
    folder = tmp_path_factory.mktemp("motors")
    return flown(folder, POOL_FILE, board=board, duration_s=1200, faults={"mix": mix})


def test_motor_runs_that_cost_charge_obey_them_and_one_that_costs_nothing_does_not(motor_run: Path) -> None:
    assert check_run(RunDirectory.open(motor_run)) == []
    lines = copy.deepcopy(lines_in(motor_run / "journal.jsonl"))
    surfacing = lines[of_kind(lines, "truth", state="SURFACING")[0]]
    surfacing["primary"][1] += 6 * 10**12
    until = lines[: lines.index(surfacing) + 1]
    assert checked(until, motor_run / "scenario.yaml")[1] == {ENERGY}


def test_the_command_shows_the_lines_that_break_a_law(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = Path(shutil.copytree(run, tmp_path / "broken"))
    lines = lines_in(run / "journal.jsonl")
    second = of_kind(lines, "truth", id=1)[1]
    lines[second] = one_grain_more(lines[second])
    (broken / "journal.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    capsys.readouterr()
    assert main(["check", str(run), str(broken)]) == 1
    shown = capsys.readouterr().out
    assert f"{run}: all rules hold" in shown and f"{ENERGY}: aMussel 1, primary" in shown
    assert main(["check", str(broken), "--json"]) == 1
    ((found, *_),) = json.loads(capsys.readouterr().out).values()
    assert found["lines"][-1]["kind"] == "truth"
    # The runs below it, and none.
    assert [main(["check", str(it)]) for it in (tmp_path, tmp_path / "nothing")] == [1, 2]

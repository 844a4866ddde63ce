"""The rules of every run: they hold in runs of all kinds, and each is broken by a line that breaks it."""

from __future__ import annotations

import copy
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import journal_of, lines_in
from scenario_files import POOL_FILE

from apad_bridge.analysis.invariants import Broken, Invariants, check_run
from apad_bridge.commands.main import main
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


def rules_broken_in(lines: Lines, summary: dict[str, Any] | None = None) -> set[str]:
    checker = Invariants(load(POOL_FILE))
    broken: list[Broken] = [it for entry in journal_of(lines).entries for it in checker.take(entry)]
    if summary is not None:
        broken += checker.end(summary, {})
    return {it.rule for it in broken}


def of_kind(lines: Lines, kind: str, **wanted: Any) -> list[int]:
    return [
        n
        for n, line in enumerate(lines)
        if line["kind"] == kind and all(line[name] == value for name, value in wanted.items())
    ]


def energy_from_nowhere(lines: Lines) -> None:
    """The first aMussel's battery gains a grain between two truths."""
    second = of_kind(lines, "truth", id=1)[1]
    lines[second]["primary"][1] += 1


def full_beyond_full(lines: Lines) -> None:
    lines[of_kind(lines, "truth", id=1)[0]]["secondary"][1] = 6 * 10**14 + 1


def back_in_time(lines: Lines) -> None:
    lines[of_kind(lines, "truth", id=1)[1]]["agent_ms"] = -1


def a_line_from_the_past(lines: Lines) -> None:
    lines[-1]["t"] = 0


def two_docks(lines: Lines) -> None:
    closed = lines[of_kind(lines, "dock", closed=True)[0]]
    lines.insert(lines.index(closed) + 1, closed | {"dock": closed["dock"] + 1})


def two_in_a_dock(lines: Lines) -> None:
    closed = lines[of_kind(lines, "dock", closed=True)[0]]
    lines.insert(lines.index(closed) + 1, closed | {"agent": closed["agent"] % 12 + 1})


def held_twice(lines: Lines) -> None:
    lines[of_kind(lines, "apad")[-1]]["docks"] = [3, 3, -1, -1]


def docked_far_away(lines: Lines) -> None:
    lines[of_kind(lines, "truth", docked=True)[0]]["north_um"] += 50_000_000


def docked_in_an_open_dock(lines: Lines) -> None:
    docked = lines[of_kind(lines, "truth", docked=True)[-1]]
    stimuli = [n for n in of_kind(lines, "stimulus", id=docked["id"]) if lines[n]["t"] <= docked["t"]]
    opened = lines[stimuli[-1]] | {"wire": [2]}
    lines.insert(lines.index(docked), opened)


def a_stranger(lines: Lines) -> None:
    lines[of_kind(lines, "truth")[-1]]["id"] = 99


def two_of_an_id(lines: Lines) -> None:
    lines[0]["agents"].append(lines[0]["agents"][0])


def a_belief_of_nan(lines: Lines) -> None:
    lines[of_kind(lines, "belief")[5]]["charge"] = float("nan")


def heard_before_it_was_sent(lines: Lines) -> None:
    belief = lines[of_kind(lines, "belief")[5]]
    belief["heard"] = belief["t"] + 1


def an_interval_the_wrong_way(lines: Lines) -> None:
    lines[of_kind(lines, "belief")[5]] |= {"low": 0.9, "high": 0.8}


def a_forgetful_log(lines: Lines) -> None:
    first, second = of_kind(lines, "truth", id=1)[:2]
    lines[first]["log"], lines[second]["log"] = [10, 5], [9, 5]


def acknowledged_before_it_was_taken(lines: Lines) -> None:
    lines[of_kind(lines, "truth", id=1)[-1]]["log"] = [3, 4]


@pytest.mark.parametrize(
    ("breaks", "rule"),
    [
        (energy_from_nowhere, ENERGY),
        (full_beyond_full, "a charge lies in 0 to 1"),
        (back_in_time, "time never falls"),
        (a_line_from_the_past, "time never falls"),
        (two_docks, "an aMussel is in one dock"),
        (two_in_a_dock, "a dock holds one aMussel"),
        (held_twice, "an aMussel is in one dock"),
        (docked_far_away, "a docked aMussel is at the aPad"),
        (docked_in_an_open_dock, "a dock that closed holds the aMussel"),
        (a_stranger, "every aMussel is of the fleet"),
        (two_of_an_id, "ids are unique"),
        (a_belief_of_nan, "a belief is finite"),
        (heard_before_it_was_sent, "a packet is older than the belief of it"),
        (an_interval_the_wrong_way, "an interval has an order"),
        (a_forgetful_log, "a log forgets nothing"),
        (acknowledged_before_it_was_taken, "a sample is taken before it is acknowledged"),
    ],
)
def test_a_broken_rule_is_found(journal: Lines, breaks: Callable[[Lines], None], rule: str) -> None:
    assert rules_broken_in(journal) == set()
    lines = copy.deepcopy(journal)
    breaks(lines)
    assert rule in rules_broken_in(lines)


def test_the_cost_is_the_way_driven(run: Path, journal: Lines) -> None:
    summary = json.loads((run / "summary.json").read_text())
    assert rules_broken_in(journal, summary) == set()
    assert rules_broken_in(journal, summary | {"cost_m": 1.2 * summary["cost_m"]}) == {
        "the cost is the way driven"
    }
    dearer = summary | {"planned_m": 1.2 * summary["planned_m"]}
    assert rules_broken_in(journal, dearer) == {"the planned way is that of the legs"}


def test_a_sample_is_kept_once_and_was_taken(journal: Lines, run: Path) -> None:
    checker = Invariants(load(POOL_FILE))
    lines = copy.deepcopy(journal)
    lines[of_kind(lines, "truth", id=1)[-1]]["log"] = [3, 1]
    for entry in journal_of(lines).entries:
        checker.take(entry)
    summary = json.loads((run / "summary.json").read_text())
    assert checker.end(summary, {1: Counter({0: 1, 1: 1, 2: 1})}) == []
    assert [it.rule for it in checker.end(summary, {1: Counter({1: 2})})] == ["a sample is kept once"]
    assert [it.rule for it in checker.end(summary, {1: Counter({3: 1})})] == [
        "a sample is taken before it is kept"
    ]


@pytest.fixture(scope="module")
def sound_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Whole boards that sample and speak through the water."""
    folder = tmp_path_factory.mktemp("sound")
    scenarios = Path(__file__).parents[3] / "launch_scripts/scenarios"
    data = yaml.safe_load((scenarios / "sound-12.yaml").read_text())
    data["fleet"]["start"] = str(scenarios / data["fleet"]["start"])
    scenario, out = folder / "sound.yaml", folder / "run"
    scenario.write_text(yaml.safe_dump(data | {"duration_s": 600}))
    command = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(out)]
    assert main(command) == 0
    return out


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
    checker = Invariants(load(sound_run / "scenario.yaml"))
    until = journal_of([line for line in lines if line["t"] <= lines[after]["t"]])
    assert {it.rule for entry in until.entries for it in checker.take(entry)} == broken


@pytest.fixture(scope="module")
def motor_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pool whose motor runs cost a hundredth of a battery each, with resets and leaks among them."""
    folder = tmp_path_factory.mktemp("motors")
    data = yaml.safe_load(POOL_FILE.read_text())
    data["fleet"]["start"] = str(POOL_FILE.parent / data["fleet"]["start"])
    data["board"]["motor_run_charge"] = 0.01
    data |= {
        "duration_s": 1200,
        "faults": {"mix": {"seed": 5, "count": 40, "of": ["brown_out", "battery_loss", "battery_ageing"]}},
    }
    scenario, out = folder / "motors.yaml", folder / "run"
    scenario.write_text(yaml.safe_dump(data))
    command = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(out)]
    assert main(command) == 0
    return out


def test_motor_runs_that_cost_charge_obey_them(motor_run: Path) -> None:
    assert check_run(RunDirectory.open(motor_run)) == []


def test_a_motor_run_that_costs_nothing_breaks_the_rule_of_energy(motor_run: Path) -> None:
    lines = copy.deepcopy(lines_in(motor_run / "journal.jsonl"))
    surfacing = lines[of_kind(lines, "truth", state="SURFACING")[0]]
    surfacing["primary"][1] += 6 * 10**12
    checker = Invariants(load(motor_run / "scenario.yaml"))
    until = journal_of(lines[: lines.index(surfacing) + 1])
    broken = [it for entry in until.entries for it in checker.take(entry)]
    assert {it.rule for it in broken} == {ENERGY}


def test_the_command_shows_the_lines_that_break_a_law(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    for file in ("scenario.yaml", "summary.json"):
        (broken / file).write_bytes((run / file).read_bytes())
    lines = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
    energy_from_nowhere(lines)
    (broken / "journal.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    capsys.readouterr()
    assert main(["check", str(run), str(broken)]) == 1
    shown = capsys.readouterr().out
    assert (
        f"{run}: all rules hold" in shown and "energy is neither made nor lost: aMussel 1, primary" in shown
    )
    assert main(["check", str(broken), "--json"]) == 1
    ((found, *_),) = json.loads(capsys.readouterr().out).values()
    assert found["lines"][-1]["kind"] == "truth"
    assert main(["check", str(tmp_path)]) == 1  # the runs below it
    assert main(["check", str(tmp_path / "nothing")]) == 2

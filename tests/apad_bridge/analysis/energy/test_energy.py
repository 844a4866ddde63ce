"""The energy of a run's boards, against the batteries that the run recorded."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from math import fsum

import pytest
import yaml
from journals import lines_in
from scenario_files import POOL_FILE

from apad_bridge.analysis.energy.energy import BOARD, MOTORS, energy_of, summed
from apad_bridge.commands.main import main
from apad_bridge.records.run_directory import RunDirectory


def test_the_second_run_goes_the_way_of_the_first(pool_run, whole_run):
    """One that nothing reaches drew what its battery lost, by its first truth; no board rests on its backup here."""
    for run in (pool_run, whole_run):
        lines, found = lines_in(run.journal), energy_of(run)
        assert [(it.agent_id, it.is_exact) for it in found] == [(n, True) for n in range(1, 13)]
        reached = {line["id"] for line in lines if line["kind"] == "stimulus"}
        first = {line["id"]: line["primary"][1] / 6e14 for line in reversed(lines) if line["kind"] == "truth"}
        summary = json.loads(run.summary.read_text())["amussels"]
        assert 0 < len(reached) < 12
        for energy in found:
            its = [sum(it.values()) for it in (energy.by_module, energy.by_state, energy.state_hours)]
            assert its[1:] == pytest.approx([its[0], 600 * 30 / 3600])
            lost = first[energy.agent_id] - summary[str(energy.agent_id)]["final_charge"]
            assert energy.agent_id in reached or its[0] == pytest.approx(lost, abs=1e-6)


def test_modules_are_those_of_the_board(pool_run, whole_run):
    assert energy_of(pool_run, (3,))[0].by_module.keys() == {BOARD}
    modules = summed(energy_of(whole_run), lambda it: it.by_module)
    assert {"mu_active", "pi", "wifi", "motors"} <= modules.keys()
    assert list(modules.values()) == sorted(modules.values(), reverse=True)


def test_runs_of_the_motors_are_a_module_of_the_worst_case(tmp_path):
    """Nothing charges here, so all that the batteries lost was drawn; each way up or down costs a hundredth."""
    data = yaml.safe_load(POOL_FILE.read_text())
    data["board"]["motor_run_charge"], data["apad"]["dock_miss_probability"] = 0.01, 1.0
    data["fleet"]["start"], data["duration_s"] = str(POOL_FILE.parent / data["fleet"]["start"]), 900
    scenario, run = tmp_path / "motors.yaml", RunDirectory(tmp_path / "run")
    scenario.write_text(yaml.safe_dump(data))
    command = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(run.path)]
    assert main(command) == 0
    lines, found = lines_in(run.journal), energy_of(run)
    assert all(it.is_exact for it in found)
    entered, before = Counter(), {}
    for agent_id, state in ((it["id"], it["state"]) for it in lines if it["kind"] == "truth"):
        entered[agent_id] += state in ("SURFACING", "SINKING") and before.get(agent_id) != state
        before[agent_id] = state
    summary = json.loads(run.summary.read_text())["amussels"]
    starts = {it["id"]: it["primary"] for it in lines[0]["agents"]}
    assert sum(entered.values()) > 4
    for energy in found:
        lost = starts[energy.agent_id] - summary[str(energy.agent_id)]["final_charge"]
        sums = [sum(it.values()) for it in (energy.by_module, energy.by_state)]
        assert energy.by_module.get(MOTORS, 0) == pytest.approx(0.01 * entered[energy.agent_id])
        assert sums == pytest.approx([lost, lost], abs=1e-6)


def test_another_journal_is_told(pool_run, tmp_path, capsys):
    """Without the contact that charged it, the board goes another way than its truths say."""
    copy = RunDirectory(shutil.copytree(pool_run.path, tmp_path / "run"))
    lines = lines_in(copy.journal)
    docked = next(line["agent"] for line in lines if line["kind"] == "dock")
    kept = [line for line in lines if not (line["kind"] == "stimulus" and line["id"] == docked)]
    copy.journal.write_text("".join(f"{json.dumps(line)}\n" for line in kept))
    assert [it.agent_id for it in energy_of(copy) if not it.is_exact] == [docked]
    assert main(["mu", "energy", str(copy.path)]) == 0
    assert f"aMussels {docked} went another way" in capsys.readouterr().err


def test_the_command(pool_run, whole_run, capsys):
    assert main(["mu", "energy", str(whole_run.path), "--agent", "2", "--json"]) == 0
    (energy,) = json.loads(capsys.readouterr().out)
    assert energy["agent_id"] == 2 and energy["by_module"]["pi"] > 0
    assert main(["mu", "energy", str(whole_run.path), "--agent", "2"]) == 0
    sums = [line.split()[3] for line in capsys.readouterr().out.splitlines() if line.startswith("│ all ")]
    assert sums == [f"{100 * fsum(energy['by_module'].values()):.3f}"] * 2
    assert main(["mu", "energy", str(pool_run.path)]) == 0
    assert "12 aMussels, by module" in capsys.readouterr().out
    assert main(["mu", "energy", str(pool_run.path), "--agent", "13"]) == 2
    assert "there is no aMussel 13; its fleet has 1 to 12" in capsys.readouterr().err

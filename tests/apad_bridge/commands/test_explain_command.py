"""`musselbed explain`, as a person types it: the plan in force at a time with its reasons, or one line with the fault."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import pytest

from apad_bridge.commands.help_text import mission_seconds
from apad_bridge.commands.look import explain
from apad_bridge.mission.policy.plan_checks import plan_event
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales
from apad_bridge.planning.explanation import Option
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategy import CollectionStrategy
from apad_bridge.records.journal import Journal
from apad_bridge.scenario.errors import UserError

AGENTS = tuple(Candidate(k, k, 2.0, 0.1 * k, 1.0, k, 2.0) for k in (1, 2, 3, 4, 5))
SITUATION = Situation(0.0, 0.0, AGENTS, (0, 1))


def command(*words: object) -> int:
    parser = argparse.ArgumentParser()
    explain.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["explain", *map(str, words)])
    return explain.run(arguments)


def run_with(directory: Path, *plans: tuple[int, object]) -> Path:
    """A run's directory whose journal has plans of strategies at mission times in ms."""
    journal = Journal(directory / "journal.jsonl")
    for at_ms, strategy in plans:
        solution = strategy.plan(SITUATION, 2)  # type: ignore[attr-defined]
        plan = plan_event("collect", "mine", solution, SITUATION, CostScales(), strategy)
        journal.append(at_ms, plan)
    journal.close()
    return directory


def test_it_prints_the_plan_in_force_with_its_runner_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, (60_000, registry.collection("cautious")), (120_000, registry.collection("greedy")))
    assert command(tmp_path, "--at", 119, "--json") == 0
    line = json.loads(capsys.readouterr().out)
    best, second, *_ = line["options"]
    assert (line["t"], best["agents"], second["agents"]) == (60_000, [1, 2], [1, 3])
    assert (best["cost"], second["parts"]) == (pytest.approx(0.3), {"charge": pytest.approx(0.4)})
    assert command(tmp_path, "--at", 119) == 0
    shown = capsys.readouterr().out
    assert "60 s: mine planned to collect 1, 2" in shown and "runner-up" in shown and "+0.100" in shown
    assert "the rule of" not in shown  # a strategy of a user's is not executed to be shown


class Silent(CollectionStrategy):
    """Gives no reasons."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        return registry.collection("greedy").plan(situation, batch)


class Broken(Silent):
    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return [Option((1,), {"way": float("nan")})]


def test_it_says_who_takes_whose_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    solution = registry.collection("cautious").plan(SITUATION, 1)
    plan = plan_event("collect", "mine", solution, SITUATION, CostScales(), exchanged=[(9, 1)])
    journal = Journal(tmp_path / "journal.jsonl")
    journal.append(60_000, plan)
    journal.close()
    assert command(tmp_path) == 0
    assert "9 takes the place of 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("strategy", "said"), [(Silent(), "no reasons given\n"), (Broken(), "its explanation failed")]
)
def test_a_strategy_without_reasons_says_so(
    strategy: Silent, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, (1000, strategy))
    assert command(tmp_path) == 0
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("plans", "words", "told"),
    [
        ([], [], "no plan was made yet"),
        ([60_000], ["--at", 59], "the first plan was made at 60 s"),
        ([60_000], ["--at", 99999], "--at 99999: the run has come to 60 s"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, plans: list[int], words: list[object], told: str) -> None:
    run_with(tmp_path, *((at_ms, registry.collection("cautious")) for at_ms in plans))
    with pytest.raises(UserError, match=told):
        command(tmp_path, *words)


@pytest.mark.parametrize("name", ["blend", "best-of-pool", "cautious", "edf", "greedy", "shortest-order"])
def test_the_plan_comes_first_and_its_options_by_rising_cost(name: str) -> None:
    strategy = registry.collection(name, CostScales(1.0, 50.0))
    plan = strategy.plan(SITUATION, 2)
    options = strategy.explain(SITUATION, plan)
    assert list(options[0].agents) == [step.agent_id for step in plan.steps]
    costs = [option.cost for option in options[1:]]
    assert costs == sorted(costs) and len(options) == 5
    if name != "greedy":
        assert options[0].cost <= costs[0]


@pytest.mark.parametrize("at", ["119", "1:59", "0:01:59", "119.0"])
def test_a_mission_time_has_one_form_for_all_commands(
    tmp_path: Path, at: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, (60_000, registry.collection("cautious")), (120_000, registry.collection("greedy")))
    assert command(tmp_path, "--at", at, "--json") == 0
    assert json.loads(capsys.readouterr().out)["t"] == 60_000
    assert mission_seconds(at) == 119.0
    for wrong in ("-1", "1:2:3:4", "nan", "10m"):
        with pytest.raises(argparse.ArgumentTypeError, match="a mission time is 14:20"):
            mission_seconds(wrong)


def test_each_strategy_of_ours_has_a_rule_in_one_sentence() -> None:
    rules = [registry.rule_of(name) for name in registry.known_names()]
    assert len(set(rules)) == len(rules)
    assert all(re.fullmatch(r"(?!Raises|Source)[A-Z].*\.", rule) for rule in rules), rules

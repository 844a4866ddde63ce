"""Strategies by name, with a real distribution on sys.path: the template's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from doc_blocks import install_template

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.registry import (
    NotTrusted,
    Trust,
    collection,
    identity,
    known_names,
    label,
    redeployment,
)
from apad_bridge.planning.strategies.paper_strategies import Greedy, GreedyRedeploy, NoCollection


def install(site: Path, distribution: str, entries: str, module: str, code: str) -> None:
    """Writes the files that pip installs: a module, and a dist-info folder with its metadata and entry points."""
    info = site / f"{distribution}-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(f"[musselbed.strategies]\n{entries}\n")
    (site / f"{module}.py").write_text(code)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("find", "name", "why"),
    [
        (collection, "gready", r"^unknown strategy 'gready'; known: .*cautious.*greedy.*none"),
        (collection, "greedy-redeploy", r"'greedy-redeploy' .* is no collect strategy"),
        (redeployment, "greedy", r"'greedy' .* is no deploy strategy"),
    ],
)
def test_what_no_built_in_one_is(find: Any, name: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        find(name)


def test_the_template_adds_a_strategy(site: Path) -> None:
    install_template(site, "strategy")
    assert "farthest" in known_names()
    agents = (
        Candidate(1, 3, 0, 0.5, 1, 3, 0),
        Candidate(2, 9, 0, 0.5, 1, 9, 0),
        Candidate(3, 6, 0, 0.5, 1, 6, 0),
    )
    plan = collection("farthest").plan(Situation(0, 0, agents, (0, 1)), batch=4)
    assert plan.steps == (("collect", 2, 0), ("collect", 3, 1))


@pytest.mark.parametrize(
    ("package", "entry_point", "code", "name", "why"),
    [
        (
            "broken_lab",
            "broken = broken_lab:Missing",
            "",
            "broken",
            r"'broken' \(from broken_lab 1.2, broken_lab:Missing\) cannot be loaded",
        ),
        (
            "odd_lab",
            "odd = odd_lab:Odd",
            "class Odd: pass\n",
            "odd",
            r"'odd' \(from odd_lab 1.2\) is no collect strategy",
        ),
        # A name that is taken is not shadowed silently.
        (
            "shadow_lab",
            "greedy = shadow_lab:Own",
            "class Own: pass\n",
            "greedy",
            r"is in each of musselbed itself, shadow_lab 1\.2",
        ),
    ],
)
def test_a_package_s_strategy_that_cannot_be_flown_is_named(
    site: Path, package: str, entry_point: str, code: str, name: str, why: str
) -> None:
    install(site, package, entry_point, package, code)
    with pytest.raises(ValueError, match=why):
        collection(name)


FILE = """\
from dataclasses import dataclass

from apad_bridge.planning.strategies.paper_strategies import Greedy, GreedyRedeploy
from apad_bridge.planning.solution import StepKind


class Mine(Greedy):
    pass


@dataclass
class Weighed(Greedy):
    weight: float = 1.0


class Odd:
    pass


class NoBatch:
    plans = StepKind.COLLECT

    def plan(self, situation):
        return None


class Asks(Greedy):
    def __init__(self, weight):
        pass


class Home(GreedyRedeploy):
    pass


class Plain:
    plans = StepKind.COLLECT

    def plan(self, situation, batch):
        return Greedy().plan(situation, batch)


class Whole(Plain):
    pre_empts = True

    def refuses(self, situation):
        return True

    def explain(self, situation, solution):
        return [solution]
"""


FILES = {
    "mine": FILE,
    "wrong": "x = 1\nclass 5:\n",
    "raises": "\n\n1 / 0\n",
    "empty": "",
    "leaves": "raise SystemExit(0)\n",
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / f"{name}.py").write_text(text)
    return tmp_path / "mine.py"


def test_a_class_of_a_file_is_a_strategy_and_a_changed_file_is_read_again(file: Path) -> None:
    name = f"{file}:Mine"
    found = [collection(f"{file}:{it}", trust=Trust()) for it in ("Mine", "Weighed")]
    assert all(isinstance(it, Greedy) for it in found)
    assert isinstance(redeployment(f"{file}:Home", Trust()), GreedyRedeploy)
    assert (label(name), label("greedy"), identity("greedy")) == ("mine.py:Mine", "greedy", "greedy")
    first = identity(name)
    file.write_text(
        FILE.replace("Mine(Greedy)", "Mine(NoCollection)").replace("Greedy,", "Greedy, NoCollection,")
    )
    assert isinstance(collection(name, trust=Trust()), NoCollection)
    assert first != identity(name) and first.startswith("mine.py:Mine ")


def test_a_strategy_that_derives_from_none_has_defaults_for_what_it_lacks(file: Path) -> None:
    situation = Situation(0, 0, (Candidate(4, 3, 0, 0.5, 1, 3, 0),), (1,))
    for name, takes_over in (("Plain", False), ("Whole", True)):
        strategy = collection(f"{file}:{name}", trust=Trust())
        solution = strategy.plan(situation, batch=1)
        assert solution.steps == (("collect", 4, 1),)
        assert (strategy.pre_empts, strategy.refuses(situation)) == (takes_over, takes_over)
        assert list(strategy.explain(situation, solution)) == [solution] * takes_over


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gone.py:Mine", r"strategy gone.py:Mine: .*/gone.py: No such file or directory"),
        ("mine.py:Mnie", "strategy mine.py:Mnie has no class Mnie: did you mean mine.py:Mine"),
        ("mine.py", "strategy mine.py names no class of its file: did you mean mine.py:Mine"),
        (
            "mine.py:Odd",
            r"strategy mine.py:Odd is no collect strategy: it needs `plans = StepKind.COLLECT` and a method "
            r"`plan\(self, situation, batch\)`",
        ),
        ("mine.py:NoBatch", r"it needs a method `plan\(self, situation, batch\)`"),
        ("mine.py:Home", r"it needs `plans = StepKind.COLLECT` and a method"),
        ("mine.py:Asks", "cannot be made without arguments: TypeError: .*weight"),
        ("wrong.py:Mine", "strategy wrong.py:Mine cannot be loaded: line 2: invalid syntax"),
        (
            "raises.py:Mine",
            "strategy raises.py:Mine cannot be loaded: line 3: ZeroDivisionError: division by zero",
        ),
        ("leaves.py:Mine", "strategy leaves.py:Mine cannot be loaded: line 1: SystemExit: 0"),
        ("empty.py:Mine", "strategy empty.py:Mine has no class Mine: it defines no class"),
    ],
)
def test_a_wrong_file_is_told_in_one_line_with_what_it_lacks(file: Path, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as told:
        collection(str(file.parent / name), trust=Trust())
    assert "\n" not in str(told.value)


def test_a_file_is_executed_with_a_trust_that_covers_it_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    executed = tmp_path / "executed"
    (tmp_path / "stranger.py").write_text(
        f"open({str(executed)!r}, 'w').close()\n"
        "from apad_bridge.planning.strategies.paper_strategies import Greedy, GreedyRedeploy\n"
    )
    name = f"{tmp_path}/stranger.py"
    for trust in (None, Trust(frozenset()), Trust(frozenset({f"{tmp_path}/mine.py"}))):
        with pytest.raises(NotTrusted, match=r"^strategy stranger.py:Greedy is code in a file: add --trust"):
            collection(f"{name}:Greedy", trust=trust)
        with pytest.raises(NotTrusted):
            redeployment(f"{name}:GreedyRedeploy", trust)
    assert not executed.exists()
    monkeypatch.chdir(tmp_path)
    collection("stranger.py:Greedy", trust=Trust(frozenset({name})))
    assert executed.exists()

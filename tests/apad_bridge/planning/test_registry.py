"""Strategies by name, with a real distribution on sys.path: the example of docs/first-strategy.md, word for
word.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from doc_blocks import file_of

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.paper_strategies import Cautious, Greedy, GreedyRedeploy, NoCollection
from apad_bridge.planning.registry import collection, known_names, redeployment

DOCUMENT = Path(__file__).parents[3] / "docs" / "first-strategy.md"


def block(name: str) -> str:
    return file_of(DOCUMENT, name)


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


def test_the_built_in_ones() -> None:
    assert isinstance(collection("greedy"), Greedy)
    assert isinstance(collection("cautious"), Cautious)
    assert isinstance(collection("none"), NoCollection)
    assert isinstance(redeployment("greedy-redeploy"), GreedyRedeploy)


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"^unknown strategy 'gready'; known: .*cautious.*greedy.*none"):
        collection("gready")


def test_a_redeployment_is_no_collection() -> None:
    with pytest.raises(ValueError, match=r"'greedy-redeploy' .* is no collect strategy"):
        collection("greedy-redeploy")
    with pytest.raises(ValueError, match=r"'greedy' .* is no deploy strategy"):
        redeployment("greedy")


def test_the_documented_package_adds_a_strategy(site: Path) -> None:
    setup = block("setup.cfg")
    entry = setup.split("musselbed.strategies =")[1].strip()
    install(site, "lab_strategies", entry, "lab_strategies", block("lab_strategies.py"))
    assert "farthest" in known_names()
    agents = (
        Candidate(1, 3, 0, 0.5, 1, 3, 0),
        Candidate(2, 9, 0, 0.5, 1, 9, 0),
        Candidate(3, 6, 0, 0.5, 1, 6, 0),
    )
    plan = collection("farthest").plan(Situation(0, 0, agents, (0, 1)), batch=4)
    assert plan.encode() == [["collect", 2, 0], ["collect", 3, 1]]


def test_a_package_that_cannot_be_imported_is_named(site: Path) -> None:
    install(site, "broken_lab", "broken = broken_lab:Missing", "broken_lab", "")
    with pytest.raises(
        ValueError, match=r"'broken' \(from broken_lab 1.2, broken_lab:Missing\) cannot be loaded"
    ):
        collection("broken")


def test_what_is_no_strategy_is_refused(site: Path) -> None:
    install(site, "odd_lab", "odd = odd_lab:Odd", "odd_lab", "class Odd: pass\n")
    with pytest.raises(ValueError, match=r"'odd' \(from odd_lab 1.2\) is no collect strategy"):
        collection("odd")


def test_a_name_that_is_taken_is_not_shadowed_silently(site: Path) -> None:
    install(site, "shadow_lab", "greedy = shadow_lab:Own", "shadow_lab", "class Own: pass\n")
    with pytest.raises(ValueError, match=r"is in each of musselbed itself, shadow_lab 1\.2"):
        collection("greedy")

"""The pieces of scenarios and files on the page about the water match their descriptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from doc_blocks import blocks
from scenario_files import SOUND_FILE

from agents.water.topology import LinkRule, parse_topology
from apad_bridge.scenario.loader import from_data, load, resolve

ROOT = Path(__file__).parents[3]
PIECES = [it.text for it in blocks(ROOT / "docs" / "water.md")]


def check_holds(flown: Any, written: Any) -> None:
    """Every value of the page reaches the scenario; what the page leaves out has a default there."""
    if isinstance(written, dict):
        for key, value in written.items():
            check_holds(flown[key], value)
    elif isinstance(written, list):
        for one, other in zip(flown, written, strict=True):
            check_holds(one, other)
    else:
        assert flown == written


def test_its_scenario_s_blocks_can_be_flown() -> None:
    waters = [yaml.safe_load(piece) for piece in PIECES if piece.startswith("water:")]
    assert len(waters) >= 2
    for block in waters:
        if "current" in block["water"]:
            block["water"]["current"].pop("file")
        data = resolve(load(SOUND_FILE))
        data["water"].update(block["water"])
        check_holds(resolve(from_data(data, "page"))["water"], block["water"])


def test_its_links_are_links() -> None:
    (piece,) = (it for it in PIECES if it.startswith("from, to"))
    assert parse_topology(piece, {"apad": 0}, 1000).rules == (
        LinkRule(3, 0, 1.0),
        LinkRule(0, 3, 0.2),
        LinkRule(None, 0, 1.0, 600_000, 1_200_000),
    )

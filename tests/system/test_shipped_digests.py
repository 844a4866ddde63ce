"""Each shipped scenario gives the digest that docs/records.md states, on the Debian at hand.

It takes five minutes, so the suite leaves it out. By itself, here or in a clean Debian:
launch_scripts/test -m digests; launch_scripts/test --debian 13 -m digests
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from programs import ROOT

from apad_bridge.commands.main import main

SCENARIOS = ROOT / "launch_scripts" / "scenarios"
STATED = dict(
    re.findall(
        r"^\| `([\w-]+\.yaml)` \| `([0-9a-f]{16})` \|$", (ROOT / "docs/records.md").read_text(), re.MULTILINE
    )
)

pytestmark = [pytest.mark.system, pytest.mark.digests]


def test_the_page_has_each_scenario_of_a_simulated_apad() -> None:
    assert STATED.keys() == {it.name for it in SCENARIOS.glob("*.yaml")} - {"real-apad.yaml"}


@pytest.mark.parametrize("name", STATED)
def test_a_shipped_scenario_gives_the_digest_of_the_page(name: str, tmp_path: Path) -> None:
    assert (
        main(["run", str(SCENARIOS / name), "--time", "asap", "--out", str(tmp_path / "run"), "--json"]) == 0
    )
    assert json.loads((tmp_path / "run/summary.json").read_text())["digest"] == STATED[name]

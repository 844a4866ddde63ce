"""A fleet of whole boards, a process each: the same flight, byte for byte, as in one process."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from journals import lines_in

from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved

pytestmark = pytest.mark.system
SHIPPED = Path(__file__).parents[2] / "launch_scripts/scenarios/whole-board-12.yaml"


def flown(scenario: Path, out: Path, *options: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "apad_bridge.commands.main", "run", scenario, "--json", "--out", out]
    done = subprocess.run(
        [*command, *options],
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    figures: dict[str, Any] = json.loads(done.stdout)
    return {key: value for key, value in figures.items() if key != "run"}


def test_one_process_and_many_fly_alike_to_the_byte(tmp_path: Path) -> None:
    data = resolve(load(SHIPPED))
    data.update(name="whole", duration_s=2200)
    scenario = tmp_path / "whole.yaml"
    write_resolved(scenario, from_data(data, "whole"))
    alone = flown(scenario, tmp_path / "one", "--time", "asap", "--hosting", "one_process")
    together = flown(scenario, tmp_path / "many", "--time", "asap", "--hosting", "processes")
    assert alone == together
    assert alone["services"] == 4
    journals = [(tmp_path / run / "journal.jsonl").read_bytes() for run in ("one", "many")]
    assert journals[0] == journals[1]
    samples = [(tmp_path / run / "samples.jsonl").read_text() for run in ("one", "many")]
    assert samples[0] == samples[1]
    assert len(samples[0].splitlines()) == alone["samples_uploaded"] > 0
    lines = lines_in(tmp_path / "many" / "journal.jsonl")
    states = {line["state"] for line in lines if line["kind"] == "truth"}
    assert {"SLEEPING", "SAMPLING", "PROCESSING", "AWAITING_SLOT", "TRANSMITTING", "REPORTING"} <= states


def test_samples_come_ashore_over_ros(tmp_path: Path) -> None:
    data = resolve(load(SHIPPED))
    data.update(name="whole", duration_s=600)
    data["mission"]["pool_threshold"] = 0.98
    scenario = tmp_path / "whole.yaml"
    write_resolved(scenario, from_data(data, "whole"))
    figures = flown(scenario, tmp_path / "run", "--speed", "100")
    uploaded = (tmp_path / "run" / "samples.jsonl").read_text().splitlines()
    assert len(uploaded) == figures["samples_uploaded"] >= 4
    assert figures["samples_lost"] == 0

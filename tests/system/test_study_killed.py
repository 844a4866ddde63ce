"""A study whose process is killed: its workers end with it, and the same command goes on from its missions."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from killing import gone
from programs import MUSSELBED, ROOT, begun, done, wait_until
from scenario_files import POOL_FILE

pytestmark = pytest.mark.system

STRATEGY = """
import os, signal
from apad_bridge.planning.strategies.paper_strategies import Greedy

class Waits(Greedy):
    plans_of_process = 0

    def plan(self, situation, batch):
        Waits.plans_of_process += 1
        if Waits.plans_of_process > 2 and os.path.exists(os.environ["WAITING"]):
            with open(os.environ["WAITING"], "w") as waiting:
                waiting.write(f"{os.getpid()}\\n")
            signal.pause()
        return super().plan(situation, batch)
"""


def test_its_workers_end_with_it_and_it_goes_on(tmp_path: Path) -> None:
    waiting, out = tmp_path / "waiting", tmp_path / "out"
    (tmp_path / "lab.py").write_text(STRATEGY)
    os.mkfifo(waiting)
    study = {
        "name": "killed",
        "scenarios": [str(POOL_FILE)],
        "strategies": ["lab.py:Waits"],
        "seeds": 8,
        "parameters": {"duration_s": [300.0]},
    }
    (tmp_path / "study.yaml").write_text(json.dumps(study))
    command = (*MUSSELBED, "study", tmp_path / "study.yaml", "--workers", 2, "--out", out, "--json")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "WAITING": str(waiting)}
    with begun(*command, cwd=tmp_path, env=environment) as flying:
        workers: set[int] = set()
        while len(workers) < 2:  # each writes its id when it waits, and goes on no further
            with open(waiting) as lines:
                workers |= {int(line) for line in lines}
        # A worker is told its next block before the last one is written. Both wait now, so nothing more is written.
        trials = out / "trials.jsonl"
        wait_until(
            lambda: trials.read_text().count("\n") >= 3, flying
        )  # the study's line, and two missions at least
        flying.send_signal(signal.SIGKILL)
        assert all(gone(it) for it in workers), "a worker lives on without its study"
    kept = (out / "trials.jsonl").read_text()
    waiting.unlink()
    told = done(*command, cwd=tmp_path, env=environment).stdout
    assert json.loads(told)["missions"] == 8
    assert (out / "trials.jsonl").read_text().startswith(kept)

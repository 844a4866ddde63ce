"""A study whose process is killed: its workers end with it, and the same command goes on from its missions."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
PATIENCE_S = 180.0
STRATEGY = """
import os, signal
from apad_bridge.planning.paper_strategies import Greedy

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
    site, waiting, out = tmp_path / "site", tmp_path / "waiting", tmp_path / "out"
    info = site / "lab-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[musselbed.strategies]\nwaits = lab:Waits\n")
    (site / "lab.py").write_text(STRATEGY)
    os.mkfifo(waiting)
    study = {
        "name": "killed",
        "scenarios": [str(POOL_FILE)],
        "strategies": ["waits"],
        "seeds": 8,
        "parameters": {"duration_s": [300.0]},
    }
    (tmp_path / "study.yaml").write_text(json.dumps(study))
    command = [sys.executable, "-m", "apad_bridge.commands.main", "study", str(tmp_path / "study.yaml")]
    command += ["--workers", "2", "--out", str(out), "--json"]
    environment = {**os.environ, "PYTHONPATH": f"{site}:{ROOT}", "WAITING": str(waiting)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE) as flying:
        workers: set[int] = set()
        while len(workers) < 2:  # each writes its id when it waits, and goes on no further
            with open(waiting) as lines:
                workers |= {int(line) for line in lines}
        # A worker is told its next block before the last one is written. Both wait now, so nothing more is written.
        until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
        while (out / "trials.jsonl").read_text().count(
            "\n"
        ) < 3:  # the study's line, and two missions at least
            assert time.monotonic() < until_s
            pause.wait(0.05)
        ends = select.poll()
        for worker in workers:
            ends.register(os.pidfd_open(worker), select.POLLIN)
        flying.send_signal(signal.SIGKILL)
        ended = 0
        while ended < 2:
            found = ends.poll(PATIENCE_S * 1000)
            assert found, "a worker lives on without its study"
            for descriptor, _ in found:
                ends.unregister(descriptor)
                os.close(descriptor)
                ended += 1
    kept = (out / "trials.jsonl").read_text()
    waiting.unlink()
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["missions"] == 8
    assert (out / "trials.jsonl").read_text().startswith(kept)

"""Samples on their way from real processes to the disk, while agents, the nursery and the supervisor are killed."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system
PROGRAM = Path(__file__).parent / "sample_ashore.py"
UNTIL_S = 840
"""Seven turns; in the last nothing is killed, so that all that waits comes ashore."""


def test_nothing_is_lost_and_nothing_is_there_twice_whoever_dies(tmp_path: Path) -> None:
    chance = random.Random(5)
    deaths = [("supervisor", 95), ("agent", 95), ("agent", 101), ("supervisor", 217), ("nursery", 335)]
    deaths += [("agent", 340), ("supervisor", 346), ("agent", 460), ("agent", 583)]
    (tmp_path / "fleet").mkdir()
    epoch, told = 0, {}
    while not told:
        epoch += 1
        command = [sys.executable, str(PROGRAM), str(tmp_path), str(epoch), str(UNTIL_S)]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
            assert process.stdin is not None and process.stdout is not None
            for line in process.stdout:
                heard = json.loads(line)
                if isinstance(heard, dict):
                    told = heard
                    break
                now_s, nursery_pid, pids = heard
                if deaths and now_s >= deaths[0][1]:
                    who, _ = deaths.pop(0)
                    pid = {"supervisor": process.pid, "nursery": nursery_pid}.get(who) or chance.choice(
                        list(pids.values())
                    )
                    os.kill(pid, signal.SIGKILL)
                    if pid == process.pid:
                        break
                # It waits for this, so a death comes at its tick however late this process is.
                process.stdin.write("\n")
                process.stdin.flush()
        assert told or process.returncode == -signal.SIGKILL
    assert deaths == [] and epoch == 4

    lines = [json.loads(line) for line in (tmp_path / "samples.jsonl").read_text().splitlines()]
    kept = [(line["id"], line["sequence"]) for line in lines]
    assert len(kept) == len(set(kept))
    for agent_id, taken in told.items():
        mine = sorted(sequence for kept_id, sequence in kept if kept_id == int(agent_id))
        # What was sampled after the last upload is still aboard; all before it is here.
        assert mine == list(range(len(mine)))
        assert 20 < len(mine) <= taken < len(mine) + 8

"""Runs on a machine that is short of something: one line that names it, exit code 3, nothing left, whole records."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from apad_bridge.records.journal import read_journal

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
POOL = "launch_scripts/scenarios/pool-12.yaml"
PATIENCE_S = 240.0
OVER_ROS = ("--time", "wall", "--speed", "100")
ASAP = ("--time", "asap")


def fly(out: Path, limit: tuple[int, int], *options: str) -> subprocess.CompletedProcess[str]:
    """Flies the pool with this limit of a resource, (which, how much)."""
    return subprocess.run(
        [*MUSSELBED, "run", POOL, "--out", str(out), "--json", *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        preexec_fn=lambda: resource.setrlimit(limit[0], (limit[1], limit[1])),
    )


def left_of(run: Path) -> list[str]:
    """Processes that name the run's directory."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(run) in line and entry.name != str(os.getpid()):
            found.append(line)
    return found


def check_failed(done: subprocess.CompletedProcess[str], run: Path, words: str) -> None:
    """`done` failed for the reason with these words, in one line, and left nothing behind."""
    assert done.returncode == 3, done.stderr
    (line,) = done.stderr.splitlines()
    assert words in line and str(run) in line
    for log in (run / "supervisor.log", run / "fleet" / "nursery.log"):
        text = log.read_text() if log.exists() else ""
        assert "Traceback" not in text, text
    assert left_of(run) == []


@pytest.mark.parametrize("options", [ASAP, OVER_ROS], ids=["asap", "over ROS"])
def test_a_full_disk_ends_the_mission_in_order_with_whole_records(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    run = tmp_path / "run"
    done = fly(run, (resource.RLIMIT_FSIZE, 300_000), *options)
    check_failed(done, run, "takes no more data (File too large)")
    contents = read_journal(run / "journal.jsonl")
    assert contents.dropped == 0 and contents.last_ms > 60_000
    with Reader(run / "run.bag") as bag:
        truths_s = [at_ns // 10**9 for it, at_ns, _ in bag.messages() if it.topic == "/musselbed/truth"]
    assert truths_s == list(range(len(truths_s))) and 60 < len(truths_s) <= contents.last_ms / 1000 + 1


def test_a_full_disk_is_told_once_to_a_person(tmp_path: Path) -> None:
    """As it happens, while the vehicle comes to rest, and not again at the end."""
    run = tmp_path / "run"
    done = subprocess.run(
        [*MUSSELBED, "run", POOL, "--out", str(run), *OVER_ROS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000)),
    )
    assert done.returncode == 3, done.stderr
    assert " ".join(done.stderr.split()).count("takes no more data (File too large)") == 1, done.stderr


@pytest.mark.parametrize("options", [ASAP, OVER_ROS], ids=["asap", "over ROS"])
def test_too_few_open_files_are_one_line(tmp_path: Path, options: tuple[str, ...]) -> None:
    run = tmp_path / "run"
    check_failed(fly(run, (resource.RLIMIT_NOFILE, 24), *options), run, "ulimit -n is 24")


@pytest.mark.parametrize("kilobytes", [50_000, 80_000, 110_000, 130_000, 150_000])
def test_too_little_memory_is_one_line(tmp_path: Path, kilobytes: int) -> None:
    """50 000 kB do not hold the packages, 80 000 not numpy's library, with 110 000 it asked for memory for ever."""
    done = fly(tmp_path / "run", (resource.RLIMIT_AS, 1024 * kilobytes), *ASAP)
    assert done.returncode == 3, done.stderr
    assert done.stderr == (
        f"musselbed run: not enough memory: `ulimit -v` allows {kilobytes} kB here; raise it\n"
    )


def test_a_scenario_that_is_damaged_is_one_line_of_every_command(tmp_path: Path) -> None:
    """Its supervisor is dead, and its scenario is no text any more."""
    run = tmp_path / "run"
    assert fly(run, (resource.RLIMIT_CORE, 0), *ASAP).returncode == 0
    (run / "summary.json").unlink()
    options = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**options, "time": "wall"}))
    (run / "scenario.yaml").write_bytes(b"name: \xff\xfe")
    for words in ("resume", "replay", "report", "check"):
        done = subprocess.run(
            [*MUSSELBED, words, str(run)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), (words, done.stderr)
        assert "scenario.yaml: is not UTF-8 text" in done.stderr, (words, done.stderr)

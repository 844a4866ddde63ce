"""Runs on a machine that is short of something: one line that names it, exit code 3, nothing left, whole records."""

from __future__ import annotations

import resource
import subprocess
from pathlib import Path

import pytest
from programs import musselbed, processes_of
from rosbags.rosbag1 import Reader

from apad_bridge.records.journal import read_journal

pytestmark = pytest.mark.system

POOL = "launch_scripts/scenarios/pool-12.yaml"
OVER_ROS = ("--time", "wall", "--speed", "100")
ASAP = ("--time", "asap")


def fly(out: Path, limit: tuple[int, int], *options: str, code: int = 3) -> subprocess.CompletedProcess[str]:
    """Flies the pool with this limit of a resource, (which, how much)."""
    limited = {"preexec_fn": lambda: resource.setrlimit(limit[0], (limit[1], limit[1]))}
    return musselbed("run", POOL, "--out", out, *options, code=code, **limited)


def check_failed(done: subprocess.CompletedProcess[str], run: Path, words: str) -> None:
    """`done` failed for the reason with these words, in one line, and left nothing behind."""
    (line,) = done.stderr.splitlines()
    assert words in line and str(run) in line
    for log in (run / "supervisor.log", run / "fleet" / "nursery.log"):
        text = log.read_text() if log.exists() else ""
        assert "Traceback" not in text, text
    assert not processes_of(run)


@pytest.mark.parametrize("options", [ASAP, OVER_ROS], ids=["asap", "over ROS"])
def test_a_full_disk_ends_the_mission_in_order_with_whole_records(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    """A person is told over ROS: once, as it happens, while the vehicle comes to rest, and not again at the end."""
    run, told = tmp_path / "run", "takes no more data (File too large)"
    for_program = options == ASAP
    done = fly(run, (resource.RLIMIT_FSIZE, 300_000), *options, *["--json"] * for_program)
    if for_program:
        check_failed(done, run, told)
    assert " ".join(done.stderr.split()).count(told) == 1, done.stderr
    assert "Traceback" not in done.stderr and not processes_of(run)
    contents = read_journal(run / "journal.jsonl")
    assert contents.dropped == 0 and contents.last_ms > 60_000
    with Reader(run / "run.bag") as bag:
        truths_s = [at_ns // 10**9 for it, at_ns, _ in bag.messages() if it.topic == "/musselbed/truth"]
    assert truths_s == list(range(len(truths_s))) and 60 < len(truths_s) <= contents.last_ms / 1000 + 1


@pytest.mark.parametrize("options", [ASAP, OVER_ROS], ids=["asap", "over ROS"])
def test_too_few_open_files_are_one_line(tmp_path: Path, options: tuple[str, ...]) -> None:
    run = tmp_path / "run"
    check_failed(fly(run, (resource.RLIMIT_NOFILE, 24), *options, "--json"), run, "ulimit -n is 24")


@pytest.mark.parametrize("kilobytes", [50_000, 80_000, 110_000, 130_000, 150_000])
def test_too_little_memory_is_one_line(tmp_path: Path, kilobytes: int) -> None:
    """50 000 kB do not hold the packages, 80 000 not numpy's library, with 110 000 it asked for memory for ever."""
    done = fly(tmp_path / "run", (resource.RLIMIT_AS, 1024 * kilobytes), *ASAP, "--json")
    assert done.stderr == (
        f"musselbed run: not enough memory: `ulimit -v` allows {kilobytes} kB here; raise it\n"
    )

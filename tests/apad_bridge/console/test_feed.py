"""What a console reads and asks for its pages."""

import json
import os
import socket
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.console.feed import Feed
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.control_protocol import SOCKET_NAME


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    scenario = load(POOL_FILE)
    directory = RunDirectory.create("pool", datetime(2026, 5, 4, tzinfo=UTC), tmp_path / "run")
    starts = starts_of(scenario)
    directory.write_inputs(scenario, starts)
    RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT).save(directory.path)
    recorder = Recorder(directory, scenario, {it.agent_id: (it.north_m, it.east_m) for it in starts})
    journal_start(recorder, scenario, starts)
    recorder.close()
    return directory.path


def test_however_many_pages_open_the_supervisor_is_asked_once_a_poll(run_dir: Path) -> None:
    with socket.socket(socket.AF_UNIX) as supervisor:
        descriptor = os.open(run_dir, os.O_DIRECTORY)
        supervisor.bind(f"/proc/self/fd/{descriptor}/{SOCKET_NAME}")
        os.close(descriptor)
        supervisor.listen(256)
        supervisor.setblocking(False)
        with closing(Feed(run_dir)) as feed:
            assert feed.poll()["supervisor"]
            asked = waiting(supervisor)
            for _ in range(100):
                assert feed.since((0, 0, 0, 0, 0))["supervisor"]
                feed.page_data()
            assert (asked, waiting(supervisor)) == (2, 0)  # at its begin, and by the poll
    (run_dir / SOCKET_NAME).unlink()
    with closing(Feed(run_dir)) as feed:
        assert not feed.poll()["supervisor"] and not feed.since((0, 0, 0, 0, 0))["supervisor"]


def test_an_end_that_is_written_after_the_sample_of_its_tick_is_told(run_dir: Path) -> None:
    with closing(Feed(run_dir)) as feed:
        with (run_dir / "journal.jsonl").open("a") as journal:
            print('{"t":5000,"kind":"remark","by":"Anna","text":"gulls"}', file=journal, flush=True)
            assert feed.poll()["sample"]["t"] == 5000
            flying = {"supervisor": False, "ended_by": None, "summary": None}
            assert feed.poll() == {"sample": None, **flying, "speed": 1.0}
            print('{"t":5000,"kind":"speed","times":5.0,"by":"Anna"}', file=journal, flush=True)
            assert feed.poll()["speed"] == 5.0
            # The next supervisor flies at the speed with which the run began.
            resumed = {"journal_dropped": 0, "journal_torn_bytes": 0, "bag_repaired": None, "bag_lost_ms": 0}
            print(json.dumps({"t": 5000, "kind": "resumed", **resumed}), file=journal, flush=True)
            assert feed.poll()["speed"] == 1.0
            print('{"t":5000,"kind":"end","reason":"a call","end_reason":"a call"}', file=journal, flush=True)
        told = feed.poll()
        assert (told["ended_by"], told["sample"]["t"]) == ("a call", 5000)
        assert told["sample"]["events"] == [[5000, "news", "the mission ended: a call", None]]
        assert feed.poll()["sample"] is None


def test_samples_that_are_uploaded_come_with_the_next_tick(run_dir: Path) -> None:
    with closing(Feed(run_dir)) as feed:
        with (
            (run_dir / "journal.jsonl").open("a") as journal,
            (run_dir / "samples.jsonl").open("a") as samples,
        ):
            for at_ms in (5000, 6000):
                line = {"id": 3, "sequence": at_ms // 1000, "mission_ms": at_ms - 500, "oxygen_mg_l": 8.0}
                print(json.dumps(line), file=samples, flush=True)
                assert feed.poll()["sample"] is None
                print(json.dumps({"t": at_ms, "kind": "tick"}), file=journal, flush=True)
                assert feed.poll()["sample"]["measured"] == [[at_ms - 500, 3, 8.0, None, None, None]]
        assert len(feed.page_data()["measured"]) == 2


def waiting(listener: socket.socket) -> int:
    """Takes all connections that wait, and counts them."""
    count = 0
    with suppress(BlockingIOError):
        while True:
            listener.accept()[0].close()
            count += 1
    return count


@pytest.mark.parametrize(
    ("part", "apad", "is_real", "takes_faults"),
    [
        (BenchPart.WHOLE, APadKind.SIM, False, True),
        (BenchPart.WHOLE, APadKind.ROS, True, False),
        # Another part commands it. The fleet's own boards are simulated, and the hull beside them is none the less real.
        (BenchPart.FLEET, APadKind.ROS, True, True),
    ],
)
def test_a_page_says_whose_the_aPad_is(
    run_dir: Path, part: BenchPart, apad: APadKind, is_real: bool, takes_faults: bool
) -> None:
    RunOptions(part, apad, TimeSource.WALL, 1.0, OnDeath.WAIT).save(run_dir)
    with closing(Feed(run_dir)) as feed:
        feed.poll()
        page = feed.page_data()
        assert (page["is_real"], bool(page["live"]["orders"]["faults"])) == (is_real, takes_faults)

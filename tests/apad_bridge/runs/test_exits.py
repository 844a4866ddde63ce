"""Why a mission ended decides the exit code, and is restored from records of any age."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from errno import ENOENT
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from journals import lines_in
from rosbags.rosbag1 import Reader
from scenario_files import POOL_FILE

from agents.packet_medium import Medium
from agents.time_scale import MissionMs
from apad_bridge.assembly.flight_config import FlightConfig, flight_config
from apad_bridge.commands.outcome import exit_of, report
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.records.recorder import Recorder, RecordsFailed
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.sample_file import read_samples
from apad_bridge.runs import exits
from apad_bridge.runs.exits import Exit, peers_may_fail
from apad_bridge.runs.flying import fly, in_process_context, journal_start, open_fleet
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import ClockLost, OnTimeReached, StopSign
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.packet_relay import (
    PacketOrigin,
    PacketRelay,
    RelayedPacket,
    RelayOutcome,
    whole_flight,
)
from apad_bridge.vehicle.link_errors import PeerFailed
from firmware_model.packets import LogAck, LogRecords, decode
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.sensors import NO_COUNTS

FAILED = MissionEnd(EndReason.STRATEGY_FAILED, "failure of strategy 'x': ValueError: no")


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (MissionEnd(EndReason.MISSION_TIME), Exit.DONE),
        (MissionEnd(EndReason.OPERATOR), Exit.INTERRUPTED),
        (FAILED, Exit.PEER_FAILED),
        (MissionEnd(EndReason.SCRIPT_FAILED, "failure of the script: x"), Exit.PEER_FAILED),
        # The words are the script's own, and decide nothing.
        (MissionEnd(EndReason.SCRIPT_ABORTED, "the operator"), Exit.DONE),
        (MissionEnd(EndReason.SCRIPT_ABORTED, "failure of strategy"), Exit.DONE),
    ],
)
def test_the_reason_decides_the_exit_code_and_not_its_text(
    end: MissionEnd, code: Exit, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = {"ended_by": str(end), "end_reason": end.reason.value}
    assert report("a", "greedy", RunDirectory(Path("run")), summary, as_json=True) is code


class ClockThatStops:
    """A simulated aPad's node confirms the first five seconds, the third of them late, and nothing more."""

    behind_s = 0.0

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        self.behind_s = {3000: 1.75, 4000: 0.5}.get(now_ms, 0.0)
        if now_ms > 5000:
            raise ClockLost("the node of /apad1 did not say within 60 s that it has come to 6 s")


def minute_in(folder: Path, **parts: Any) -> tuple[FlightConfig, FlightContext, Recorder]:
    """A flight of a minute with its records in a folder."""
    scenario = replace(load(POOL_FILE), duration_s=60)
    scenario = replace(scenario, fleet=replace(scenario.fleet, hosting=Hosting.ONE_PROCESS))
    config, starts = flight_config(scenario), starts_of(scenario)
    recorder = Recorder(RunDirectory(folder), scenario, config.ids)
    journal_start(recorder, scenario, starts)
    context = in_process_context(config, open_fleet(config, starts, folder.parent))
    return config, replace(context, **parts), recorder


def test_a_clock_that_is_lost_ends_the_mission_in_order_with_its_records(tmp_path: Path) -> None:
    config, context, recorder = minute_in(tmp_path, pace=ClockThatStops())
    with FlightProgress("pool", 60_000, quiet=True) as progress:
        summary = fly(config, context, recorder, progress)
    directory = RunDirectory(tmp_path)
    assert summary["ended_by"].startswith("loss of the clock: the node of /apad1 did not say")
    assert exit_of(EndReason(summary["end_reason"])) is Exit.PEER_FAILED
    assert json.loads(directory.summary.read_text()) == summary
    assert summary["latest_tick_s"] == 1.75
    (end,) = [line for line in lines_in(directory.journal) if line["kind"] == "end"]
    assert (end["t"], end["end_reason"]) == (6000, "loss of the clock")
    with Reader(directory.bags[0]):
        pass


class MessagesOfFlight:
    """A display that keeps what it is told, with the time of the newest tick then."""

    def __init__(self, removed: Path) -> None:
        self.now_ms, self.told = 0, list[tuple[int, str]]()
        self._removed = removed

    def print_message(self, text: str) -> None:
        self.told.append((self.now_ms, text))

    def show_status(self, now_ms: int, status: object) -> None:
        self.now_ms = now_ms
        if now_ms == 20_000:
            shutil.rmtree(self._removed)


def test_a_directory_that_is_gone_is_told_at_the_next_tick_and_not_at_the_end(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    (config, context, recorder), progress = minute_in(out), MessagesOfFlight(out)
    with pytest.raises(RecordsFailed, match="was deleted while the run flew"):
        fly(config, context, recorder, progress)
    recorder.close()
    (told,) = [(now_ms, text) for now_ms, text in progress.told if "was deleted" in text]
    assert told[0] <= 21_000
    assert told[1].startswith(f"{out / 'journal.jsonl'} was deleted while the run flew: the run ends")


def test_no_sample_is_acknowledged_after_the_records_have_failed(tmp_path: Path) -> None:
    """A real aMussel uploads a sample a tick, and would forget those that nobody wrote."""
    config, context, recorder = minute_in(tmp_path)
    directory, real = RunDirectory(tmp_path), config.ids[0]
    sequences, acknowledged = count(), list[int]()

    def upload(now_ms: int) -> list[RelayedPacket]:
        if now_ms == 20_000:
            directory.journal.unlink(missing_ok=True)
        record = SampleRecord(next(sequences), now_ms, NO_COUNTS, 0)
        data = LogRecords.of(real, 0, record.sequence, 1, [record]).encode()
        return [RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, real, Medium.WIFI, data, MissionMs(now_ms))]

    def publish(packet: RelayedPacket) -> None:
        if isinstance(sent := decode(packet.data), LogAck):
            acknowledged.append(sent.next_sequence)

    whole = whole_flight(lambda: frozenset(config.ids) - {real})
    relay = PacketRelay(whole, [upload], {RelayOutcome.PUBLISH: publish})
    with pytest.raises(RecordsFailed), FlightProgress("pool", 60_000, quiet=True) as progress:
        fly(config, replace(context, relay=relay), recorder, progress)
    recorder.close()
    written = [it.sequence for it in read_samples(directory.samples)]
    assert next(sequences) > len(written) and written == list(range(acknowledged[-1]))


@pytest.mark.parametrize("is_quiet", [False, True])
def test_what_was_told_as_it_happened_is_not_told_again_at_the_end(
    is_quiet: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """The flight told the first failure; a quiet display showed nobody, so the end has to."""
    with FlightProgress("pool", 60_000, quiet=is_quiet) as progress:
        progress.print_message("apad1: its records are gone")
    with pytest.raises(SystemExit) as ended, peers_may_fail(progress.was_shown):
        raise PeerFailed("apad1: its records are gone", "apad2: its node has ended")
    assert ended.value.code == Exit.PEER_FAILED
    told = capsys.readouterr().err
    assert told.count("its records are gone") == told.count("apad2: its node has ended") == 1
    assert told.endswith("\n") and "musselbed: ;" not in told


def test_an_error_that_hides_a_lack_of_memory_is_known_by_the_space_that_is_used_up() -> None:
    """CPython's compiler makes a ValueError of it: what an own bug raises with room to spare is no lack of memory."""
    program = """
import resource
from apad_bridge.runs.exits import is_for_lack_of_memory
assert not is_for_lack_of_memory(ValueError("field 'target' is required for AnnAssign"))
resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
assert not is_for_lack_of_memory(ValueError("field 'target' is required for AnnAssign"))
held = []
try:
    while True:
        held.append(bytes(1 << 20))
except MemoryError:
    held.pop()
assert is_for_lack_of_memory(ValueError("field 'target' is required for AnnAssign"))
assert is_for_lack_of_memory(ImportError("numpy._core.multiarray failed to import"))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_a_file_of_ours_that_is_missing_is_no_mistake_of_the_user() -> None:
    ours = Path(exits.__file__).with_name("gone.py")
    assert exits.fault_of_file(FileNotFoundError(ENOENT, "No such file", str(ours))) is None
    assert exits.fault_of_file(OSError(ENOENT, "No such file")) is None
    assert (
        exits.fault_of_file(FileNotFoundError(ENOENT, "No such file", "mine.csv")) == "mine.csv: No such file"
    )

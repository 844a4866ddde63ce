"""Fleets of boards with a C program in a process of its own: the same traces as ours, and each death stays alone."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from doc_blocks import install_template
from fleets import KILL, PAPER, Story, command, deaths, fly
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from journals import lines_in
from killing import gone, kill_9, pid_of_supervisor
from native_boards import NATIVE, compiled
from patient import PATIENCE_S
from programs import MUSSELBED, Begin, children, ended_well, lines_of, musselbed, parent_of, wait_until
from scenario_files import write_scenario

from agents.coordinator import Coordinator
from agents.fleet_config import FirmwareConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.board_parts import BoardPart
from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved, PartFailed
from agents.nursery.fleet_file import RestartPolicy
from agents.time_scale import TimeScale
from apad_bridge.records.journal import read_journal
from firmware_model.packets import Kind

pytestmark = pytest.mark.system

IDS = (3, 8, 21)
THETA = 30
OTHERS = 65_534
"""The group of nobody."""
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
PATIENT = RestartPolicy(restarts=1000)
POOL = Path(__file__).parents[2] / "launch_scripts" / "scenarios" / "pool-12.yaml"
WHOLE = POOL.with_stem("whole-board-12")


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory)


def started(directory: Path, board: Path, agent_ids: tuple[int, ...] = ()) -> ProcessHost:
    fleet = replace(PAPER, firmware=(FirmwareConfig((str(board),), agent_ids),))
    return ProcessHost.start(directory, fleet, BIRTHS, window_timeout_s=PATIENCE_S, restart_policy=PATIENT)


EVENTS = st.one_of(
    st.just(KILL),
    st.sampled_from([ContactClosed(1, 2), DockMoved(9, 9), ContactOpened()]),
    st.sampled_from(
        [
            PartFailed(part, value)
            for part in (
                BoardPart.CONVERTER,
                BoardPart.UARTS,
                BoardPart.SUPPLY,
                BoardPart.HOLD,
                BoardPart.DEPTH,
            )
            for value in (0, 4, 10**9)
        ]
    ),
    st.sampled_from(
        [command(kind, agent_id) for kind in (Kind.PERMISSION, Kind.RELEASE) for agent_id in IDS]
    ),
)


@settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    story=st.lists(st.tuples(st.integers(0, 20), st.sampled_from(IDS), EVENTS), max_size=12),
    steps_ms=st.lists(st.integers(1, 4000), min_size=5, max_size=20),
)
def test_a_fleet_of_c_boards_gives_the_trace_of_ours(
    tmp_path_factory: pytest.TempPathFactory, board: Path, story: Story, steps_ms: list[int]
) -> None:
    """Any events and cuts, and kills of agents. One of the three boards has our firmware."""
    with closing(started(tmp_path_factory.mktemp("run"), board, IDS[:2])) as many:
        assert fly(many, IDS, story, steps_ms) == fly(InProcessHost(PAPER, BIRTHS), IDS, story, steps_ms)
        assert not many.dropped


def flying(host: ProcessHost) -> tuple[Coordinator, dict[int, int]]:
    """The fleet at 10 s of mission time, and the process of each board's firmware; aMussel 8 charges in a dock."""
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))
    clock.receive(8, command(Kind.PERMISSION, 8), 1_000)
    clock.advance(1_000)
    clock.receive(8, ContactClosed(7_000_000, 8_000_000), 5_000)
    clock.advance(10_000)
    boards = {agent_id: children(pid) for agent_id, pid in host.pids.items()}
    assert all(len(it) == 1 for it in boards.values())
    return clock, {agent_id: pid for agent_id, (pid,) in boards.items()}


def test_a_firmware_has_its_port_alone_no_more_rights_and_ends_with_its_agent_or_the_nursery(
    tmp_path: Path, board: Path
) -> None:
    """The kernel gives the files of a process that none but root may trace to root: here they are told by their group."""
    if is_root := os.getuid() == 0:
        os.setresgid(OTHERS, OTHERS, OTHERS)
    try:
        host = started(tmp_path, board)
    finally:
        if is_root:
            os.setresgid(0, 0, 0)
    with closing(host):
        _, boards = flying(host)
        for pid in boards.values():
            assert sorted(os.listdir(f"/proc/{pid}/fd")) == ["0", "1", "2", "3"]
            assert "NoNewPrivs:\t1\n" in Path(f"/proc/{pid}/status").read_text()
            assert os.stat(f"/proc/{pid}/mem").st_gid != 0
        ours = (host.nursery_pid, *host.pids.values())
        assert [os.stat(f"/proc/{pid}/mem").st_gid for pid in ours] == [0] * 4
        kill_9(host.pids[3])
        assert gone(boards[3])
        kill_9(host.nursery_pid)
        assert all(gone(pid) for pid in boards.values())


def test_what_firmware_leaves_in_another_session_ends_with_the_fleet(tmp_path: Path, board: Path) -> None:
    program = tmp_path / "leaves.sh"
    until_it_sleeps = "until grep -qs sleep /proc/$!/comm; do :; done"
    program.write_text(
        f"#!/bin/sh\nsetsid sleep 1000 3>&- &\n{until_it_sleeps}\necho $! >>{tmp_path}/left\nexec {board}\n"
    )
    program.chmod(0o755)
    host = started(tmp_path, program)
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))
    clock.advance(10_000)
    left = list(map(int, (tmp_path / "left").read_text().split()))
    assert len(left) == len(IDS) and all(Path(f"/proc/{it}/comm").read_text() == "sleep\n" for it in left)
    # Its parent's death, and its own, are no agent's.
    kill_9(children(host.pids[3])[0])
    kill_9(left[0])
    assert [it.agent_id for it in deaths(clock.advance(20_000))] == [3]
    host.close()
    left += list(map(int, (tmp_path / "left").read_text().split()))
    assert all(gone(it) for it in left)
    assert "ended 3 processes that firmware had left behind" in (tmp_path / "nursery.log").read_text()


FLIGHTS = {
    "Perl": (POOL, "worst_case.pl", 600, 40),
    "C, failing parts": (POOL, "worst_case", 600, 40),
    "C, whole, failing parts": (WHOLE, "whole_board", 2400, 600),
}
FAILING_PARTS = (
    "bus_silent",
    "readings_scatter",
    "readings_stand",
    "depth_stands",
    "uart_overrun",
    "write_torn",
    "flash_worn",
    "flash_silent",
    "write_brown_out",
)


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_of_other_boards_has_the_journal_of_ours(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, name: str
) -> None:
    """Minutes of the paper's pool at theta 30, byte for byte; whole boards sleep, dock and upload in theirs."""
    scenario, program, duration_s, least_truths = FLIGHTS[name]
    faults = [
        {"fault": fault, "id": (2 * n + k) % 12 + 1, "at_s": 60 + 20 * n, "for_s": 400}
        for n, fault in enumerate(FAILING_PARTS if name.endswith("failing parts") else ())
        for k in (0, 1)
    ]
    perl = program.endswith(".pl")
    shutil.copy(NATIVE / program if perl else compiled(tmp_path_factory, program), tmp_path / "board")
    ours, native = flights(tmp_path, scenario, duration_s=duration_s, faults={"at": faults})
    assert native == ours
    assert ours.count(b'"kind":"truth"') > least_truths
    samples = samples_of(tmp_path)
    assert samples[0] == samples[1] and bool(samples[1]) == name.startswith("C, whole")


def flights(directory: Path, scenario: Path, site: str = "", **changes: Any) -> Iterator[bytes]:
    """The journals of this scenario with our boards, and with `board` in the directory; `site` has further packages."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([site, os.environ.get("PYTHONPATH", "")])}
    for name, firmware in (("ours", None), ("native", {"executable": str(directory / "board")})):
        path = write_scenario(directory / "flown.yaml", scenario, fleet={"firmware": firmware}, **changes)
        out = directory / name
        musselbed("run", path, "--time", "asap", "--out", out, env=environment)
        yield (out / "journal.jsonl").read_bytes()


def samples_of(directory: Path) -> list[bytes]:
    paths = [directory / it / "samples.jsonl" for it in ("ours", "native")]
    return [it.read_bytes() if it.exists() else b"" for it in paths]


OF_LINES = (
    """\
    return if length $data != 6 or crc(substr $data, 0, -2) != unpack 'v', substr $data, -2;
    my ($version, $kind, $id) = unpack 'CCv', $data;
""",
    """\
    my ($body, $name, $id, $check) = $data =~ /^\\$(COMMAND,(\\w+),(\\d+))\\*([0-9A-F]{2})$/ or return;
    my $sum = 0;
    $sum ^= $_ for unpack 'C*', $body;
    return if $sum != hex $check;
    my ($version, $kind) = split /[.]/, {PERMISSION => '1.2', RELEASE => '1.3', SINK => '2.6'}->{$name} // return;
""",
)
"""The Perl board's look at a packet, and that of a board whose packets are the lines of docs/extending.md."""


def test_firmware_with_packets_of_its_own_flies_by_its_codec(tmp_path: Path) -> None:
    """Lines of text are all that this board understands; its laboratory's codec is a package of its own."""
    old, new = OF_LINES
    program = (NATIVE / "worst_case.pl").read_text()
    assert program.count(old) == 1
    (tmp_path / "board").write_text(program.replace(old, new))
    (tmp_path / "board").chmod(0o755)
    site = tmp_path / "site"
    install_template(site, "codec")
    text = POOL.read_text().replace("hearing: {", "hearing: {codec: lines, ")
    (tmp_path / "lines.yaml").write_text(text)
    shutil.copy(POOL.with_suffix(".csv"), tmp_path)
    ours, native = flights(tmp_path, tmp_path / "lines.yaml", site=str(site), duration_s=600)
    assert native == ours
    states = {it["state"] for it in lines_of(tmp_path / "native", "truth")}
    assert {"SURFACING", "CHARGING", "SINKING"} <= states


def running(program: Path) -> list[int]:
    """The processes of this program: a nursery that another supervisor started is no descendant of the run."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (entry / "exe").readlink() == program:
                found.append(int(entry.name))
    return sorted(found)


def test_whatever_is_killed_over_ros_nothing_is_lost(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, begin: Begin
) -> None:
    """kill -9 of an agent, of boards' firmware, of the supervisor and of the nursery, in one flight of whole boards. Each
    kill of a firmware or of an agent leaves the other eleven as they are.

    The run's own check replays its stimuli on our boards: the states of all aMussels are those that it recorded.
    """
    program, out = tmp_path / "board", tmp_path / "run"
    shutil.copy(compiled(tmp_path_factory, "whole_board"), program)
    fleet, mission = {"firmware": {"executable": str(program)}}, {"pool_threshold": 0.98}
    path = write_scenario(tmp_path / "killed.yaml", WHOLE, duration_s=3600, fleet=fleet, mission=mission)
    options = ("--speed", 20, "--json", "--out", out, "--on-supervisor-death", "resume")
    flight = begin(*MUSSELBED, "run", path, *options)

    def fly_on() -> None:
        """Returns once the flight has gone on for 25 s of mission time."""
        goal_ms = last_ms(out) + 25_000
        wait_until(lambda: last_ms(out) >= goal_ms, flight)

    fly_on()
    for victim, undisturbed in ((7, 11), (0, 12), (3, 11), (-1, 0), (11, 11)):
        boards = running(program)
        assert len(boards) == 12
        (nursery,) = {parent_of(parent_of(it)) for it in boards}
        agent = parent_of(boards[victim])
        kill_9({3: agent, -1: nursery, 0: pid_of_supervisor(out)}.get(victim, boards[victim]))
        fly_on()
        left = set(running(program))
        assert len(left) == 12 and len(left & set(boards)) == undisturbed, victim
    assert {it["cause"] for it in lines_of(out, "died")} == {"BROWN_OUT"}

    def kept() -> dict[int, list[int]]:
        """The samples that came ashore, by their numbers, of each aMussel."""
        found: dict[int, list[int]] = {}
        for it in lines_in(out / "samples.jsonl"):
            found.setdefault(it["id"], []).append(it["sequence"])
        return found

    # Samples come while boards are docked; all before the newest of each are here, each once.
    wait_until(lambda: len(kept()) > 2, flight)
    flight.send_signal(signal.SIGINT)
    ended_well(flight, 130)
    assert all(sorted(numbers) == list(range(len(numbers))) for numbers in kept().values()), kept()


def last_ms(out: Path) -> int:
    return int(read_journal(out / "journal.jsonl").last_ms) if (out / "journal.jsonl").exists() else 0

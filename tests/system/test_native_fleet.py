"""Fleets of boards with a C program in a process of its own: the same traces as ours, and each death stays alone."""

from __future__ import annotations

import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from doc_blocks import install_template
from fleets import PAPER
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from killing import gone, kill_9, pid_of_supervisor
from native_boards import NATIVE, compiled

from agents.coordinator import AgentDied, Coordinator
from agents.fleet import FirmwareConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.defects import BoardPart
from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import (
    AgentStimulus,
    ContactClosed,
    ContactOpened,
    DockMoved,
    PartFailed,
    SoundArrived,
)
from agents.nursery.fleet_file import RestartPolicy
from agents.time_scale import TimeScale
from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.run_directory import RunDirectory
from firmware_model.packets import CommandPacket, Kind
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

pytestmark = pytest.mark.system

IDS = (3, 8, 21)
THETA = 30
PATIENCE_S = 180.0
KILLS_SEED = 2
OTHERS = 65_534
"""The group of nobody."""
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
PATIENT = RestartPolicy(restarts=1000)
SCENARIO = Path(__file__).parents[2] / "launch_scripts" / "scenarios" / "pool-12.yaml"
MUSSELBED = Path(__file__).parents[2] / "launch_scripts" / "musselbed"


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory)


def started(directory: Path, board: Path, agent_ids: tuple[int, ...] = ()) -> ProcessHost:
    fleet = replace(PAPER, firmware=(FirmwareConfig((str(board),), agent_ids),))
    return ProcessHost.start(directory, fleet, BIRTHS, window_timeout_s=PATIENCE_S, restart_policy=PATIENT)


@pytest.fixture
def host(tmp_path: Path, board: Path) -> Iterator[ProcessHost]:
    host = started(tmp_path, board)
    yield host
    host.close()


def command(kind: Kind, agent_id: int) -> SoundArrived:
    return SoundArrived(CommandPacket(kind, agent_id).encode())


EVENTS = st.one_of(
    st.just("kill"),
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
Story = list[tuple[int, int, AgentStimulus | str]]


def fly(
    host: InProcessHost | ProcessHost, story: Story, steps_ms: list[int]
) -> tuple[list[Output | AgentDied], list[Truth]]:
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))
    came: list[Output | AgentDied] = []
    told: list[Truth] = []
    now_ms = 0
    for step, length_ms in enumerate([0, *steps_ms]):
        now_ms += length_ms
        for _, agent_id, event in (entry for entry in story if entry[0] == step):
            if not isinstance(event, str):
                clock.receive(agent_id, event, now_ms)
            elif isinstance(host, InProcessHost):
                host.kill(agent_id)
            elif agent_id in host.pids:
                kill_9(host.pids[agent_id])
        came += clock.advance(now_ms)
        told += host.take_truths()
    return came, told


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
    many = started(tmp_path_factory.mktemp("run"), board, IDS[:2])
    try:
        assert fly(many, story, steps_ms) == fly(InProcessHost(PAPER, BIRTHS), story, steps_ms)
        assert not many.dropped
    finally:
        many.close()


def children(pid: int) -> list[int]:
    return [int(it) for it in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def flying(host: ProcessHost) -> tuple[Coordinator, dict[int, int]]:
    """The fleet at 10 s of mission time, and the process of each board's firmware; aMussel 8 charges in a dock."""
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))
    clock.receive(8, command(Kind.PERMISSION, 8), 1_000)
    clock.advance(1_000)
    clock.receive(8, ContactClosed(7_000_000, 8_000_000), 5_000)
    clock.advance(10_000)
    boards = {}
    for agent_id, pid in host.pids.items():
        (boards[agent_id],) = children(pid)
    return clock, boards


def test_kill_9_of_a_firmware_is_a_reset_of_its_board_alone(host: ProcessHost) -> None:
    clock, boards = flying(host)
    before = {truth.agent_id: truth for truth in host.take_truths()}[8]
    assert before.state is State.CHARGING
    kill_9(boards[8])
    died = [it for it in clock.advance(20_000) if isinstance(it, AgentDied)]
    assert [(it.agent_id, it.agent_ms, it.cause, it.reason, it.gave_up) for it in died] == [
        (8, 300_000, ResetCause.BROWN_OUT, "its firmware failed; see nursery.log", None)
    ]
    mine = [truth for truth in host.take_truths() if truth.agent_id == 8]
    assert [(truth.at_ms, truth.state) for truth in mine] == [
        (300_000, State.BOOTING),
        (302_000, State.CHARGING),
    ]
    assert all(truth.physical == before.physical for truth in mine)
    assert [children(host.pids[it]) for it in (3, 21)] == [[boards[3]], [boards[21]]]


def test_a_firmware_ends_with_its_agent(host: ProcessHost) -> None:
    _, boards = flying(host)
    kill_9(host.pids[3])
    assert gone(boards[3])


def test_a_firmware_has_its_port_and_nothing_else_of_its_agent(host: ProcessHost) -> None:
    _, boards = flying(host)
    for pid in boards.values():
        assert sorted(os.listdir(f"/proc/{pid}/fd")) == ["0", "1", "2", "3"]


def test_firmware_ends_with_the_nursery(host: ProcessHost) -> None:
    _, boards = flying(host)
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
    assert len(left) == len(IDS) and all(is_board(it, "sleep") for it in left)
    # Its parent's death, and its own, are no agent's.
    kill_9(children(host.pids[3])[0])
    kill_9(left[0])
    assert [it.agent_id for it in clock.advance(20_000) if isinstance(it, AgentDied)] == [3]
    host.close()
    left += list(map(int, (tmp_path / "left").read_text().split()))
    assert all(gone(it) for it in left)
    assert "ended 3 processes that firmware had left behind" in (tmp_path / "nursery.log").read_text()


def test_firmware_gets_no_more_rights_and_looks_into_no_agent(tmp_path: Path, board: Path) -> None:
    """The kernel gives the files of a process that none but root may trace to root: here they are told by their group."""
    if is_root := os.getuid() == 0:
        os.setresgid(OTHERS, OTHERS, OTHERS)
    try:
        host = started(tmp_path, board)
    finally:
        if is_root:
            os.setresgid(0, 0, 0)
    _, boards = flying(host)
    for pid in boards.values():
        assert "NoNewPrivs:\t1\n" in Path(f"/proc/{pid}/status").read_text()
        assert os.stat(f"/proc/{pid}/mem").st_gid != 0
    assert [os.stat(f"/proc/{pid}/mem").st_gid for pid in (host.nursery_pid, *host.pids.values())] == [0] * 4
    host.close()


def test_a_firmware_that_hangs_stays_dead_and_the_others_fly_on(host: ProcessHost) -> None:
    """A stopped process cannot be told from one that hangs, or from a host that is too slow for its fleet."""
    clock, boards = flying(host)
    os.kill(boards[21], signal.SIGSTOP)
    clock.receive(21, command(Kind.PERMISSION, 21), 11_000)
    came = clock.advance(12_000)
    (died,) = [it for it in came if isinstance(it, AgentDied)]
    assert (died.agent_id, died.reason) == (21, "its firmware hung; see nursery.log")
    assert died.gave_up == "aMussel 21: its firmware hangs, so it stays dead; see nursery.log"
    assert gone(boards[21])
    heard = {it.agent_id for it in clock.advance(20_000) if isinstance(it, Output)}
    assert heard == {3, 8}


FLIGHTS = {
    "C": ("pool-12", "worst_case", 600, 40),
    "Perl": ("pool-12", "worst_case.pl", 600, 40),
    "C, whole": ("whole-board-12", "whole_board", 3600, 1000),
    "C, failing parts": ("pool-12", "worst_case", 600, 40),
    "C, whole, failing parts": ("whole-board-12", "whole_board", 1800, 400),
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
    data = yaml.safe_load(SCENARIO.with_stem(scenario).read_text())
    data["duration_s"] = duration_s
    if name.endswith("failing parts"):
        data["faults"] = {
            "at": [
                {"fault": fault, "id": (2 * n + k) % 12 + 1, "at_s": 60 + 20 * n, "for_s": 400}
                for n, fault in enumerate(FAILING_PARTS)
                for k in (0, 1)
            ]
        }
    shutil.copy(SCENARIO.with_suffix(".csv"), tmp_path)
    perl = program.endswith(".pl")
    shutil.copy(NATIVE / program if perl else compiled(tmp_path_factory, program), tmp_path / "board")
    ours, native = journals(tmp_path, data)
    assert native == ours
    assert sum(json.loads(it)["kind"] == "truth" for it in ours.splitlines()) > least_truths
    samples = [
        path.read_bytes() if (path := tmp_path / it / "samples.jsonl").exists() else b""
        for it in ("ours", "native")
    ]
    assert samples[0] == samples[1]
    assert bool(samples[1]) == name.startswith("C, whole")


def journals(directory: Path, data: dict[str, Any], site: Path | None = None) -> Iterator[bytes]:
    """The journals of this scenario with our boards, and with `board` in the directory; `site` has further packages."""
    path = (
        {} if site is None else {"PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}
    )
    for run_name, firmware in (("ours", None), ("native", {"executable": "board"})):
        data["fleet"]["firmware"] = firmware
        (directory / f"{run_name}.yaml").write_text(yaml.safe_dump(data))
        out = directory / run_name
        run = [sys.executable, str(MUSSELBED), "run", str(directory / f"{run_name}.yaml"), "--time", "asap"]
        subprocess.run(
            [*run, "--out", str(out)],
            check=True,
            timeout=PATIENCE_S,
            capture_output=True,
            env={**os.environ, **path},
        )
        yield (out / "journal.jsonl").read_bytes()


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
    install_template(tmp_path / "site", "codec")
    shutil.copy(SCENARIO.with_suffix(".csv"), tmp_path)
    data = yaml.safe_load(SCENARIO.read_text())
    data["duration_s"] = 600
    data.setdefault("hearing", {})["codec"] = "lines"
    ours, native = journals(tmp_path, data, tmp_path / "site")
    assert native == ours
    states = {it.get("state") for it in map(json.loads, native.splitlines()) if it["kind"] == "truth"}
    assert {"SURFACING", "CHARGING", "SINKING"} <= states


def test_a_flight_over_ros_has_the_journal_of_our_boards(tmp_path: Path, board: Path) -> None:
    """All events of three minutes, but for the aPad's own battery, whose messages come when its node sends them."""
    data = yaml.safe_load(SCENARIO.read_text())
    data["duration_s"] = 180
    shutil.copy(SCENARIO.with_suffix(".csv"), tmp_path)
    shutil.copy(board, tmp_path / "board")
    flown = []
    for run_name, firmware in (("ours", None), ("native", "board")):
        data["fleet"]["firmware"] = firmware
        (tmp_path / f"{run_name}.yaml").write_text(yaml.safe_dump(data))
        out = tmp_path / run_name
        run = [sys.executable, str(MUSSELBED), "run", str(tmp_path / f"{run_name}.yaml"), "--speed", "40"]
        subprocess.run(
            [*run, "--json", "--out", str(out)], check=True, timeout=PATIENCE_S, capture_output=True
        )
        flown.append([it for it in lines(out) if it["kind"] != "apad"])
    ours, native = flown
    assert native == ours
    assert sum(it["kind"] == "truth" for it in ours) > 15


def descendants(pid: int) -> list[int]:
    with suppress(FileNotFoundError):
        return [it for child in children(pid) for it in (child, *descendants(child))]
    return []


def is_board(pid: int, program: str) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/comm").read_text().strip() == program
    return False


def running(program: Path) -> list[int]:
    """The processes of this program: a nursery that another supervisor started is no descendant of the run."""
    found = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdigit() and (entry / "exe").readlink() == program:
                found.append(int(entry.name))
    return sorted(found)


def parent_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


@pytest.mark.parametrize("order", [("board", "supervisor", "agent"), ("agent", "board", "supervisor")])
def test_whatever_is_killed_over_ros_nothing_is_lost(
    tmp_path: Path, board: Path, order: tuple[str, ...]
) -> None:
    """kill -9 of a board's firmware, of another's agent, of the supervisor and at last of the nursery, in one flight.

    The run's own check replays its stimuli on our boards: the states of all aMussels are those that it recorded.
    """
    data = yaml.safe_load(SCENARIO.read_text())
    data["duration_s"] = 900
    shutil.copy(SCENARIO.with_suffix(".csv"), tmp_path)
    shutil.copy(board, tmp_path / "c_board")
    data["fleet"]["firmware"] = "c_board"
    (tmp_path / "pool.yaml").write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    run = [sys.executable, str(MUSSELBED), "run", str(tmp_path / "pool.yaml"), "--speed", "10", "--json"]
    with subprocess.Popen(
        [*run, "--out", str(out), "--on-supervisor-death", "resume"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        fly_on(process, out)
        boards = sorted(it for it in descendants(process.pid) if is_board(it, "c_board"))
        assert len(boards) == 12
        agents = [parent_of(it) for it in boards]
        (nursery,) = {parent_of(it) for it in agents}
        victims = {"board": lambda: boards[2], "agent": lambda: agents[7]}
        for what in order:
            kill_9(victims[what]() if what in victims else pid_of_supervisor(out))
            fly_on(process, out)
        died = [it for it in lines(out) if it["kind"] == "died"]
        assert sorted(it["cause"] for it in died) == ["BROWN_OUT", "BROWN_OUT"], died
        assert len({it["id"] for it in died}) == 2
        left = {it for it in descendants(process.pid) if is_board(it, "c_board")}
        assert len(left) == 12 and len(left & set(boards)) == 10
        kill_9(nursery)
        fly_on(process, out)
        process.send_signal(signal.SIGINT)
        _, mistakes = process.communicate(timeout=PATIENCE_S)
    assert check_run(RunDirectory.open(out)) == [], mistakes


def test_random_kills_over_ros_lose_nothing_of_whole_boards(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Five kill -9 in a random order; each kill of a firmware or of an agent leaves the other eleven as they are."""
    rng = random.Random(KILLS_SEED)
    data = yaml.safe_load(SCENARIO.with_stem("whole-board-12").read_text())
    data["duration_s"] = 1800
    shutil.copy(SCENARIO.with_suffix(".csv"), tmp_path)
    shutil.copy(compiled(tmp_path_factory, "whole_board"), tmp_path / "whole_c")
    data["fleet"]["firmware"] = "whole_c"
    (tmp_path / "whole.yaml").write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    run = [sys.executable, str(MUSSELBED), "run", str(tmp_path / "whole.yaml"), "--speed", "20", "--json"]
    order = ["firmware", "agent", "nursery", "supervisor", rng.choice(["firmware", "agent", "nursery"])]
    rng.shuffle(order)
    with subprocess.Popen(
        [*run, "--out", str(out), "--on-supervisor-death", "resume"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        fly_on(process, out)
        for what in order:
            boards = running(tmp_path / "whole_c")
            assert len(boards) == 12, (order, what)
            victim = rng.choice(boards)
            (nursery,) = {parent_of(parent_of(it)) for it in boards}
            victims = {"firmware": victim, "agent": parent_of(victim), "nursery": nursery}
            kill_9(victims[what] if what in victims else pid_of_supervisor(out))
            fly_on(process, out)
            left = set(running(tmp_path / "whole_c"))
            undisturbed = {"firmware": 11, "agent": 11, "nursery": 0, "supervisor": 12}[what]
            assert len(left) == 12 and len(left & set(boards)) == undisturbed, (order, what)
        process.send_signal(signal.SIGINT)
        _, mistakes = process.communicate(timeout=PATIENCE_S)
    assert check_run(RunDirectory.open(out)) == [], mistakes


def lines(out: Path) -> list[dict[str, Any]]:
    path = out / "journal.jsonl"
    text = path.read_text() if path.exists() else ""
    return [json.loads(it) for it in text.splitlines() if it.endswith("}")]


def fly_on(process: subprocess.Popen[str], out: Path) -> None:
    """Returns once the flight has gone on for 15 s of mission time; it ends a test whose run has ended."""
    goal_ms = last_ms(out) + 15_000
    until_s = time.monotonic() + PATIENCE_S
    while last_ms(out) < goal_ms:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until_s, lines(out)[-3:]
        select.select([], [], [], 0.1)


def last_ms(out: Path) -> int:
    return max((it["t"] for it in lines(out)), default=0)

"""Mixed fleets: boards with our firmware, with a C program, and a real board on a serial line."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from fleets import PAPER
from killing import kill_9
from native_boards import compiled
from serial_rigs import SerialRig, compiled_for_serial

from agents.coordinator import AgentDied, Coordinator
from agents.fleet import FirmwareConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import ContactClosed, ContactOpened, SoundArrived
from agents.nursery.fleet_file import RestartPolicy
from agents.time_scale import TimeScale
from apad_bridge.commands.main import main
from firmware_model.bench.conformance import Case
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES
from firmware_model.packets import CommandPacket, Kind

pytestmark = pytest.mark.system

OURS, C, SERIAL = 3, 8, 21
IDS = (OURS, C, SERIAL)
PATIENCE_S = 180.0
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
MUSSELBED = Path(__file__).parents[2] / "launch_scripts" / "musselbed"


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return compiled(tmp_path_factory), compiled_for_serial(tmp_path_factory)


@pytest.fixture
def rig(programs: tuple[Path, Path], tmp_path: Path) -> Iterator[SerialRig]:
    rig = SerialRig(programs[1], tmp_path / "ttyUSB0")
    yield rig
    rig.close()


@pytest.fixture
def host(programs: tuple[Path, Path], rig: SerialRig, tmp_path: Path) -> Iterator[ProcessHost]:
    firmware = (
        FirmwareConfig((str(programs[0]),), (C,)),
        FirmwareConfig((f"serial:{rig.device}",), (SERIAL,)),
    )
    (tmp_path / "run").mkdir()
    host = ProcessHost.start(
        tmp_path / "run",
        replace(PAPER, theta=1, firmware=firmware),
        BIRTHS,
        window_timeout_s=PATIENCE_S,
        restart_policy=RestartPolicy(restarts=1000),
    )
    yield host
    host.close()


def fly(
    host: InProcessHost | ProcessHost, until_s: int
) -> tuple[list[Output | AgentDied], list[Truth], Coordinator]:
    """A permission for each aMussel, a dock for each, and again the water; the agents of two are killed."""
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(1))
    came: list[Output | AgentDied] = []
    told: list[Truth] = []
    for now_s in range(0, until_s, 10):
        for n, agent_id in enumerate(IDS):
            if now_s == 30 + 10 * n:
                clock.receive(
                    agent_id, SoundArrived(CommandPacket(Kind.PERMISSION, agent_id).encode()), 1000 * now_s
                )
            if now_s == 400 + 30 * n:
                clock.receive(agent_id, ContactClosed(1, 2), 1000 * now_s)
            if now_s == 900:
                clock.receive(agent_id, ContactOpened(), 1000 * now_s)
        if now_s in (100, 600):
            for agent_id in (C, SERIAL):
                if isinstance(host, InProcessHost):
                    host.kill(agent_id)
                else:
                    kill_9(host.pids[agent_id])
        came += clock.advance(1000 * now_s)
        told += host.take_truths()
    return came, told, clock


def test_a_mixed_fleet_gives_the_trace_of_ours(host: ProcessHost) -> None:
    expected = fly(InProcessHost(replace(PAPER, theta=1), BIRTHS), 1200)[:2]
    assert fly(host, 1200)[:2] == expected
    assert {it.agent_id for it in expected[0] if isinstance(it, AgentDied)} == {C, SERIAL}


def test_a_board_that_resets_by_itself_boots_and_nobody_else_notices(
    host: ProcessHost, rig: SerialRig
) -> None:
    _, _, clock = fly(host, 60)
    rig.reset()
    died = [it for it in clock.advance(300_000) if isinstance(it, AgentDied)]
    assert [(it.agent_id, it.reason, it.gave_up) for it in died] == [
        (SERIAL, "its firmware failed; see nursery.log", None)
    ]


def test_a_board_whose_cable_stays_out_stays_dead_and_the_others_fly_on(
    host: ProcessHost, rig: SerialRig
) -> None:
    _, _, clock = fly(host, 60)
    rig.pull_out()
    came = clock.advance(300_000)
    (died,) = [it for it in came if isinstance(it, AgentDied)]
    assert (died.agent_id, died.reason) == (SERIAL, "its firmware hung; see nursery.log")
    assert died.gave_up is not None
    assert {it.agent_id for it in clock.advance(600_000) if isinstance(it, Output)} == {OURS, C}


def test_a_real_board_runs_as_a_program_does(programs: tuple[Path, Path], rig: SerialRig) -> None:
    """It answers each turn at once, so hours of its time take seconds."""
    shown = [
        subprocess.run(
            [sys.executable, str(MUSSELBED), "mu", "run", firmware],
            timeout=PATIENCE_S,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for firmware in (str(programs[0]), f"serial:{rig.device}")
    ]
    assert shown[0] == shown[1]


def test_a_real_board_passes_its_cases(rig: SerialRig, capsys: pytest.CaptureFixture[str]) -> None:
    """Every third case: the same board as a program passes all of them, and the line alone is another."""
    assert passed([f"serial:{rig.device}"], CASES[::3], capsys) > 40


def test_a_real_whole_board_passes_its_cases(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = SerialRig(compiled_for_serial(tmp_path_factory, is_whole=True), tmp_path / "ttyUSB0")
    try:
        assert passed([f"serial:{rig.device}", "--profile", "mu"], WHOLE_CASES[::3], capsys) > 80
    finally:
        rig.close()


def passed(board: list[str], cases: Sequence[Case], capsys: pytest.CaptureFixture[str]) -> int:
    """The number of these cases, all of which the board passes."""
    chosen = [word for it in cases for word in ("--case", it.name)]
    assert main(["mu", "conform", *board, *chosen, "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert len(results) == len(cases)
    assert {it["verdict"] for it in results} == {"passed"}
    return len(results)

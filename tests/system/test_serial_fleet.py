"""Mixed fleets: boards with our firmware, with a C program, and a real board on a serial line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from fleets import KILL, PAPER, Story, deaths, fly, heard
from native_boards import compiled
from programs import code_here
from serial_rigs import SerialRig, compiled_for_serial

from agents.coordinator import Coordinator
from agents.fleet_config import FirmwareConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.stimuli import ContactClosed, ContactOpened, SoundArrived
from agents.nursery.fleet_file import RestartPolicy
from agents.time_scale import TimeScale
from firmware_model.bench.conformance import Case
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES
from firmware_model.packets import CommandPacket, Kind

pytestmark = pytest.mark.system

OURS, C, SERIAL = 3, 8, 21
IDS = (OURS, C, SERIAL)
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return compiled(tmp_path_factory), compiled_for_serial(tmp_path_factory)


@pytest.fixture
def rig(programs: tuple[Path, Path], tmp_path: Path) -> Iterator[SerialRig]:
    with closing(SerialRig(programs[1], tmp_path / "ttyUSB0")) as rig:
        yield rig


@pytest.fixture
def host(programs: tuple[Path, Path], rig: SerialRig, tmp_path: Path) -> Iterator[ProcessHost]:
    firmware = (
        FirmwareConfig((str(programs[0]),), (C,)),
        FirmwareConfig((f"serial:{rig.device}",), (SERIAL,)),
    )
    (tmp_path / "run").mkdir()
    fleet, policy = replace(PAPER, theta=1, firmware=firmware), RestartPolicy(restarts=1000)
    run = tmp_path / "run"
    with closing(
        ProcessHost.start(run, fleet, BIRTHS, window_timeout_s=180.0, restart_policy=policy)
    ) as host:
        yield host


def story(until_s: int) -> tuple[Story, list[int]]:
    """In windows of 10 s: a permission and a dock for each aMussel, and again the water; the agents of two are killed."""
    told: Story = [(it, agent_id, KILL) for it in (10, 60) for agent_id in (C, SERIAL)]
    for n, agent_id in enumerate(IDS):
        permission = SoundArrived(CommandPacket(Kind.PERMISSION, agent_id).encode())
        told += [(3 + n, agent_id, permission), (40 + 3 * n, agent_id, ContactClosed(1, 2))]
        told.append((90, agent_id, ContactOpened()))
    return sorted(told, key=lambda it: it[0]), [10_000] * (until_s // 10 - 1)


def test_a_mixed_fleet_gives_the_trace_of_ours(host: ProcessHost) -> None:
    expected = fly(InProcessHost(replace(PAPER, theta=1), BIRTHS), IDS, *story(1200), theta=1)
    assert fly(host, IDS, *story(1200), theta=1) == expected
    assert {it.agent_id for it in deaths(expected[0])} == {C, SERIAL}


def test_a_board_that_resets_boots_and_one_whose_cable_stays_out_stays_dead_and_nobody_else_notices(
    host: ProcessHost, rig: SerialRig
) -> None:
    clock = Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(1))
    clock.advance(60_000)
    rig.reset()
    died = [(it.agent_id, it.reason, it.gave_up) for it in deaths(clock.advance(300_000))]
    assert died == [(SERIAL, "its firmware failed; see nursery.log", None)]
    rig.pull_out()
    (gone,) = deaths(clock.advance(600_000))
    assert (gone.agent_id, gone.reason) == (SERIAL, "its firmware hung; see nursery.log")
    assert gone.gave_up is not None
    assert set(heard(clock.advance(900_000))) == {OURS, C}


@pytest.mark.parametrize(("is_whole", "cases"), [(False, CASES[::5]), (True, WHOLE_CASES[::12])])
def test_a_real_board_passes_its_cases(
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
    is_whole: bool,
    cases: Sequence[Case],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Some of them: the same board as a program passes all, and the line alone is another."""
    rig = SerialRig(compiled_for_serial(tmp_path_factory, is_whole=is_whole), tmp_path / "ttyUSB0")
    with closing(rig):
        chosen = [word for it in cases for word in ("--case", it.name)]
        profile = ("--profile", "mu") if is_whole else ()
        assert code_here("mu", "conform", f"serial:{rig.device}", *profile, *chosen, "--json") == 0
    results = json.loads(capsys.readouterr().out)
    assert len(results) == len(cases) > 20 and {it["verdict"] for it in results} == {"passed"}

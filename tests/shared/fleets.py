"""The fleet from which tests start, each of which changes what it needs; and a story that a fleet lives through."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from killing import kill_9

from agents.coordinator import AgentDied, Coordinator
from agents.fleet_config import FleetConfig
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.body import BodyConfig
from agents.mussel.outputs import Output, Truth
from agents.mussel.reporter import ReportConfig
from agents.mussel.stimuli import AgentStimulus, SoundArrived
from agents.time_scale import MissionMs, TimeScale
from firmware_model.config import BoardConfig, FullFirmware
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.sinking import Sinking
from firmware_model.table_one import MODEL, WORST_CASE

PAPER = FleetConfig(
    theta=30,
    seed=5,
    codec="musselbed-1",
    board=BoardConfig(
        agent_id=0,
        charge=WORST_CASE,
        pin_debounce_ms=50,
        boot_ms=2000,
        float_timeout_ms=600_000,
        release_wait_ms=120_000,
    ),
    body=BodyConfig(Sinking(3_000_000, 60_000, 45_000), drifts_always=True, drift_amplitude_um=5000),
    reports=ReportConfig(30_000, heard_always=True),
)
"""The worst case, with the paper's reception and drift."""
STILL = replace(
    PAPER,
    body=replace(PAPER.body, drifts_always=False, drift_amplitude_um=0),
    reports=replace(PAPER.reports, heard_always=False),
)
"""The same in still water, with aMussels that are not always heard."""


def with_whole_boards(fleet: FleetConfig, whole: FullFirmware) -> FleetConfig:
    """The fleet with whole boards, on their batteries."""
    return replace(fleet, board=replace(fleet.board, charge=MODEL, whole=whole))


def reporting_every(fleet: FleetConfig, period_ms: int) -> FleetConfig:
    return replace(fleet, reports=replace(fleet.reports, period_ms=period_ms))


Story = list[tuple[int, int, AgentStimulus | str]]
"""(window, aMussel, what happens before that window); a text is a kill of its process."""
KILL = "kill"


def command(kind: Kind, agent_id: int) -> SoundArrived:
    return SoundArrived(MusselbedCodec().encode(CommandPacket(kind, agent_id)))


def fly(
    host: InProcessHost | ProcessHost,
    ids: Iterable[int],
    story: Story,
    steps_ms: Sequence[int],
    theta: int = PAPER.theta,
) -> tuple[list[Output | AgentDied], list[Truth]]:
    """All that came of windows of these lengths, after one of none. A process is killed as kill -9 does."""
    clock = Coordinator(host, dict.fromkeys(ids, 0), TimeScale(theta))
    came: list[Output | AgentDied] = []
    told: list[Truth] = []
    now_ms = 0
    for step, length_ms in enumerate([0, *steps_ms]):
        now_ms += length_ms
        for _, agent_id, event in (entry for entry in story if entry[0] == step):
            if not isinstance(event, str):
                clock.receive(agent_id, event, MissionMs(now_ms))
            elif isinstance(host, InProcessHost):
                host.kill(agent_id)
            elif agent_id in host.pids:
                kill_9(host.pids[agent_id])  # perhaps killed before, and not granted since
        came += clock.advance(MissionMs(now_ms))
        told += host.take_truths()
    return came, told


def deaths(came: Iterable[object]) -> list[AgentDied]:
    return [it for it in came if isinstance(it, AgentDied)]


def heard(came: Iterable[object]) -> list[int]:
    """The senders of what came over the air, in ascending order."""
    return sorted(it.agent_id for it in came if isinstance(it, Output))

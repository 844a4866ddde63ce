"""A trial walk of an agent through its states, which the nursery plays before it forks.

Python specialises code and fills caches as it runs, which copies pages that a forked agent would otherwise share. After
the walk every path of an agent has run, so that all agents share the result. The walk needs no list of paths: in each
state that it comes to, it tries every command and every stimulus, and then waits for what is due.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from agents.fleet_config import AgentConfigs, resting_on_bottom
from agents.hosting.agent_loop import WindowHandler, answer_one, message_buffer
from agents.hosting.host import Grant
from agents.hosting.link_protocol import NEVER, Key, Repeat, WindowGrant
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.stimuli import (
    AgentStimulus,
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    DockMoved,
    ModemSent,
    PingArrived,
    Placed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from agents.nursery.flash_file import FlashRegion
from agents.nursery.state_file import RecordRing
from firmware_model import stimuli as board_stimuli
from firmware_model.board import Board
from firmware_model.packets import PLAIN, CommandPacket, Packet
from firmware_model.packets.codec import Codec
from firmware_model.packets.command_packets import WITH_ARGUMENTS
from firmware_model.packets.wire import HEAD
from firmware_model.power.charge import FULL, Battery, Flow
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

if TYPE_CHECKING:
    from firmware_model.hardware.worst_case import WorstCaseHardware
    from firmware_model.port import FirmwareLike

_LIVES = 12
"""The interpreter specialises a function after eight calls."""
_VISITS = 15
"""States that a life comes to."""
_SELDOM_MS = 86_400_000
"""The period of reports and drift in the walk: real ones would make most of its work."""
_TURN_S = 1.0
_PAUSE_MS = 1000
"""The time between two stimuli; the charger's pin settles in it."""
_NUMBERS = ((0, 0), (1, 0), (3_600_000, 6), (2**64 - 1, 0))
"""Arguments of a command: the first number, and by how many bits each next one is smaller. A falling row suits a sleep
schedule, which wakes for less than its period, and a timeslot, which is shorter than its frame."""


def warm_up(configs: AgentConfigs, codec: Codec, agent_id: int) -> None:
    """Runs an agent through all states that its configuration lets it reach, with refusals and restarts."""
    config = configs.config(agent_id)
    water = replace(config.water, step_ms=_SELDOM_MS)
    reports = replace(config.reports, period_ms=_SELDOM_MS)
    walk = _Walk(replace(config, reports=reports, water=water, firmware=()), codec)
    for epoch in range(1, _LIVES + 1):
        walk.live(epoch)
    walk.close()


def warm_up_port(config: AgentConfig, codec: Codec) -> None:
    """Runs a board whose firmware is in a process of its own, up to the link, whose other end answers here.

    Without it each agent would import and specialise that code after the fork, in memory of its own.
    """
    # Imported here: most fleets have no firmware but ours.
    from agents.mussel.port.firmware_process import FirmwareChild, FirmwareProcess
    from agents.mussel.port.port_firmware import PortFirmware
    from agents.nursery.answering_board import AnsweringBoard

    def firmware(hardware: WorstCaseHardware) -> FirmwareLike:
        return PortFirmware(
            lambda: FirmwareProcess(AnsweringBoard(), _TURN_S), config.board, hardware, config.water.seed
        )

    battery = Battery(0, FULL // 2, Flow.DISCHARGING)
    stimuli: tuple[board_stimuli.Stimulus, ...] = (
        board_stimuli.ChargePinRose(),
        board_stimuli.SurfaceReached(),
        board_stimuli.PacketHeard(b"wrong"),
        board_stimuli.ChargePinFell(),
        board_stimuli.WifiReceived(b"wrong"),
    )
    for _ in range(_LIVES):
        board = Board(config.board, codec, battery, battery, 0, firmware=firmware)
        board.receive(board_stimuli.PowerCameOn(ResetCause.POWER_ON, False, False), 0)
        for n, stimulus in enumerate(stimuli, start=1):
            board.receive(stimulus, n * _PAUSE_MS)
        board.advance((len(stimuli) + 1) * _PAUSE_MS)
        # The start of a process is warmed by one that ends at once.
        FirmwareChild(("/bin/true",)).end()


class _Walk:
    """One agent behind its link, all of whose files and sockets lead nowhere."""

    def __init__(self, config: AgentConfig, codec: Codec) -> None:
        self._config = config
        self._codec = codec
        self._records_fd, self._flash_fd = os.memfd_create("warm-up"), os.memfd_create("warm-up")
        self._truth_out, self._truth_in = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._supervisor, self._link = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._buffer = message_buffer()
        self._ring = RecordRing(self._records_fd, 0, config.board.agent_id)
        self._ring.initial_state(resting_on_bottom(0.0, 0.0, _bottom_um(config) / 1e6, 0.5, 1.0))
        self._stimuli = list(_stimuli(config, codec))
        self._visits = dict.fromkeys(State, 0)
        self._turns = dict.fromkeys(State, 0)
        """The index of each state's next stimulus: a state takes all of them in turn."""

    def close(self) -> None:
        self._buffer.release()
        for sock in (self._truth_out, self._truth_in, self._supervisor, self._link):
            sock.close()
        os.close(self._records_fd)
        os.close(self._flash_fd)

    def live(self, epoch: int) -> None:
        """Restarts the agent from its record, as the supervisor of that epoch, and lets it visit states."""
        record = self._ring.newest((epoch, 0))
        assert record is not None
        flash = FlashRegion(self._flash_fd, 0, 3)
        flash.roll_back(record.physical.samples)
        cause = ResetCause.POWER_ON if epoch == 1 else ResetCause.BROWN_OUT
        self._agent = Agent(self._config, self._codec, record.physical, record.granted_ms, cause, flash)
        self._handler = WindowHandler(self._agent, self._ring, self._truth_in, record.key, record.granted_ms)
        self._now_ms = record.granted_ms
        self._key: Key = (epoch, 0)
        self._ask(Repeat(self._key).encode())
        for _ in range(_VISITS):
            self._visit()
        for wrong in (b"wrong", WindowGrant(NEVER, Grant(0)).encode(), Repeat((epoch, 1)).encode()):
            self._ask(wrong)

    def _visit(self) -> None:
        """Waits for the next due time; at each third visit of a state, sends stimuli until one of them ends the state."""
        agent, state = self._agent, self._agent.board.state
        self._visits[state] += 1
        if self._visits[state] % 3 == 0:
            for _ in self._stimuli:
                stimulus = self._stimuli[self._turns[state] % len(self._stimuli)]
                self._turns[state] += 1
                self._grant(self._now_ms + _PAUSE_MS, stimulus)
                if agent.board.state is not state:
                    return
        self._grant(agent.next_due_ms or self._now_ms)

    def _grant(self, until_ms: int, *stimuli: AgentStimulus) -> None:
        epoch, sequence = self._key
        self._key = epoch, sequence + 1
        facts = tuple((self._now_ms, stimulus) for stimulus in stimuli)
        self._now_ms = max(self._now_ms, until_ms)
        self._ask(WindowGrant(self._key, Grant(self._now_ms, facts)).encode())

    def _ask(self, message: bytes) -> None:
        self._supervisor.send(message)
        answer_one(self._link, self._buffer, self._handler)
        for end in (self._supervisor, self._truth_out):
            with suppress(BlockingIOError):
                while end.recv(1, socket.MSG_DONTWAIT):
                    pass


def _bottom_um(config: AgentConfig) -> int:
    return config.water.body.sinking.bottom_um


def _stimuli(config: AgentConfig, codec: Codec) -> Iterator[AgentStimulus]:
    bottom_um = _bottom_um(config)
    yield from (ContactClosed(0, 0), DockMoved(1, 1), CoilSlipped(), ContactOpened())
    yield from (PingArrived(1), ModemSent(100), SoundArrived(b"wrong"), WifiArrived(b"wrong"))
    for data in _commands(codec, config.board.agent_id):
        yield from (SoundArrived(data), WifiArrived(data))
    for primary, secondary in ((FULL // 2, FULL), (0, FULL), (0, FULL // 20), (0, 0)):
        yield Placed(0, 0, bottom_um, primary, secondary)
    yield WasReset(ResetCause.WATCHDOG)


def _commands(codec: Codec, agent_id: int) -> Iterator[bytes]:
    """Every command of the firmware's packet tables, with numbers that can be obeyed and numbers that cannot."""
    packets: list[Packet | None] = [CommandPacket(kind, agent_id) for kind in sorted(PLAIN)]
    for command in WITH_ARGUMENTS:
        head = HEAD.pack(command.VERSION, command.kind, agent_id)
        sizes = [struct.calcsize(f"<{code}") for code in command.FORMAT.format[len(HEAD.format) :]]
        for first, shift in _NUMBERS:
            numbers = [(first >> shift * n).to_bytes(8, "little") for n in range(len(sizes))]
            arguments = [number[:size] for number, size in zip(numbers, sizes, strict=True)]
            packets.append(command.decode_body(b"".join([head, *arguments])))
    for packet in packets:
        if packet is None:
            continue
        try:
            data = codec.encode(packet)
        except Exception:  # a laboratory's codec may not know every command
            continue
        yield data

"""The nursery's walk of an agent tries every command, and comes to every state that the board can reach."""

from __future__ import annotations

import gc
import os
from dataclasses import replace

import pytest
from fleets import PAPER, with_whole_boards
from seas import FLEET

from agents.fleet_config import FleetConfig
from agents.mussel.agent import Agent
from agents.mussel.outputs import Truth
from agents.mussel.port.firmware_process import FirmwareProcess
from agents.mussel.port.port_firmware import PortFirmware
from agents.nursery import warm_up
from agents.nursery.answering_board import AnsweringBoard
from firmware_model.actions import Dropped, RunBuoyancy, SendBytes, StateReported
from firmware_model.bench import Bench
from firmware_model.config import LastResort, Timekeeping, Timeslots
from firmware_model.packets import PLAIN, Packet
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.command_packets import WITH_ARGUMENTS
from firmware_model.states import State
from firmware_model.table_one import FIELD, power, worst_case_board

WHOLE = with_whole_boards(
    FLEET,
    replace(
        FLEET.board.whole,
        power=power(LastResort.CALL),
        cycle=replace(FIELD, slots=Timeslots(300_000, 1000, guard_ms=100)),
        timekeeping=Timekeeping(20_000, 60_000),
    ),
)
WORST_CASE_STATES = {
    State.BOOTING,
    State.ACTIVE,
    State.SURFACING,
    State.FLOATING,
    State.CHARGING,
    State.RELEASED,
    State.SINKING,
    State.EMPTY,
}


class Recording(MusselbedCodec):
    """Notes which commands a board reads."""

    def __init__(self) -> None:
        self.kinds: set[object] = set()

    def decode(self, data: bytes) -> Packet | None:
        packet = super().decode(data)
        self.kinds.add(getattr(packet, "kind", None))
        return packet


class Ignorant(MusselbedCodec):
    """A laboratory's codec that has no commands."""

    def encode(self, packet: Packet) -> bytes:
        if hasattr(packet, "kind"):
            raise KeyError(packet.kind)
        return super().encode(packet)


@pytest.mark.parametrize(
    ("fleet", "states"),
    [(PAPER, WORST_CASE_STATES), (WHOLE, set(State) - {State.OFF})],
    ids=["worst", "whole"],
)
def test_it_reads_every_command_and_comes_to_every_state(
    fleet: FleetConfig, states: set[State], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: set[State] = set()

    class Watched(Agent):
        def take_truths(self) -> list[Truth]:
            truths = super().take_truths()
            seen.update(truth.state for truth in truths)
            return truths

    monkeypatch.setattr(warm_up, "Agent", Watched)
    codec = Recording()
    warm_up.warm_up(fleet.maker(), codec, 1)
    assert codec.kinds == {None, *PLAIN, *(command.kind for command in WITH_ARGUMENTS)}
    assert seen == states


def test_a_codec_without_commands_does_not_stop_the_nursery() -> None:
    warm_up.warm_up(PAPER.maker(), Ignorant(), 1)


def test_each_turn_of_the_answering_board_has_every_frame_that_a_board_may_send() -> None:
    config = worst_case_board()
    bench = Bench(
        config,
        firmware=lambda hardware: PortFirmware(
            lambda: FirmwareProcess(AnsweringBoard(), 1.0), config, hardware, seed=1
        ),
    )
    bench.run(ms=1500)
    for kind, times in ((StateReported, 4), (RunBuoyancy, 6), (SendBytes, 3), (Dropped, 3)):
        assert (
            len(bench.did(kind)) == times
        )  # three turns: at the reset, which is a state itself, after 700 ms and 1400 ms


def test_a_fleet_with_programs_is_warmed_up_to_their_links() -> None:
    """Each life ends all that it began: no process and no descriptor is left to the agents."""
    gc.collect()  # what other tests left is not counted
    before = len(os.listdir("/proc/self/fd"))
    warm_up.warm_up_port(PAPER.maker().config(1), MusselbedCodec())
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) == before
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)

"""The nursery's walk of an agent tries every command, and comes to every state that the board can reach."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fleets import PAPER, with_whole_boards
from seas import FLEET

from agents.fleet import FleetConfig
from agents.mussel.agent import Agent
from agents.mussel.outputs import Truth
from agents.nursery import warm_up
from firmware_model.config import LastResort, Timekeeping, Timeslots
from firmware_model.packets import PLAIN_KINDS, Packet
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.command_packets import WITH_ARGUMENTS
from firmware_model.states import State
from firmware_model.table_one import FIELD, power

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
    assert codec.kinds == {None, *PLAIN_KINDS, *(command.KIND for command in WITH_ARGUMENTS)}
    assert seen == states


def test_a_codec_without_commands_does_not_stop_the_nursery() -> None:
    warm_up.warm_up(PAPER.maker(), Ignorant(), 1)

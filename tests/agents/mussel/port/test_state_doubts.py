"""Firmware whose states contradict its board is told once; firmware that tells the truth is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from fleets import STILL
from native_boards import NATIVE, compiled, compiled_with

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.outputs import Output, StateDoubted, from_wire, to_wire
from agents.mussel.stimuli import BuoyancyJammed, ContactClosed, ContactOpened, SoundArrived, WifiArrived
from firmware_model.config import BoardConfig
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, board, power, worst_case_board

HOUR_MS = 3_600_000
TOLD = "mu_state((uint8_t)board.state)"
IN_THE_PAGES_ORDER = "mu_state((const uint8_t[]){0, 1, 2, 9, 10, 12, 13, 14, 16}[board.state])"
"""SURFACING told as 9, FLOATING as 10: an order in which the states might be explained."""


def dive(config: BoardConfig, program: Path, jammed: bool = False) -> list[Output]:
    """Four hours below, up, five hours in a dock, and three hours below."""
    water = STILL.maker().config(config.agent_id).water
    mussel = Agent(
        AgentConfig(config, water, STILL.reports, (str(program),)),
        MusselbedCodec(),
        resting_on_bottom(0.0, 0.0, 3.0, 0.6, 1.0),
        0,
        ResetCause.POWER_ON,
    )
    permission, release = (CommandPacket(kind, 0).encode() for kind in (Kind.PERMISSION, Kind.RELEASE))
    outputs = mussel.receive(BuoyancyJammed(True), 0) if jammed else []
    outputs += mussel.receive(SoundArrived(permission), 4 * HOUR_MS)
    outputs += mussel.receive(ContactClosed(0, 0), 5 * HOUR_MS)
    outputs += mussel.receive(ContactOpened(), 10 * HOUR_MS)
    outputs += mussel.receive(WifiArrived(release), 10 * HOUR_MS + 1000)
    outputs += mussel.advance(13 * HOUR_MS)
    mussel.close()
    return outputs


def doubts(outputs: list[Output]) -> list[str]:
    return [it.reason for it in outputs if isinstance(it, StateDoubted)]


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The C board of the worst case with another word in place of the state."""
    source, made = NATIVE / "worst_case.c", {}
    for name, text in (("silent", "(void)board"), ("numbered", IN_THE_PAGES_ORDER)):
        made[name] = tmp_path_factory.mktemp(name) / "board"
        compiled_with(tmp_path_factory, source, source.read_text().replace(TOLD, text), made[name])
    return made


@pytest.mark.parametrize(
    ("name", "config"),
    [("worst_case", worst_case_board(7)), ("whole_board", board(FIELD, power(), agent_id=7))],
    ids=["worst_case", "whole_board"],
)
def test_our_c_boards_are_not_doubted(
    name: str, config: BoardConfig, tmp_path_factory: pytest.TempPathFactory
) -> None:
    assert doubts(dive(config, compiled(tmp_path_factory, name))) == []


def test_a_board_that_tells_no_state_is_told_once(changed: dict[str, Path]) -> None:
    assert doubts(dive(worst_case_board(7), changed["silent"])) == ["it has told no state since its boot"]


def test_a_board_with_other_numbers_is_told(changed: dict[str, Path]) -> None:
    """By hand: its FLOATING is told as 10, its CHARGING as 12, while it floats and while a dock charges it."""
    assert doubts(dive(worst_case_board(7), changed["numbered"])) == [
        "it tells the state SAMPLING, and floats",
        "it tells the state AWAITING_SLOT, and a dock charges it",
    ]


def test_rails_that_are_not_those_of_the_state_are_told(tmp_path_factory: pytest.TempPathFactory) -> None:
    source = NATIVE / "whole" / "state_task.c"
    rails = "[SLEEPING] = R(HAL_MODEM),"
    assert rails in source.read_text()
    program = tmp_path_factory.mktemp("lavish") / "board"
    text = source.read_text().replace(rails, "[SLEEPING] = R(HAL_MODEM) | R(HAL_PI),")
    compiled_with(tmp_path_factory, source, text, program)
    assert doubts(dive(board(FIELD, power(), agent_id=7), program)) == [
        "it tells the state SLEEPING, and its rails PI are those of another"
    ]


def test_a_defective_board_is_not_doubted(changed: dict[str, Path]) -> None:
    assert doubts(dive(replace(worst_case_board(7)), changed["silent"], jammed=True)) == []


def test_a_doubt_goes_over_the_link_of_its_agent() -> None:
    doubt = StateDoubted(70, 3, "it tells the state SAMPLING, and floats")
    assert from_wire(to_wire(doubt), 3) == doubt

"""The sea's events for the aPad, and the numbers of its modems. Mission time."""

from __future__ import annotations

from dataclasses import dataclass

from agents.coordinator import AgentDied
from agents.mussel.outputs import Output
from agents.mussel.stimuli import AgentStimulus
from agents.time_scale import MissionMs
from agents.water.medium import PacketEnded

APAD = 0
"""The node of the aPad's modem; those of further aPads are -1, -2, ... An aMussel's node is its id, which begins at 1."""
APAD_ADDRESS = 255
"""The address of every aPad's modem, to which all aMussels send: each aPad that a packet reaches takes it."""
_ADDRESSES = 254


def address_of(node: int) -> int:
    """A modem's 8-bit address. aMussels beyond 254 share addresses; their packets carry ids."""
    return APAD_ADDRESS if node <= APAD else (node - 1) % _ADDRESSES + 1


@dataclass(frozen=True, slots=True)
class SoundReached:
    """The aPad's modem received an aMussel's bytes, at mission time `mission_ms`, rounded up.

    In a shared sea they may be those of another fleet's aMussel, or of another aPad, whose number is not positive.
    """

    mission_ms: MissionMs
    agent_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class AgentRanged:
    """An aMussel answered a ping of the aPad."""

    mission_ms: MissionMs
    agent_id: int
    range_m: float


@dataclass(frozen=True, slots=True)
class NotRanged:
    """An aMussel did not answer a ping of the aPad in time."""

    mission_ms: MissionMs
    agent_id: int


@dataclass(frozen=True, slots=True)
class StimulusDelivered:
    """An agent received a stimulus from the water, at agent time `agent_ms`."""

    mission_ms: MissionMs
    agent_id: int
    agent_ms: int
    stimulus: AgentStimulus


@dataclass(frozen=True, slots=True)
class Printed:
    """An opened modem printed this on its serial line."""

    mission_ms: MissionMs
    agent_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class LeftWater:
    """An aPad's modem and its aMussels are out of the water that several flights share, though its flight has not ended."""

    mission_ms: MissionMs
    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class SeaLost:
    """The process that owns the sea is gone, and the sea with it."""

    mission_ms: MissionMs
    reason: str


SeaResult = (
    Printed
    | Output
    | AgentDied
    | SoundReached
    | AgentRanged
    | NotRanged
    | StimulusDelivered
    | PacketEnded
    | LeftWater
    | SeaLost
)

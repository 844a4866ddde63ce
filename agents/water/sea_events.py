"""What comes out of a fleet's sea for the aPad, and how its modems are numbered. Mission time."""

from __future__ import annotations

from dataclasses import dataclass

from agents.coordinator import Died, Heard
from agents.mussel.stimuli import Stimulus
from agents.water.medium import PacketEnded

APAD = 0
"""The aPad's modem among the nodes; aMussels are theirs by their ids, which begin at 1."""
APAD_ADDRESS = 255
_ADDRESSES = 254


def address_of(node: int) -> int:
    """A modem's 8-bit address. aMussels beyond 254 share theirs; their packets carry ids."""
    return APAD_ADDRESS if node == APAD else (node - 1) % _ADDRESSES + 1


@dataclass(frozen=True, slots=True)
class SoundReached:
    """The aPad's modem received an aMussel's bytes, at mission time `mission_ms`, rounded up."""

    mission_ms: int
    agent_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Ranged:
    """A ping of the aPad's was answered."""

    mission_ms: int
    agent_id: int
    range_m: float


@dataclass(frozen=True, slots=True)
class NotRanged:
    """A ping of the aPad's was not answered in time."""

    mission_ms: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class Told:
    """An agent was told something by the water, at agent time `agent_ms`."""

    mission_ms: int
    agent_id: int
    agent_ms: int
    stimulus: Stimulus


@dataclass(frozen=True, slots=True)
class Printed:
    """An opened modem printed this on its serial line."""

    mission_ms: int
    agent_id: int
    data: bytes


SeaResult = Printed | Heard | Died | SoundReached | Ranged | NotRanged | Told | PacketEnded

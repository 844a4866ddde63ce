"""An agent's outputs: those that the world receives, and the truth, on a channel of its own. Stamps are agent time.

The link of an agent carries its outputs without its id, because its host knows whose link it is.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, ClassVar, get_args

from agents.mussel.physical import Physical
from firmware_model.states import STATE_OF, State
from firmware_model.value import value


@value
class WifiSent:
    at_ms: int
    agent_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class SoundSent:
    at_ms: int
    agent_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class PingAnswered:
    """The modem answered a ping; `travelled_us` is the travel time of the ping's sound."""

    at_ms: int
    agent_id: int
    travelled_us: int


@dataclass(frozen=True, slots=True)
class StimulusDropped:
    """A stimulus without effect; counted, never raised."""

    at_ms: int
    agent_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class StateDoubted:
    """Somebody's firmware tells a state that its board contradicts."""

    at_ms: int
    agent_id: int
    reason: str


Output = WifiSent | SoundSent | StimulusDropped | PingAnswered | StateDoubted

_KINDS: tuple[type[Any], ...] = get_args(Output)
_CODES: dict[type[Any], int] = {kind: code for code, kind in enumerate(_KINDS)}
_VALUES = (("data", bytes), ("data", bytes), ("reason", str), ("travelled_us", int), ("reason", str))
"""The name and type of each kind's value besides its time and its agent."""


def to_wire(output: Output) -> list[Any]:
    """[code, at_ms, value]: plain values that msgpack carries."""
    code = _CODES[type(output)]
    return [code, output.at_ms, getattr(output, _VALUES[code][0])]


def from_wire(wire: Any, agent_id: int) -> Output:
    """The inverse of `to_wire` for this agent's output; ValueError for anything else."""
    if not isinstance(wire, list) or len(wire) != 3 or type(wire[0]) is not int or type(wire[1]) is not int:
        raise ValueError("not an output")
    if not 0 <= wire[0] < len(_KINDS) or type(wire[2]) is not _VALUES[wire[0]][1]:
        raise ValueError("not an output")
    output: Output = _KINDS[wire[0]](wire[1], agent_id, wire[2])
    return output


@value
class Truth:
    """An aMussel's true state, from `at_ms` until its next Truth. The recorder alone reads it."""

    HEAD: ClassVar[struct.Struct] = struct.Struct("<QHB")

    at_ms: int
    agent_id: int
    state: State
    physical: Physical

    def pack(self) -> bytes:
        return self.HEAD.pack(self.at_ms, self.agent_id, self.state) + self.physical.pack()

    @classmethod
    def unpack(cls, data: bytes | memoryview, offset: int = 0) -> Truth:
        """The inverse of `pack`, from `offset` on; struct.error or ValueError for other bytes."""
        at_ms, agent_id, code = cls.HEAD.unpack_from(data, offset)
        if (state := STATE_OF.get(code)) is None:
            raise ValueError(f"no state {code}")
        return cls(at_ms, agent_id, state, Physical.unpack(data, offset + cls.HEAD.size))


TRUTH_BYTES = Truth.HEAD.size + Physical.FORMAT.size


def unpack_truths(data: bytes | memoryview) -> tuple[Truth, ...]:
    """The truths of which `data` are the packed bytes, in order; ValueError for other bytes."""
    if len(data) % TRUTH_BYTES:
        raise ValueError("bytes that are no truths")
    try:
        return tuple([Truth.unpack(data, start) for start in range(0, len(data), TRUTH_BYTES)])
    except ValueError:
        raise ValueError("a truth with a value that cannot be") from None

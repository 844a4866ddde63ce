"""The modems of a sea in which some have been opened: each one a machine, so that whatever a driver asks is answered.

Without opened modems a sea does without this: its agents' frames go into the water as they are, and are the same ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from agents.modem.facts import (
    Action,
    Answered,
    Delivered,
    Dropped,
    EmitFrame,
    FrameArrived,
    FrameRequested,
    PowerCame,
    PowerWent,
    SerialBytes,
    SerialOut,
    Stimulus,
)
from agents.modem.firmware import Firmware, ModemConfig
from agents.modem.frames import Frame
from agents.modem.rack import NodeAction, Rack


@dataclass(frozen=True, slots=True)
class Emission:
    at_ms: int
    node: int
    frame: Frame
    asked: bool
    """By the node's own host; otherwise somebody else drives the modem, or it answers a question by itself."""


class SeaModems:
    """Agent time. What is to happen in a round is noted first; `round` then lets it happen in the order of time."""

    def __init__(
        self,
        firmware: Firmware,
        addresses: Mapping[int, int],
        opened: Collection[int],
        now_ms: int,
        dropped: Counter[str],
    ) -> None:
        self.dropped = dropped
        self.opened = frozenset(opened)
        self._rack = Rack(ModemConfig(firmware), addresses, self.opened, now_ms)
        self._now_ms = now_ms
        self._off: set[int] = set()
        self._noted: list[tuple[int, int, int, Stimulus]] = []
        self._printed: list[tuple[int, bytes]] = []
        self._emitted: list[Emission] = []
        self._asked: dict[int, Frame] = {}
        """What each node's host asked for last."""

    @property
    def next_due_ms(self) -> int | None:
        return self._rack.next_due_ms

    def write(self, node: int, data: bytes) -> None:
        """Whoever opened the modem wrote this, after a pause: as soon as may be."""
        self._take(self._rack.receive(node, SerialBytes(data, 0, paused=True), self._now_ms))

    def ask(self, node: int, frame: Frame, at_ms: int) -> None:
        """The node's own host wants this sent."""
        self._asked[node] = frame
        self._noted.append((at_ms, 1, node, FrameRequested(frame)))

    def power(self, node: int, on: bool, at_ms: int) -> None:
        if on == (node in self._off):
            (self._off.discard if on else self._off.add)(node)
            self._noted.append((at_ms, 0, node, PowerCame() if on else PowerWent()))

    def round(self, until_ms: int) -> list[Emission]:
        """Everything up to `until_ms`; what went into the water, in the order of time."""
        noted, self._noted = self._noted, []
        for at_ms, _, node, stimulus in sorted(noted, key=lambda it: it[:3]):
            self._take(self._rack.receive(node, stimulus, max(at_ms, self._now_ms)))
            self._now_ms = max(at_ms, self._now_ms)
        self._take(self._rack.advance(until_ms))
        self._now_ms = until_ms
        emitted, self._emitted = self._emitted, []
        return emitted

    def hear(self, node: int, arrived: FrameArrived, at_ms: int) -> bool:
        """A frame reached the node's modem; whether its own host learns of it."""
        at_ms = max(at_ms, self._now_ms)
        did = self._rack.receive(node, arrived, at_ms)
        self._now_ms = at_ms
        self._take(did)
        return any(who == node and _is_told(action) for who, action in did)

    def take_printed(self) -> list[tuple[int, bytes]]:
        """What opened modems have printed since the last call, as (node, bytes)."""
        printed, self._printed = self._printed, []
        return printed

    def _take(self, did: list[NodeAction]) -> None:
        for node, action in did:
            match action:
                case SerialOut(_, data):
                    self._printed.append((node, data))
                case EmitFrame(at_ms, frame):
                    asked = self._asked.get(node) is frame
                    self._emitted.append(Emission(at_ms, node, frame, asked))
                case Dropped(_, reason):
                    self.dropped[f"modem: {reason}"] += 1


def _is_told(action: Action) -> bool:
    return isinstance(action, Answered) or (isinstance(action, Delivered) and bool(action.frame.data))

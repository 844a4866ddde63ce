"""The modems of a sea in which some have been opened, simulated in full, so that each answers whatever a driver asks.

A sea without opened modems does not need them: its agents' frames go straight into the water, and are the same frames.
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
    from_host: bool
    """True if the node's own host sent it; otherwise another driver did, or the modem answered by itself."""


class SeaModems:
    """Agent time. It first collects the stimuli of a round; `round` then applies them in the order of time."""

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
        self._pending: list[tuple[int, int, int, Stimulus]] = []
        self._printed: list[tuple[int, bytes]] = []
        self._emitted: list[Emission] = []
        self._requested: dict[int, Frame] = {}
        """The last frame that each node's host requested."""

    @property
    def next_due_ms(self) -> int | None:
        return self._rack.next_due_ms

    def write(self, node: int, data: bytes) -> None:
        """Writes bytes of whoever opened the modem, after a pause, at once."""
        self._take(self._rack.receive(node, SerialBytes(data, 0, paused=True), self._now_ms))

    def ask(self, node: int, frame: Frame, at_ms: int) -> None:
        """Requests a frame for the node's own host."""
        self._requested[node] = frame
        self._pending.append((at_ms, 1, node, FrameRequested(frame)))

    def power(self, node: int, on: bool, at_ms: int) -> None:
        if on == (node in self._off):
            (self._off.discard if on else self._off.add)(node)
            self._pending.append((at_ms, 0, node, PowerCame() if on else PowerWent()))

    def round(self, until_ms: int) -> list[Emission]:
        """Runs everything up to `until_ms`. Returns the frames that went into the water, in the order of time."""
        pending, self._pending = self._pending, []
        for at_ms, _, node, stimulus in sorted(pending, key=lambda it: it[:3]):
            self._take(self._rack.receive(node, stimulus, max(at_ms, self._now_ms)))
            self._now_ms = max(at_ms, self._now_ms)
        self._take(self._rack.advance(until_ms))
        self._now_ms = until_ms
        emitted, self._emitted = self._emitted, []
        return emitted

    def frame_arrived(self, node: int, arrived: FrameArrived, at_ms: int) -> bool:
        """Brings a frame to the node's modem. Returns True if the modem delivers it to its own host."""
        at_ms = max(at_ms, self._now_ms)
        actions = self._rack.receive(node, arrived, at_ms)
        self._now_ms = at_ms
        self._take(actions)
        return any(actor == node and _reaches_host(action) for actor, action in actions)

    def take_printed(self) -> list[tuple[int, bytes]]:
        """The output of opened modems since the last call, as (node, bytes)."""
        printed, self._printed = self._printed, []
        return printed

    def _take(self, actions: list[NodeAction]) -> None:
        for node, action in actions:
            match action:
                case SerialOut(_, data):
                    self._printed.append((node, data))
                case EmitFrame(at_ms, frame):
                    from_host = self._requested.get(node) is frame
                    self._emitted.append(Emission(at_ms, node, frame, from_host))
                case Dropped(_, reason):
                    self.dropped[f"modem: {reason}"] += 1


def _reaches_host(action: Action) -> bool:
    return isinstance(action, Answered) or (isinstance(action, Delivered) and bool(action.frame.data))

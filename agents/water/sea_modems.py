"""The modems of a sea in which some have been opened, simulated in full, so that each answers whatever a driver asks.

A sea without opened modems does not need them: its agents' frames go straight into the water, and are the same frames.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from agents.modem.facts import (
    AddressChanged,
    Delivered,
    EmitFrame,
    FrameArrived,
    FrameDropped,
    FrameRequested,
    ModemAction,
    ModemStimulus,
    NoiseChanged,
    PowerCame,
    PowerWent,
    QuestionAnswered,
    SerialBytes,
    SerialOut,
)
from agents.modem.frames import ModemFrame
from agents.modem.modem_model import ModemConfig, ModemFirmware
from agents.modem.rack import NodeAction, Rack
from agents.water.medium import Readdressed


@dataclass(frozen=True, slots=True)
class Emission:
    at_ms: int
    node: int
    frame: ModemFrame
    from_host: bool
    """True if the node's own host sent it; otherwise another driver did, or the modem answered by itself."""


class SeaModems:
    """Agent time. It first collects the stimuli of a round; `round` then applies them in the order of time."""

    def __init__(
        self,
        firmware: ModemFirmware,
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
        self._pending: list[tuple[int, int, int, ModemStimulus]] = []
        self._printed: list[tuple[int, bytes]] = []
        self._emitted: list[Emission] = []
        self._readdressed: list[tuple[int, Readdressed]] = []
        self._requested: dict[int, ModemFrame] = {}
        """The last frame that each node's host requested."""

    @property
    def next_due_ms(self) -> int | None:
        return self._rack.next_due_ms

    def write(self, node: int, data: bytes) -> None:
        """Writes bytes of whoever opened the modem, after a pause, at once."""
        self._take(self._rack.receive(node, SerialBytes(data, 0, paused=True), self._now_ms))

    def ask(self, node: int, frame: ModemFrame, at_ms: int) -> None:
        """Requests a frame for the node's own host. Its source becomes the modem's present address."""
        frame = replace(frame, source=self._rack[node].address)
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

    def take_readdressed(self) -> list[tuple[int, Readdressed]]:
        """The changes of addresses since the last call, each with its time."""
        readdressed, self._readdressed = self._readdressed, []
        return readdressed

    def measure(self, noise: NoiseChanged, nodes: Collection[int]) -> None:
        """Sets the noise at these nodes' modems from now on."""
        for node in nodes:
            self._take(self._rack.receive(node, noise, self._now_ms))

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
                case AddressChanged(at_ms, address):
                    self._readdressed.append((at_ms, Readdressed(node, address)))
                case FrameDropped(_, reason):
                    self.dropped[f"modem: {reason}"] += 1


def _reaches_host(action: ModemAction) -> bool:
    return isinstance(action, QuestionAnswered) or (isinstance(action, Delivered) and bool(action.frame.data))


def noise_measured(level_db: float) -> NoiseChanged:
    """A modem's measure of Gaussian noise of this level in its band, in dB re 1 uPa.

    The converter's scale is not public: here its 65535 steps are the level of a modem at 1 m, 168 dB. Of a second's 160 000
    samples the largest and the least are 9 standard deviations apart; the mean magnitude is sqrt(2 / pi) of one.
    """
    rms = 65_535 * 10 ** ((level_db - 168) / 20)
    return NoiseChanged(*(min(999_999, round(rms * part)) for part in (1.0, 9.0, 0.7979)))

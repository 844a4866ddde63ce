"""The water as sound travels through it: which receivers get which packet, when, and why not. Agent time throughout.

A packet acts at its END at each receiver. The decision there needs everything that began before, so `agents.water.sea`
grants senders time up to an end before it advances the medium to that end. Delays and ends are whole milliseconds,
rounded up, so that no packet acts before it has arrived; ranging has the delay in microseconds.
"""

from __future__ import annotations

import heapq
from bisect import insort
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from math import log10

from agents.modem.frames import ModemFrame
from agents.water.packet_draws import fates
from agents.water.places import CellGrid, ModemPlace, distance_m
from agents.water.sound import Sound
from agents.water.topology import Topology

_LANE = b"sound"


class PacketOutcome(IntEnum):
    """The outcome of a packet at a receiver: the first that holds, in this order."""

    RECEIVED = 0
    CUT = 1
    """The topology has no link."""
    IN_AIR = 2
    """The receiver was not under water all the time."""
    TRANSMITTING = 3
    """Half duplex: the receiver was sending."""
    COLLIDED = 4
    """Others overlapped it at the receiver, and it was not louder by the capture ratio."""
    LOST = 5
    """The topology's loss."""
    NOISE = 6
    """Too weak: lost by the packet error rate."""
    OUT_OF_RANGE = 7
    """The destination is beyond the range limit. A broadcast does not list the receivers out there."""


@dataclass(frozen=True, slots=True)
class Began:
    """A modem began to send. `node` identifies it where the 8-bit address may not."""

    node: int
    frame: ModemFrame


@dataclass(frozen=True, slots=True)
class ModemMoved:
    """A modem is at this place from now on; None takes it out of the water for good."""

    node: int
    place: ModemPlace | None


@dataclass(frozen=True, slots=True)
class ThrustersRan:
    """Thrusters beside this modem started or stopped."""

    node: int
    running: bool


@dataclass(frozen=True, slots=True)
class Readdressed:
    """A modem takes frames for this address from now on."""

    node: int
    address: int


@dataclass(frozen=True, slots=True)
class LinksChanged:
    topology: Topology


MediumStimulus = Began | ModemMoved | ThrustersRan | Readdressed | LinksChanged


@dataclass(frozen=True, slots=True)
class Reception:
    """A packet at one receiver, at its end there. Its sound travelled for `travelled_us`."""

    receiver: int
    at_ms: int
    outcome: PacketOutcome
    snr_db: float
    travelled_us: int


@dataclass(frozen=True, slots=True)
class FrameHeard:
    """A whole packet reached a modem that takes it, at `reception.at_ms`."""

    sender: int
    frame: ModemFrame
    reception: Reception


@dataclass(frozen=True, slots=True)
class PacketEnded:
    """All outcomes of a packet, complete once they are decided at every destination in range."""

    sender: int
    began_ms: int
    frame: ModemFrame
    unsent: str | None
    """The reason why nothing went into the water; None if it did."""
    receptions: tuple[Reception, ...]


MediumResult = FrameHeard | PacketEnded


@dataclass(slots=True)
class _OnAir:
    sender: int
    began_ms: int
    ends_ms: int
    frame: ModemFrame
    place: ModemPlace
    waiting: int = 0
    """The number of receivers at which it is still undecided."""
    receptions: list[Reception] = field(default_factory=list)


class WaterMedium:
    """The three verbs. Nodes are numbers; each has a modem's address, which several nodes of a large fleet share."""

    def __init__(
        self, sound: Sound, seed: int, addresses: Iterable[tuple[int, int]], now_ms: int = 0
    ) -> None:
        """`addresses` has (node, address 0 to 255) of all modems."""
        self.sound = sound
        self._seed = seed
        self.now_ms = now_ms
        self._nodes_at: dict[int, list[int]] = {}
        for node, address in sorted(addresses):
            self._nodes_at.setdefault(address, []).append(node)
        self._places: dict[int, ModemPlace] = {}
        self._grid = CellGrid(max(1, round(sound.range_limit_m * 1e6)))
        self._loud: set[int] = set()
        """Nodes beside running thrusters."""
        self._topology = Topology()
        self._on_air: list[_OnAir] = []
        self._ends: list[tuple[int, int, int, int, _OnAir, int]] = []
        """A heap of (end at the receiver, begin, sender, receiver, packet, travel time in us)."""
        self._ended: list[PacketEnded] = []
        self._reach_ms = -(-sound.delay_us(sound.range_limit_m) // 1000) + sound.reverberation_ms
        """The time from a packet's end until nothing of it is left anywhere."""

    @property
    def next_due_ms(self) -> int | None:
        """The next end of a packet at a receiver."""
        return self._ends[0][0] if self._ends else None

    def advance(self, now_ms: int) -> list[MediumResult]:
        """Decides packets up to `now_ms`, in the order of their ends (ValueError if time went back)."""
        if now_ms < self.now_ms:
            raise ValueError(f"time went back: {now_ms} before {self.now_ms}")
        self.now_ms = now_ms
        results: list[MediumResult] = list(self._ended)
        self._ended = []
        while self._ends and self._ends[0][0] <= now_ms:
            at_ms, _, _, receiver, packet, travelled_us = heapq.heappop(self._ends)
            reception = self._decide(packet, receiver, at_ms, travelled_us)
            packet.receptions.append(reception)
            if reception.outcome is PacketOutcome.RECEIVED:
                results.append(FrameHeard(packet.sender, packet.frame, reception))
            packet.waiting -= 1
            if packet.waiting == 0:
                results.append(_whole(packet))
        self._forget()
        return results

    def receive(self, stimulus: MediumStimulus, now_ms: int) -> list[MediumResult]:
        """Takes a fact at `now_ms`, after everything that was due by then."""
        results = self.advance(now_ms)
        match stimulus:
            case ModemMoved(node, place):
                self._move(node, place)
            case Began(node, frame):
                self._begin(node, frame, now_ms)
            case ThrustersRan(node, running):
                (self._loud.add if running else self._loud.discard)(node)
            case Readdressed(node, address):
                for nodes in self._nodes_at.values():
                    if node in nodes:
                        nodes.remove(node)
                insort(self._nodes_at.setdefault(address, []), node)
            case LinksChanged(topology):
                self._topology = topology
        results += self._ended
        self._ended = []
        return results

    def _move(self, node: int, place: ModemPlace | None) -> None:
        if place is None:
            self._places.pop(node, None)
            self._grid.remove(node)
        else:
            self._places[node] = place
            self._grid.put(node, place)

    def _begin(self, node: int, frame: ModemFrame, now_ms: int) -> None:
        place = self._places.get(node)
        unsent = None
        if place is None or not place.hears_at(now_ms):
            unsent = "the modem is not in the water"
        elif any(other.sender == node and other.ends_ms > now_ms for other in self._on_air):
            unsent = "the modem is still sending"
        if unsent is not None or place is None:
            self._ended.append(PacketEnded(node, now_ms, frame, unsent, ()))
            return
        packet = _OnAir(node, now_ms, now_ms + frame.duration_ms, frame, place)
        self._on_air.append(packet)
        for receiver in self._takers(node, frame, place):
            metres = distance_m(place, self._places[receiver], now_ms)
            if metres > self.sound.range_limit_m:
                if frame.destination is not None:
                    far = Reception(
                        receiver, packet.ends_ms, PacketOutcome.OUT_OF_RANGE, self.sound.snr_db(metres), 0
                    )
                    packet.receptions.append(far)
                continue
            travelled_us = self.sound.delay_us(metres)
            end_ms = packet.ends_ms - (-travelled_us // 1000)
            heapq.heappush(self._ends, (end_ms, now_ms, node, receiver, packet, travelled_us))
            packet.waiting += 1
        if packet.waiting == 0:
            self._ended.append(_whole(packet))

    def _takers(self, node: int, frame: ModemFrame, place: ModemPlace) -> list[int]:
        if frame.destination is None:
            return [other for other in self._grid.near(place) if other != node]
        addressed = self._nodes_at.get(frame.destination, ())
        return [other for other in addressed if other != node and other in self._places]

    def _decide(self, packet: _OnAir, receiver: int, end_ms: int, travelled_us: int) -> Reception:
        place = self._places.get(receiver)
        begin_ms = end_ms - (packet.ends_ms - packet.began_ms)
        if place is None:
            return Reception(receiver, end_ms, PacketOutcome.IN_AIR, 0.0, travelled_us)
        sound = self.sound
        level_db = sound.level_db(travelled_us * sound.sound_speed_m_s / 1e6)
        first, second, normal = fates(self._seed, packet.sender, packet.began_ms, receiver, _LANE)
        level_db += sound.fading_db * normal
        snr_db = level_db - sound.noise_db - sound.thruster_noise_db * (receiver in self._loud)
        loss = self._topology.loss(packet.sender, receiver, packet.began_ms)
        outcome = PacketOutcome.RECEIVED
        if loss >= 1:
            outcome = PacketOutcome.CUT
        elif not (place.hears_at(begin_ms) and place.hears_at(end_ms)):
            outcome = PacketOutcome.IN_AIR
        elif (others := self._disturbance(packet, receiver, place, begin_ms, end_ms)) is None:
            outcome = PacketOutcome.TRANSMITTING
        elif others and level_db - 10 * log10(others) < sound.capture_db:
            outcome = PacketOutcome.COLLIDED
        elif first < loss:
            outcome = PacketOutcome.LOST
        elif second < sound.errors.probability(snr_db, len(packet.frame.data)):
            outcome = PacketOutcome.NOISE
        return Reception(receiver, end_ms, outcome, snr_db, travelled_us)

    def _disturbance(
        self, packet: _OnAir, receiver: int, place: ModemPlace, begin_ms: int, end_ms: int
    ) -> float | None:
        """Summed power of all sounds that overlap [begin_ms, end_ms) at the receiver; None if the receiver was sending."""
        sound, power = self.sound, 0.0
        for other in self._on_air:
            if other is packet or other.began_ms >= end_ms or other.ends_ms + self._reach_ms <= begin_ms:
                continue
            if other.sender == receiver:
                if other.ends_ms + sound.turnaround_ms > begin_ms:
                    return None
                continue
            metres = distance_m(other.place, place, other.began_ms)
            if (
                metres > sound.range_limit_m
                or self._topology.loss(other.sender, receiver, other.began_ms) >= 1
            ):
                continue
            delay_ms = -(-sound.delay_us(metres) // 1000)
            if other.began_ms + delay_ms >= end_ms:
                continue
            if (past_ms := begin_ms - other.ends_ms - delay_ms) < 0:
                power += 10 ** (sound.level_db(metres) / 10)
            elif past_ms < sound.reverberation_ms:
                power += 10 ** ((sound.level_db(metres) - sound.reverberation_db) / 10)
        return power

    def _forget(self) -> None:
        """Forgets packets that can disturb nothing any more, neither present packets nor later ones."""
        if not self._on_air:
            return
        since_ms = min((packet.began_ms for packet in self._on_air if packet.waiting), default=self.now_ms)
        keep_ms = max(self._reach_ms, self.sound.turnaround_ms)
        if any(packet.ends_ms + keep_ms <= since_ms for packet in self._on_air):
            self._on_air = [packet for packet in self._on_air if packet.ends_ms + keep_ms > since_ms]


def _whole(packet: _OnAir) -> PacketEnded:
    receptions = tuple(sorted(packet.receptions, key=lambda it: (it.at_ms, it.receiver)))
    return PacketEnded(packet.sender, packet.began_ms, packet.frame, None, receptions)

"""Relays packets between aMussels and supervisors that live in different processes, by one table of routing rules.

`RULES` says what becomes of a packet, by the place where it begins, the standing of its aMussel in this process, and its
medium. A `Division` gives the standings. The relay knows neither ROS nor a clock: its inlets bring the packets of other
processes, and its outlets carry packets to them.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cache
from math import nan
from typing import Final, Literal

from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, DockMoved, from_wire, to_wire
from agents.packet_medium import Medium
from agents.time_scale import MissionMs
from apad_bridge.acoustics.schedule import PendingPings
from apad_bridge.acoustics.serial.nanomodem import WAIT_MS
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.input_ranges import FARTHEST_M, out_of_range
from apad_bridge.mission.facts import AMusselHeard, RangeHeard, Send
from apad_bridge.mission.sources import Allocation
from firmware_model.state_groups import DOCKED

REPEATS = 3
"""So often an aMussel of another process is told of a contact: one that reports otherwise then does not feel its dock."""
ON_THE_WAY_MS = 2_000
"""A report that arrives so soon after a contact may have been sent before the aMussel felt it."""

RANGE: Final = "range"
"""Stands for the medium of a ping of a real aMussel, which has no data, and of its range, in m as text."""
Carriage = Medium | Literal["range"] | None
"""A relayed packet's medium, or what stands for it; None for a contact."""


class PacketOrigin(Enum):
    """The place where a packet begins. A dock's contact with an aMussel travels as a packet without a medium."""

    LOCAL_AMUSSEL = auto()
    """An aMussel that this process simulates. The supervisor of this process has its packet already."""
    LOCAL_SUPERVISOR = auto()
    LOCAL_DOCK = auto()
    REMOTE_AMUSSEL = auto()
    REMOTE_SUPERVISOR = auto()
    REMOTE_DOCK = auto()
    LABORATORY = auto()
    """Anybody who commands aMussels by a laboratory's own messages."""


class AMusselStanding(Enum):
    """Home and server of an aMussel, as one process sees them."""

    OURS = auto()
    """Simulated and served here."""
    REAL = auto()
    """A real aMussel, served here. If this process simulates its twin, the twin is muted."""
    LENT = auto()
    """Simulated here, and served by another supervisor."""
    BORROWED = auto()
    """Served here, and simulated by another process."""
    FOREIGN = auto()
    """Neither simulated nor served here."""


class RelayOutcome(Enum):
    PUBLISH = auto()
    """Other processes get the packet."""
    RECEIVE = auto()
    """The flight gets it: the supervisor an aMussel's packet, the aMussel a command or a contact."""
    REFUSE = auto()
    """The packet is dropped and counted, because two aMussels would speak under one id."""
    PUBLISH_PACKET = auto()
    """The laboratory gets the packet's bytes."""
    PUBLISH_WIFI = auto()
    """The laboratory is told that the aMussel is on the Wi-Fi."""
    PUBLISH_COMMAND = auto()
    """The laboratory gets the command in a message of its own, if it has one."""


@dataclass(frozen=True, slots=True)
class RoutingRule:
    """The outcome of a packet from `source`, by its aMussel's standing and its medium; None stands for any."""

    source: PacketOrigin
    standing: AMusselStanding | None
    medium: Medium | None
    outcome: RelayOutcome

    def applies(self, source: PacketOrigin, standing: AMusselStanding, medium: Carriage) -> bool:
        return (
            source is self.source
            and self.standing in (None, standing)
            and (self.medium is None or medium is self.medium)
        )


RULES = (
    RoutingRule(PacketOrigin.LOCAL_AMUSSEL, AMusselStanding.LENT, None, RelayOutcome.PUBLISH),
    RoutingRule(PacketOrigin.LOCAL_AMUSSEL, None, Medium.SOUND, RelayOutcome.PUBLISH_PACKET),
    RoutingRule(PacketOrigin.LOCAL_AMUSSEL, None, Medium.WIFI, RelayOutcome.PUBLISH_WIFI),
    RoutingRule(PacketOrigin.LOCAL_SUPERVISOR, AMusselStanding.REAL, None, RelayOutcome.PUBLISH),
    RoutingRule(PacketOrigin.LOCAL_SUPERVISOR, AMusselStanding.BORROWED, None, RelayOutcome.PUBLISH),
    RoutingRule(PacketOrigin.LOCAL_SUPERVISOR, AMusselStanding.FOREIGN, None, RelayOutcome.PUBLISH),
    RoutingRule(PacketOrigin.LOCAL_SUPERVISOR, None, Medium.SOUND, RelayOutcome.PUBLISH_COMMAND),
    RoutingRule(PacketOrigin.LOCAL_SUPERVISOR, None, Medium.WIFI, RelayOutcome.PUBLISH_COMMAND),
    RoutingRule(PacketOrigin.LOCAL_DOCK, AMusselStanding.BORROWED, None, RelayOutcome.PUBLISH),
    RoutingRule(PacketOrigin.REMOTE_AMUSSEL, AMusselStanding.REAL, None, RelayOutcome.RECEIVE),
    RoutingRule(PacketOrigin.REMOTE_AMUSSEL, AMusselStanding.BORROWED, None, RelayOutcome.RECEIVE),
    RoutingRule(PacketOrigin.REMOTE_AMUSSEL, AMusselStanding.OURS, None, RelayOutcome.REFUSE),
    RoutingRule(PacketOrigin.REMOTE_SUPERVISOR, AMusselStanding.LENT, None, RelayOutcome.RECEIVE),
    RoutingRule(PacketOrigin.REMOTE_DOCK, AMusselStanding.OURS, None, RelayOutcome.RECEIVE),
    RoutingRule(
        PacketOrigin.REMOTE_DOCK, AMusselStanding.REAL, None, RelayOutcome.RECEIVE
    ),  # its twin feels the same docks
    RoutingRule(PacketOrigin.REMOTE_DOCK, AMusselStanding.LENT, None, RelayOutcome.RECEIVE),
    RoutingRule(PacketOrigin.LABORATORY, None, None, RelayOutcome.RECEIVE),
)
"""All rules that apply act, in this order. A packet to which none applies goes no further: the packets of a lent aMussel
come back from the topic on which this process published them, for example."""


@cache
def outcomes(source: PacketOrigin, standing: AMusselStanding, medium: Carriage) -> tuple[RelayOutcome, ...]:
    return tuple(rule.outcome for rule in RULES if rule.applies(source, standing, medium))


@dataclass(frozen=True, slots=True)
class Division:
    """Division of aMussels and supervisors between this process and others."""

    standing: Callable[[int], AMusselStanding]
    """The present standing of an aMussel, or of EVERYONE."""
    peers: tuple[PacketOrigin, ...]
    """The sources in other processes."""


def whole_flight(simulated: Callable[[], frozenset[int]]) -> Division:
    """A supervisor with a fleet. An aMussel that is not simulated is real."""
    return Division(
        lambda agent_id: AMusselStanding.OURS if agent_id in simulated() else AMusselStanding.REAL,
        (PacketOrigin.REMOTE_AMUSSEL,),
    )


FLEET_ALONE = Division(lambda _: AMusselStanding.LENT, (PacketOrigin.REMOTE_SUPERVISOR,))
"""A fleet whose aPad reports by itself what its docks hold."""
FLEET_WITH_DOCKS = Division(
    lambda _: AMusselStanding.LENT, (PacketOrigin.REMOTE_SUPERVISOR, PacketOrigin.REMOTE_DOCK)
)
MISSION_ALONE = Division(
    lambda _: AMusselStanding.BORROWED, (PacketOrigin.REMOTE_AMUSSEL, PacketOrigin.REMOTE_DOCK)
)
"""A mission hears of nobody's docks, and tells a fleet of its own."""


def one_of_several(allocation: Allocation, simulated: Callable[[], frozenset[int]]) -> Division:
    """One of several aPads that take over from each other."""

    def standing(agent_id: int) -> AMusselStanding:
        if agent_id in allocation.own:
            if agent_id in allocation.served_elsewhere:
                return AMusselStanding.LENT
            return AMusselStanding.OURS if agent_id in simulated() else AMusselStanding.REAL
        return AMusselStanding.BORROWED if agent_id in allocation.served else AMusselStanding.FOREIGN

    return Division(
        standing, (PacketOrigin.REMOTE_AMUSSEL, PacketOrigin.REMOTE_SUPERVISOR, PacketOrigin.REMOTE_DOCK)
    )


@dataclass(frozen=True, slots=True)
class RelayedPacket:
    """A packet of an aMussel, or for an aMussel or EVERYONE, with its mission time."""

    source: PacketOrigin
    agent_id: int
    medium: Carriage
    data: bytes
    at_ms: MissionMs


@dataclass(frozen=True, slots=True)
class RemoteContact:
    """A stimulus that an aMussel gets from the dock of an aPad whose supervisor is in another process."""

    agent_id: int
    stimulus: AgentStimulus


@dataclass(frozen=True, slots=True)
class _SentContact:
    """A contact that was sent to an aMussel of another process, and that no report confirms yet."""

    stimulus: ContactClosed | ContactOpened
    at_ms: MissionMs
    times_sent: int


RelayedEvent = AMusselHeard | RangeHeard | Send | RemoteContact
Inlet = Callable[[MissionMs], Sequence[RelayedPacket]]
"""Returns the packets that arrived since the last call, at a mission time."""
Outlet = Callable[[RelayedPacket], None]


class PacketRelay:
    """Applies the rules. An outcome without an outlet has no effect: a flight without a laboratory publishes none."""

    def __init__(
        self, division: Division, inlets: Sequence[Inlet], outlets: Mapping[RelayOutcome, Outlet]
    ) -> None:
        self.dropped: Counter[str] = Counter()
        self._division = division
        self._inlets = inlets
        self._outlets = outlets
        self._sent_contacts: dict[int, _SentContact] = {}
        self._pings = PendingPings()

    def without_outlets(self) -> PacketRelay:
        """The same relay, which receives and transmits nothing. Its drops count in this one's."""
        silent = PacketRelay(self._division, self._inlets, {})
        silent.dropped = self.dropped
        return silent

    def advance(self, now_ms: MissionMs) -> list[RelayedEvent]:
        """Returns the events for this flight up to mission time `now_ms`."""
        received: list[RelayedEvent] = []
        for inlet in self._inlets:
            for packet in inlet(now_ms):
                received += self._route(packet)
        return received + [RangeHeard(now_ms, it, None) for it in self._pings.given_up(now_ms)]

    def ping(self, agent_id: int, now_ms: MissionMs) -> None:
        """Routes a ping of a real aMussel, unless one waits for its answer; a RangeHeard follows.

        It has no range if none comes while a ping may wait for a modem, and the modem for the answer.
        """
        if self._pings.awaits(agent_id):
            return
        self._pings.await_answer(agent_id, now_ms + WAIT_MS)
        self._route(RelayedPacket(PacketOrigin.LOCAL_SUPERVISOR, agent_id, RANGE, b"", now_ms))

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: MissionMs) -> None:
        """Routes a packet that an aMussel of this process sent."""
        if self._outlets:
            self._route(RelayedPacket(PacketOrigin.LOCAL_AMUSSEL, agent_id, medium, data, now_ms))

    def forward(self, send: Send, now_ms: MissionMs) -> None:
        """Routes a packet that the supervisor of this process sent."""
        self._route(
            RelayedPacket(PacketOrigin.LOCAL_SUPERVISOR, send.agent_id, send.medium, send.data, now_ms)
        )

    def send_contact(self, felt: RemoteContact, now_ms: MissionMs) -> None:
        """Routes a contact of this process's docks with an aMussel."""
        outlets = outcomes(PacketOrigin.LOCAL_DOCK, self._division.standing(felt.agent_id), None)
        if self._outlets.keys().isdisjoint(outlets):
            return
        self._publish_contact(felt, now_ms)
        match felt.stimulus:
            case ContactClosed() | ContactOpened() as stimulus:
                self._sent_contacts[felt.agent_id] = _SentContact(stimulus, now_ms, 1)
            case DockMoved(north_um, east_um) if (sent := self._sent_contacts.get(felt.agent_id)) is not None:
                self._sent_contacts[felt.agent_id] = replace(sent, stimulus=ContactClosed(north_um, east_um))

    def repeat_contacts(self, belief_of: Callable[[int], Belief | None], now_ms: MissionMs) -> None:
        """Sends an aMussel its contact again when it reports no dock though one holds it, or a dock though it was let go.

        The link to its process was cut when the dock moved. Otherwise it would stand docked for ever.
        """
        for agent_id, sent in list(self._sent_contacts.items()):
            belief = belief_of(agent_id)
            if belief is None or belief.heard_ms <= sent.at_ms + ON_THE_WAY_MS:
                continue
            is_docked = belief.state in DOCKED
            if is_docked is isinstance(sent.stimulus, ContactClosed) or sent.times_sent == REPEATS:
                del self._sent_contacts[agent_id]
            else:
                self._publish_contact(RemoteContact(agent_id, sent.stimulus), now_ms)
                self._sent_contacts[agent_id] = _SentContact(sent.stimulus, now_ms, sent.times_sent + 1)

    def _publish_contact(self, felt: RemoteContact, now_ms: MissionMs) -> None:
        data = json.dumps(to_wire(felt.stimulus)).encode()
        self._route(RelayedPacket(PacketOrigin.LOCAL_DOCK, felt.agent_id, None, data, now_ms))

    def _route(self, packet: RelayedPacket) -> list[RelayedEvent]:
        received: list[RelayedEvent] = []
        for outcome in outcomes(packet.source, self._division.standing(packet.agent_id), packet.medium):
            if outcome is RelayOutcome.RECEIVE:
                received += self._received(packet)
            elif outcome is RelayOutcome.REFUSE:
                self.dropped["a packet of a real aMussel whose id is simulated here"] += 1
            elif (carry := self._outlets.get(outcome)) is not None:
                carry(packet)
        return received

    def _received(self, packet: RelayedPacket) -> list[RelayedEvent]:
        match packet.source, packet.medium:
            case PacketOrigin.REMOTE_AMUSSEL, _ if packet.medium == RANGE:
                return self._received_range(packet)
            case PacketOrigin.REMOTE_AMUSSEL, Medium() as medium:
                return [AMusselHeard(medium, packet.at_ms, packet.data)]
            case ((PacketOrigin.REMOTE_SUPERVISOR | PacketOrigin.LABORATORY), Medium() as medium):
                return [Send(medium, packet.agent_id, packet.data)]
            case PacketOrigin.REMOTE_DOCK, None:
                if (contact := _contact(packet.data)) is None:
                    self.dropped["felt: no contact of a dock"] += 1
                    return []
                return [RemoteContact(packet.agent_id, contact)]
        self.dropped["packet: no such medium"] += 1
        return []

    def _received_range(self, packet: RelayedPacket) -> list[RelayedEvent]:
        try:
            range_m = float(packet.data)
        except ValueError:
            range_m = nan
        if (reason := out_of_range(range_m=range_m)) is not None:
            self.dropped[f"range: {reason}"] += 1
        elif not self._pings.answered(packet.agent_id):
            self.dropped["range: no ping awaits it"] += 1
        else:
            return [RangeHeard(packet.at_ms, packet.agent_id, range_m)]
        return []


def _contact(data: bytes) -> AgentStimulus | None:
    """The contact of another aPad's dock; None for anything else, such as a stimulus that no dock causes."""
    try:
        stimulus = from_wire(json.loads(data))
    except (ValueError, TypeError, KeyError, IndexError, RecursionError):
        return None
    match stimulus:
        case ContactClosed(north_um, east_um) | DockMoved(north_um, east_um):
            return stimulus if max(abs(north_um), abs(east_um)) <= 1e6 * FARTHEST_M else None
        case ContactOpened():
            return stimulus
    return None


def no_relay() -> PacketRelay:
    """The relay of a flight whose aMussels and supervisor are all in its process: it relays nothing."""
    return PacketRelay(Division(lambda _: AMusselStanding.OURS, ()), (), {})

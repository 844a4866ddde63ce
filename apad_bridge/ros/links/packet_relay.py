"""Relays packets over ROS between aMussels and supervisors that live in different processes.

`/musselbed/heard` carries the packets that aMussels transmit, `/musselbed/said` those that a supervisor sends to them, both
as bytes of the fleet's codec. Each class here is a `PacketRelay` for another division of the two:

    RealAgentRelay      a whole flight, with real aMussels beside the simulated ones
    FleetRelay          a fleet without a mission
    MissionRelay        a mission without a fleet, also over the legacy topics of aMussels that have no packets
    SeveralRelay        one of several aPads that take over from each other
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import rospy
from std_msgs.msg import Float64
from std_srvs.srv import Trigger, TriggerResponse

from agents.mussel.stimuli import from_wire, to_wire
from agents.packet_medium import Medium
from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, ours
from apad_bridge.supervisor.packet_relay import RelayedEvent, RemoteContact
from firmware_model.packets import CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import Codec
from firmware_model.states import State

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from musselbed_msgs.msg import Packet  # noqa: E402

HEARD, SAID, FELT = ours("heard"), ours("said"), ours("felt")
_CONTACT = "contact"
"""Stands on `felt` for the medium."""
_QUEUE = 5000
"""Packets that a thousand aMussels send in five seconds; a reader that stalls for longer loses the oldest."""
_CONTACT_QUEUE = 1000
_MEDIA = {medium.value: medium for medium in Medium}
_LARGEST = 1024
"""Bytes; no packet of Wi-Fi or sound here comes near it."""


class LegacyPlace(NamedTuple):
    """What an aMussel's `position` says."""

    north_m: float
    east_m: float


class LegacyCharge(NamedTuple):
    """What an aMussel's `battery_level` says."""

    battery_percent: float


class PacketTopics:
    """One topic out, one in. A message that is no packet of this fleet is dropped and counted."""

    def __init__(self, outgoing: str, incoming: str, agent_ids: Iterable[int]) -> None:
        self.dropped: Counter[str] = Counter()
        self._known = frozenset(agent_ids)
        self._inbox: Inbox[tuple[int, str, bytes]] = Inbox()
        self._publisher = rospy.Publisher(outgoing, Packet, queue_size=_QUEUE)
        self._subscriber = rospy.Subscriber(incoming, Packet, self._take, tcp_nodelay=True)

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        self._publisher.publish(_packet(medium.value, agent_id, data, now_ms))

    def take(self) -> list[tuple[int, Medium, bytes]]:
        packets = []
        for agent_id, medium, data in self._inbox.take():
            if agent_id not in self._known:
                self.dropped["packet of an aMussel that is not of this fleet"] += 1
            elif len(data) > _LARGEST:
                self.dropped["packet: too large"] += 1
            elif (known := _MEDIA.get(medium)) is None:
                self.dropped["packet: no such medium"] += 1
            else:
                packets.append((agent_id, known, data))
        return packets

    def close(self) -> None:
        self._publisher.unregister()
        self._subscriber.unregister()

    def _take(self, message: Any) -> None:
        self._inbox.put((message.agent, message.medium, bytes(message.data)))


class RealAgentRelay:
    """Joins real aMussels to a flight: receives their packets and sends them the supervisor's.

    A packet of an aMussel that is simulated here is dropped and counted: two would speak for one.
    """

    def __init__(self, agent_ids: Iterable[int], simulated: Callable[[], frozenset[int]]) -> None:
        self._topics = PacketTopics(SAID, HEARD, agent_ids)
        self._simulated = simulated

    @property
    def dropped(self) -> Counter[str]:
        return self._topics.dropped

    def advance(self, now_ms: int) -> list[RelayedEvent]:
        simulated, received = self._simulated(), list[RelayedEvent]()
        for agent_id, medium, data in self._topics.take():
            if agent_id in simulated:
                self._topics.dropped["a packet of a real aMussel whose id is simulated here"] += 1
                continue
            received.append(_heard(medium, data, now_ms))
        return received

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """Does nothing: this process receives a simulated aMussel's packets already."""

    def forward(self, send: Send, now_ms: int) -> None:
        if send.agent_id not in self._simulated():
            self._topics.transmit(send.medium, send.agent_id, send.data, now_ms)

    def close(self) -> None:
        self._topics.close()


class FleetRelay:
    """Publishes a fleet's packets and receives those for it.

    A planner that has no packets calls /amusselN/surface and /amusselN/sink, which become the same packets.
    """

    def __init__(self, agent_ids: Iterable[int], codec: Codec) -> None:
        ids = list(agent_ids)
        self._topics = PacketTopics(HEARD, SAID, ids)
        self._codec = codec
        self._called: Inbox[Send] = Inbox()
        self._services = [
            rospy.Service(of_amussel(agent_id, name), Trigger, self._service(agent_id, kind, medium))
            for agent_id in ids
            for name, kind, medium in (
                ("surface", Kind.PERMISSION, Medium.SOUND),
                ("sink", Kind.RELEASE, Medium.WIFI),
            )
        ]

    @property
    def dropped(self) -> Counter[str]:
        return self._topics.dropped

    def advance(self, now_ms: int) -> list[RelayedEvent]:
        sends = [Send(medium, agent_id, data) for agent_id, medium, data in self._topics.take()]
        return [*self._called.take(), *sends]

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        self._topics.transmit(medium, agent_id, data, now_ms)

    def forward(self, send: Send, now_ms: int) -> None:
        """Does nothing: a fleet alone has no supervisor that sends packets."""

    def close(self) -> None:
        self._topics.close()
        for service in self._services:
            service.shutdown("the flight is over")

    def _service(self, agent_id: int, kind: Kind, medium: Medium) -> Any:
        data = self._codec.encode(CommandPacket(kind, agent_id))

        def answer(_: Any) -> Any:
            self._called.put(Send(medium, agent_id, data))
            return TriggerResponse(success=True, message=f"told aMussel {agent_id} by {medium.value}")

        return answer


class MissionRelay:
    """Receives aMussels' packets for a mission, or the topics of aMussels that have none, and sends packets to them.

    The topics /amusselN/position and battery_level of an aMussel that sends packets are ignored. Topics carry no state: an
    aMussel known by them alone is taken to float, as in the paper's experiments, and to charge while a dock holds it
    (`is_held`).
    """

    def __init__(
        self, agent_ids: Iterable[int], codec: Codec, theta: int, is_held: Callable[[int], bool]
    ) -> None:
        ids = list(agent_ids)
        self._topics = PacketTopics(SAID, HEARD, ids)
        self._codec = codec
        self._theta = theta
        self._is_held = is_held
        self._with_packets: set[int] = set()
        self._places: dict[int, LegacyPlace] = {}
        self._charges: dict[int, float] = {}
        self._legacy: Inbox[tuple[int, LegacyPlace | LegacyCharge]] = Inbox()
        self._subscribers = [
            subscriber
            for agent_id in ids
            for subscriber in (
                rospy.Subscriber(of_amussel(agent_id, "position"), NavSts, self._take_place, agent_id),
                rospy.Subscriber(of_amussel(agent_id, "battery_level"), Float64, self._take_charge, agent_id),
            )
        ]

    @property
    def dropped(self) -> Counter[str]:
        return self._topics.dropped + self._legacy.dropped

    def advance(self, now_ms: int) -> list[RelayedEvent]:
        received: list[RelayedEvent] = []
        for agent_id, medium, data in self._topics.take():
            self._with_packets.add(agent_id)
            received.append(_heard(medium, data, now_ms))
        return received + self._take_legacy(now_ms)

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        self._topics.transmit(medium, agent_id, data, now_ms)

    def forward(self, send: Send, now_ms: int) -> None:
        """Does nothing: a mission alone has no aMussels in its process."""

    def close(self) -> None:
        self._topics.close()
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _take_legacy(self, now_ms: int) -> list[RelayedEvent]:
        published: set[int] = set()
        for agent_id, values in self._legacy.take():
            if (reason := out_of_range(**values._asdict())) is not None:
                self._topics.dropped[f"an aMussel's topic: {reason}"] += 1
                continue
            published.add(agent_id)
            match values:
                case LegacyPlace():
                    self._places[agent_id] = values
                case LegacyCharge(percent):
                    self._charges[agent_id] = min(1.0, max(0.0, percent / 100))
        known = published & self._places.keys() & self._charges.keys()
        return [self._status(agent_id, now_ms) for agent_id in sorted(known - self._with_packets)]

    def _status(self, agent_id: int, now_ms: int) -> WifiHeard:
        state = State.CHARGING if self._is_held(agent_id) else State.FLOATING
        north_m, east_m = self._places[agent_id]
        charge = self._charges[agent_id]
        packet = StatusPacket(agent_id, 0, state, charge, 1.0, north_m, east_m, 0.0, now_ms * self._theta)
        return WifiHeard(now_ms, self._codec.encode(packet))

    def _take_place(self, message: Any, agent_id: int) -> None:
        self._legacy.put((agent_id, LegacyPlace(message.position.north, message.position.east)))

    def _take_charge(self, message: Any, agent_id: int) -> None:
        self._legacy.put((agent_id, LegacyCharge(message.data)))


class SeveralRelay:
    """Relays for one of several aPads: a fleet's relay and a mission's in one.

    An aMussel of its own that another aPad serves is treated as in a fleet alone; one that it serves for another aPad,
    which is simulated elsewhere, like a real one. The contacts of its docks with the latter go out on `musselbed/felt`,
    because no aPad of generation B publishes which aMussels it holds. `agent_ids` are those of all the aPads; `simulated`
    gives those of its own fleet that are simulated at the moment.
    """

    def __init__(
        self, agent_ids: Iterable[int], allocation: Allocation, simulated: Callable[[], frozenset[int]]
    ) -> None:
        ids = list(agent_ids)
        self._allocation = allocation
        self._simulated = simulated
        self._fleet_topics = PacketTopics(HEARD, SAID, ids)
        self._mission_topics = PacketTopics(SAID, HEARD, ids)
        self._felt: Inbox[tuple[int, bytes]] = Inbox()
        self._publisher = rospy.Publisher(FELT, Packet, queue_size=_CONTACT_QUEUE)
        self._subscriber = rospy.Subscriber(FELT, Packet, self._take, tcp_nodelay=True)
        self._dropped: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        topics = self._fleet_topics.dropped + self._mission_topics.dropped
        return self._dropped + topics + self._felt.dropped

    def advance(self, now_ms: int) -> list[RelayedEvent]:
        allocation, simulated, received = self._allocation, self._simulated(), list[RelayedEvent]()
        for agent_id, medium, data in self._mission_topics.take():
            if agent_id in allocation.own & simulated:
                # Packets of those served elsewhere are our own, which come back.
                if agent_id not in allocation.served_elsewhere:
                    self._dropped["a packet of a real aMussel whose id is simulated here"] += 1
            elif agent_id in allocation.served:
                received.append(_heard(medium, data, now_ms))
        received += [
            Send(medium, agent_id, data)
            for agent_id, medium, data in self._fleet_topics.take()
            if agent_id in allocation.served_elsewhere
        ]
        for agent_id, data in self._felt.take():
            if agent_id in allocation.own:
                received += self._decode_felt(agent_id, data)
        return received

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        if agent_id in self._allocation.served_elsewhere:
            self._fleet_topics.transmit(medium, agent_id, data, now_ms)

    def forward(self, send: Send, now_ms: int) -> None:
        if send.agent_id not in self._simulated():
            self._mission_topics.transmit(send.medium, send.agent_id, send.data, now_ms)

    def send_contact(self, felt: RemoteContact, now_ms: int) -> None:
        data = json.dumps(to_wire(felt.stimulus)).encode()
        self._publisher.publish(_packet(_CONTACT, felt.agent_id, data, now_ms))

    def close(self) -> None:
        self._fleet_topics.close()
        self._mission_topics.close()
        self._publisher.unregister()
        self._subscriber.unregister()

    def _decode_felt(self, agent_id: int, data: bytes) -> list[RemoteContact]:
        try:
            return [RemoteContact(agent_id, from_wire(json.loads(data)))]
        except (ValueError, TypeError, KeyError, IndexError):
            self._dropped["felt: no word of a dock"] += 1
            return []

    def _take(self, message: Any) -> None:
        self._felt.put((message.agent, bytes(message.data)), always=True)


def _heard(medium: Medium, data: bytes, now_ms: int) -> WifiHeard | SoundHeard:
    return WifiHeard(now_ms, data) if medium is Medium.WIFI else SoundHeard(now_ms, data)


def _packet(medium: str, agent_id: int, data: bytes, now_ms: int) -> Packet:
    message = Packet(mission_time_ms=now_ms, agent=agent_id, medium=medium, data=data)
    message.header.stamp = to_ros(now_ms)
    return message

"""Carries packets over ROS between aMussels and supervisors that live in different processes, for a `PacketRelay`.

`/musselbed/heard` carries the packets that aMussels transmit, `/musselbed/said` those that a supervisor sends to them, both
as bytes of the fleet's codec; and ranges to real aMussels, and pings of them. `/musselbed/felt` carries the contacts of an
aPad's docks with aMussels of another process. No aPad of generation B publishes which aMussels it holds. Peers without
packets use an aMussel's services and legacy topics.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Container, Iterable, Set
from typing import Any, NamedTuple

import rospy
from std_msgs.msg import Bool, Float64
from std_srvs.srv import Trigger, TriggerResponse

from agents.packet_medium import Medium, medium_of
from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.ros.system.inbox import Listening
from apad_bridge.ros.system.ros_time import stamp
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, ours
from apad_bridge.supervisor.packet_relay import RANGE, Carriage, PacketOrigin, RelayedPacket
from firmware_model.packets import EVERYONE, CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import Codec
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow, fraction
from firmware_model.states import State

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from musselbed_msgs.msg import Packet  # noqa: E402

_HEARD, _SAID, _FELT = ours("heard"), ours("said"), ours("felt")
_TOPICS = {
    PacketOrigin.REMOTE_AMUSSEL: (_HEARD, _SAID, PacketOrigin.LOCAL_SUPERVISOR),
    PacketOrigin.REMOTE_SUPERVISOR: (_SAID, _HEARD, PacketOrigin.LOCAL_AMUSSEL),
    PacketOrigin.REMOTE_DOCK: (_FELT, _FELT, PacketOrigin.LOCAL_DOCK),
}
"""By peer: the topic of its packets, the topic to it, and the source of the latter's packets."""
_CONTACT = "contact"
"""Stands on `felt` for the medium."""
_QUEUE = 5000
"""Packets that a thousand aMussels send in five seconds; a reader that stalls for longer loses the oldest."""
_MEDIA: dict[str, Carriage] = {**{medium.value: medium for medium in Medium}, _CONTACT: None, RANGE: RANGE}
_LARGEST = 1024
"""Bytes; no packet of Wi-Fi or sound here comes near it."""
_CHARGING_QUEUE = 10
_END_S = 5.0
_SERVICES = {"surface": Kind.PERMISSION, "sink": Kind.RELEASE}


class PacketTopics(Listening[tuple[PacketOrigin, int, str, bytes]]):
    """The topics to and from `peers`. A message that is no packet of these aMussels is dropped and counted."""

    def __init__(self, agent_ids: Iterable[int], peers: Iterable[PacketOrigin]) -> None:
        super().__init__()
        self.senders: set[int] = set()
        """The aMussels of other processes that have sent packets."""
        self._known = frozenset(agent_ids)
        self._publishers = {}
        for peer in peers:
            incoming, outgoing, sends = _TOPICS[peer]
            self._publishers[sends] = rospy.Publisher(outgoing, Packet, queue_size=_QUEUE)
            self._subscribers.append(rospy.Subscriber(incoming, Packet, self._put, peer, tcp_nodelay=True))

    def take(self, now_ms: MissionMs) -> list[RelayedPacket]:
        """The packets since the last call, stamped `now_ms`, because the clocks of other processes are not ours."""
        packets = []
        for source, agent_id, medium, data in self._inbox.take():
            is_command_to_all = source is PacketOrigin.REMOTE_SUPERVISOR and agent_id == EVERYONE
            if agent_id not in self._known and not is_command_to_all:
                self._dropped["packet of an aMussel that is not of this fleet"] += 1
            elif len(data) > _LARGEST:
                self._dropped["packet: too large"] += 1
            elif medium not in _MEDIA:
                self._dropped["packet: no such medium"] += 1
            else:
                if source is PacketOrigin.REMOTE_AMUSSEL and medium != RANGE:
                    self.senders.add(agent_id)
                packets.append(RelayedPacket(source, agent_id, _MEDIA[medium], data, now_ms))
        return packets

    def publish(self, packet: RelayedPacket) -> None:
        """Publishes on the topic of the packet's source."""
        medium = _CONTACT if packet.medium is None else str(packet.medium)
        message = Packet(mission_time_ms=packet.at_ms, agent=packet.agent_id, medium=medium, data=packet.data)
        message.header.stamp = stamp(packet.at_ms)
        self._publishers[packet.source].publish(message)

    def close(self) -> None:
        for publisher in self._publishers.values():
            publisher.unregister()
        super().close()

    def _put(self, message: Any, source: PacketOrigin) -> None:
        always = source is PacketOrigin.REMOTE_DOCK
        self._inbox.put((source, message.agent, message.medium, bytes(message.data)), always=always)


class AMusselServices(Listening[tuple[int, Medium, bytes]]):
    """`/amusselN/surface` and `/amusselN/sink`, by which a supervisor without packets sends a permission and a release."""

    def __init__(self, agent_ids: Iterable[int], codec: Codec) -> None:
        super().__init__()
        self._codec = codec
        self._services = [
            rospy.Service(of_amussel(agent_id, name), Trigger, self._service(agent_id, kind))
            for agent_id in agent_ids
            for name, kind in _SERVICES.items()
        ]

    def take(self, now_ms: MissionMs) -> list[RelayedPacket]:
        return [
            RelayedPacket(PacketOrigin.REMOTE_SUPERVISOR, *called, now_ms) for called in self._inbox.take()
        ]

    def close(self) -> None:
        for service in self._services:
            service.shutdown("the flight is over")

    def _service(self, agent_id: int, kind: Kind) -> Callable[[Any], Any]:
        medium = medium_of(kind)
        data = self._codec.encode(CommandPacket(kind, agent_id))

        def answer(_: Any) -> Any:
            self._inbox.put((agent_id, medium, data))
            return TriggerResponse(success=True, message=f"told aMussel {agent_id} by {medium.value}")

        return answer


class LegacyOrders(Listening[tuple[int, bool | None]]):
    """`/amusselN/goto_surface` and `/amusselN/charging`, by which legacy controllers command an aMussel, of a fleet.

    `goto_surface` is a permission to surface when it is true; false has no effect. `charging` has none either: a simulated
    aMussel charges by its board as long as a dock holds it. Each message without an effect is counted.
    """

    def __init__(
        self, agent_ids: Iterable[int], codec: Codec, simulated: Callable[[], Container[int]]
    ) -> None:
        """Only `simulated` aMussels are commanded: a real one subscribes to its own topics."""
        super().__init__()  # of the messages' permissions by aMussel; None for a message of `charging`
        self._codec = codec
        self._simulated = simulated
        self._subscribers = [
            subscriber
            for agent_id in agent_ids
            for subscriber in (
                rospy.Subscriber(of_amussel(agent_id, "goto_surface"), Bool, self._take_permission, agent_id),
                rospy.Subscriber(of_amussel(agent_id, "charging"), Float64, self._take_charging, agent_id),
            )
        ]

    def take(self, now_ms: MissionMs) -> list[RelayedPacket]:
        packets = []
        for agent_id, permission in self._inbox.take():
            if agent_id not in self._simulated():
                continue
            if permission is None:
                self._dropped["charging: a simulated aMussel charges at its dock"] += 1
            elif not permission:
                self._dropped["goto_surface: false has no effect"] += 1
            else:
                data = self._codec.encode(CommandPacket(Kind.PERMISSION, agent_id))
                packets.append(RelayedPacket(PacketOrigin.LABORATORY, agent_id, Medium.SOUND, data, now_ms))
        return packets

    def _take_permission(self, message: Any, agent_id: int) -> None:
        self._inbox.put((agent_id, bool(message.data)), always=True)

    def _take_charging(self, message: Any, agent_id: int) -> None:
        self._inbox.put((agent_id, None))


class PublishedPlace(NamedTuple):
    """The place in an aMussel's `position`."""

    north_m: float
    east_m: float


class PublishedCharge(NamedTuple):
    """The charge in an aMussel's `battery_level`."""

    battery_percent: float


class AMusselTopics(Listening[tuple[int, PublishedPlace | PublishedCharge]]):
    """`/amusselN/position` and `battery_level` of aMussels that have no packets, as status packets.

    The topics of an aMussel in `senders`, which sends packets, are left for good: ten positions a second of a thousand
    aMussels would cost a mission most of its time. Topics carry no state: an aMussel known by them alone is taken to float,
    as in the paper's experiments, and to charge while a dock holds it (`is_held`): then `/amusselN/charging` is published
    at each tick, the percent points that the scenario's board gains since the last one.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        codec: Codec,
        scale: TimeScale,
        is_held: Callable[[int], bool],
        senders: Set[int],
        charge: ChargeModel,
    ) -> None:
        super().__init__()
        self._codec = codec
        self._scale = scale
        self._is_held = is_held
        self._senders = senders
        self._charge = charge
        self._charging_since_ms: dict[int, MissionMs] = {}
        """By aMussel in a dock, the mission time up to which its charging is published."""
        self._places: dict[int, PublishedPlace] = {}
        self._charges: dict[int, float] = {}
        ids = list(agent_ids)
        self._charging = {
            agent_id: rospy.Publisher(of_amussel(agent_id, "charging"), Float64, queue_size=_CHARGING_QUEUE)
            for agent_id in ids
        }
        self._of_amussels = {
            agent_id: (
                rospy.Subscriber(of_amussel(agent_id, "position"), NavSts, self._take_place, agent_id),
                rospy.Subscriber(of_amussel(agent_id, "battery_level"), Float64, self._take_charge, agent_id),
            )
            for agent_id in ids
        }
        self._left: queue.SimpleQueue[Any] = queue.SimpleQueue()
        """Publishers and subscribers to unregister, each by a call to the master; None at the end."""
        self._leaver = threading.Thread(target=self._unregister_left, name="topics left", daemon=True)
        self._leaver.start()

    def take(self, now_ms: MissionMs) -> list[RelayedPacket]:
        published: set[int] = set()
        for agent_id, values in self._inbox.take():
            if (reason := out_of_range(**values._asdict())) is not None:
                self._dropped[f"an aMussel's topic: {reason}"] += 1
                continue
            published.add(agent_id)
            match values:
                case PublishedPlace():
                    self._places[agent_id] = values
                case PublishedCharge(percent):
                    self._charges[agent_id] = min(1.0, max(0.0, percent / 100))
        for agent_id in self._of_amussels.keys() & self._senders:
            for each in (*self._of_amussels.pop(agent_id), self._charging.pop(agent_id)):
                self._left.put(each)
        self._publish_charging(now_ms)
        known = published & self._places.keys() & self._charges.keys()
        return [self._status(agent_id, now_ms) for agent_id in sorted(known) if agent_id not in self._senders]

    def close(self) -> None:
        self._left.put(None)
        self._leaver.join(_END_S)
        for subscribers in self._of_amussels.values():
            for subscriber in subscribers:
                subscriber.unregister()
        for publisher in self._charging.values():
            publisher.unregister()

    def _unregister_left(self) -> None:
        """A master out of reach holds up this thread, and not the flight's."""
        while (left := self._left.get()) is not None:
            left.unregister()

    def _publish_charging(self, now_ms: MissionMs) -> None:
        for agent_id, charge in self._charges.items():
            if agent_id in self._senders or not self._is_held(agent_id):
                self._charging_since_ms.pop(agent_id, None)
                continue
            since_ms = self._charging_since_ms.setdefault(agent_id, now_ms)
            if since_ms == now_ms:
                continue
            self._charging_since_ms[agent_id] = now_ms
            before = Battery(self._scale.agent_ms(since_ms), round(charge * FULL), Flow.CHARGING)
            gained = self._charge.charge_at(before, self._scale.agent_ms(now_ms)) - before.charge
            self._charging[agent_id].publish(Float64(100 * fraction(gained)))

    def _status(self, agent_id: int, now_ms: MissionMs) -> RelayedPacket:
        state = State.CHARGING if self._is_held(agent_id) else State.FLOATING
        north_m, east_m = self._places[agent_id]
        charge = self._charges[agent_id]
        packet = StatusPacket(
            agent_id=agent_id,
            sequence=0,
            state=state,
            primary=charge,
            secondary=1.0,
            north_m=north_m,
            east_m=east_m,
            depth_m=0.0,
            agent_ms=self._scale.agent_ms(now_ms),
        )
        data = self._codec.encode(packet)
        return RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, agent_id, Medium.WIFI, data, now_ms)

    def _take_place(self, message: Any, agent_id: int) -> None:
        self._inbox.put((agent_id, PublishedPlace(message.position.north, message.position.east)))

    def _take_charge(self, message: Any, agent_id: int) -> None:
        self._inbox.put((agent_id, PublishedCharge(message.data)))

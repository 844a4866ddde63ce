"""The two ends of an ether on ROS: a fleet's, and a mission's.

`/musselbed/heard` carries what aMussels transmit, `/musselbed/said` what a supervisor says to them, both as bytes of the
fleet's codec. A mission also hears a fleet that knows nothing of us, by its `/amusselN/position` and `battery_level`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import rospy
from std_msgs.msg import Float64
from std_srvs.srv import Trigger, TriggerResponse

from agents.packet_medium import Medium
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard
from apad_bridge.ros.links.inbox import Inbox
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, ours
from firmware_model.packets import CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import Codec
from firmware_model.states import State

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from musselbed_msgs.msg import Packet  # noqa: E402

HEARD, SAID = ours("heard"), ours("said")
_QUEUE = 5000
"""A thousand aMussels' packets of five seconds; a reader that stalls for longer loses the oldest."""
_MEDIA = {medium.value: medium for medium in Medium}
_LARGEST = 1024
"""Bytes; no packet of Wi-Fi or sound here comes near it."""


class PacketTopics:
    """One topic out, one in; what is no packet of ours is dropped and counted."""

    def __init__(self, outgoing: str, incoming: str, agent_ids: Iterable[int]) -> None:
        self.dropped: Counter[str] = Counter()
        self._known = frozenset(agent_ids)
        self._inbox: Inbox[tuple[int, str, bytes]] = Inbox()
        self._publisher = rospy.Publisher(outgoing, Packet, queue_size=_QUEUE)
        self._subscriber = rospy.Subscriber(incoming, Packet, self._take, tcp_nodelay=True)

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        message = Packet(mission_time_ms=now_ms, agent=agent_id, medium=medium.value, data=data)
        message.header.stamp = to_ros(now_ms)
        self._publisher.publish(message)

    def take(self) -> list[tuple[int, Medium, bytes]]:
        came = []
        for agent_id, medium, data in self._inbox.take():
            if agent_id not in self._known:
                self.dropped["packet of an aMussel that is not of this fleet"] += 1
            elif len(data) > _LARGEST:
                self.dropped["packet: too large"] += 1
            elif (known := _MEDIA.get(medium)) is None:
                self.dropped["packet: no such medium"] += 1
            else:
                came.append((agent_id, known, data))
        return came

    def close(self) -> None:
        self._publisher.unregister()
        self._subscriber.unregister()

    def _take(self, message: Any) -> None:
        self._inbox.put((message.agent, message.medium, bytes(message.data)))


class RealAgentRelay:
    """Real aMussels beside simulated ones: their packets are heard on /musselbed/heard, and what is said to them goes out.

    A packet of an aMussel that is simulated here is dropped and counted: two speak for one.
    """

    def __init__(self, agent_ids: Iterable[int], simulated: Callable[[], frozenset[int]]) -> None:
        self._topics = PacketTopics(SAID, HEARD, agent_ids)
        self._simulated = simulated

    @property
    def dropped(self) -> Counter[str]:
        return self._topics.dropped

    def advance(self, now_ms: int) -> list[WifiHeard | SoundHeard | Send]:
        simulated, heard = self._simulated(), list[WifiHeard | SoundHeard | Send]()
        for agent_id, medium, data in self._topics.take():
            if agent_id in simulated:
                self._topics.dropped["a packet of a real aMussel whose id is simulated here"] += 1
                continue
            heard.append(WifiHeard(now_ms, data) if medium is Medium.WIFI else SoundHeard(now_ms, data))
        return heard

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """What a simulated aMussel transmits is heard in this process already."""

    def said(self, send: Send, now_ms: int) -> None:
        if send.agent_id not in self._simulated():
            self._topics.transmit(send.medium, send.agent_id, send.data, now_ms)

    def close(self) -> None:
        self._topics.close()


class FleetRelay:
    """The fleet's end: tells what its aMussels transmit, hears what is said to them.

    A planner that has no packets calls /amusselN/surface and /amusselN/sink, which become the same packets.
    """

    def __init__(self, agent_ids: Iterable[int], codec: Codec) -> None:
        ids = list(agent_ids)
        self._topics = PacketTopics(HEARD, SAID, ids)
        self._codec = codec
        self._called: Inbox[Send] = Inbox()
        self._services = [
            rospy.Service(of_amussel(agent_id, name), Trigger, self._call(agent_id, kind, medium))
            for agent_id in ids
            for name, kind, medium in (
                ("surface", Kind.PERMISSION, Medium.SOUND),
                ("sink", Kind.RELEASE, Medium.WIFI),
            )
        ]

    @property
    def dropped(self) -> Counter[str]:
        return self._topics.dropped

    def advance(self, now_ms: int) -> list[WifiHeard | SoundHeard | Send]:
        said = [Send(medium, agent_id, data) for agent_id, medium, data in self._topics.take()]
        return [*self._called.take(), *said]

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        self._topics.transmit(medium, agent_id, data, now_ms)

    def said(self, send: Send, now_ms: int) -> None:
        """A fleet alone has no supervisor that says anything."""

    def close(self) -> None:
        self._topics.close()
        for service in self._services:
            service.shutdown("the flight is over")

    def _call(self, agent_id: int, kind: Kind, medium: Medium) -> Any:
        data = self._codec.encode(CommandPacket(kind, agent_id))

        def answer(_: Any) -> Any:
            self._called.put(Send(medium, agent_id, data))
            return TriggerResponse(success=True, message=f"told aMussel {agent_id} by {medium.value}")

        return answer


class MissionRelay:
    """The mission's end: hears aMussels, by their packets or by the topics of a fleet that has none, and speaks to them.

    One that sends packets is not listened to on its topics. Topics say no state: an aMussel of whom only they are heard is
    taken to float, as in the paper's experiments, and to charge while `is_held` says that a dock holds it.
    """

    def __init__(
        self, agent_ids: Iterable[int], codec: Codec, theta: int, is_held: Callable[[int], bool]
    ) -> None:
        ids = list(agent_ids)
        self._topics = PacketTopics(SAID, HEARD, ids)
        self._codec = codec
        self._theta = theta
        self._is_held = is_held
        self._speaking: set[int] = set()
        self._places: dict[int, tuple[float, float]] = {}
        self._charges: dict[int, float] = {}
        self._legacy: Inbox[tuple[int, tuple[float, ...]]] = Inbox()
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

    def advance(self, now_ms: int) -> list[WifiHeard | SoundHeard | Send]:
        heard: list[WifiHeard | SoundHeard | Send] = []
        for agent_id, medium, data in self._topics.take():
            self._speaking.add(agent_id)
            heard.append(WifiHeard(now_ms, data) if medium is Medium.WIFI else SoundHeard(now_ms, data))
        return heard + self._hear_topics(now_ms)

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        self._topics.transmit(medium, agent_id, data, now_ms)

    def said(self, send: Send, now_ms: int) -> None:
        """A mission alone has no aMussels to say anything to."""

    def close(self) -> None:
        self._topics.close()
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _hear_topics(self, now_ms: int) -> list[WifiHeard]:
        spoke: set[int] = set()
        for agent_id, values in self._legacy.take():
            if not all(map(math.isfinite, values)):
                self._topics.dropped["an aMussel's topic: not finite"] += 1
                continue
            spoke.add(agent_id)
            if len(values) == 2:
                self._places[agent_id] = (values[0], values[1])
            else:
                self._charges[agent_id] = min(1.0, max(0.0, values[0] / 100))
        known = spoke & self._places.keys() & self._charges.keys()
        return [self._status(agent_id, now_ms) for agent_id in sorted(known - self._speaking)]

    def _status(self, agent_id: int, now_ms: int) -> WifiHeard:
        state = State.CHARGING if self._is_held(agent_id) else State.FLOATING
        north_m, east_m = self._places[agent_id]
        charge = self._charges[agent_id]
        packet = StatusPacket(agent_id, 0, state, charge, 1.0, north_m, east_m, 0.0, now_ms * self._theta)
        return WifiHeard(now_ms, self._codec.encode(packet))

    def _take_place(self, message: Any, agent_id: int) -> None:
        self._legacy.put((agent_id, (message.position.north, message.position.east)))

    def _take_charge(self, message: Any, agent_id: int) -> None:
        self._legacy.put((agent_id, (message.data,)))

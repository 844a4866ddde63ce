"""The ether of one of several aPads that take over from each other: a fleet's end and a mission's in one.

An aMussel that is served elsewhere is heard and spoken to on `musselbed/heard` and `musselbed/said`, like one of a fleet
alone; a guest, which is simulated elsewhere, like a real one. What an aPad's docks do to a guest crosses on
`musselbed/felt`, for no aPad of generation B says what it holds, and none says it to whom.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import rospy

from agents.mussel.stimuli import from_wire, to_wire
from agents.packet_medium import Medium
from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard
from apad_bridge.ros.links.inbox import Inbox
from apad_bridge.ros.links.packet_router import HEARD, SAID, PacketTopics
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours
from apad_bridge.supervisor.packet_relay import Came, Felt

use_generated_messages()

from musselbed_msgs.msg import Packet  # noqa: E402

FELT = ours("felt")
_CONTACT = "contact"
"""What stands in such a packet for the medium."""
_QUEUE = 1000


class SeveralRelay:
    """`everybody` are the aMussels of all the aPads, `simulated` says which of its own fleet are so at the moment."""

    def __init__(
        self, everybody: Iterable[int], allocation: Allocation, simulated: Callable[[], frozenset[int]]
    ) -> None:
        ids = list(everybody)
        self._share = allocation
        self._simulated = simulated
        self._fleets_end = PacketTopics(HEARD, SAID, ids)
        self._missions_end = PacketTopics(SAID, HEARD, ids)
        self._felt: Inbox[tuple[int, bytes]] = Inbox()
        self._publisher = rospy.Publisher(FELT, Packet, queue_size=_QUEUE)
        self._subscriber = rospy.Subscriber(FELT, Packet, self._take, tcp_nodelay=True)
        self._dropped: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        return self._dropped + self._fleets_end.dropped + self._missions_end.dropped + self._felt.dropped

    def advance(self, now_ms: int) -> list[Came]:
        allocation, simulated, came = self._share, self._simulated(), list[Came]()
        for agent_id, medium, data in self._missions_end.take():
            if agent_id in allocation.own & simulated:
                if (
                    agent_id not in allocation.served_elsewhere
                ):  # of the given ones it is our own word that comes back
                    self._dropped["a packet of a real aMussel whose id is simulated here"] += 1
            elif agent_id in allocation.served:
                came.append(WifiHeard(now_ms, data) if medium is Medium.WIFI else SoundHeard(now_ms, data))
        came += [
            Send(medium, agent_id, data)
            for agent_id, medium, data in self._fleets_end.take()
            if agent_id in allocation.served_elsewhere
        ]
        for agent_id, data in self._felt.take():
            if agent_id in allocation.own:
                came += self._made_out(agent_id, data)
        return came

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        if agent_id in self._share.served_elsewhere:
            self._fleets_end.transmit(medium, agent_id, data, now_ms)

    def said(self, send: Send, now_ms: int) -> None:
        if send.agent_id not in self._simulated():
            self._missions_end.transmit(send.medium, send.agent_id, send.data, now_ms)

    def tell_served_elsewhere(self, felt: Felt, now_ms: int) -> None:
        data = json.dumps(to_wire(felt.stimulus)).encode()
        message = Packet(mission_time_ms=now_ms, agent=felt.agent_id, medium=_CONTACT, data=data)
        message.header.stamp = to_ros(now_ms)
        self._publisher.publish(message)

    def close(self) -> None:
        self._fleets_end.close()
        self._missions_end.close()
        self._publisher.unregister()
        self._subscriber.unregister()

    def _made_out(self, agent_id: int, data: bytes) -> list[Felt]:
        try:
            return [Felt(agent_id, from_wire(json.loads(data)))]
        except (ValueError, TypeError, KeyError, IndexError):
            self._dropped["felt: no word of a dock"] += 1
            return []

    def _take(self, message: Any) -> None:
        self._felt.put((message.agent, bytes(message.data)), always=True)

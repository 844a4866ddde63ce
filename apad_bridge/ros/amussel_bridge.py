"""Real aMussels on ROS: a node that carries packets between the ways to them and the topics `heard` and `said`.

The nodes may have a codec of their own. Then the bridge translates: on the graph all packets are in the scenario's codec.
"""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Self

import genpy
import rosgraph
import rospy

from agents.packet_medium import Medium
from agents.time_scale import MissionMs
from apad_bridge.beliefs.input_ranges import status_out_of_range
from apad_bridge.doctor.network import Unreachable, call
from apad_bridge.ros.gateway.claims import LEASE_S, PERIOD_S, TOPIC
from apad_bridge.ros.links.packet_topics import PacketTopics
from apad_bridge.ros.node_links import (
    FromNode,
    LinkNotice,
    LinkResult,
    NodeLink,
    NodeRanged,
    NotCarried,
    SentToNode,
)
from apad_bridge.ros.system.node import start_node
from apad_bridge.ros.system.ros_time import follow_master
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.supervisor.packet_relay import RANGE, Carriage, PacketOrigin, RelayedPacket
from apad_bridge.vehicle.link_errors import PeerFailed
from firmware_model.packets import EVERYONE, CommandPacket, LogRecords, Packet, ShortStatus, StatusPacket
from firmware_model.packets.codec import Codec

use_generated_messages()

from musselbed_msgs.msg import FleetClaim  # noqa: E402

_POLL_S = 0.03
_NO_MISSIONS_TIME = MissionMs(0)
"""A bridge begins and ends when it likes, and knows no mission's time. The stamps of its messages are the master's."""
_OF_AMUSSELS = StatusPacket | ShortStatus | LogRecords

Tell = Callable[[str, str], None]
"""Takes the kind of a line, and its text for a person."""


class AMusselBridge:
    """The node's parts. One thread calls `advance` with milliseconds that run as fast as real ones.

    `counts` has every packet, by what became of it. The first one of each kind that is dropped is told.
    """

    def __init__(
        self,
        ids: Sequence[int],
        codec: Codec,
        links: Sequence[NodeLink],
        tell: Tell,
        nodes_codec: Codec | None = None,
    ) -> None:
        """`links` are of one medium each; `nodes_codec` is the nodes' own, and None for the scenario's `codec`."""
        self.counts: Counter[str] = Counter()
        self._ids = frozenset(ids)
        self._codec, self._nodes_codec = codec, nodes_codec
        self._links = {it.medium: it for it in links}
        self._report = tell
        self._topics = PacketTopics(ids, [PacketOrigin.REMOTE_SUPERVISOR])
        self._claims = rospy.Publisher(TOPIC, FleetClaim, queue_size=1, latch=True)
        self._claim = FleetClaim(node=rospy.get_name(), real=True, lease_s=LEASE_S, ids=sorted(ids))
        self._claim.since = genpy.Time.from_sec(time.time())
        self._claimed_ms = -round(1000 * PERIOD_S)
        self._heard: set[int] = set()

    @classmethod
    def on_graph(
        cls,
        ids: Sequence[int],
        codec: Codec,
        links: Sequence[NodeLink],
        tell: Tell,
        nodes_codec: Codec | None,
    ) -> Self:
        """Puts the node on the graph. PeerFailed, in one line, where no master answers."""
        master_uri = rosgraph.get_master_uri()
        try:
            call(master_uri, "getPid")
            # Nodes for other aMussels, with modems of their own, may stand beside this one.
            start_node(f"musselbed_bridge_{min(ids)}")
        except (OSError, Unreachable, rospy.ROSException) as error:
            raise PeerFailed(f"no ROS master answers at {master_uri} ({error})") from error
        for link in links:
            link.begin()
        return cls(ids, codec, links, tell, nodes_codec)

    def advance(self, now_ms: MissionMs) -> None:
        """Waits until the first link has something, for some 30 ms at most; then carries what has come both ways."""
        if now_ms - self._claimed_ms >= 1000 * PERIOD_S:
            self._claimed_ms = now_ms
            self._claims.publish(self._claim)
        next(iter(self._links.values())).wait(_POLL_S)
        for link in self._links.values():
            self._take(link, link.poll(now_ms))
        for packet in self._topics.take(now_ms):
            self._say(packet, now_ms)
        for reason, count in self._topics.dropped.items():
            if count > self.counts[reason]:
                self._drop(reason, count - self.counts[reason])

    def close(self) -> None:
        for link in self._links.values():
            link.close()
        self._topics.close()
        # Its claim ends with it, and not after a lease: then a person may take the aMussels back.
        self._claim.lease_s = 0.0
        self._claims.publish(self._claim)
        self._claims.unregister()

    def _take(self, link: NodeLink, results: list[LinkResult]) -> None:
        for result in results:
            match result:
                case FromNode():
                    self._hear(link, result)
                case SentToNode():
                    self.counts["sent to aMussels"] += 1
                case NodeRanged(agent_id, range_m):
                    self.counts["ranges to aMussels"] += 1
                    self._publish(agent_id, RANGE, b"%.3f" % range_m)
                case NotCarried(reason, count):
                    self._drop(reason, count)
                case LinkNotice(text):
                    self._report("modem", text)

    def _say(self, packet: RelayedPacket, now_ms: MissionMs) -> None:
        if packet.medium is None:
            self._drop("to an aMussel: a contact, which is of the topic `felt`")
            return
        data = packet.data
        # One way to the nodes takes all: a permission goes by sound, and a release by Wi-Fi, to whoever has both.
        medium = Medium.SOUND if packet.medium == RANGE else packet.medium
        link = self._links.get(medium) or next(iter(self._links.values()))
        if packet.medium == RANGE:
            self._take(link, link.ping(packet.agent_id, now_ms))
            return
        if self._nodes_codec is not None:
            if (read := self._codec.decode(data)) is None:
                self._drop("to an aMussel: damaged, or another layout than the scenario's codec")
                return
            try:
                data = self._nodes_codec.encode(read)
            except Exception as error:  # as in decode
                self._drop(f"to an aMussel: the nodes' codec raised {type(error).__name__}", why=str(error))
                return
            if not data:
                kind = read.kind.name if isinstance(read, CommandPacket) else type(read).__name__
                self._drop(f"to an aMussel: the nodes' codec has no bytes for {kind}")
                return
        self._take(link, link.send(packet.agent_id, data, now_ms))

    def _hear(self, link: NodeLink, packet: FromNode) -> None:
        try:
            read = (self._nodes_codec or self._codec).decode(packet.data)
        except Exception as error:  # a laboratory's own code: one datagram ends no bridge
            self._drop(f"heard: the codec raised {type(error).__name__}", why=str(error))
            return
        if read is None:
            whose = "scenario's" if self._nodes_codec is None else "nodes'"
            self._drop(f"heard: damaged, or another layout than the {whose} codec")
            return
        if not isinstance(read, _OF_AMUSSELS):
            self._drop("heard: another bridge's packet to an aMussel")
            return
        if read.agent_id == EVERYONE and packet.agent_id is not None:
            read = replace(read, agent_id=packet.agent_id)
        if (agent_id := packet.agent_id or read.agent_id) not in self._ids:
            self._drop(f"heard: aMussel {agent_id} is none of --ids")
        elif read.agent_id != agent_id:
            self._drop("heard: what stands beside the packet names another aMussel than the packet")
        elif (data := packet.data if self._nodes_codec is None else self._written(read)) is not None:
            self.counts["heard from aMussels"] += 1
            if agent_id not in self._heard:
                self._heard.add(agent_id)
                self._report("heard", f"aMussel {agent_id} is heard by {link.name}")
            self._take(link, link.found(agent_id, packet.sender))
            self._publish(agent_id, link.medium, data)

    def _publish(self, agent_id: int, medium: Carriage, data: bytes) -> None:
        follow_master(_NO_MISSIONS_TIME)
        self._topics.publish(
            RelayedPacket(PacketOrigin.LOCAL_AMUSSEL, agent_id, medium, data, _NO_MISSIONS_TIME)
        )

    def _written(self, read: Packet) -> bytes | None:
        """A node's packet in the scenario's codec. A number of it that the codec cannot write makes it dropped."""
        try:
            if isinstance(read, StatusPacket) and (wrong := status_out_of_range(read)) is not None:
                self._drop(f"heard: {wrong}")
                return None
            return self._codec.encode(read)
        except (struct.error, TypeError, ValueError, OverflowError) as error:
            self._drop("heard: the nodes' codec made a packet that cannot be written", why=str(error))
            return None

    def _drop(self, reason: str, count: int = 1, why: str = "") -> None:
        """Counts by `reason`; tells the first one, with `why`, which may be another for each packet."""
        if not self.counts[reason]:
            told = f"{reason}: {' '.join(why.split())}" if why else reason
            self._report("dropped", f"dropped, and counted from now on: {told}")
        self.counts[reason] += count

"""Real aMussels on ROS: a node that carries their packets between a nanomodem and the topics `heard` and `said`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Self

import genpy
import rosgraph
import rospy

from agents.packet_medium import Medium
from agents.time_scale import MissionMs
from apad_bridge.acoustics.serial.attached import AttachedModem, NanomodemResult
from apad_bridge.acoustics.serial.nanomodem import (
    ModemNotice,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
    RoutedPacket,
)
from apad_bridge.ros.gateway.claims import LEASE_S, PERIOD_S, TOPIC
from apad_bridge.ros.links.packet_topics import PacketTopics
from apad_bridge.ros.system.node import start_node
from apad_bridge.ros.system.ros_time import follow_master
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.supervisor.packet_relay import PacketOrigin, RelayedPacket
from apad_bridge.vehicle.errors import PeerFailed
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.packets.codec import Codec

use_generated_messages()

from musselbed_msgs.msg import FleetClaim  # noqa: E402

_POLL_S = 0.03
_NO_MISSIONS_TIME = MissionMs(0)
"""A bridge begins and ends when it likes, and knows no mission's time. The stamps of its messages are the master's."""
_SKIPPED = "bytes of the modem that belong to no answer"

Tell = Callable[[str, str], None]
"""Takes the kind of a line, and its text for a person."""


class AMusselBridge:
    """The node's parts. One thread calls `advance` with milliseconds that run as fast as real ones.

    `counts` has every packet, by what became of it. The first one of each kind that is dropped is told.
    """

    def __init__(self, ids: Sequence[int], codec: Codec, modem: AttachedModem, tell: Tell) -> None:
        self.counts: Counter[str] = Counter()
        self._ids = frozenset(ids)
        self._codec = codec
        self._modem = modem
        self._tell = tell
        self._topics = PacketTopics(ids, [PacketOrigin.REMOTE_SUPERVISOR])
        self._claims = rospy.Publisher(TOPIC, FleetClaim, queue_size=1, latch=True)
        self._claim = FleetClaim(node=rospy.get_name(), real=True, lease_s=LEASE_S, ids=sorted(ids))
        self._claim.since = genpy.Time.from_sec(time.time())
        self._claimed_ms = -round(1000 * PERIOD_S)

    @classmethod
    def on_graph(cls, ids: Sequence[int], codec: Codec, modem: AttachedModem, tell: Tell) -> Self:
        """Puts the node on the graph. PeerFailed, in one line, where no master answers."""
        master_uri = rosgraph.get_master_uri()
        try:
            rosgraph.Master("/musselbed_bridge").getPid()
            # Nodes for other aMussels, with modems of their own, may stand beside this one.
            start_node(f"musselbed_bridge_{min(ids)}")
        except (OSError, rosgraph.MasterException, rospy.ROSException) as error:
            raise PeerFailed(f"no ROS master answers at {master_uri} ({error})") from error
        return cls(ids, codec, modem, tell)

    def advance(self, now_ms: MissionMs) -> None:
        """Waits until the modem has bytes, for some 30 ms at most; then carries what has come both ways."""
        if now_ms - self._claimed_ms >= 1000 * PERIOD_S:
            self._claimed_ms = now_ms
            self._claims.publish(self._claim)
        self._modem.port.wait(_POLL_S)
        self._take(self._modem.poll(now_ms), now_ms)
        for packet in self._topics.take(now_ms):
            if packet.medium is Medium.SOUND:
                self._take(self._modem.command(packet.agent_id, packet.data, now_ms), now_ms)
            else:
                self._drop("to an aMussel by another medium than sound")
        if (skipped := self._modem.queue.skipped_bytes) > self.counts[_SKIPPED]:
            self._drop(_SKIPPED, skipped - self.counts[_SKIPPED])
        for reason, count in self._topics.dropped.items():
            if count > self.counts[reason]:
                self._drop(reason, count - self.counts[reason])

    def close(self) -> None:
        self._modem.close()
        self._topics.close()
        self._claims.unregister()

    def _take(self, results: list[NanomodemResult], now_ms: MissionMs) -> None:
        for result in results:
            match result:
                case PacketReceived(_, packet):
                    self._hear(packet)
                case PacketSent():
                    self.counts["sent to aMussels"] += 1
                case PacketDropped(_, reason):
                    self._drop(reason)
                case ModemNotice(_, what):
                    self._tell("modem", what)

    def _hear(self, packet: RoutedPacket) -> None:
        read = self._codec.decode(packet.data)
        if packet.direction is not PacketDirection.FROM_AMUSSEL:
            self._drop("heard: another bridge's packet to an aMussel")
        elif packet.agent_id not in self._ids:
            self._drop(f"heard: aMussel {packet.agent_id} is none of --ids")
        elif read is None:
            self._drop("heard: damaged, or another layout than the scenario's codec")
        elif isinstance(read, StatusPacket | ShortStatus) and read.agent_id != packet.agent_id:
            self._drop("heard: the header names another aMussel than the packet")
        else:
            self.counts["heard from aMussels"] += 1
            follow_master(_NO_MISSIONS_TIME)
            self._topics.publish(
                RelayedPacket(
                    PacketOrigin.LOCAL_AMUSSEL, packet.agent_id, Medium.SOUND, packet.data, _NO_MISSIONS_TIME
                )
            )

    def _drop(self, reason: str, count: int = 1) -> None:
        if not self.counts[reason]:
            self._tell("dropped", f"dropped, and counted from now on: {reason}")
        self.counts[reason] += count

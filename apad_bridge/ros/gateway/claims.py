"""Settles which node publishes which aMussels: claims on /musselbed/claims, each with a lease.

A fleet claims the ids that it simulates. Another fleet with an id of an earlier one is refused at its start; where two come
to overlap later, as after a split of the network, the later one retires its own. A bridge of real aMussels claims them as
real, and the simulated ones make room. A real claim that merely falls silent changes nothing: a real aMussel that is not
heard is still in the water. A real claim that is repeated without an id gives that id back.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import genpy
import rosgraph
import rospy

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.events.fleet_events import Presence
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours
from apad_bridge.world.roster import (
    Claim,
    PresenceRequest,
    Presences,
    PresenceTrigger,
    claim_conflicts,
    unclaimed_real_ids,
)

use_generated_messages()

from musselbed_msgs.msg import FleetClaim  # noqa: E402

TOPIC = ours("claims")
PERIOD_S = 1.0
LEASE_S = 5.0
_COLLECT_S = 3.0
"""The longest wait for others' claims. They are latched and arrive at once, except from a node that was killed and is
registered still, or whose machine stands still."""


class ClaimBoard:
    """Publishes this process's claim and collects those of others. `changes` is for the flight's thread."""

    def __init__(self, node: str, simulated: Callable[[], frozenset[int]]) -> None:
        self._node = node
        self._simulated = simulated
        self._since_s = time.time()
        self._lock = threading.Lock()
        self._others: dict[str, Claim] = {}
        self._given_back: dict[int, str] = {}
        """Ids that a repeated claim of real aMussels left out, and its node."""
        self._publisher = rospy.Publisher(TOPIC, FleetClaim, queue_size=1, latch=True)
        self._subscriber = rospy.Subscriber(TOPIC, FleetClaim, self._take, tcp_nodelay=True)
        # Of no aMussel yet: fleets that start together would otherwise wait for one another.
        self._claim([])
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._repeat, name="claims", daemon=True)

    def refuse_overlap(self, ids: Iterable[int]) -> None:
        """Raises SecondFleet when a living fleet claims one of `ids` already; otherwise begins to publish our claim."""
        self._collect_others()
        ours = frozenset(ids)
        for claim in self._alive():
            if not claim.real and (both := sorted(claim.ids & ours)):
                raise SecondFleet(
                    f"node {claim.node} simulates aMussel {both[0]} already: two fleets on one master need disjoint ids "
                    "(fleet.first_id, fleet.count) or a namespace each (ROS_NAMESPACE)"
                )
        self._thread.start()

    def resume(self, presences: Presences) -> list[str]:
        """Begins to publish the claim of a fleet that was on the graph before its supervisor died.

        Nothing is refused: others' present claims override what was. Returns a line for a person on each difference.
        """
        self._collect_others()
        claims = self._alive()
        with self._lock:
            self._given_back |= unclaimed_real_ids(presences.before, claims)
        self._thread.start()
        return claim_conflicts(presences.of, presences.before, claims)

    def changes(self, presence_of: Callable[[int], Presence | None]) -> list[PresenceRequest]:
        """The changes of our aMussels that others' present claims demand."""
        changes = []
        for claim in self._alive():
            for agent_id in sorted(claim.ids):
                presence = presence_of(agent_id)
                if claim.real and presence in (Presence.SIMULATED, Presence.RETIRED):
                    changes.append(PresenceRequest(agent_id, PresenceTrigger.HAND_OVER, claim.node))
                elif (
                    not claim.real
                    and presence is Presence.SIMULATED
                    and (claim.since_s, claim.node) < (self._since_s, self._node)
                ):
                    changes.append(PresenceRequest(agent_id, PresenceTrigger.RETIRE, claim.node))
        with self._lock:
            unclaimed_real_ids, self._given_back = self._given_back, {}
        for agent_id, node in unclaimed_real_ids.items():
            if presence_of(agent_id) is Presence.REAL:
                changes.append(PresenceRequest(agent_id, PresenceTrigger.TAKE_BACK, node))
        return changes

    def real_by(self, agent_id: int) -> str | None:
        """The living node that claims an aMussel as real; None without one. For any thread."""
        return next((it.node for it in self._alive() if it.real and agent_id in it.ids), None)

    def close(self) -> None:
        self._ended.set()
        self._subscriber.unregister()
        self._publisher.unregister()

    def _collect_others(self) -> None:
        others = _publishers() - {self._node}
        deadline_s = time.monotonic() + _COLLECT_S
        while time.monotonic() < deadline_s and others - self._others.keys():
            self._ended.wait(0.02)

    def _alive(self) -> list[Claim]:
        now_s = time.monotonic()
        with self._lock:
            return [claim for _, claim in sorted(self._others.items()) if claim.until_s > now_s]

    def _take(self, message: Any) -> None:
        if message.node == self._node:
            return
        claim = Claim(
            message.node,
            bool(message.real),
            message.since.to_sec(),
            frozenset(message.ids),
            time.monotonic() + message.lease_s,
        )
        with self._lock:
            before = self._others.get(claim.node)
            self._others[claim.node] = claim
            if before is not None and before.real and claim.real:
                self._given_back |= dict.fromkeys(before.ids - claim.ids, claim.node)

    def _repeat(self) -> None:
        while not self._ended.is_set():
            self._claim(sorted(self._simulated()))
            self._ended.wait(PERIOD_S)

    def _claim(self, ids: list[int]) -> None:
        claim = FleetClaim(node=self._node, lease_s=LEASE_S, ids=ids)
        claim.since = genpy.Time.from_sec(self._since_s)
        self._publisher.publish(claim)


def _publishers() -> set[str]:
    graph = Graph.read(rosgraph.get_master_uri())
    return set(graph.publishers.get(rospy.resolve_name(TOPIC), ()))

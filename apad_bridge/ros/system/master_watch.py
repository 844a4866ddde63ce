"""Watches somebody else's master: it may restart or go out of reach, and rospy registers nothing again by itself.

A restarted master knows no node. Existing connections go on without it, but no new node would find this one. And a master
announces a new publisher once: if it cannot reach us then, we never learn of it. So every second this asks the master
whether it knows us. If not, or when the master was out of reach, or on request, everything is registered again and the
publishers that the master names are connected. Events are kept for the flight, which journals them at its next tick.

rospy also gives a connection up that ends, as one to another machine does whose link was cut, though the master still names
its publisher. So this notes which connections have ended, and registers again until they are back or named no more. A topic
of ours that has lost a reader is named again some times: the reader may have ended, or lost its link.
"""

from __future__ import annotations

import threading
import time
import xmlrpc.client
from contextlib import suppress
from http.client import HTTPException
from typing import Any

import rosgraph
import rospy
from rospy.impl.registration import (
    RegManager,
    get_registration_listeners,
    get_service_manager,
    get_topic_manager,
)

from apad_bridge.doctor.network import Timed, Unreachable, call_for_reply
from apad_bridge.events.graph_events import MasterBack, MasterGone
from apad_bridge.ros.system.inbox import Inbox

PERIOD_S = 1.0
_CALL_S = 5.0
_AT_ONCE = 200
"""Registrations in one call to the master."""
_LEAVE_S = 1.0
"""A run that a person ended is over within five seconds."""
_LONGEST_RETRY_S = 30.0
"""The longest time between two tries to connect to a publisher whose connection ended: it may have been killed."""
_CALLED_S = 300.0
"""A reader is called back for so long: one of rospy may notice after 150 s that its connection has ended."""


def forget_silent_master(master_uri: str) -> None:
    """The first step of the end of a node: where the master does not answer, the other steps leave it out.

    rospy tells the master of each topic and service that it leaves, and would wait there for one that stands still. Such a
    master names our node until somebody calls `rosnode cleanup`.
    """
    try:
        with xmlrpc.client.ServerProxy(master_uri, transport=Timed(_LEAVE_S)) as master:
            master.getPid(rospy.get_name())
    except (OSError, HTTPException, xmlrpc.client.Error):
        listeners = get_registration_listeners()
        for it in listeners.listeners:
            if isinstance(it, RegManager):
                it.master_uri = None  # its last call, at the node's end
        listeners.clear()


def name_again(topic: str, kind: str) -> None:
    """Has the master name this node's publisher to the topic's readers again; without an answer nothing happens.

    A reader of rospy whose connection has ended does not come back by itself.
    """
    with (
        suppress(OSError, HTTPException, xmlrpc.client.Error),
        xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=Timed(_CALL_S)) as master,
    ):
        master.registerPublisher(rospy.get_name(), topic, kind, rospy.get_node_uri())


def _answers(result: Any, count: int) -> list[Any]:
    """The values of `count` calls that the master answers together. Raises Unreachable for anything else."""
    try:
        values = [value for _, _, value in result]
    except (KeyError, TypeError, ValueError) as error:
        raise Unreachable(f"its answer is none of a ROS master: {error}") from error
    if len(values) != count:
        raise Unreachable(f"it answers {len(values)} of {count} calls")
    return values


class MasterWatch:
    """The node is initialised before. One thread, which ends with `close`."""

    def __init__(self, master_uri: str, period_s: float = PERIOD_S) -> None:
        self._uri = master_uri
        self._period_s = period_s
        self._events: Inbox[MasterGone | MasterBack] = Inbox()
        self._gone_since_s: float | None = None
        self._connected: set[tuple[str, str]] = set()
        """The topics, and the nodes from which they came, at the last look."""
        self._lost: set[tuple[str, str]] = set()
        """Those whose connection ended since."""
        self._retry_s, self._retry_at_s = period_s, 0.0
        self._readers: set[tuple[str, str]] = set()
        """Our topics, and the nodes that read them, at the last look."""
        self._left: dict[tuple[str, str], tuple[float, float]] = {}
        """Readers whose connection ended: since when, and the time of the next call."""
        self._requested = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watch of the master", daemon=True)
        self._thread.start()

    def take(self) -> list[MasterGone | MasterBack]:
        return self._events.take()

    def request_registration(self) -> None:
        """Registers everything again: the master's announcement of a missing publisher may have failed to reach us."""
        self._requested.set()

    def close(self) -> None:
        self._ended.set()
        if get_registration_listeners().listeners:  # else the thread may wait for a master that stands still
            self._thread.join(2 * _CALL_S)

    def _watch(self) -> None:
        while not self._ended.wait(self._period_s) and not rospy.is_shutdown():
            try:
                self._look()
            except (Unreachable, OSError, HTTPException, xmlrpc.client.Error) as error:
                if self._gone_since_s is None:
                    self._gone_since_s = time.monotonic()
                    self._report(MasterGone(self._uri, str(error)))

    def _look(self) -> None:
        code, _, _ = call_for_reply(self._uri, "lookupNode", rospy.get_name())
        was_gone, requested = self._gone_since_s, self._requested.is_set()
        self._note_connections()
        self._call_readers_back()
        is_retry = bool(self._lost) and time.monotonic() >= self._retry_at_s
        if code == 1 and was_gone is None and not requested and not is_retry:
            return
        registered = self._register_again()
        self._retry_at_s = time.monotonic() + self._retry_s
        self._retry_s = min(2 * self._retry_s, _LONGEST_RETRY_S)
        self._requested.clear()
        self._gone_since_s = None
        if code != 1 or was_gone is not None:
            gone_s = 0.0 if was_gone is None else time.monotonic() - was_gone
            self._report(MasterBack(self._uri, round(gone_s, 1), registered))

    def _note_connections(self) -> None:
        connected = {
            (topic, peer)
            for _, peer, direction, _, topic, *_ in get_topic_manager().get_pub_sub_info()
            if direction == "i"
        }
        # A topic that we have left ends its connections, too.
        subscribes = get_topic_manager().has_subscription
        ended = {it for it in self._connected - connected if subscribes(it[0])}
        self._connected = connected
        if ended - self._lost:
            self._retry_s, self._retry_at_s = self._period_s, 0.0
        self._lost = (self._lost | ended) - connected

    def _call_readers_back(self) -> None:
        readers = {
            (topic, peer)
            for _, peer, direction, _, topic, *_ in get_topic_manager().get_pub_sub_info()
            if direction == "o"
        }
        now_s, kinds = time.monotonic(), dict(get_topic_manager().get_publications())
        self._left |= dict.fromkeys(self._readers - readers, (now_s, now_s))
        self._readers = readers
        self._left = {
            it: (since_s, call_s)
            for it, (since_s, call_s) in self._left.items()
            if it not in readers and it[0] in kinds and now_s - since_s < _CALLED_S
        }
        due = {it: since_s for it, (since_s, call_s) in self._left.items() if call_s <= now_s}
        for topic in {topic for topic, _ in due}:
            name_again(topic, kinds[topic])
        for it, since_s in due.items():
            wait_s = min(max(self._period_s, now_s - since_s), _LONGEST_RETRY_S)
            self._left[it] = (since_s, now_s + wait_s)

    def _register_again(self) -> int:
        """Returns the number of registered topics and services. A node that is ending has none."""
        topics, services = get_topic_manager(), get_service_manager()
        managers = [it for it in get_registration_listeners().listeners if isinstance(it, RegManager)]
        if not managers:
            return 0
        name, ours = rospy.get_name(), managers[0].uri
        with topics.lock:  # another thread may leave topics meanwhile
            publications, subscriptions = topics.get_publications(), topics.get_subscriptions()
        calls: list[tuple[str, tuple[Any, ...]]] = [
            *(("registerPublisher", (name, topic, kind, ours)) for topic, kind in publications),
            *(("registerSubscriber", (name, topic, kind, ours)) for topic, kind in subscriptions),
            *(("registerService", (name, service, uri, ours)) for service, uri in services.get_services()),
        ]
        named: set[tuple[str, str]] = set()
        with xmlrpc.client.ServerProxy(self._uri, transport=Timed(_CALL_S)) as master:
            for first in range(0, len(calls), _AT_ONCE):
                batch = calls[first : first + _AT_ONCE]
                together = xmlrpc.client.MultiCall(master)
                for method, arguments in batch:
                    getattr(together, method)(*arguments)
                answers = _answers(together(), len(batch))
                for (method, arguments), publishers in zip(batch, answers, strict=True):
                    if method == "registerSubscriber" and isinstance(publishers, list) and publishers:
                        managers[0].publisher_update(arguments[1], publishers)
                        named |= {(arguments[1], uri) for uri in publishers}
        self._lost &= named
        return len(calls)

    def _report(self, event: MasterGone | MasterBack) -> None:
        self._events.put(event, always=True)
        rospy.logwarn("%s: %s", event.kind, event.data)

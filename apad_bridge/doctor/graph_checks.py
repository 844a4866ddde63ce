"""Checks a ROS master: its clock, its nodes, its way back to this machine, and aMussels that are there already."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar
from xmlrpc.server import SimpleXMLRPCServer

from apad_bridge.doctor.finding import Check, Finding, fail, ok, warn
from apad_bridge.doctor.network import (
    CALLER,
    TIMEOUT_S,
    ConnectionRefused,
    Unreachable,
    address_of,
    address_towards,
    call,
    call_for_reply,
    connect,
    host_and_port,
)
from apad_bridge.ros_names.names import in_full
from apad_bridge.scenario.errors import in_ranges

_AT_ONCE = 16
_AGAIN_S = 0.1
"""The pause before a master is asked again."""
_MAX_LISTED = 8
Names = dict[str, list[str]]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Graph:
    """The publishers, subscribers and services on the master at `uri`, with nodes by name of topic or service.

    After `remapped` the names are those that a run uses, and `name_there` gives the name on the master.
    """

    uri: str
    publishers: Names
    subscribers: Names
    services: Names
    types: dict[str, str]
    mapping: Mapping[str, str] = field(default_factory=dict)

    def remapped(self, mapping: Mapping[str, str]) -> Graph:
        """The graph as a node with this remapping (from name, to name, in full) sees it."""

        def seen(names: dict[str, T]) -> dict[str, T]:
            kept = {name: nodes for name, nodes in names.items() if name not in mapping}
            return kept | {name: names[there] for name, there in mapping.items() if there in names}

        return replace(
            self,
            publishers=seen(self.publishers),
            subscribers=seen(self.subscribers),
            services=seen(self.services),
            types=seen(self.types),
            mapping=dict(mapping),
        )

    def name_there(self, name: str) -> str:
        """The name on the master of a topic or service that a run calls `name`."""
        return self.mapping.get(name, name)

    @classmethod
    def read(cls, uri: str) -> Graph:
        """Raises Unreachable if the master does not answer."""
        state, types = call(uri, "getSystemState"), call(uri, "getTopicTypes")
        try:
            publishers, subscribers, services = (
                {name: list(nodes) for name, nodes in part} for part in state
            )
            return cls(uri, publishers, subscribers, services, dict(types))
        except (TypeError, ValueError) as error:
            raise Unreachable(f"{uri} tells no graph: {error}") from error

    @classmethod
    def read_within(cls, uri: str, timeout_s: float) -> Graph:
        """Asks a master that does not answer again, as on a busy machine. Raises Unreachable after `timeout_s`."""
        until_s = time.monotonic() + timeout_s
        while True:
            try:
                return cls.read(uri)
            except Unreachable:
                if time.monotonic() > until_s:
                    raise
                time.sleep(_AGAIN_S)

    def living_publishers(self, topic: str) -> list[str]:
        """Leaves out those whose process has ended without a word to the master."""
        return _living(self.uri, self.publishers.get(topic, []))[0]

    @property
    def nodes(self) -> list[str]:
        parts = (self.publishers, self.subscribers, self.services)
        return sorted({node for part in parts for nodes in part.values() for node in nodes})


def check_addresses(uri: str, announced: str) -> Iterator[Finding]:
    """Checks the address under which this machine's nodes are called; `announced` is ROS_HOSTNAME, ROS_IP or its name."""
    route = address_towards(uri)
    mend = (
        f"export ROS_IP={route}"
        if "ROS_HOSTNAME" not in os.environ
        else f"unset ROS_HOSTNAME; export ROS_IP={route}"
    )
    try:
        here = address_of(announced)
    except Unreachable as error:
        yield fail(f"nodes of this machine call themselves {announced}, but {error}", mend)
        return
    if here == route or (here.startswith("127.") and route.startswith("127.")):
        yield ok(
            f"nodes of this machine call themselves {announced}; the route to the master is from {route}",
        )
    elif here.startswith("127."):
        yield fail(f"{announced} is this machine's loopback, and the master is at {uri}", mend)
    else:
        yield warn(f"{announced} is {here}, but the route to the master is from {route}", mend)


def check_call_back(uri: str, announced: str, bind: str) -> Finding:
    """Checks that the master can call a node on this machine, by a topic that nobody else uses.

    The master calls a subscriber for each publisher of its topic, so a node that is both is called about itself. The check
    then unregisters both. The call proves the way from the master's machine.
    """
    called = threading.Event()
    topic = f"{CALLER}/call_back"
    with SimpleXMLRPCServer((bind, 0), logRequests=False) as server:

        def publisher_update(*update: Any) -> tuple[int, str, int]:
            if update[1:] == (topic, [ours]):
                called.set()
            return 1, "", 0

        server.register_function(publisher_update, "publisherUpdate")
        port = server.socket.getsockname()[1]
        ours = f"http://{announced}:{port}/"
        serving = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        serving.start()
        try:
            call(uri, "registerSubscriber", topic, "std_msgs/Empty", ours)
            call(uri, "registerPublisher", topic, "std_msgs/Empty", ours)
            is_called_back = called.wait(TIMEOUT_S)
        finally:
            _unregister(uri, topic, ours)
            server.shutdown()
            serving.join(TIMEOUT_S)
    if is_called_back:
        return ok(f"the master reached a node of this machine at {announced}")
    route = address_towards(uri)
    return fail(
        f"the master did not reach {ours} within {TIMEOUT_S:g} s: topics would be listed here, but nothing would arrive",
        f"export ROS_IP={route}, and let the firewall pass TCP from the master's machine to all ports above 1024",
    )


def _unregister(uri: str, topic: str, ours: str) -> None:
    for method in ("unregisterPublisher", "unregisterSubscriber"):
        try:
            call_for_reply(uri, method, topic, ours)
        except Unreachable:
            continue  # the master is gone, and its registrations too


def check_clock(graph: Graph) -> Finding:
    """Checks the source of the time that nodes on this master follow."""
    code, _, simulated = call_for_reply(graph.uri, "getParam", "/use_sim_time")
    follows = code == 1 and bool(simulated)
    sources, dead = _living(graph.uri, graph.publishers.get("/clock", []))
    whose = ", ".join(
        f"{node} ({'ours' if node.rpartition('/')[2].startswith('musselbed') else 'somebody else'})"
        for node in sources
    )
    if len(sources) > 1:
        return fail(f"/clock comes from {whose}: time would jump", "end all of these nodes but one")
    if follows and not sources:
        return fail(
            f"/use_sim_time is true and no node{' that lives' if dead else ''} publishes /clock: time stands still",
            "start the node that publishes /clock, or: rosparam set /use_sim_time false, and start the nodes again",
        )
    if follows:
        return ok(f"simulated time, /clock from {whose}: fly with --time ros")
    if sources:
        return warn(
            f"/clock comes from {whose}, but /use_sim_time is not set: nodes follow their own clocks",
            "rosparam set /use_sim_time true before any node starts, or end it",
        )
    return ok("wall time: fly with --time wall")


def check_nodes(graph: Graph) -> Iterator[Finding]:
    """Checks that each node's host name resolves here, that its port connects, and that it answers."""
    nodes = graph.nodes
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        troubles = [
            trouble for trouble in pool.map(lambda node: _trouble_with(graph.uri, node), nodes) if trouble
        ]
    yield from troubles[:_MAX_LISTED]
    if len(troubles) > _MAX_LISTED:
        yield warn(
            f"{len(troubles) - _MAX_LISTED} more nodes do not answer",
            "mend those above and run this again",
        )
    if not troubles:
        yield ok(f"{len(nodes)} on the graph, all reachable from here" if nodes else "none on the graph")


def _trouble_with(uri: str, node: str) -> Finding | None:
    api = ""
    try:
        code, _, value = call_for_reply(uri, "lookupNode", node)
        if code != 1:
            return None  # it left since the graph was read, as another person's preflight does
        api = str(value)
        host, _ = host_and_port(api)
        address_of(host)
    except Unreachable as error:
        host = api.removeprefix("http://").split(":")[0] or "its host"
        mend = f"add {host} to /etc/hosts here, or set ROS_IP on that machine and start the node again"
        return fail(f"announces {api or 'nothing'}: {error}", mend, check=node)
    try:
        call(api, "getPid")
    except Unreachable as error:
        mend = "if the node is dead: rosnode cleanup; if it lives: let the firewall pass TCP to that port"
        return warn(str(error), mend, check=node)
    return None


def _living(uri: str, nodes: Iterable[str]) -> tuple[list[str], list[str]]:
    """The nodes that live, and those whose process has ended without a word to the master, each by name.

    A node that a time-out or a firewall hides counts as living.
    """
    named = sorted(set(nodes))
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        has_ended = list(pool.map(lambda node: _has_ended(uri, node), named))
    found = list(zip(named, has_ended, strict=True))
    return [node for node, ended in found if not ended], [node for node, ended in found if ended]


def _has_ended(uri: str, node: str) -> bool:
    try:
        api = str(call(uri, "lookupNode", node))
    except Unreachable:
        return False
    try:
        connect(api).close()
    except ConnectionRefused:
        return True
    except Unreachable:
        return False
    return False


def check_agents_present(graph: Graph, ids: Iterable[int] | None, namespace: str = "") -> Finding:
    """Checks for aMussels that somebody publishes already in this namespace, and for clashes with a scenario's `ids`."""
    position = re.compile(in_full(namespace, r"amussel(\d+)/position"))
    taken: dict[int, list[str]] = {}
    for topic, nodes in graph.publishers.items():
        if found := position.fullmatch(topic):
            taken[int(found[1])] = nodes
    clash = sorted(set(taken) & set(ids or ()))
    living, dead = _living(graph.uri, {node for agent_id in clash for node in taken[agent_id]})
    if not taken:
        return ok(f"no node publishes an {in_full(namespace, 'amusselK')}/position")
    taken_ids = in_ranges(taken)
    if clash and not living:
        who = f"{', '.join(dead)} alone, whose process has ended"
        return warn(f"{in_ranges(clash)} of the scenario are published by {who}", "rosnode cleanup")
    if clash:
        who = ", ".join(living)
        beyond = max(taken) + 1
        mend = f"end {who}, or set fleet.first_id to {beyond} in the scenario"
        return fail(f"{in_ranges(clash)} of the scenario are published already by {who}", mend)
    if ids is None:
        mend = "give other ids to a fleet on this master: fleet.first_id in the scenario"
        return warn(f"{taken_ids} are published already", mend)
    return ok(f"{taken_ids} are published already, none of them the scenario's")


@dataclass(frozen=True, slots=True)
class MasterSeen:
    """A master as nodes of this machine see it: `announced` is their host name, `bind` the address at which they listen."""

    graph: Graph
    announced: str
    bind: str
    ids: Iterable[int] | None
    """The scenario's aMussels, None without a scenario."""
    namespace: str


CHECKS: tuple[Check[MasterSeen], ...] = (
    Check("own address", lambda it: check_addresses(it.graph.uri, it.announced)),
    Check("call back", lambda it: check_call_back(it.graph.uri, it.announced, it.bind)),
    Check("clock", lambda it: check_clock(it.graph), may_be_red_in_trial=True),
    Check("nodes", lambda it: check_nodes(it.graph), may_be_red_in_trial=True),
    Check("aMussel ids", lambda it: check_agents_present(it.graph, it.ids, it.namespace)),
)

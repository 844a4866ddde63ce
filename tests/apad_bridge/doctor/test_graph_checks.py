"""Checks of a graph against fake masters: XML-RPC servers with prepared answers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from xmlrpc_answers import CUT_SHORT, answering_with, whole

from apad_bridge.doctor import graph_checks, network
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable


@contextmanager
def answering(**answers: Any) -> Iterator[str]:
    """Starts a server on loopback whose methods return the given values, or what they return, and returns its URI."""
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True) as server:
        for name, answer in answers.items():
            given = answer if callable(answer) else lambda *_, answer=answer: answer
            server.register_function(given, name)
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.socket.getsockname()[1]}/"
        finally:
            server.shutdown()
            thread.join(5)


@pytest.fixture
def mute() -> Iterator[str]:
    """Accepts connections and never answers, as a stopped process does."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"http://127.0.0.1:{server.getsockname()[1]}/"


@pytest.fixture
def closed() -> Iterator[str]:
    """Reserves a port on which nobody listens and which nobody else can take meanwhile."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        yield f"http://127.0.0.1:{bound.getsockname()[1]}/"


def a_graph(uri: str = "http://127.0.0.1:1/", **publishers: list[str]) -> Graph:
    named = {f"/{name.replace('__', '/')}": nodes for name, nodes in publishers.items()}
    return Graph(uri, named, {}, {}, {})


def test_a_master_is_read() -> None:
    state = [[["/chatter", ["/talker"]]], [["/chatter", ["/listener"]]], [["/talker/tell", ["/talker"]]]]
    with answering(
        getSystemState=[1, "", state], getTopicTypes=[1, "", [["/chatter", "std_msgs/String"]]]
    ) as uri:
        found = Graph.read(uri)
    assert (found.nodes, found.types) == (["/listener", "/talker"], {"/chatter": "std_msgs/String"})


def test_a_node_that_was_killed_publishes_nothing_though_the_master_names_it(closed: str) -> None:
    """A second publisher of an aPad's position, which no person may override, would keep it from every start."""
    with answering(lookupNode=lambda _, node: [1, "", closed if node == "/killed" else master]) as master:
        found = a_graph(master, position=["/killed", "/vehicle"])
        assert found.living_publishers("/position") == ["/vehicle"]
        assert found.living_publishers("/nobodys") == []


@pytest.mark.parametrize(
    ("uri", "told"),
    [
        *((uri, "no address") for uri in ("", "localhost:11311", "http://:11311", "http://127.0.0.1:no")),
        ("closed", "does not answer"),
        ("mute", "getSystemState"),
        ("no master", "no answer of a ROS program"),
        ("http://mussel.invalid:11311", r"mussel\.invalid"),
    ],
)
def test_a_master_that_cannot_be_asked_is_said(
    uri: str, told: str, closed: str, mute: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is stopped costs no more than the time-out."""
    monkeypatch.setattr(network, "TIMEOUT_S", 0.2)
    with answering(getSystemState="hello") as no_master, pytest.raises(Unreachable, match=told):
        Graph.read({"closed": closed, "mute": mute, "no master": no_master}.get(uri, uri))


@pytest.mark.parametrize(
    "answer",
    [
        CUT_SHORT,
        whole(True).replace(b"<boolean>1", b"<boolean>7"),
        whole([1, "", ""]).replace(b"<string>", b"<string>\xff"),
        whole([1, "", [7]]),
        whole([1, "", [[], []]]),
    ],
    ids=["cut short", "no boolean", "no text", "no graph", "a part of a graph"],
)
def test_a_masters_answer_that_cannot_be_read_is_none(answer: bytes) -> None:
    with answering_with(answer) as uri, pytest.raises(Unreachable, match=uri):
        Graph.read(uri)


def test_a_look_up_that_hangs_is_left_alone() -> None:
    never = threading.Event()
    with pytest.raises(TimeoutError):
        network.within(0.05, never.wait)
    never.set()


def test_a_master_that_never_calls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graph_checks, "TIMEOUT_S", 0.2)
    deaf = [1, "", 1]
    with answering(
        registerSubscriber=deaf, registerPublisher=deaf, unregisterPublisher=deaf, unregisterSubscriber=deaf
    ) as uri:
        finding = graph_checks.check_call_back(uri, "127.0.0.1", "127.0.0.1")
    assert finding.status is CheckStatus.FAIL
    assert "export ROS_IP=127.0.0.1" in str(finding.mend)


@pytest.mark.parametrize(
    ("master", "name", "mend"),
    [
        ("127.0.0.1", "mussel.invalid", "export ROS_IP=127.0.0.1"),
        ("127.0.0.1", "127.0.1.1", None),
        ("10.0.200.1", "127.0.1.1", "export ROS_IP=10.0.200.7"),
    ],
    ids=["a name that nobody knows", "loopback to loopback", "a loopback name, to a master elsewhere"],
)
def test_the_name_by_which_the_others_call_must_lead_here(
    monkeypatch: pytest.MonkeyPatch, master: str, name: str, mend: str | None
) -> None:
    if master != "127.0.0.1":
        monkeypatch.setattr(graph_checks, "address_towards", lambda _: "10.0.200.7")
    (finding,) = graph_checks.check_addresses(f"http://{master}:11311", name)
    assert finding.status is (CheckStatus.FAIL if mend else CheckStatus.OK) and finding.mend == mend


@pytest.mark.parametrize(
    ("parameter", "publishers", "status", "says"),
    [
        ([-1, "not set", 0], [], "OK", "--time wall"),
        ([1, "", False], [], "OK", "--time wall"),
        ([1, "", True], ["/gazebo"], "OK", "/gazebo (somebody else)"),
        ([1, "", True], ["/musselbed"], "OK", "/musselbed (ours)"),
        ([1, "", True], [], "FAIL", "no node publishes /clock"),
        ([-1, "not set", 0], ["/gazebo"], "WARN", "not set"),
        ([1, "", True], ["/gazebo", "/player"], "FAIL", "time would jump"),
    ],
)
def test_whose_time_it_is(parameter: list[Any], publishers: list[str], status: str, says: str) -> None:
    with answering(getParam=parameter) as uri:
        finding = graph_checks.check_clock(a_graph(uri, clock=publishers) if publishers else a_graph(uri))
    assert finding.status == status and says in finding.found


TWENTY = [f"/n{number}" for number in range(20)]


@pytest.mark.parametrize(
    ("address", "nodes", "lines", "checked", "told"),
    [
        ("alive", ["/a", "/b"], 1, "OK ", "2 on the graph"),
        ("closed", ["/a", "/b"], 2, "WARN /b", ""),
        ("http://amussel7.invalid:40000/", ["/a", "/b"], 2, "FAIL /b", "/etc/hosts"),
        ("closed", TWENTY, 9, "WARN ", "12 more"),  # few lines for a graph full of dead nodes
    ],
)
def test_nodes_are_called_one_by_one(
    closed: str, address: str, nodes: list[str], lines: int, checked: str, told: str
) -> None:
    with answering(getPid=[1, "", 7]) as alive:
        api = {"alive": alive, "closed": closed}.get(address, address)
        with answering(lookupNode=[1, "", api]) as master:
            *others, finding = graph_checks.check_nodes(a_graph(master, many=nodes))
    assert (
        len(others) == lines - 1
        and f"{finding.status} {finding.check}" == checked
        and told in f"{finding.found} {finding.mend}"
    )


OURS = {"amussel3__position": ["/musselbed_1"], "clock": ["/musselbed_clock"]}
BESIDE = {name: [*nodes, "/other"] for name, nodes in OURS.items()}


@pytest.mark.parametrize(
    ("publishers", "check", "status", "told"),
    [
        (OURS, "ids", "WARN", "3 of the scenario are published by /musselbed_1 alone"),
        (OURS, "ids", "WARN", "rosnode cleanup"),
        (BESIDE, "ids", "FAIL", "published already by /other"),
        (BESIDE, "clock", "OK", ""),
        (OURS, "clock", "FAIL", "no node that lives publishes /clock"),
    ],
)
def test_ids_and_a_clock_of_a_node_that_was_killed_are_free(
    closed: str, publishers: dict[str, list[str]], check: str, status: str, told: str
) -> None:
    """The master keeps the registrations of a process that could not say good-bye."""
    with answering(getPid=[1, "", 7]) as alive:
        apis = {"/musselbed_1": closed, "/musselbed_clock": closed, "/other": alive}
        with answering(lookupNode=lambda _, node: [1, "", apis[node]], getParam=[1, "", True]) as uri:
            graph = a_graph(uri, **publishers)
            ids = check == "ids"
            found = (
                graph_checks.check_agents_present(graph, range(1, 13))
                if ids
                else graph_checks.check_clock(graph)
            )
    assert found.status == status and told in f"{found.found} {found.mend}"


SOME = a_graph(amussel2__position=["/them"], amussel3__position=["/them"], amussel9__position=["/one"])
BELOW = a_graph(basin__amussel3__position=["/basin/them"])


@pytest.mark.parametrize(
    ("graph", "ids", "namespace", "status", "told"),
    [
        (a_graph(), range(1, 13), "", "OK", []),
        (SOME, range(1, 4), "", "FAIL", ["2 to 3 of the scenario", "/them", "first_id to 10"]),
        (SOME, range(10, 20), "", "OK", []),
        (SOME, range(1, 4), "basin", "OK", []),
        (BELOW, range(1, 4), "", "OK", []),
        (BELOW, range(1, 4), "basin", "FAIL", []),
        (SOME, None, "", "WARN", ["2 to 3, 9"]),
    ],
)
def test_ids_that_are_taken(
    graph: Graph, ids: range | None, namespace: str, status: str, told: list[str]
) -> None:
    found = graph_checks.check_agents_present(graph, ids, namespace)
    assert found.status == status and all(it in f"{found.found} {found.mend}" for it in told)
    assert "/one" not in found.found or ids is None

"""Positions over two connections: what a connection that stands still may not hold back, and that nothing counts twice."""

from __future__ import annotations

import io
import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest
import rospy
from hypothesis import given
from hypothesis import strategies as st
from rosgraph.network import encode_ros_handshake_header, read_ros_handshake_header

from apad_bridge.ros.links import second_connection
from apad_bridge.ros.links.second_connection import FirstArrivals, SecondConnections
from apad_bridge.ros.links.vehicle_subscribers import NavSts, VehicleSubscribers
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.lost_links import notice_end

SOON_S = 10.0
TOPIC = "/apad1/position"


class Publisher:
    """One node on another machine, as its sockets show it: XML-RPC for the address, TCPROS for the messages."""

    def __init__(self, topic: str = TOPIC, takes: bool = True) -> None:
        self.handshakes: queue.Queue[socket.socket] = queue.Queue()
        self.asked: queue.Queue[tuple[str, str]] = queue.Queue()
        self._topic, self._takes = topic, takes
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self._server.register_function(self._request_topic, "requestTopic")
        self.uri = f"http://127.0.0.1:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()
        threading.Thread(target=self._accept, daemon=True).start()

    def _request_topic(self, caller: str, topic: str, protocols: list[list[str]]) -> tuple[int, str, Any]:
        self.asked.put((caller, topic))
        if not self._takes:
            return 0, "not a publisher of it", 0
        return 1, "", ["TCPROS", *self._listener.getsockname()]

    def _accept(self) -> None:
        header = {"md5sum": NavSts._md5sum, "type": NavSts._type, "callerid": "/nav"}
        with suppress(OSError):
            while True:
                sock, _ = self._listener.accept()
                asked = read_ros_handshake_header(sock, io.BytesIO(), 4096)
                assert asked["callerid"] != rospy.get_name()  # or a rospy publisher would end the first
                assert (asked["topic"], asked["md5sum"], asked["tcp_nodelay"]) == (self._topic, "*", "1")
                sock.sendall(encode_ros_handshake_header(header))
                self.handshakes.put(sock)

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._listener.close()


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    made = Publisher()
    yield made
    made.close()


@pytest.fixture(autouse=True)
def far_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_connection, "is_local_address", lambda host: False)


def subscriber_of(*publishers: Publisher) -> Any:
    """A rospy subscriber, as far as its connections are read."""
    connections = [
        SimpleNamespace(transport_type="TCPROS", endpoint_id=it.uri, dest_address=("127.0.0.1", 1))
        for it in publishers
    ]
    return SimpleNamespace(impl=SimpleNamespace(connections=connections), resolved_name=TOPIC)


def position(number: int) -> NavSts:
    message = NavSts()
    message.header.seq, message.position.north = number, 0.1 * number
    return message


def framed(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return len(buffer.getvalue()).to_bytes(4, "little") + buffer.getvalue()


def test_a_first_connection_that_stands_still_holds_no_position_back(publisher: Publisher) -> None:
    """After the first position on rospy's connection, three come over the second alone, and later all over the first."""
    inbox: Inbox[Any] = Inbox()
    subscribers = VehicleSubscribers("apad1", inbox, stamped=False)
    subscribers._position = subscriber_of(publisher)
    subscribers._take_pose(position_with_header(0), 0)
    second = publisher.handshakes.get(timeout=SOON_S)
    second.sendall(b"".join(framed(position(number)) for number in range(4)))
    poses: list[Any] = []
    while len(poses) < 4:
        before = len(poses)
        poses += inbox.take(SOON_S)
        assert len(poses) > before
    for number in range(1, 5):
        subscribers._take_pose(position_with_header(number), 0)
    poses += inbox.take()
    assert [it.north_m for it in poses] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert {it.publisher for it in poses} == {"/nav"}
    subscribers.close()
    assert second.recv(1) == b""


def position_with_header(number: int) -> NavSts:
    message = position(number)
    message._connection_header = {"callerid": "/nav"}
    return message


def test_each_publisher_gets_one_second_connection_and_another_after_its_end(
    publisher: Publisher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(second_connection, "_AGAIN_S", 0.0)
    got: queue.Queue[Any] = queue.Queue()
    connections = SecondConnections(got.put)
    other = Publisher()
    both = subscriber_of(publisher, other)
    connections.follow(both)
    first, _ = publisher.handshakes.get(timeout=SOON_S), other.handshakes.get(timeout=SOON_S)
    connections.follow(both)
    first.sendall(framed(position(7)))
    assert got.get(timeout=SOON_S)._connection_header["callerid"] == "/nav"
    assert publisher.handshakes.empty() and other.handshakes.empty()
    first.close()
    while publisher.handshakes.empty():
        connections.follow(both)
    assert other.handshakes.empty()
    connections.close()
    other.close()


def test_a_silent_publisher_is_asked_as_soon_as_over_the_first_connection(publisher: Publisher) -> None:
    got: queue.Queue[Any] = queue.Queue()
    connections = SecondConnections(got.put)
    connections.follow(subscriber_of(publisher))
    publisher.handshakes.get(timeout=SOON_S).sendall(framed(position(0)))
    got.get(timeout=SOON_S)
    second = connections._open[publisher.uri]
    keeps = (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
    with socket.socket() as first:
        notice_end(first)
        asked, told = ([it.getsockopt(socket.IPPROTO_TCP, keep) for keep in keeps] for it in (first, second))
    assert asked == told and second.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    connections.close()


def test_a_publisher_that_refuses_is_asked_again_after_5_s(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = iter([100.0] * 2 + [104.9] + [105.0] * 2)
    monkeypatch.setattr(second_connection, "time", SimpleNamespace(monotonic=lambda: next(now_s)))
    publisher, connections = Publisher(takes=False), SecondConnections(lambda raw: None)
    for is_asked in (True, False, True):
        connections.follow(subscriber_of(publisher))
        while connections._open:  # until its thread has ended
            pass
        assert publisher.asked.qsize() == is_asked
        assert not is_asked or publisher.asked.get()[1] == TOPIC
    publisher.close()


def test_a_publisher_on_this_machine_gets_none(publisher: Publisher, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(second_connection, "is_local_address", lambda host: looked.put(host) is None)
    connections = SecondConnections(lambda raw: None)
    connections.follow(subscriber_of(publisher))
    assert looked.get(timeout=SOON_S) == "127.0.0.1"
    for _ in range(3):
        connections.follow(subscriber_of(publisher))
    assert publisher.asked.empty() and publisher.handshakes.empty()


@given(
    count=st.integers(0, 30),
    switches=st.lists(st.booleans(), max_size=80),
    begins=st.tuples(st.integers(0, 5), st.integers(0, 10)),
)
def test_each_message_counts_once_and_in_order(
    count: int, switches: list[bool], begins: tuple[int, int]
) -> None:
    """However the connections take turns, and whichever begins later. None is lost of what both bring."""
    ways = [list(range(begin, count)) for begin in begins]
    arrivals, taken = FirstArrivals(), []
    for second in [*switches, *[False] * count, *[True] * count]:
        if ways[second]:
            message = ways[second].pop(0)
            if arrivals.is_new(int(second), message, 0.0):
                taken.append(message)
    assert taken == sorted(set(taken)) and taken[-1:] == list(range(min(begins), count))[-1:]
    if begins[0] == begins[1]:
        assert taken == list(range(begins[0], count))


@given(st.integers(1, 20), st.lists(st.booleans(), max_size=60))
def test_messages_that_are_all_alike_go_on_counting(count: int, switches: list[bool]) -> None:
    """A frozen position without stamps has as many messages as came over the connection that brought most."""
    arrivals = FirstArrivals()
    new = sum(arrivals.is_new(int(second), "frozen", 0.0) for second in switches)
    assert new == max(switches.count(False), switches.count(True))


@pytest.mark.parametrize(
    ("arrived", "told"),
    [
        pytest.param(
            [(0, 1, 0), (1, 4, 0), (0, 2, 0), (0, 3, 0), (0, 4, 0), (1, 5, 0), (0, 5, 0), (1, 6, 0)],
            [True, False, True, True, True, True, False, True],
            id="one that begins ahead counts again as soon as the other has caught up",
        ),
        # The first brings 1 and 2 and ends; the second began at 4. What comes late over the first is older, and not new.
        pytest.param(
            [(0, 1, 0.0), (0, 2, 0.1), (1, 4, 0.3), (1, 5, 1.0), (1, 6, 1.2), (0, 3, 1.3), (1, 7, 1.4)],
            [True, True, False, False, True, False, True],
            id="the other takes over from a connection that has fallen silent",
        ),
    ],
)
def test_which_message_is_new(arrived: list[tuple[int, int, float]], told: list[bool]) -> None:
    arrivals = FirstArrivals()
    assert [arrivals.is_new(*it) for it in arrived] == told


def test_a_connection_that_is_alone_forgets_what_it_brought() -> None:
    arrivals = FirstArrivals()
    assert all(arrivals.is_new(0, number, 0.0) for number in range(10_000))
    assert sum(map(len, arrivals._unpaired)) <= 600

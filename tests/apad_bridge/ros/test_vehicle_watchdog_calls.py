"""The watchdog's connections, over real sockets: no master, no answer, connections that ended. And its terminal."""

from __future__ import annotations

import contextlib
import queue
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
from std_msgs.msg import Float32
from std_srvs.srv import Trigger, TriggerResponse
from watchdog_script import WATCHDOG

PATIENCE_S = 30.0
_LENGTH = struct.Struct("<I")


class Listener:
    """Takes each connection to a port of its own, and serves it in a thread."""

    def __init__(self) -> None:
        self.connections: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        with contextlib.suppress(OSError):  # it was closed before
            self._listener.shutdown(socket.SHUT_RDWR)  # a thread that accepts would take one more
        self._listener.close()
        self.cut()

    def cut(self) -> None:
        """Ends every connection, as a node that starts again does."""
        for connection in self.connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            for number in range(1000):
                self.connections.append(self._listener.accept()[0])
                served = number, self.connections[-1]
                threading.Thread(target=self._serve, args=served, daemon=True).start()

    def _serve(self, number: int, connection: socket.socket) -> None:
        raise NotImplementedError


def _header(*fields: str) -> bytes:
    told = b"".join(_LENGTH.pack(len(it)) + it.encode() for it in fields)
    return _LENGTH.pack(len(told)) + told


class Server(Listener):
    """A service as its bytes say, written here by the protocol's text. `answers` while it is not blocked.

    `seen` are its connections' ends and requests, in their order.
    """

    def __init__(self) -> None:
        self.answers = threading.Event()
        self.answers.set()
        self.seen: queue.Queue[str] = queue.Queue()
        self.headers: list[bytes] = []
        super().__init__()

    def _serve(self, number: int, connection: socket.socket) -> None:
        with connection, contextlib.suppress(ConnectionError, struct.error):
            self.headers.append(_block(connection))  # one connection is handed out after another
            connection.sendall(
                _header(f"type={Trigger._type}", f"md5sum={Trigger._md5sum}", "callerid=/apad")
            )
            while b"probe=1" not in self.headers[-1]:
                _block(connection)
                self.seen.put(f"request on {number}")
                if self.answers.is_set():
                    connection.sendall(b"\x01" + _LENGTH.pack(5) + b"\x00" + _LENGTH.pack(0))
        if b"probe=1" not in self.headers[number]:
            self.seen.put(f"end of {number}")

    def next(self, count: int) -> list[str]:
        return [self.seen.get(timeout=PATIENCE_S) for _ in range(count)]


def _block(connection: socket.socket) -> bytes:
    (size,) = _LENGTH.unpack(connection.recv(4, socket.MSG_WAITALL))
    return connection.recv(size, socket.MSG_WAITALL) if size else b""


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.answers.set()
    made.close()


@pytest.fixture
def service(server: Server, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Without a master: whoever asked one would wait or fail here."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    made = WATCHDOG.Service("/apad1/commander/stop_mission")
    made.resolve(f"rosrpc://127.0.0.1:{server.port}/")
    yield made
    made._close()


def calls(server: Server, service: Any) -> None:
    assert service.call() == TriggerResponse(False, "")


def calls_in_vain(server: Server, service: Any) -> None:
    """The server does not answer within its time."""
    server.answers.clear()
    begun_s = time.monotonic()
    with pytest.raises(WATCHDOG.NotTaken, match="no answer") as not_taken:
        service.call()
    assert not_taken.value.is_late
    assert WATCHDOG.TAKEN_S * 0.9 < time.monotonic() - begun_s < WATCHDOG.TAKEN_S + 5.0
    server.answers.set()


def connects(server: Server, service: Any) -> None:
    service.connect()


def is_cut(server: Server, service: Any) -> None:
    server.cut()


@pytest.mark.parametrize(
    "steps",
    [
        pytest.param([(calls, ["request on 1"])] * 3, id="it keeps its connection"),
        pytest.param(
            [(connects, []), (is_cut, ["end of 1"]), (calls, ["request on 2"])],
            id="a connection that ended is opened again by the kept address",
        ),
        pytest.param(
            [
                (connects, []),
                (calls_in_vain, ["request on 1", "end of 1"]),
                (calls_in_vain, ["request on 2", "end of 2"]),
                (calls, ["request on 3"]),
            ],
            id="a call without an answer ends its connection before the next request goes out",
        ),
    ],
)
def test_what_a_server_sees(
    server: Server, service: Any, steps: list[tuple[Callable[[Server, Any], None], list[str]]]
) -> None:
    """It is asked for its type once, by a connection of its own."""
    for act, seen in steps:
        act(server, service)
        assert server.next(len(seen)) == seen
    probe, *others = server.headers
    assert b"probe=1" in probe and all(b"persistent=1" in it for it in others)


def test_a_server_that_does_not_even_shake_hands_gets_no_request() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        service = WATCHDOG.Service("/apad1/commander/stop_mission")
        service.resolve(f"rosrpc://127.0.0.1:{listener.getsockname()[1]}")
        with pytest.raises(WATCHDOG.NotTaken) as not_taken:
            service.call()
        assert not not_taken.value.is_late
        with listener.accept()[0] as connection, connection.makefile("rb") as stream:
            (size,) = _LENGTH.unpack(stream.read(4))
            with contextlib.suppress(ConnectionError):
                assert len(stream.read(size)) == size and stream.read() == b"", "more than a handshake"


def test_what_the_aPad_does_not_offer_or_no_longer_serves_is_told(server: Server, service: Any) -> None:
    with pytest.raises(WATCHDOG.NotTaken, match="does not offer it"):
        WATCHDOG.Service("/apad1/VelCon_enable").call()
    server.close()
    with pytest.raises(WATCHDOG.NotTaken, match=r"refused|reset|closed") as not_taken:
        service.call()
        service.call()
    assert not not_taken.value.is_late


def test_the_address_of_a_service_that_started_again_replaces_the_old_one(
    server: Server, service: Any
) -> None:
    service.call()
    with contextlib.closing(Server()) as other:
        service.resolve(f"rosrpc://localhost:{other.port}")
        service.call()
        assert server.next(2) == ["request on 1", "end of 1"] and other.next(1) == ["request on 1"]


def empty_goal() -> Any:
    goal = SimpleNamespace(id=None, pose=SimpleNamespace(position=SimpleNamespace(x=0.0, y=0.0)))
    return SimpleNamespace(header=SimpleNamespace(), goal_id=SimpleNamespace(), goal=goal)


def test_a_goal_that_nobody_takes_is_sent_again_as_the_same_goal_so_that_no_backlog_grows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An action server takes a goal of a known id for the same one. Two metres away the aPad holds another place."""
    sent: list[tuple[str, float]] = []
    goals = object.__new__(WATCHDOG.Goals)
    goals._goals = SimpleNamespace(
        get_num_connections=lambda: 1,
        publish=lambda it: sent.append((it.goal_id.id, it.goal.pose.position.x)),
    )
    goals._kind, goals._number, goals._order, goals._taken = empty_goal, 0, None, threading.Event()
    monkeypatch.setattr(WATCHDOG, "TAKEN_S", 0.01)
    monkeypatch.setattr(WATCHDOG.rospy, "Time", SimpleNamespace(now=lambda: 0))
    for north_m in (10.0, 11.5, 12.5, 13.0):
        with pytest.raises(WATCHDOG.NotTaken) as not_taken:
            goals.hold(north_m, 5.0)
        assert not_taken.value.is_late
    assert [it[1] for it in sent] == [10.0, 10.0, 12.5, 12.5]
    assert [it[0] == sent[0][0] for it in sent] == [True, True, False, False] and sent[2][0] == sent[3][0]


def test_a_terminal_that_blocks_or_fails_holds_up_nobody_and_shows_the_rest_when_it_is_back() -> None:
    is_back, shown = threading.Event(), queue.Queue[str]()

    def write(text: str) -> None:
        assert is_back.wait(PATIENCE_S)
        if text == "lost":
            raise OSError(5, "Input/output error")
        shown.put(text)

    terminal = WATCHDOG.Terminal(SimpleNamespace(write=write, flush=lambda: None))
    for text in ("first", "lost", "last"):
        terminal.write(text)
        terminal.flush()
    assert shown.empty()
    is_back.set()
    assert [shown.get(timeout=PATIENCE_S) for _ in range(2)] == ["first", "last"]


class Publisher(Listener):
    """A topic's publisher as its bytes say. It sends `numbers` over each connection, and then no word."""

    def __init__(self, *numbers: float) -> None:
        self.headers: queue.Queue[bytes] = queue.Queue()
        self._numbers = numbers
        super().__init__()

    def _serve(self, number: int, connection: socket.socket) -> None:
        with contextlib.suppress(OSError):
            self.headers.put(_block(connection))
            connection.sendall(_header(f"md5sum={Float32._md5sum}"))
            for it in self._numbers:
                connection.sendall(_LENGTH.pack(4) + struct.pack("<f", it))

    def close(self) -> None:
        super().close()
        for it in self.connections:
            it.close()


def master_of(*ports: int) -> Any:
    """A master by which the node at each port publishes the heartbeat."""
    return SimpleNamespace(
        getSystemState=lambda: [[["/other", ["/x"]], ["/heartbeat", [f"/n{it}" for it in ports]]], [], []],
        lookupNode=lambda node: node.removeprefix("/n"),
    )


@dataclass(frozen=True)
class Second:
    """A second subscription to /heartbeat that runs, and the numbers that it hears."""

    find: Callable[[Any], None]
    heard: queue.Queue[float]


@pytest.fixture
def second(monkeypatch: pytest.MonkeyPatch) -> Iterator[Second]:
    ended, heard = threading.Event(), queue.Queue[float]()
    monkeypatch.setattr(WATCHDOG, "RENEWED_S", 0.3)
    monkeypatch.setattr(WATCHDOG.rospy, "is_shutdown", ended.is_set)
    monkeypatch.setattr(
        WATCHDOG,
        "_proxy",
        lambda port: SimpleNamespace(requestTopic=lambda *_: (1, "", ["TCPROS", "127.0.0.1", int(port)])),
    )
    made = WATCHDOG.SecondSubscription("/heartbeat", Float32, lambda it: heard.put(it.data))
    thread = threading.Thread(target=made.run)
    thread.start()
    yield Second(made.find, heard)
    ended.set()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_a_connection_that_falls_silent_without_a_word_is_begun_anew(second: Second) -> None:
    """The publisher has given it up, and the network has lost the word of that: rospy's own waits for minutes."""
    with contextlib.closing(Publisher(0.5, -1.0)) as publisher:
        second.find(master_of(publisher.port))
        assert [second.heard.get(timeout=PATIENCE_S) for _ in range(6)] == [0.5, -1.0] * 3
        header = publisher.headers.get()
        assert b"topic=/heartbeat" in header and b"_again" in header


def test_without_a_master_the_kept_address_serves_and_a_publisher_that_starts_again_is_found(
    second: Second,
) -> None:
    with contextlib.closing(Publisher(1.0)) as before, contextlib.closing(Publisher(2.0)) as after:
        second.find(master_of(before.port))
        assert second.heard.get(timeout=PATIENCE_S) == 1.0
        second.find(master_of())  # nobody publishes, by a master that has started again
        before.cut()
        assert second.heard.get(timeout=PATIENCE_S) == 1.0
        before.close()
        second.find(master_of(after.port))
        while second.heard.get(timeout=PATIENCE_S) != 2.0:
            pass


def test_a_node_that_takes_a_call_and_never_answers_costs_the_time_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(WATCHDOG, "RENEWED_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        node = WATCHDOG._proxy(f"http://127.0.0.1:{mute.getsockname()[1]}")
        with pytest.raises(TimeoutError):
            node.requestTopic("/watchdog", "/heartbeat", [["TCPROS"]])

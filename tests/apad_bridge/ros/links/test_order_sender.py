"""An OFF by a topic counts when the node that obeys has it, whoever else reads along."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock

import pytest
import rospy
from std_srvs.srv import Trigger, TriggerRequest

from apad_bridge.ros.links import order_sender, service_calls
from apad_bridge.ros.links.order_sender import LOST, OrderSender
from apad_bridge.vehicle.order_queue import TOO_LATE, Rank

OURS, SERVER, OBSERVER = "/bench", "/apad/server", "/laptop/rostopic"
LONGEST_S = 10.0


@dataclass(eq=False)
class Reader:
    """A connection to a node. The kernel counts what the other end has not read, as TCP what is not acknowledged."""

    endpoint_id: str
    socket: socket.socket
    other_end: socket.socket

    def read(self) -> None:
        self.other_end.settimeout(LONGEST_S)
        assert self.other_end.recv(100) == b"cancel"

    def close(self) -> None:
        for end in (self.socket, self.other_end):
            end.close()


class Bench:
    def __init__(self, monkeypatch: pytest.MonkeyPatch, obeyer: str, readers: tuple[str, ...]) -> None:
        self.readers = {name: Reader(name, *socket.socketpair()) for name in readers}
        topic: Any = MagicMock(resolved_name="/apad/cancel", type="actionlib_msgs/GoalID")
        topic.publish = lambda data: [it.socket.send(data) for it in self.readers.values()]
        type(topic.impl).connections = property(lambda _: list(self.readers.values()))
        monkeypatch.setattr(rospy, "get_name", lambda: OURS)
        monkeypatch.setattr(order_sender, "never_blocking_publisher", lambda *_: topic)
        monkeypatch.setattr(order_sender, "name_again", lambda *_: None)
        self.sender = OrderSender(lambda order: True)
        self.line = self.sender.add_topic("cancels", "/apad/cancel", None, lambda: obeyer)
        self.sender.begin()
        self.answers: SimpleQueue[str | None] = SimpleQueue()

    def off(self) -> None:
        cleared: Any = SimpleNamespace(under=0)
        self.sender.send("cancels", Rank.OFF, cleared, b"cancel", lambda _, why, cut: self.answers.put(why))

    def answer(self) -> str | None:
        return self.answers.get(timeout=LONGEST_S)


@pytest.fixture
def bench(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench(monkeypatch, *request.param)
    yield bench
    bench.sender.close()
    for it in bench.readers.values():
        it.close()


@pytest.mark.parametrize(
    ("bench", "reader", "answer"),
    [
        pytest.param(
            (SERVER, (OURS, OBSERVER, SERVER)),
            SERVER,
            None,
            id="an observer that does not read makes no stop fail",
        ),
        pytest.param(
            (SERVER, (OURS, OBSERVER, SERVER)),
            OBSERVER,
            TOO_LATE,
            id="an observer that reads makes no stop good",
        ),
        # It may stand behind a relay.
        pytest.param(
            (SERVER, (OBSERVER,)),
            OBSERVER,
            None,
            id="before the node that obeys is seen every reader counts",
        ),
        pytest.param(
            ("", (OBSERVER,)), OBSERVER, None, id="where nobody is known to obey every reader counts"
        ),
    ],
    indirect=["bench"],
)
def test_a_stop_is_good_when_who_obeys_has_it(bench: Bench, reader: str, answer: str | None) -> None:
    bench.off()
    bench.readers[reader].read()
    assert bench.answer() == answer


@pytest.mark.parametrize("bench", [(SERVER, (OURS, OBSERVER, SERVER))], indirect=True)
def test_a_server_whose_connection_ends_has_not_taken_the_stop(bench: Bench) -> None:
    bench.off()
    bench.readers[OBSERVER].read()
    assert bench.answers.empty()
    server = bench.readers[SERVER]
    bench.readers = bench.readers.copy()
    del bench.readers[SERVER]
    assert bench.answer() == LOST and bench.line.readers() == []
    bench.off()
    assert bench.answer() == "nobody reads /apad/cancel"
    server.close()


def headed(*fields: bytes) -> bytes:
    """The handshake of a service."""
    header = b"".join(len(it).to_bytes(4, "little") + it for it in fields)
    return len(header).to_bytes(4, "little") + header


@pytest.mark.parametrize(
    ("torn", "defects"),
    [([b"\6\0\0\0\1\0\0\0=x"], []), ([], [ZeroDivisionError])],
    ids=["a handshake that is cut short", "a defect of ours, which is told"],
)
def test_a_stop_goes_out_though_its_line_could_not_be_opened_at_first(
    monkeypatch: pytest.MonkeyPatch, torn: list[bytes], defects: list[type[Exception]]
) -> None:
    left, told = list(defects), SimpleQueue[Any]()

    def look_up(*_: str) -> str:
        if left:
            raise left.pop()
        host, port = server.getsockname()
        return f"rosrpc://{host}:{port}"

    monkeypatch.setattr(threading, "excepthook", lambda args: told.put(args.exc_type))
    monkeypatch.setattr(rospy, "resolve_name", str)
    monkeypatch.setattr(service_calls, "call", look_up)
    sender, answers, cleared = OrderSender(lambda order: True), SimpleQueue[str | None](), Mock(under=0)
    sender.add_service("off", "/apad/off", Trigger)
    with ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        server.settimeout(LONGEST_S)
        stack.callback(sender.close)
        sender.begin()
        for head in (*torn, headed(b"callerid=/apad")):
            link = stack.enter_context(server.accept()[0])
            link.settimeout(LONGEST_S)
            assert b"service=/apad/off" in link.recv(4096)
            link.sendall(head)
        sender.send("off", Rank.OFF, cleared, TriggerRequest(), lambda _, why, cut: answers.put(why))
        assert link.recv(9) == bytes(4)
        link.sendall(b"\1" + (5).to_bytes(4, "little") + bytes(5))
        assert answers.get(timeout=LONGEST_S) is None
    assert [told.get(timeout=LONGEST_S) for _ in defects] == defects and told.empty()


class Dead(socket.socket):
    """A connection whose end nobody has noticed before something is written."""

    def send(self, *_: Any) -> int:
        raise BrokenPipeError


def test_an_order_whose_line_turns_out_to_have_ended_goes_out_by_a_new_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (near, gone), (second, far) = socket.socketpair(), socket.socketpair()
    opened = iter([Dead(fileno=near.detach()), second])
    address = SimpleNamespace(name="/apad/go", kind=Trigger, open=lambda: next(opened))
    monkeypatch.setattr(order_sender, "ServiceAddress", lambda *_: address)
    sender, answers, cleared = (
        OrderSender(lambda order: True),
        SimpleQueue[str | None](),
        SimpleNamespace(under=0),
    )
    sender.add_service("orders", "/apad/go", Trigger)
    sender.begin()
    sender.wait_until_open(["orders"])
    sender.send("orders", Rank.ORDER, cleared, TriggerRequest(), lambda _, why, cut: answers.put(why))  # type: ignore[arg-type]
    for end in (gone, far):
        end.settimeout(LONGEST_S)
    assert (gone.recv(9), far.recv(9)) == (b"", bytes(4))
    far.send(b"\1" + (5).to_bytes(4, "little") + bytes(5))
    assert answers.get(timeout=LONGEST_S) is None
    sender.close()
    for end in (gone, far):
        end.close()

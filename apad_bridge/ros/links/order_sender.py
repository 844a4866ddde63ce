"""Sends an aPad's orders by the one queue (`vehicle/order_queue.py`), from one thread that owns all their connections.

A link puts its orders into a queue and goes on. The thread writes to services, and publishes on topics, in the order that
the queue says, and reads the answers. It never waits for one connection: what may take seconds, as a look-up at the master,
happens in a thread that sends no order.
"""

from __future__ import annotations

import fcntl
import selectors
import socket
import struct
import termios
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import rospy

from apad_bridge.ros.gateway.never_blocking import Stalls, never_blocking_publisher
from apad_bridge.ros.links.service_calls import (
    PATIENCE_S,
    Answers,
    CallFailed,
    ServiceAddress,
    request_bytes,
)
from apad_bridge.ros.system.lost_links import outlive_gaps
from apad_bridge.ros.system.master_watch import name_again
from apad_bridge.vehicle.order_queue import (
    CUT,
    STOP_PATIENCE_MS,
    TOO_LATE,
    CutLine,
    Ended,
    OpenLine,
    OrderQueue,
    Outgoing,
    QueueAction,
    Rank,
    Write,
)
from apad_bridge.vehicle.vehicle_link import Cleared
from firmware_model.entry_points import in_one_line

Answered = Callable[[Any, str | None, bool], None]
"""Takes the response, the reason if there is none, and whether a stop ended the order on its way."""
LOST = "the connection ended before the order was acknowledged"
ACKNOWLEDGED_S = 0.02
"""So often somebody looks if a topic's reader has acknowledged an OFF's order."""
NAMED_AGAIN_MS = 1_000
"""The master is asked to name a topic without a reader again after so long."""
_AT_ONCE = struct.pack("ii", 1, 0)
"""Linger on, for no time: the connection's end throws away what the other side has not acknowledged."""


def end_at_once(sock: socket.socket) -> None:
    """Ends a connection, and what is still on its way: TCP would deliver it, minutes later, too."""
    with suppress(OSError):  # it has ended already
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
        sock.shutdown(socket.SHUT_RD)  # wakes whoever reads from it
    sock.close()


@dataclass(frozen=True, slots=True, eq=False)
class _Order:
    outgoing: Outgoing
    message: Any
    answered: Answered


@dataclass(frozen=True, slots=True)
class _Opened:
    line: str
    result: socket.socket | str
    """The connection, or the reason why there is none."""


class _ServiceLine:
    def __init__(self, address: ServiceAddress) -> None:
        self.address = address
        self.socket: socket.socket | None = None
        self.answers = Answers(address.kind)


@dataclass(slots=True, eq=False)
class TopicLine:
    """A line of orders by a topic, which one node obeys, and others may read."""

    obeyer: Callable[[], str]
    publisher: Any = None
    asked_ms: int | None = None
    """When the master was last asked to name the topic again: 0 for never, None until somebody has read it."""
    was_obeyed: bool = False
    """The node that obeys has read the topic. Before that it may stand behind another one, as a relay."""

    @property
    def name(self) -> str:
        return str(self.publisher.resolved_name)

    def readers(self) -> list[Any]:
        """The connections of nodes that may obey: an observer's acknowledgement is no stop, and his silence no failure."""
        others = [it for it in list(self.publisher.impl.connections) if it.endpoint_id != rospy.get_name()]
        obeyer = self.obeyer()
        theirs = [it for it in others if it.endpoint_id == obeyer]
        self.was_obeyed = self.was_obeyed or bool(theirs)
        return theirs if self.was_obeyed else others


class OrderSender:
    """`lets_go` is the gate's last word about an order, asked directly before the order leaves."""

    def __init__(self, lets_go: Callable[[Cleared[Any]], bool]) -> None:
        self._queue = OrderQueue(lets_go)
        self._services: dict[str, _ServiceLine] = {}
        self._topics: dict[str, TopicLine] = {}
        self._came: SimpleQueue[_Order | _Opened] = SimpleQueue()
        self._orders: dict[Outgoing, _Order] = {}
        self._responses: dict[str, Any] = {}
        """The newest response that came by each line."""
        self._unread: set[Outgoing] = set()
        """Orders that nobody was there to read."""
        self._unacknowledged: dict[Outgoing, tuple[list[Any], int]] = {}
        """An OFF's order by a topic, its connections, and until when their acknowledgement is awaited: such a line brings
        no other answer."""
        self._open = frozenset[str]()
        self._changed = threading.Condition()
        """Guards `_open` and `_whys` for those who wait."""
        self._whys: dict[str, str] = {}
        """The reason why a line is not open, by line."""
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._is_closed = False
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._wake_in, selectors.EVENT_READ, None)
        self._thread: threading.Thread | None = None

    # For the link's thread.

    def add_service(self, line: str, service: str, kind: Any) -> None:
        """A line to a service, before `begin`. Two lines may lead to one service."""
        self._services[line] = _ServiceLine(ServiceAddress(service, kind))
        self._queue.add_line(line)

    def add_topic(
        self, line: str, topic: str, kind: Any, obeyer: Callable[[], str] = str, *, may_be_late: bool = False
    ) -> TopicLine:
        """A line by a topic, before `begin`; nobody else may publish there.

        `obeyer` names the node that obeys its orders, or nobody as long as that is not known. What `may_be_late` is
        delivered after a gap of the link, too. Else it ends there.
        """

        def prepare(sock: socket.socket) -> None:
            outlive_gaps(sock, with_bytes=may_be_late)
            added.asked_ms = added.asked_ms or 0

        added = self._topics[line] = TopicLine(obeyer)  # a reader may be there before the publisher is
        added.publisher = never_blocking_publisher(topic, kind, Stalls(), prepare)
        self._queue.add_line(line, answers=False)
        return added

    def begin(self) -> None:
        """Opens the lines and keeps them open, from now on."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="sender of orders", daemon=True)
            self._thread.start()

    def wait_until_open(self, lines: Iterable[str]) -> None:
        """CallFailed, with the service's name, for a line that is not open within `PATIENCE_S`."""
        wanted = set(lines)
        with self._changed:
            self._changed.wait_for(lambda: wanted <= self._open | self._whys.keys(), PATIENCE_S)
            for line in sorted(wanted - self._open):
                name = self._services[line].address.name
                raise CallFailed(f"{name}: {self._whys.get(line, 'it does not answer')}")

    def are_open(self, lines: Iterable[str]) -> bool:
        return self._open.issuperset(lines)

    def send(self, line: str, rank: Rank, cleared: Cleared[Any], message: Any, answered: Answered) -> None:
        """Takes an order. The sender's thread runs `answered` once, whatever comes of it."""
        self._put(_Order(Outgoing(cleared, rank, line), message, answered))

    def close(self) -> None:
        self._is_closed = True
        self._wake()
        if self._thread is not None:
            self._thread.join(PATIENCE_S)
        for topic in self._topics.values():
            topic.publisher.unregister()
        self._wake_in.close()
        self._wake_out.close()

    def _put(self, item: _Order | _Opened) -> None:
        self._came.put(item)
        self._wake()

    def _wake(self) -> None:
        with suppress(OSError):  # a full pipe wakes as well
            self._wake_out.send(b"\0", socket.MSG_DONTWAIT)

    # For the sender's thread.

    def _run(self) -> None:
        while not self._is_closed:
            self._take_what_came()
            self._advance()
            self._report_open()
            self._call_readers_back()
            self._look_for_acknowledgements()
            due_ms = self._queue.next_due_ms()
            longest_s = ACKNOWLEDGED_S if self._unacknowledged else 1.0
            wait_s = longest_s if due_ms is None else min(longest_s, max(0.0, (due_ms - _now_ms()) / 1000))
            if self._came.empty():
                self._read(wait_s)
        for line in self._services.values():
            if line.socket is not None:
                end_at_once(line.socket)
        self._selector.close()

    def _take_what_came(self) -> None:
        with suppress(Empty):
            while True:
                item = self._came.get_nowait()
                if isinstance(item, _Order):
                    self._orders[item.outgoing] = item
                    self._queue.put(item.outgoing, _now_ms())
                    self._advance()
                else:
                    self._take_connection(item)

    def _advance(self) -> None:
        for action in self._queue.advance(_now_ms()):
            self._act(action)

    def _take_connection(self, opened: _Opened) -> None:
        line = self._services[opened.line]
        if isinstance(opened.result, str):
            with self._changed:
                self._whys[opened.line] = opened.result
                self._changed.notify_all()
            self._queue.not_opened(opened.line, f"{line.address.name}: {opened.result}", _now_ms())
            return
        line.socket, line.answers = opened.result, Answers(line.address.kind)
        line.socket.setblocking(False)
        self._selector.register(line.socket, selectors.EVENT_READ, opened.line)
        self._whys.pop(opened.line, None)
        self._queue.opened(opened.line)

    def _act(self, action: QueueAction) -> None:
        match action:
            case OpenLine(name):
                address = self._services[name].address
                threading.Thread(
                    target=self._open_line, args=(name, address), name=f"open {name}", daemon=True
                ).start()
            case CutLine(name) if name in self._topics:
                self._cut_topic(self._topics[name].publisher)
            case CutLine(name):
                self._drop(name)
            case Write(outgoing):
                self._write(outgoing)
            case Ended(outgoing, refused) if outgoing in self._unread:
                self._unread.discard(outgoing)
                self._end(outgoing, f"nobody reads {self._topics[outgoing.line].name}")
            case Ended(outgoing, None) if outgoing.line in self._topics and outgoing.rank is Rank.OFF:
                readers = self._topics[outgoing.line].readers()
                self._unacknowledged[outgoing] = readers, _now_ms() + STOP_PATIENCE_MS
            case Ended(outgoing, refused):
                self._end(outgoing, refused)

    def _end(self, outgoing: Outgoing, refused: str | None) -> None:
        response = self._responses.pop(outgoing.line, None) if refused is None else None
        self._orders.pop(outgoing).answered(response, refused, refused == CUT)

    def _look_for_acknowledgements(self) -> None:
        for outgoing, (connections, until_ms) in list(self._unacknowledged.items()):
            readers = self._topics[outgoing.line].readers()
            is_gone = not connections or any(it not in readers or it.socket is None for it in connections)
            is_acknowledged = not (is_gone or any(_unacknowledged_bytes(it.socket) for it in connections))
            if is_gone or is_acknowledged or _now_ms() >= until_ms:
                del self._unacknowledged[outgoing]
                self._end(outgoing, None if is_acknowledged else LOST if is_gone else TOO_LATE)

    def _open_line(self, name: str, address: ServiceAddress) -> None:
        result: socket.socket | str = ""
        try:
            result = address.open()
        except CallFailed as failed:
            result = str(failed)
        except BaseException as defect:  # else the line would be opening for ever, and no stop go out by it
            result = in_one_line(defect)
            raise
        finally:
            self._put(_Opened(name, result))

    def _write(self, outgoing: Outgoing) -> None:
        message = self._orders[outgoing].message
        if outgoing.line in self._topics:
            topic = self._topics[outgoing.line]
            if not topic.readers():
                self._unread.add(outgoing)
            topic.publisher.publish(message)
            return
        sock = self._services[outgoing.line].socket
        assert sock is not None, "the queue writes to open lines"
        data = request_bytes(message)
        try:
            is_whole = sock.send(data) == len(data)
        except OSError:
            is_whole = False
        if not is_whole:  # a free line has an empty buffer, so it has ended
            self._drop(outgoing.line)
            self._queue.ended(outgoing.line, _now_ms())

    def _cut_topic(self, publisher: Any) -> None:
        """Ends the connections that still hold bytes of an order; their readers are called back."""
        for connection in list(publisher.impl.connections):
            if connection.socket is not None and _unacknowledged_bytes(connection.socket) > 0:
                end_at_once(connection.socket)
                connection.close()

    def _call_readers_back(self) -> None:
        """A reader of rospy does not connect again by itself after its connection has ended."""
        for name, topic in self._topics.items():
            if topic.readers():
                topic.asked_ms = 0
            elif topic.asked_ms is not None and _now_ms() - topic.asked_ms >= NAMED_AGAIN_MS:
                topic.asked_ms = _now_ms()
                threading.Thread(
                    target=name_again,
                    args=(topic.name, topic.publisher.type),
                    name=f"name {name} again",
                    daemon=True,
                ).start()

    def _drop(self, name: str) -> None:
        line = self._services[name]
        sock, line.socket = line.socket, None
        if sock is not None:
            self._selector.unregister(sock)
            end_at_once(sock)

    def _read(self, wait_s: float) -> None:
        for key, _ in self._selector.select(wait_s):
            if key.data is None:
                with suppress(BlockingIOError):
                    while self._wake_in.recv(4096):
                        pass
            else:
                self._read_line(key.data)

    def _read_line(self, name: str) -> None:
        line = self._services[name]
        if line.socket is None:
            return
        try:
            data = line.socket.recv(65_536)
            answers = line.answers.take(data)
        except BlockingIOError:
            return
        except (OSError, ValueError):
            data, answers = b"", []
        if not data:
            self._drop(name)
            self._queue.ended(name, _now_ms())
        for response, error in answers:
            self._responses[name] = response
            self._queue.answered(name, error)

    def _report_open(self) -> None:
        is_open = frozenset(it for it in self._services if self._queue.is_open(it))
        if is_open != self._open:
            with self._changed:
                self._open = is_open
                self._changed.notify_all()


def _unacknowledged_bytes(sock: socket.socket) -> int:
    """The bytes that the other side has not acknowledged; 0 for a connection that has ended."""
    with suppress(OSError, ValueError):
        (count,) = struct.unpack("i", fcntl.ioctl(sock.fileno(), termios.TIOCOUTQ, b"\0" * 4))
        return int(count)
    return 0


def _now_ms() -> int:
    return time.monotonic_ns() // 1_000_000

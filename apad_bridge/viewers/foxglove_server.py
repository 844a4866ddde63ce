"""Serves a graph's topics to Foxglove and Lichtblick by their WebSocket protocol. They may look and not order.

A process of its own, as a console is. It subscribes to a topic for as long as a viewer looks at it, so a flight without
viewers sends it nothing. Messages pass on as bytes, in the form of ROS 1 and with their publishers' definitions.
"""

from __future__ import annotations

import os
import queue
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from agents.hosting.interrupts import received_by
from apad_bridge.doctor.network import Unreachable, call
from apad_bridge.records.bag import RecordedMessage
from apad_bridge.ros.graph_listener import GraphListener
from apad_bridge.ros.system.route import enter_graph_of, somebodys_master
from apad_bridge.ros.types.any_message import UnknownType, class_of
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros.types.workspace_services import text_folders
from apad_bridge.scenario.errors import UserError
from apad_bridge.viewers.viewer_gate import TOKEN_VARIABLE, ViewerGate, hidden_address

_NICE = 5
"""Above the supervisor's: a viewer may wait for its processor, and a tick of the flight may not."""
_LOOK_S = 5.0
"""Wall seconds between two looks at the master's list of topics."""
_WAIT_S = 0.1
_GONE_S = 3.0
"""A master that is silent for so long is gone: a run's own master ends with the run."""


def serve(
    run_dir: Path | None,
    host: str,
    port: int,
    tell: Callable[[int, str], None],
    warn: Callable[[str], None],
) -> bool:
    """Serves the graph of a run, or without one that of ROS_MASTER_URI, until SIGINT, SIGTERM or the graph's end.

    `tell` takes the port on which it listens (`port` 0 takes a free one) and the token that a page of the web needs, `warn`
    takes lines for a person. True when the run has ended.

    UserError for a directory without a run, or with one that flies without ROS, and for an address that cannot be used;
    PeerFailed for a master that does not answer.
    """
    asked = threading.Event()
    os.nice(_NICE)
    token = os.environ.pop(TOKEN_VARIABLE, "") or secrets.token_urlsafe(16)
    with received_by(asked.set), closing(_Views()) as views, _gate(host, port, token, views) as gate:
        tell(gate.port, token)
        if run_dir is not None and not enter_graph_of(run_dir, asked.wait):
            return False
        master_uri = somebodys_master()
        use_generated_messages()
        with closing(GraphListener((), "musselbed_foxglove")) as listener:
            _Relay(master_uri, listener, views, warn).run(asked)
        return not asked.is_set()


def _gate(host: str, port: int, token: str, views: _Views) -> closing[ViewerGate]:
    try:
        return closing(ViewerGate(host, port, token, views.address))
    except OSError as error:
        raise UserError(f"cannot listen on {host} port {port}: {error.strerror or error}") from error


class _Views(ServerListener):
    """The server and its channels. The protocol's threads note here who looks at what."""

    def __init__(self) -> None:
        self._context = foxglove.Context()
        self._channels: dict[str, tuple[str, foxglove.Channel]] = {}
        """By topic: the md5 of its definition, and the channel."""
        self.changes: queue.SimpleQueue[tuple[str, int]] = queue.SimpleQueue()
        """(topic, +1 for a viewer that begins to look and -1 for one that ends)."""
        host = hidden_address()
        try:
            # Neither publishing nor services nor parameters are offered: the server refuses them by itself.
            self._server = foxglove.start_server(
                name="musselbed",
                host=host,
                port=0,
                capabilities=[Capability.Time],
                server_listener=self,
                context=self._context,
            )
        except RuntimeError as error:
            raise UserError(f"cannot listen on {host}: {str(error).rpartition('port: ')[2]}") from error
        self.address: tuple[str, int] = (host, self._server.port)

    @property
    def topics(self) -> set[str]:
        return set(self._channels)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self.changes.put((channel.topic, 1))

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        self.changes.put((channel.topic, -1))

    def offer(self, topic: str, kind: str, md5: str, definition: str) -> None:
        """Offers a topic, in place of a channel of another definition."""
        self.withdraw(topic)
        schema = foxglove.Schema(name=kind, encoding="ros1msg", data=definition.encode())
        channel = foxglove.Channel(topic, schema=schema, message_encoding="ros1", context=self._context)
        self._channels[topic] = (md5, channel)

    def withdraw(self, topic: str) -> None:
        if topic in self._channels:
            self._channels.pop(topic)[1].close()

    def pass_on(self, message: RecordedMessage) -> None:
        """Sends a message to those who look at its topic."""
        connection = message.connection
        if connection.topic not in self._channels:
            return
        if self._channels[connection.topic][0] != connection.md5:
            kind = connection.kind.replace("/msg/", "/", 1)
            self.offer(connection.topic, kind, connection.md5, connection.definition)
        self._channels[connection.topic][1].log(message.data, log_time=message.stamp_ns)

    def send_time(self, now_ns: int) -> None:
        self._server.broadcast_time(now_ns)

    def close(self) -> None:
        self._server.stop()


class _Relay:
    """From the graph's topics to the viewers, in the process's main thread."""

    def __init__(
        self, master_uri: str, listener: GraphListener, views: _Views, warn: Callable[[str], None]
    ) -> None:
        self._master_uri = master_uri
        self._listener = listener
        self._views = views
        self._warn = warn
        self._lookers: Counter[str] = Counter()
        self._newest: dict[str, RecordedMessage] = {}
        """By topic that somebody looks at: a latched message comes once, and later viewers need it too."""
        self._unknown: set[str] = set()
        self._texts = text_folders()
        self._answered_s = time.monotonic()

    def run(self, asked: threading.Event) -> None:
        """Returns when asked to end, or when the master is gone."""
        next_look_s = 0.0
        while not asked.is_set():
            if (now_s := time.monotonic()) >= next_look_s:
                if not self._look():
                    return
                next_look_s = now_s + (_LOOK_S if self._answered_s >= now_s else _WAIT_S)
            self._follow_viewers()
            for message in self._listener.take(_WAIT_S):
                self._newest[message.connection.topic] = message
                self._views.pass_on(message)
            if (now_ns := self._listener.now_ns()) > 0:
                self._views.send_time(now_ns)

    def _look(self) -> bool:
        """Offers the topics of the graph as it is now; False for a master that is gone."""
        try:
            published = dict(call(self._master_uri, "getPublishedTopics", ""))
        except Unreachable:
            return time.monotonic() - self._answered_s < _GONE_S
        self._answered_s = time.monotonic()
        for topic in self._views.topics - published.keys():
            self._views.withdraw(topic)
        for topic in sorted(published.keys() - self._views.topics):
            kind = published[topic]
            if kind in self._unknown:
                continue
            try:
                known = class_of(kind, self._texts)
            except UnknownType as error:
                self._unknown.add(kind)
                self._warn(f"left out: {error}")
                continue
            self._views.offer(topic, kind, known._md5sum, known._full_text)
        return True

    def _follow_viewers(self) -> None:
        while not self._views.changes.empty():
            topic, change = self._views.changes.get()
            before, self._lookers[topic] = self._lookers[topic], self._lookers[topic] + change
            if before == 0 and change > 0:
                self._listener.listen(topic)
            elif self._lookers[topic] == 0:
                self._listener.leave(topic)
                self._newest.pop(topic, None)
            elif change > 0 and topic in self._newest:
                self._views.pass_on(self._newest[topic])

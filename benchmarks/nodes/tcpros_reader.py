"""Reads a fleet's topics off the wire with one selector, as a quick node would; rospy's own reader has a thread a topic.

Use: tcpros_reader.py XMLRPC_URI NAME AGENTS [RECEIVE_BUFFER_BYTES]; prints `reading` when all are connected. It reads until
its stdin ends, then prints a line of JSON: the number of messages, of messages missing by the header's sequence, and of
connections that the publisher ended.
"""

from __future__ import annotations

import json
import selectors
import socket
import struct
import sys
import xmlrpc.client
from dataclasses import dataclass, field
from typing import Any

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

_TIMEOUT_S = 30.0


@dataclass(slots=True)
class Stream:
    """One topic's connection; `sequence` is the header's, which a Float64 does not have."""

    has_header: bool
    rest: bytes = b""
    messages: int = 0
    missing: int = 0
    sequence: int | None = None
    ended: bool = field(default=False)

    def take(self, data: bytes) -> None:
        data = self.rest + data
        at = 0
        while len(data) - at >= 4:
            (length,) = struct.unpack_from("<I", data, at)
            if len(data) - at - 4 < length:
                break
            self.messages += 1
            if self.has_header:
                (sequence,) = struct.unpack_from("<I", data, at + 4)
                if self.sequence is not None:
                    self.missing += sequence - self.sequence - 1
                self.sequence = sequence
            at += 4 + length
        self.rest = data[at:]


def connect(
    proxy: xmlrpc.client.ServerProxy, name: str, topic: str, kind: Any, buffer: int | None
) -> socket.socket:
    """A TCPROS connection after its handshake; RuntimeError when the publisher refuses it."""
    answer_of: Any = proxy.requestTopic(f"/{name}", topic, [["TCPROS"]])
    _, text, (protocol, host, port) = answer_of
    if protocol != "TCPROS":
        raise RuntimeError(f"{topic}: {text}")
    sock = socket.socket()
    if buffer is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    sock.settimeout(_TIMEOUT_S)
    sock.connect((host, port))
    fields = {
        "callerid": f"/{name}",
        "topic": topic,
        "type": kind._type,
        "md5sum": kind._md5sum,
        "tcp_nodelay": "1",
    }
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    header = b"".join(struct.pack("<I", len(line)) + line for line in lines)
    sock.sendall(struct.pack("<I", len(header)) + header)
    answer = b""
    while len(answer) < 4 or len(answer) < 4 + struct.unpack_from("<I", answer)[0]:
        answer += sock.recv(4 if len(answer) < 4 else 4 + struct.unpack_from("<I", answer)[0] - len(answer))
    if b"error=" in answer:
        raise RuntimeError(f"{topic}: {answer!r}")
    sock.setblocking(False)
    return sock


def main() -> None:
    uri, name, agents = sys.argv[1], sys.argv[2], int(sys.argv[3])
    buffer = int(sys.argv[4]) if len(sys.argv) > 4 else None
    selector = selectors.DefaultSelector()
    streams = []
    proxy = xmlrpc.client.ServerProxy(uri)
    for agent_id in range(1, agents + 1):
        for topic, kind in (("position", NavSts), ("battery_level", Float64)):
            stream = Stream(kind is NavSts)
            streams.append(stream)
            sock = connect(proxy, name, f"/amussel{agent_id}/{topic}", kind, buffer)
            selector.register(sock, selectors.EVENT_READ, stream)
    selector.register(sys.stdin, selectors.EVENT_READ)
    print("reading", flush=True)
    stdin_ended = False
    while True:
        ready = selector.select(0.5 if stdin_ended else None)
        if stdin_ended and not ready:
            break
        for key, _ in ready:
            if key.fileobj is sys.stdin:
                stdin_ended = True
                selector.unregister(sys.stdin)
            elif data := key.fileobj.recv(65536):  # type: ignore[union-attr]
                key.data.take(data)
            else:
                key.data.ended = True
                selector.unregister(key.fileobj)
    totals = {
        "messages": sum(it.messages for it in streams),
        "missing": sum(it.missing for it in streams),
        "ended": sum(it.ended for it in streams),
    }
    print(json.dumps(totals), flush=True)


if __name__ == "__main__":
    main()

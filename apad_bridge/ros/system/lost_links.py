"""Closes connections to other machines over a lost link, so that what was ordered before is not delivered after it.

TCP keeps what is not acknowledged, and delivers it when a link is back: minutes later, a go-to would start a vehicle. Here
a connection by which this node sends ends when nothing was acknowledged for `UNACKNOWLEDGED_S`, with all that it holds. Of
topics by which orders leave only those end that hold bytes, and never that of cancels, which stop a vehicle at any time.
A subscription sends nothing. It asks a silent publisher every few seconds whether its connection is still there.
"""

from __future__ import annotations

import ipaddress
import socket
from typing import Any
from urllib.parse import urlsplit

import rosgraph
from rosgraph.network import is_local_address
from rospy import ServiceException, ServiceProxy
from rospy.impl.tcpros_base import TCPROSTransport

from apad_bridge.doctor.network import within

UNACKNOWLEDGED_S = 3
IDLE_S, AGAIN_S, UNANSWERED = 5, 2, 8
"""After so much silence a subscription asks, and asks again; it ends after so many questions without an answer, or at once
where the publisher has ended it. Few questions would end it by chance over a link that loses many packets."""


def end_when_unacknowledged(sock: socket.socket) -> None:
    """For a connection to another machine: on this one no link is lost, and a stopped program may go on."""
    try:
        address = ipaddress.ip_address(sock.getpeername()[0])
    except (OSError, ValueError):
        return  # it has ended already
    if address.is_loopback:
        return
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * UNACKNOWLEDGED_S)
    # One that is idle notices it, too: before the next order is written into it.
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, UNACKNOWLEDGED_S)


def outlive_gaps(sock: socket.socket, *, with_bytes: bool) -> None:
    """For a topic by which orders leave: its connection outlives a gap of the link, `with_bytes` what it then holds, too.

    A vehicle's reader, one of rospy, learns after 150 s that a connection ended in a gap, and connects no new one before.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 0)
    if with_bytes:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 0)


def notice_end(sock: socket.socket) -> None:
    """A publisher that gave up during a short cut is known soon. rospy would ask it after a minute."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, IDLE_S)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, AGAIN_S)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, UNANSWERED)


_connect = TCPROSTransport.connect


def _connect_within(
    transport: Any, dest_addr: str, dest_port: int, endpoint_id: str, timeout: float | None = None
) -> None:
    """Bounds what a service's client does, which gives no time-out. A subscription gives one."""
    if timeout is not None or is_local_address(dest_addr):
        _connect(transport, dest_addr, dest_port, endpoint_id, timeout)
        if timeout is not None and not is_local_address(dest_addr):
            notice_end(transport.socket)
        return
    # The kernel by itself would try for two minutes.
    _connect(transport, dest_addr, dest_port, endpoint_id, UNACKNOWLEDGED_S)
    transport.socket.settimeout(None)
    end_when_unacknowledged(transport.socket)


_look_up = ServiceProxy._get_service_uri


def _look_up_within(proxy: Any, request: Any) -> Any:
    """Bounds the question to the master, which rospy asks before each call, and whose answer has no time-out."""
    if is_local_address(urlsplit(rosgraph.get_master_uri()).hostname):
        return _look_up(proxy, request)
    try:
        return within(UNACKNOWLEDGED_S, lambda: _look_up(proxy, request))
    except TimeoutError:
        raise ServiceException(f"the master does not answer within {UNACKNOWLEDGED_S} s") from None


def bound_calls() -> None:
    """For all services on other machines that this process calls, and publishers there that it hears, from now on."""
    TCPROSTransport.connect = _connect_within
    ServiceProxy._get_service_uri = _look_up_within

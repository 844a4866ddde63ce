"""A link that is cut, between two machines that are network namespaces here; and that a connection on one machine stays."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from rospy import ServiceException, ServiceProxy
from rospy.impl.tcpros_base import TCPROSTransport
from stalled import stalled_s
from std_srvs.srv import Trigger

from apad_bridge.ros.system import lost_links
from apad_bridge.ros.system.lost_links import UNACKNOWLEDGED_S, end_when_unacknowledged

ROOT = Path(__file__).parents[4]
CUT = Path(__file__).with_name("cut_a_link.py")
SOON_S = 0.2
PATIENCE_S = 60.0


@pytest.mark.parametrize(("peer", "ends"), [("10.0.200.1", True), ("127.0.0.1", False), ("::1", False)])
def test_a_connection_to_another_machine_ends_after_3_s_without_an_acknowledgement(
    peer: str, ends: bool
) -> None:
    sock = MagicMock()
    sock.getpeername.return_value = peer, 11311
    end_when_unacknowledged(sock)
    options = {it.args[:2]: it.args[2] for it in sock.setsockopt.call_args_list}
    wanted = 1000 * UNACKNOWLEDGED_S if ends else None
    assert options.get((socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)) == wanted


def test_a_connection_that_has_ended_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as never_connected:
        end_when_unacknowledged(never_connected)


def namespaces_work() -> bool:
    if shutil.which("unshare") is None or shutil.which("nsenter") is None or shutil.which("ip") is None:
        return False
    tried = subprocess.run(
        ["unshare", "-rn", "ip", "link", "add", "va", "type", "veth", "peer", "name", "vb"],
        capture_output=True,
        check=False,
    )
    return tried.returncode == 0


@pytest.mark.skipif(not namespaces_work(), reason="this machine lets nobody make network namespaces")
def test_what_was_sent_into_a_cut_link_never_arrives_though_the_link_comes_back() -> None:
    """Beside it a connection without the bound: its order arrives when the link is back."""
    others_s = stalled_s()
    done = subprocess.run(
        ["unshare", "-rn", sys.executable, str(CUT)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["before"] == {"bounded": "before", "plain": "before"}
    assert told["ended_by"] == "TimeoutError"
    # Three seconds, and the kernel's timers, which double from 0.2 s. What others took of the machine is not ours.
    assert told["ended_after_s"] > UNACKNOWLEDGED_S - 0.5
    assert told["ended_after_s"] - (stalled_s() - others_s) < 4 * UNACKNOWLEDGED_S
    assert told["after"] == {"bounded": "", "plain": "late"}


def test_rospy_s_clients_on_other_machines_are_bounded_and_those_here_are_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    called: list[tuple[str, float | None]] = []
    monkeypatch.setattr(
        lost_links, "_connect", lambda it, address, port, endpoint, timeout: called.append((address, timeout))
    )
    monkeypatch.setattr(lost_links, "is_local_address", lambda address: address == "127.0.0.1")
    asks_after_s = []
    calls = [("127.0.0.1", None), ("10.0.200.1", None), ("127.0.0.1", 60.0), ("10.0.200.1", 60.0)]
    with socket.socket() as sock:
        for address, timeout in calls:
            lost_links._connect_within(SimpleNamespace(socket=sock), address, 1, "/a", timeout)
            asks_after_s.append(sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE))
    assert called == [calls[0], ("10.0.200.1", UNACKNOWLEDGED_S), *calls[2:]]
    # A fleet whose link was cut for six seconds was not heard for a minute after them.
    *_, before_s, subscription_s = asks_after_s
    assert before_s > 60 > 10 > subscription_s


def test_an_order_whose_service_is_found_only_when_the_link_is_back_is_not_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    is_back, reached = threading.Event(), threading.Event()

    def look_up(caller: str, name: str) -> list[object]:
        is_back.wait(PATIENCE_S)
        return [1, "", f"rosrpc://127.0.0.1:{service.getsockname()[1]}"]

    def serve() -> None:
        with contextlib.suppress(OSError):
            service.accept()[0].close()
            reached.set()

    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as master, socket.socket() as service:
        service.bind(("127.0.0.1", 0))
        service.listen()
        service.settimeout(10 * SOON_S)
        master.register_function(look_up, "lookupService")
        threads = [threading.Thread(target=it, daemon=True) for it in (master.handle_request, serve)]
        for thread in threads:
            thread.start()
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{master.server_address[1]}")
        monkeypatch.setattr("rospy.impl.tcpros_base._use_tcp_keepalive", False)  # else the master is asked
        monkeypatch.setattr(lost_links, "UNACKNOWLEDGED_S", SOON_S)
        monkeypatch.setattr(lost_links, "is_local_address", lambda address: False)
        for bounded in (TCPROSTransport, "connect"), (ServiceProxy, "_get_service_uri"):
            monkeypatch.setattr(*bounded, getattr(*bounded))  # as they were, after this
        lost_links.bound_calls()
        with pytest.raises(ServiceException, match="does not answer"):
            ServiceProxy("/apad1/commander/stop_mission", Trigger)()
        is_back.set()
        for thread in threads:
            thread.join()
    assert not reached.is_set()

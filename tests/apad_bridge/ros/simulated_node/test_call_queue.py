"""Calls that wait while the simulated aPad of generation B blocks: in their order, and none whose connection closed."""

from __future__ import annotations

import socket
import threading
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from functools import partial
from types import SimpleNamespace
from unittest.mock import MagicMock

from apad_bridge.ros.generation_b.server import ServiceCallQueue

PATIENCE_S = 30.0


def test_a_call_whose_connection_closes_while_it_waits_never_runs_and_the_others_run_in_their_order() -> None:
    ran, asks = list[str](), MagicMock(return_value=True)
    calls = ServiceCallQueue(asks)
    with ExitStack() as stack, ThreadPoolExecutor() as pool:
        ends = {it: [*map(stack.enter_context, socket.socketpair())] for it in ("first", "closed", "last")}
        running = []
        for name, (_, theirs) in ends.items():
            running.append(pool.submit(calls.run, SimpleNamespace(socket=theirs), partial(ran.append, name)))
            while len(calls._waiting) < len(running) or not asks.called:  # a call asks when it has its place
                wait(running, 0.01)
        ends["closed"][0].close()
        assert ran == []
        asks.return_value = False
        calls.look()
        assert not wait(running, PATIENCE_S).not_done
    assert ran == ["first", "last"]


def test_a_call_that_never_ends_keeps_nobody_waiting() -> None:
    calls, ends, hangs = ServiceCallQueue(lambda: False), threading.Event(), threading.Event()
    ours, theirs = socket.socketpair()
    with ours, theirs, ThreadPoolExecutor() as pool:
        transport, ran = SimpleNamespace(socket=theirs), list[str]()
        pool.submit(calls.run, transport, lambda: (calls.let_next(), hangs.set(), ends.wait(PATIENCE_S)))
        assert hangs.wait(PATIENCE_S)
        calls.run(transport, lambda: ran.append("next"))
        assert ran == ["next"]
        ends.set()

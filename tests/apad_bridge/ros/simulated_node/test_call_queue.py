"""Calls that wait while the simulated aPad of generation B blocks: in their order, and none whose connection closed."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack
from types import SimpleNamespace

from apad_bridge.ros.generation_b.server import ServiceCallQueue

PATIENCE_S = 30.0


def test_a_call_whose_connection_closes_while_it_waits_never_runs_and_the_others_run_in_their_order() -> None:
    blocks, ran, began = threading.Event(), list[str](), threading.Semaphore(0)
    blocks.set()

    def blocked() -> bool:
        began.release()  # a call asks when it has its place
        return blocks.is_set()

    calls = ServiceCallQueue(blocked)
    with ExitStack() as stack:
        threads, ours = [], {}
        for name in ("first", "closed", "last"):
            ours[name], theirs = (stack.enter_context(it) for it in socket.socketpair())

            def call(name: str = name, theirs: socket.socket = theirs) -> None:
                calls.run(SimpleNamespace(socket=theirs), lambda: ran.append(name))

            threads.append(threading.Thread(target=call, daemon=True))
            threads[-1].start()
            if name == "first":
                assert began.acquire(timeout=PATIENCE_S)
            while len(calls._waiting) < len(threads):
                threads[-1].join(0.01)
        ours["closed"].close()
        assert ran == []
        blocks.clear()
        calls.look()
        for thread in threads:
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
    assert ran == ["first", "last"]


def test_a_call_that_never_ends_keeps_nobody_waiting() -> None:
    calls, ends, hangs = ServiceCallQueue(lambda: False), threading.Event(), threading.Event()

    def hang() -> None:
        calls.let_next()
        hangs.set()
        ends.wait(PATIENCE_S)

    ours, theirs = socket.socketpair()
    with ours, theirs:
        transport, ran = SimpleNamespace(socket=theirs), list[str]()
        thread = threading.Thread(target=calls.run, args=(transport, hang), daemon=True)
        thread.start()
        assert hangs.wait(PATIENCE_S)
        calls.run(transport, lambda: ran.append("next"))
        assert ran == ["next"]
        ends.set()
        thread.join(PATIENCE_S)

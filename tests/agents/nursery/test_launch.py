"""Ctrl-C and SIGTERM while a nursery starts."""

from __future__ import annotations

import signal
import threading

import pytest

from agents.nursery.launch import signals_held_back


def test_ctrl_c_waits_until_it_is_let_in() -> None:
    reached = []
    with pytest.raises(KeyboardInterrupt), signals_held_back() as let_in:
        signal.raise_signal(signal.SIGINT)
        reached.append("begun")
        let_in()
        reached.append("never")
    assert reached == ["begun"] and signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_acts_at_the_end_as_it_did_before(number: int) -> None:
    acted: list[int] = []
    before = signal.signal(number, lambda it, _: acted.append(it))
    try:
        with signals_held_back():
            signal.raise_signal(number)
            assert acted == []
        assert acted == [number]
        signal.raise_signal(number)
        assert acted == [number, number]
    finally:
        signal.signal(number, before)


def test_in_another_thread_nothing_is_held() -> None:
    before, seen = signal.getsignal(signal.SIGINT), []

    def run() -> None:
        with signals_held_back() as let_in:
            seen.append(signal.getsignal(signal.SIGINT))
            let_in()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(20)
    assert seen == [before]

"""Ctrl-C and SIGTERM, kept waiting while a process is begun: until then nobody knows of it who could end it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def held_back() -> Iterator[Callable[[], None]]:
    """Until what it gives is called, or at the end, when they act as they did before.

    In other threads than the main one, where Python lets no signal in, nothing has to wait.
    """
    came: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, lambda it, _: came.append(it))

    def let_in() -> None:
        while before:
            signal.signal(*before.popitem())
        if came:
            signal.raise_signal(came.pop())

    try:
        yield let_in
    finally:
        let_in()

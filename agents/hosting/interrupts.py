"""SIGINT, SIGTERM and SIGHUP ask this process to end. All three have the same meaning, and one meaning at a time.

Python runs a signal's handler between any two instructions of the main thread. An exception from there tears what is just
being started, written or ended. So a program begins with `interruptible`, in which a signal raises KeyboardInterrupt.
Whoever starts or ends something enters `held_back`, in which a signal is only noted, and waits in `let_in`, in which it
acts as it did outside. A flight takes the signal by `received_by`, as a request to stop.
"""

from __future__ import annotations

import errno
import os
import signal
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTED = 130
"""The exit status of a process that was asked to end before it had anything to lose."""

SignalMeaning = Callable[[], object]

_meaning: SignalMeaning | None = None
"""None while the handlers are not ours."""
_outside: SignalMeaning | None = None
"""The meaning outside everything that holds signals back."""
_noted: list[int] = []
"""Signals that were held back and that nobody has acted upon."""


def leave_at_once() -> None:
    """Gives the signals their meaning for a program that holds nothing yet, or no more: the process ends, in silence."""
    global _meaning
    _install()
    _meaning = _leave


@contextmanager
def held_back() -> Iterator[None]:
    """Notes the signals while it is entered. After it they act as they did before; not if it is left by an exception.

    In another thread than the main one, where Python receives no signals, it does nothing.
    """
    with _meaning_is(_note):
        yield
    if _noted and _in_main_thread():
        newest = _noted[-1]
        _noted.clear()
        signal.raise_signal(newest)


@contextmanager
def interruptible() -> Iterator[None]:
    """A signal raises KeyboardInterrupt while this is entered, outside whatever holds it back.

    Only the first one does. Later ones are noted, because the exception is then on its way through code that ends things.
    """
    with received_by(_interrupt):
        yield


@contextmanager
def let_in() -> Iterator[None]:
    """Within `held_back`: lets signals act as they do outside it, and at once if one was noted before."""
    with received_by(_outside or _interrupt):
        yield


@contextmanager
def received_by(act: SignalMeaning) -> Iterator[None]:
    """Calls `act` for each signal while it is entered, and at once if one was noted before."""
    with _meaning_is(act):
        if _noted and _in_main_thread():
            _noted.clear()
            act()
        yield


@contextmanager
def _meaning_is(meaning: SignalMeaning) -> Iterator[None]:
    global _meaning, _outside
    if not _in_main_thread():
        yield
        return
    before, outside = _meaning, _outside
    handlers = _install() if before is None else {}
    if meaning is not _note:
        _outside = meaning
    # One assignment gives all signals their new meaning: a signal meets either the old one or the new one.
    _meaning = meaning
    try:
        yield
    except BaseException:
        if before is None:
            _noted.clear()
        raise
    finally:
        _meaning, _outside = before, outside
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _install() -> dict[int, Any]:
    """Returns the handlers before. An ignored SIGHUP stays ignored: nohup asks for that."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return {
        number: signal.signal(number, _receive)
        for number in ENDING
        if not (number == signal.SIGHUP and ignored)
    }


def _receive(number: int, _: object) -> None:
    if number == signal.SIGHUP:
        _discard_lost_terminal()
    if _meaning is _note:
        _noted.append(number)
    elif _meaning is not None:
        _meaning()


def _note() -> None:
    """The meaning of signals that are held back; `_receive` keeps their numbers."""


def _interrupt() -> None:
    global _meaning
    _meaning = _note
    raise KeyboardInterrupt


def _leave() -> None:
    os._exit(INTERRUPTED)


def _discard_lost_terminal() -> None:
    """Sends output to nowhere if its terminal has hung up: writing to it would fail, and end what is to end in order."""
    for descriptor in (1, 2):
        try:
            termios.tcgetattr(descriptor)
        except termios.error as error:
            if error.args[0] == errno.EIO:
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, descriptor)
                os.close(nowhere)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()

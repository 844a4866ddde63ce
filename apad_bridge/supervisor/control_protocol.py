"""The asker's side of a person's orders: a request, its answer, and the socket in the run's directory.

A command that stops an aPad imports this module and little else, because each import delays the stop.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from apad_bridge.events.person_orders import LONGEST_NAME, LONGEST_REMARK, Act
from apad_bridge.vehicle.link_errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.supervisor.amussel_orders import AMusselRequest

SOCKET_NAME = "control.sock"
LONGEST_LINE = 16_384
"""Bytes of a request or an answer."""
LATE_S = 2.0
"""Wall seconds after which a person hears that no answer has come. A supervisor acts once a second."""
PATIENCE_S = 23.0
"""Wall seconds for an answer. The supervisor itself answers sooner, so silence for longer is not the mission's."""
_AGAIN_S = 0.02
"""A client waits so long before it tries again to connect to a supervisor whose queue is full."""


@dataclass(frozen=True, slots=True)
class Request:
    act: Act
    by: str
    """The person's name."""
    text: str = ""
    """The remark."""
    off: bool = False
    """A stop switches the controllers off, wherever the aPad is."""
    stop: int | None = None
    """The number of the stop after which to continue; None: the newest. 0: none, because another party had the aPad."""
    pilot_left: bool = False
    """The person who continues says that no pilot steers any more, whatever the pilot's flag says."""
    lookout: str = ""
    """The person who watches the water on the way back inside the fence."""
    goal_m: tuple[float, float] | None = None
    """The goal (north, east) of a go-to or a hold, which need one."""
    speed_m_s: float | None = None
    """The speed of a go-to; None: the scenario's."""
    times: float | None = None
    """The speed of a simulated flight, in mission seconds a wall second. 0: time stands still; None: one more tick."""

    @property
    def mistake(self) -> str:
        """The reason why no supervisor takes it; empty for finite numbers, names, and a remark of a fair length."""
        numbers = (*(self.goal_m or ()), 0.0 if self.speed_m_s is None else self.speed_m_s)
        if not all(map(math.isfinite, numbers)):
            return "a goal and a speed are finite numbers"
        if self.times is not None and not (self.times == 0 or 0.01 <= self.times <= 1e4):
            return "a flight's speed is 0, or 0.01 to 10000 times real time"
        if len(self.text) > LONGEST_REMARK:
            return f"a remark has at most {LONGEST_REMARK} characters"
        if not 1 <= len(self.by) <= LONGEST_NAME or len(self.lookout) > LONGEST_NAME:
            return f"a name has 1 to {LONGEST_NAME} characters"
        return ""


@dataclass(frozen=True, slots=True)
class Answer:
    accepted: bool
    message: str
    """Why it was refused, or that it changed nothing; empty for an order that was carried out."""
    stop: int | None = None
    """The number of the stop that was ordered."""
    mode: str = ""
    """`hold` or `off`, of a stop."""
    state: str = ""
    """The state of a stop: `obeyed`, `at rest`, `not obeyed`, `not taken`, `refused`, or how far it came in time."""
    after_s: dict[str, float] = field(default_factory=dict)
    """Mission seconds from the order of a stop to each state that it reached."""
    steers: str = ""
    """The party that steers the aPad now, for a person."""


class NobodyListens(Exception):
    """No supervisor of the run takes orders."""


def listens(run_dir: Path) -> bool:
    """True while the run has a supervisor that takes orders."""
    try:
        with _connected(run_dir, 0.0):
            return True
    except NobodyListens:
        return False
    except BlockingIOError:  # the queue of a supervisor that is there is full
        return True


def ask(
    run_dir: Path, request: Request | AMusselRequest, is_late: Callable[[], object] = lambda: None
) -> Answer:
    """The supervisor's answer. NobodyListens without a supervisor; PeerFailed if it does not answer in time.

    Calls `is_late` once when no answer has come for `LATE_S`.
    """
    try:
        with _connected(run_dir, PATIENCE_S) as link:
            link.sendall(json.dumps(asdict(request)).encode() + b"\n")
            if not select.select([link], [], [], LATE_S)[0]:
                is_late()
            return _answer_in(link.makefile("rb").readline(LONGEST_LINE))
    except (OSError, ValueError, TypeError) as error:
        raise PeerFailed(f"the supervisor of {run_dir} does not answer: {error}") from error


def answer_of(run_dir: Path, request: Request | AMusselRequest) -> Answer:
    """Like `ask`, with a refusal in place of an error."""
    try:
        return ask(run_dir, request)
    except NobodyListens:
        return Answer(False, "no supervisor takes orders: the run has ended, or its supervisor died")
    except PeerFailed as error:
        return Answer(False, str(error))


def _answer_in(line: bytes) -> Answer:
    """ValueError or TypeError for another line than an answer's."""
    if not line:
        raise ValueError("it closed the connection")
    answer = Answer(**json.loads(line))
    if not isinstance(answer.accepted, bool):
        raise TypeError("its answer says neither yes nor no")
    return answer


@contextmanager
def _connected(run_dir: Path, timeout_s: float) -> Iterator[socket.socket]:
    """A link to the run's supervisor; NobodyListens without one, BlockingIOError when its queue is full for so long."""
    until_s = time.monotonic() + timeout_s
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(timeout_s)
        try:
            with short_path(run_dir) as path:
                while True:
                    try:
                        link.connect(path)
                        break
                    except BlockingIOError:  # a Unix socket does not wait for a place in the queue
                        if time.monotonic() >= until_s:
                            raise
                        time.sleep(_AGAIN_S)
        except (FileNotFoundError, ConnectionRefusedError) as error:
            raise NobodyListens(str(run_dir)) from error
        yield link


@contextmanager
def short_path(run_dir: Path) -> Iterator[str]:
    """A path within a Unix socket's 107 bytes; a run directory's may be longer."""
    directory = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{directory}/{SOCKET_NAME}"
    finally:
        os.close(directory)

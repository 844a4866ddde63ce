"""The processes that serve people or programs beside a run: a console, an IMC gateway, a server for Foxglove, and the
run's own ROS master.

They are watched for as long as the run flies. The death of a command is told on the terminal and in the journal, and
another is started. One that dies again and again is left, which is told too. A master alone knows who takes part in its
graph, so no other can take its place: a run ends with its master, and one that stands still is told, with its end.
"""

from __future__ import annotations

import queue
import signal
import threading
import time
import xmlrpc.client
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from http.client import HTTPException
from pathlib import Path

from agents.hosting.link_protocol import readable
from apad_bridge.doctor.network import Timed
from apad_bridge.events.person_orders import Act
from apad_bridge.runs.children import Child
from apad_bridge.scenario.errors import UserError
from apad_bridge.supervisor.control_protocol import Request, answer_of, listens

_STARTS_S = 60.0
"""Wall seconds: on a busy machine the imports alone take some."""
_END_S = 5.0
_LOOK_S = 0.5
_MOST_DEATHS = 5
_WITHIN_S = 60.0
"""With more deaths within this time the command is not started again."""
_AGAIN_S = 0.5
"""The time before a start that follows a death; twice as long after each further one."""
_BY = "musselbed"
_MASTER_LOOK_S = 2.0
_MASTER_STILL_S = 15.0
"""A busy machine may take seconds for an answer of the master's."""


@dataclass(frozen=True, slots=True)
class ServiceCommand:
    """A command of ours that serves a run."""

    name: str
    directory: Path
    arguments: list[str]
    """The arguments of `musselbed`."""
    environment: dict[str, str] = field(default_factory=dict)

    def start(self) -> tuple[Child, str]:
        """Starts it and returns its first line. UserError when it does not come up."""
        child = Child(
            self.name,
            "apad_bridge.commands.main",
            self.arguments,
            self.directory / f"{self.name}.log",
            self.environment,
        )
        line = child.lines.readline() if readable(child.lines.fileno(), _STARTS_S) else ""
        if not line:
            child.end(_END_S)
            raise UserError(f"{self.name} does not start: {child.last_log_line()}")
        return child, line


@dataclass(frozen=True, slots=True)
class Service:
    """A command of ours that a run has beside it, with what differs between such commands."""

    name: str
    arguments: tuple[str, ...]
    """The arguments of `musselbed NAME RUN`."""
    patience_s: float
    """Wall seconds: for so long it may say, at the end of the run, that it has seen it."""
    again: Callable[[str], tuple[tuple[str, ...], dict[str, str]]] | None = None
    """Makes, from the first one's line, the further arguments and the environment of a start that follows a death, so that
    it serves at the same address; None where each start is the same."""
    address: Callable[[str], str] = str.rstrip
    """The words for people in its first line."""
    title: str = ""
    """The words before them."""
    serves_several: bool = False
    """It serves a run of several aPads as a whole."""

    @contextmanager
    def beside(self, directory: Path, tell: Callable[[str], None] = print) -> Iterator[str]:
        """Has it serve the run, in a process of its own, while this is entered; yields its address.

        `tell` takes the lines about its deaths. UserError when it cannot start.
        """
        if not directory.is_dir():
            raise UserError(f"{directory} is no run: it does not exist")
        first = ServiceCommand(self.name, directory, [self.name, str(directory), *self.arguments])
        child, line = first.start()
        further, environment = ((), {}) if self.again is None else self.again(line)
        watch = _Watch(
            child, replace(first, arguments=[*first.arguments, *further], environment=environment), tell
        )
        try:
            yield self.address(line)
        finally:
            watch.end(self.patience_s)


class _Notes:
    """Tells lines on the terminal at once, and has the supervisor of the run journal them once it takes orders."""

    def __init__(self, directory: Path, tell: Callable[[str], None]) -> None:
        self._directory = directory
        self._report = tell
        self._unwritten: deque[str] = deque()

    @property
    def are_written(self) -> bool:
        return not self._unwritten

    def note(self, text: str) -> None:
        self._report(text)
        self._unwritten.append(text)

    def write(self) -> None:
        while self._unwritten and listens(self._directory):
            if not answer_of(self._directory, Request(Act.REMARK, _BY, self._unwritten[0])).accepted:
                return
            self._unwritten.popleft()


@contextmanager
def watched_master(
    uri: str,
    directory: Path,
    tell: Callable[[str], None],
    period_s: float = _MASTER_LOOK_S,
    still_s: float = _MASTER_STILL_S,
) -> Iterator[None]:
    """While entered, tells that the run's own master stands still, and that it answers again.

    A master that has ended is none of this: the run ends with it, and names it. One question waits for its answer however
    long that takes. Each further one would wait in the master's queue, which is short, and keep nodes from it.
    """
    notes, came = _Notes(directory, tell), queue.SimpleQueue[_Came]()

    def watch() -> None:
        while _next(came, period_s) is None:
            notes.write()
            threading.Thread(target=_ask, args=(uri, came), daemon=True).start()
            found, is_reported = _next(came, still_s), False
            while found is None:
                if not is_reported:
                    notes.note(
                        "the run's own ROS master stands still, so no ROS tool finds the run: "
                        f"{uri} has not answered for {still_s:g} s"
                    )
                is_reported = True
                notes.write()
                found = _next(came, period_s)
            if found is _Came.END:
                return
            if is_reported and found is _Came.ANSWER:
                notes.note("the run's own ROS master answers again")

    watching = threading.Thread(target=watch, name="watch of the run's own master", daemon=True)
    watching.start()
    try:
        yield
    finally:
        came.put(_Came.END)
        watching.join(_END_S)


class _Came(Enum):
    ANSWER = auto()
    NO_MASTER = auto()
    END = auto()


def _next(came: queue.SimpleQueue[_Came], timeout_s: float) -> _Came | None:
    with suppress(queue.Empty):
        return came.get(timeout=timeout_s)
    return None


def _ask(uri: str, came: queue.SimpleQueue[_Came]) -> None:
    try:
        with xmlrpc.client.ServerProxy(uri, transport=Timed(None)) as master:
            master.getPid("/musselbed")
    except (OSError, HTTPException, xmlrpc.client.Error):
        came.put(_Came.NO_MASTER)
    else:
        came.put(_Came.ANSWER)


class _Watch:
    """Watches one command in a thread of its own, which is also the one that starts it again."""

    def __init__(self, child: Child, command: ServiceCommand, tell: Callable[[str], None]) -> None:
        self._child = child
        self._command = command
        self._notes = _Notes(command.directory, tell)
        self._deaths_s: deque[float] = deque()
        self._is_ending = threading.Event()
        self._spoke = threading.Event()
        """Set when the command has said something after its first line: that the run has ended."""
        self._thread = threading.Thread(target=self._watch, name=f"watch of the {command.name}", daemon=True)
        self._thread.start()

    def end(self, patience_s: float) -> None:
        """Ends the command, which may say its last line before."""
        if self._thread.is_alive():
            self._spoke.wait(patience_s)
        self._is_ending.set()
        self._child.ask_to_end()
        self._thread.join(patience_s)
        self._child.end(patience_s)
        self._thread.join(patience_s)

    def _watch(self) -> None:
        while self._follow():
            self._child.end(_END_S)
            if not self._start_again():
                break
        self._spoke.set()
        while not self._notes.are_written and not self._is_ending.wait(_LOOK_S):
            self._notes.write()

    def _follow(self) -> bool:
        """Returns when the command has ended: True for a death, False for an end in order."""
        while True:
            self._notes.write()
            if not readable(self._child.lines.fileno(), _LOOK_S):
                continue
            if self._child.lines.readline():
                self._spoke.set()
                continue
            code = self._child.wait(_END_S)
            if self._is_ending.is_set() or code == 0:
                return False
            how = self._child.last_log_line() if code is None or code > 0 else signal.Signals(-code).name
            self._notes.note(f"the {self._command.name} died ({how})")
            return True

    def _start_again(self) -> bool:
        """False when the run is ending, and when there were too many deaths."""
        while True:
            self._deaths_s.append(time.monotonic())
            while self._deaths_s[0] < time.monotonic() - _WITHIN_S:
                self._deaths_s.popleft()
            if len(self._deaths_s) > _MOST_DEATHS:
                self._notes.note(
                    f"the {self._command.name} died {len(self._deaths_s)} times within {_WITHIN_S:g} s and is not started "
                    f"again: see {self._child.log}; musselbed stop {self._command.directory} orders a stop without it"
                )
                return False
            if self._is_ending.wait(_AGAIN_S * 2 ** (len(self._deaths_s) - 1)):
                return False
            try:
                self._child, _ = self._command.start()
            except UserError as error:
                self._notes.note(str(error))
                continue
            if self._is_ending.is_set():
                self._child.end(_END_S)
                return False
            self._notes.note(f"the {self._command.name} was started again")
            return True

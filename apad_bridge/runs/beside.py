"""Commands of ours that serve people or programs beside a run, each in a process of its own: a console, an IMC gateway and
a server for Foxglove.

They are watched for as long as the run flies. The death of one is told on the terminal and in the journal, and another is
started. One that dies again and again is left, which is told too.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from agents.hosting.link_protocol import readable
from apad_bridge.runs.children import Child
from apad_bridge.runs.exits import UserError
from apad_bridge.supervisor.control import Act, Request, answer_of, listens

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


@dataclass(frozen=True, slots=True)
class Command:
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
        first = Command(self.name, directory, [self.name, str(directory), *self.arguments])
        child, line = first.start()
        further, environment = ((), {}) if self.again is None else self.again(line)
        watch = _Watch(
            child, replace(first, arguments=[*first.arguments, *further], environment=environment), tell
        )
        try:
            yield self.address(line)
        finally:
            watch.end(self.patience_s)


class _Watch:
    """Watches one command in a thread of its own, which is also the one that starts it again."""

    def __init__(self, child: Child, command: Command, tell: Callable[[str], None]) -> None:
        self._child = child
        self._command = command
        self._tell = tell
        self._unwritten: deque[str] = deque()
        """The lines that the run's journal lacks, because no supervisor listens yet."""
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
        while self._unwritten and not self._is_ending.wait(_LOOK_S):
            self._write()

    def _follow(self) -> bool:
        """Returns when the command has ended: True for a death, False for an end in order."""
        while True:
            self._write()
            if not readable(self._child.lines.fileno(), _LOOK_S):
                continue
            if self._child.lines.readline():
                self._spoke.set()
                continue
            code = self._child.wait(_END_S)
            if self._is_ending.is_set() or code == 0:
                return False
            how = self._child.last_log_line() if code is None or code > 0 else signal.Signals(-code).name
            self._note(f"the {self._command.name} died ({how})")
            return True

    def _start_again(self) -> bool:
        """False when the run is ending, and when there were too many deaths."""
        while True:
            self._deaths_s.append(time.monotonic())
            while self._deaths_s[0] < time.monotonic() - _WITHIN_S:
                self._deaths_s.popleft()
            if len(self._deaths_s) > _MOST_DEATHS:
                self._note(
                    f"the {self._command.name} died {len(self._deaths_s)} times within {_WITHIN_S:g} s and is not started "
                    f"again: see {self._child.log}; musselbed stop {self._command.directory} orders a stop without it"
                )
                return False
            if self._is_ending.wait(_AGAIN_S * 2 ** (len(self._deaths_s) - 1)):
                return False
            try:
                self._child, _ = self._command.start()
            except UserError as error:
                self._note(str(error))
                continue
            if self._is_ending.is_set():
                self._child.end(_END_S)
                return False
            self._note(f"the {self._command.name} was started again")
            return True

    def _note(self, text: str) -> None:
        self._tell(text)
        self._unwritten.append(text)

    def _write(self) -> None:
        """Has the supervisor write the lines into the journal, once it takes orders."""
        while self._unwritten and listens(self._command.directory):
            if not answer_of(self._command.directory, Request(Act.REMARK, _BY, self._unwritten[0])).accepted:
                return
            self._unwritten.popleft()

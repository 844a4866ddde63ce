"""A supervisor's end of the control link: asks the nursery, and keeps what it says by itself. Every wait has a time-out."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeVar

from agents.hosting.link_protocol import LinkError, readable
from agents.nursery import protocol

_Wanted = TypeVar("_Wanted")

ANSWER_TIMEOUT_S = 10.0
"""A nursery that does not answer for so long counts as dead. Each agent that it starts makes this longer."""
SECONDS_PER_START = 0.05


class Fenced(RuntimeError):
    """A newer supervisor has this fleet: this one must not move it any more."""


class NurseryDied(RuntimeError):
    """The control link ended, or the nursery does not answer."""


@dataclass(frozen=True, slots=True)
class Enrolled:
    """An agent as the nursery has it: pid and link of a living one, and its newest slot."""

    agent_id: int
    pid: int
    link: int | None
    epoch: int
    sequence: int
    granted_ms: int


@dataclass(slots=True)
class Starting:
    """The outcome of a Start: (pid, link) of the agents that live, and why the others do not."""

    living: dict[int, tuple[int, int]] = field(default_factory=dict)
    refused: dict[int, str] = field(default_factory=dict)


class NurseryLink:
    """Connected and greeted, or an exception: Fenced, OSError when there is no nursery, NurseryDied."""

    def __init__(self, run_dir: str, epoch: int) -> None:
        self._sock = protocol.connect(run_dir, ANSWER_TIMEOUT_S)
        self._request = 0
        self._fenced: str | None = None
        self.pid = 0
        self.dropped: Counter[str] = Counter()
        self._died: dict[int, str] = {}
        """Why processes ended, by pid."""
        try:
            self._tell(protocol.Hello(epoch))
            welcome, (truth,) = self._hear(protocol.Welcome, ANSWER_TIMEOUT_S)
            self.truth = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, 0, truth)
            # A library in this process may have set a default time-out, as rospy does (60 s): a read that shall not wait
            # would then wait for so long.
            self.truth.setblocking(False)
            self.pid = welcome.pid
            self._process = os.pidfd_open(self.pid)
            self.roll: list[Enrolled] = []
            for _ in range(welcome.rolls):
                roll, links = self._hear(protocol.ChildList, ANSWER_TIMEOUT_S)
                handed = iter(links)
                self.roll += [
                    Enrolled(row[0], row[1], next(handed) if row[1] else None, *row[2:]) for row in roll.rows
                ]
        except BaseException:
            self._sock.close()
            raise

    def fileno(self) -> int:
        return self._sock.fileno()

    def pump(self) -> None:
        """Takes what the nursery has said by itself. Raises Fenced or NurseryDied."""
        while readable(self._sock, 0):
            self._keep(self._receive())

    def start(self, rows: list[tuple[int, ...]]) -> Starting:
        """Rows as of `protocol.Start`."""
        outcome = Starting()
        for start in range(0, len(rows), protocol.DESCRIPTORS_AT_ONCE):
            self._start(tuple(rows[start : start + protocol.DESCRIPTORS_AT_ONCE]), outcome)
        return outcome

    def _start(self, rows: tuple[tuple[int, ...], ...], outcome: Starting) -> None:
        self._request += 1
        self._tell(protocol.Start(self._request, rows))
        asked = [row[0] for row in rows]
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S + SECONDS_PER_START * len(rows)
        answered = 0
        while answered < len(asked):
            message, links = self._receive(deadline_s - time.monotonic())
            match message:
                case protocol.Started(self._request, started):
                    for (agent_id, pid), link in zip(started, links, strict=True):
                        outcome.living[agent_id] = (pid, link)
                    answered += len(started)
                case protocol.Refused(self._request, agent_id, False, reason):
                    outcome.refused[agent_id] = reason
                    answered += 1
                case _:
                    self._keep((message, links))

    def kill(self, agent_id: int) -> None:
        """Returns when that agent's process is gone."""
        self._request += 1
        self._tell(protocol.Kill(self._request, agent_id))
        self._hear(protocol.Killed, ANSWER_TIMEOUT_S)

    def why(self, pid: int, timeout_s: float) -> str:
        """Why a process ended, which the nursery says as soon as it has reaped it."""
        deadline_s = time.monotonic() + timeout_s
        while pid not in self._died:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return "its link ended"
            if readable(self._sock, left_s):
                self._keep(self._receive())
        return self._died.pop(pid)

    def end(self, timeout_s: float) -> None:
        """Ends the fleet and the nursery; one that does not within `timeout_s` is killed, and its agents with it.

        Raises Fenced, and ends nothing, when they are another supervisor's.
        """
        with suppress(NurseryDied):
            self._tell(protocol.End())
        if not readable(self._process, timeout_s):
            signal.pidfd_send_signal(self._process, signal.SIGKILL)
            readable(self._process, timeout_s)

    def close(self) -> None:
        self._sock.close()
        self.truth.close()
        os.close(self._process)

    def _tell(self, message: protocol.Message) -> None:
        if self._fenced is not None:
            raise Fenced(self._fenced)
        try:
            protocol.send(self._sock, message)
        except OSError as error:
            # A supervisor that was fenced off has a word to read that says so.
            self.pump()
            raise NurseryDied(f"the nursery's link ended: {error}") from None

    def _hear(self, kind: type[_Wanted], timeout_s: float) -> tuple[_Wanted, list[int]]:
        deadline_s = time.monotonic() + timeout_s
        while True:
            message, links = self._receive(deadline_s - time.monotonic())
            if isinstance(message, kind):
                return message, links
            self._keep((message, links))

    def _receive(self, timeout_s: float = ANSWER_TIMEOUT_S) -> tuple[protocol.Message, list[int]]:
        deadline_s = time.monotonic() + timeout_s
        while True:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not readable(self._sock, left_s):
                raise NurseryDied(f"the nursery (process {self.pid}) did not answer within {timeout_s:.0f} s")
            try:
                heard = protocol.receive(self._sock)
            except LinkError as error:
                self.dropped[f"control: {error}"] += 1
                continue
            except OSError:
                heard = None
            if heard is None:
                raise NurseryDied("the nursery's link ended")
            return heard

    def _keep(self, heard: tuple[protocol.Message, list[int]]) -> None:
        message, links = heard
        for link in links:
            os.close(link)
        match message:
            case protocol.Died(_, pid, reason):
                self._died[pid] = reason
            case protocol.Refused(_, _, True, reason):
                self._fenced = reason
                raise Fenced(reason)
            case protocol.Refused(_, _, False, reason):
                self.dropped[f"nursery: {reason}"] += 1
            case _:
                self.dropped[f"control: an unexpected {type(message).__name__}"] += 1

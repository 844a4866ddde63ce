"""A supervisor's end of the control link: sends requests and keeps the nursery's own reports. All waits have time-outs."""

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

_Awaited = TypeVar("_Awaited")

ANSWER_TIMEOUT_S = 10.0
"""A nursery that does not answer for so long counts as dead. Each agent that it starts adds to this time."""
SECONDS_PER_START = 0.05


class Fenced(RuntimeError):
    """A newer supervisor has taken over this fleet; this one must not move it any more."""


class NurseryDied(RuntimeError):
    """The control link ended, or the nursery does not answer."""


@dataclass(frozen=True, slots=True)
class ChildEntry:
    """The nursery's entry of an agent: its newest record, and the pid and link of a living agent."""

    agent_id: int
    pid: int
    link: int | None
    epoch: int
    sequence: int
    granted_ms: int


@dataclass(slots=True)
class StartOutcome:
    """The outcome of a Start: (pid, link) of the agents that live, and the reasons why the others do not."""

    living: dict[int, tuple[int, int]] = field(default_factory=dict)
    refused: dict[int, str] = field(default_factory=dict)


class NurseryLink:
    """Connects and greets, or raises Fenced, NurseryDied, or OSError if there is no nursery."""

    def __init__(self, run_dir: str, epoch: int) -> None:
        self._sock = protocol.connect(run_dir, ANSWER_TIMEOUT_S)
        self.epoch = epoch
        self._request = 0
        self._fenced: str | None = None
        self.pid = 0
        self.dropped: Counter[str] = Counter()
        self._died: dict[int, str] = {}
        """The reason why each process ended, by pid."""
        try:
            self._send(protocol.Hello(epoch))
            welcome, (truth,) = self._wait_for(protocol.Welcome, ANSWER_TIMEOUT_S)
            self.truth = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, 0, truth)
            # A library in this process may have set a default time-out, as rospy does (60 s): a read that must not wait
            # would then wait for that time.
            self.truth.setblocking(False)
            self.pid = welcome.pid
            self._process = os.pidfd_open(self.pid)
            self.entries: list[ChildEntry] = []
            for _ in range(welcome.rolls):
                children, links = self._wait_for(protocol.ChildList, ANSWER_TIMEOUT_S)
                next_links = iter(links)
                self.entries += [
                    ChildEntry(row[0], row[1], next(next_links) if row[1] else None, *row[2:])
                    for row in children.rows
                ]
        except BaseException:
            self._sock.close()
            raise

    def fileno(self) -> int:
        return self._sock.fileno()

    def pump(self) -> None:
        """Takes the nursery's own reports. Raises Fenced or NurseryDied."""
        while readable(self._sock, 0):
            self._keep(self._receive())

    def start(self, rows: list[tuple[int, ...]]) -> StartOutcome:
        """Starts agents, with rows as in `protocol.Start`."""
        outcome = StartOutcome()
        for start in range(0, len(rows), protocol.DESCRIPTORS_AT_ONCE):
            self._start(tuple(rows[start : start + protocol.DESCRIPTORS_AT_ONCE]), outcome)
        return outcome

    def _start(self, rows: tuple[tuple[int, ...], ...], outcome: StartOutcome) -> None:
        self._request += 1
        self._send(protocol.StartAgents(self._request, rows))
        agent_ids = [row[0] for row in rows]
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S + SECONDS_PER_START * len(rows)
        answered = 0
        while answered < len(agent_ids):
            message, links = self._receive(deadline_s - time.monotonic())
            match message:
                case protocol.Started(self._request, started):
                    for (agent_id, pid), link in zip(started, links, strict=True):
                        outcome.living[agent_id] = (pid, link)
                    answered += len(started)
                case protocol.StartRefused(self._request, agent_id, False, reason):
                    outcome.refused[agent_id] = reason
                    answered += 1
                case _:
                    self._keep((message, links))

    def kill(self, agent_id: int) -> None:
        """Kills an agent and returns when its process has ended."""
        self._request += 1
        self._send(protocol.Kill(self._request, agent_id))
        self._wait_for(protocol.Killed, ANSWER_TIMEOUT_S)

    def why(self, pid: int, timeout_s: float) -> str:
        """The reason why a process ended; the nursery reports it as soon as it has reaped the process."""
        deadline_s = time.monotonic() + timeout_s
        while pid not in self._died:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return "its link ended"
            if readable(self._sock, left_s):
                self._keep(self._receive())
        return self._died.pop(pid)

    def end(self, timeout_s: float) -> None:
        """Ends the fleet and the nursery. Kills a nursery that lives on after `timeout_s`, and its agents with it.

        Raises Fenced, and ends nothing, if they belong to another supervisor.
        """
        with suppress(NurseryDied):
            self._send(protocol.End())
        if not readable(self._process, timeout_s):
            signal.pidfd_send_signal(self._process, signal.SIGKILL)
            readable(self._process, timeout_s)

    def close(self) -> None:
        self._sock.close()
        self.truth.close()
        os.close(self._process)

    def _send(self, message: protocol.NurseryMessage) -> None:
        if self._fenced is not None:
            raise Fenced(self._fenced)
        try:
            protocol.send(self._sock, message)
        except OSError as error:
            # A supervisor that was fenced off has a message to read that says so.
            self.pump()
            raise NurseryDied(f"the nursery's link ended: {error}") from None

    def _wait_for(self, kind: type[_Awaited], timeout_s: float) -> tuple[_Awaited, list[int]]:
        deadline_s = time.monotonic() + timeout_s
        while True:
            message, links = self._receive(deadline_s - time.monotonic())
            if isinstance(message, kind):
                return message, links
            self._keep((message, links))

    def _receive(self, timeout_s: float = ANSWER_TIMEOUT_S) -> tuple[protocol.NurseryMessage, list[int]]:
        deadline_s = time.monotonic() + timeout_s
        while True:
            if (left_s := deadline_s - time.monotonic()) <= 0 or not readable(self._sock, left_s):
                raise NurseryDied(f"the nursery (process {self.pid}) did not answer within {timeout_s:.0f} s")
            try:
                received = protocol.receive(self._sock)
            except LinkError as error:
                self.dropped[f"control: {error}"] += 1
                continue
            except OSError:
                received = None
            if received is None:
                raise NurseryDied("the nursery's link ended")
            return received

    def _keep(self, received: tuple[protocol.NurseryMessage, list[int]]) -> None:
        message, links = received
        for link in links:
            os.close(link)
        match message:
            case protocol.Died(_, pid, reason):
                self._died[pid] = reason
            case protocol.StartRefused(_, _, True, reason):
                self._fenced = reason
                raise Fenced(reason)
            case protocol.StartRefused(0, _, False, reason):
                self.dropped[f"nursery: {reason}"] += 1
            case protocol.StartRefused():
                self.dropped["nursery: it refused a start that nobody waits for"] += 1
            case _:
                self.dropped[f"control: an unexpected {type(message).__name__}"] += 1

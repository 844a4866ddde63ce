"""The nursery's one loop: it receives requests, answers them, and reports deaths."""

from __future__ import annotations

import os
import select
import socket
import sys
import time
from contextlib import suppress

from agents.hosting.link_protocol import LinkError
from agents.nursery import protocol
from agents.nursery.agent_processes import AgentProcesses, Boot, NotStarted
from agents.nursery.fleet_file import FleetFile
from firmware_model.stimuli import ResetCause

_SEND_TIMEOUT_S = 5.0
"""A supervisor that reads nothing for so long has left."""
_NEWCOMERS = 8
"""The most connections without a Hello; the nursery closes a further one at once."""


class NurseryServer:
    """Manages the agents for one supervisor at a time. `wakeup` is readable after a signal."""

    def __init__(self, run_dir: str, file: FleetFile, agents: AgentProcesses, wakeup: socket.socket) -> None:
        self._agents = agents
        self._orphan_s = file.restart_policy.orphan_s
        self._epoch = max((row[2] for row in agents.rows()), default=0)
        self._greeted = False
        self._listener = protocol.listen(run_dir)
        self._wakeup = wakeup
        self._newcomers: dict[int, socket.socket] = {}
        self._supervisor: socket.socket | None = None
        self._left_at_s = time.monotonic()
        self._ending = False

    def run(self) -> None:
        """Runs until it is told to end, or until the fleet was an orphan for the policy's time."""
        while not self._ending:
            readers = [self._listener, self._wakeup, *self._newcomers.values()]
            timeout_s = None
            if self._supervisor is not None:
                readers.append(self._supervisor)
            else:
                timeout_s = self._left_at_s + self._orphan_s - time.monotonic()
                if timeout_s <= 0:
                    _log(f"no supervisor for {self._orphan_s:g} s: the fleet ends")
                    break
            poll = select.poll()
            for reader in readers:
                poll.register(reader, select.POLLIN)
            ready = {
                descriptor for descriptor, _ in poll.poll(None if timeout_s is None else timeout_s * 1000 + 1)
            }
            self._reap(self._wakeup.fileno() in ready)
            for reader in readers[2:]:
                if reader.fileno() in ready:
                    self._receive(reader)
            if self._listener.fileno() in ready:
                self._accept()
        self._agents.end()
        self._send_to_supervisor(protocol.NurseryEnded())

    def end(self) -> None:
        self._ending = True

    def _accept(self) -> None:
        newcomer, _ = self._listener.accept()
        newcomer.settimeout(_SEND_TIMEOUT_S)
        if not protocol.is_of_our_user(newcomer):
            _log("a process of another user was refused")
            newcomer.close()
        elif len(self._newcomers) < _NEWCOMERS:
            self._newcomers[newcomer.fileno()] = newcomer
        else:
            newcomer.close()

    def _receive(self, sock: socket.socket) -> None:
        try:
            received = protocol.receive(sock)
        except LinkError as error:
            _log(f"a message was dropped: {error}")
            self._send(sock, protocol.StartRefused(0, 0, False, f"dropped: {error}"))
            return
        except OSError:
            received = None
        if received is None:
            self._leave(sock)
            return
        message, descriptors = received
        for descriptor in descriptors:
            os.close(descriptor)
        if isinstance(message, protocol.Hello):
            self._greet(sock, message.epoch)
        elif sock is not self._supervisor:
            self._send(sock, protocol.StartRefused(0, 0, False, "say Hello first"))
        else:
            self._handle(message)

    def _greet(self, sock: socket.socket, epoch: int) -> None:
        if epoch < self._epoch or (epoch == self._epoch and self._greeted):
            reason = f"fenced off: epoch {self._epoch} is taken; a new supervisor comes with a higher one, not {epoch}"
            self._send(sock, protocol.StartRefused(0, 0, True, reason))
            return
        if self._supervisor is not None and self._supervisor is not sock:
            self._send(
                self._supervisor,
                protocol.StartRefused(0, 0, True, f"fenced off: epoch {epoch} has taken over"),
            )
            if self._supervisor is not None:
                self._leave(self._supervisor)
        self._newcomers.pop(sock.fileno(), None)
        self._epoch, self._greeted, self._supervisor = epoch, True, sock
        rows = self._agents.rows()
        chunks = [
            tuple(rows[start : start + protocol.DESCRIPTORS_AT_ONCE])
            for start in range(0, len(rows), protocol.DESCRIPTORS_AT_ONCE)
        ]
        if not self._send(sock, protocol.Welcome(os.getpid(), len(chunks)), [self._agents.truth.fileno()]):
            return
        for chunk in chunks:
            living = [self._agents.children[row[0]].link for row in chunk if row[1]]
            if not self._send(sock, protocol.ChildList(chunk), living):
                return

    def _handle(self, message: protocol.NurseryMessage) -> None:
        match message:
            case protocol.StartAgents(request, rows):
                self._start(request, rows)
            case protocol.Kill(request, agent_id):
                if agent_id in self._agents.children:
                    self._agents.kill(agent_id)
                # An agent that ended by itself a moment ago fulfils the request, too.
                self._send_to_supervisor(protocol.Killed(request, agent_id))
            case protocol.End():
                self._ending = True
            case _:
                self._send_to_supervisor(protocol.StartRefused(0, 0, False, "not a supervisor's message"))

    def _start(self, request: int, rows: tuple[tuple[int, ...], ...]) -> None:
        try:
            boots = [Boot(row[0], row[1], ResetCause(row[2]), (row[3], row[4])) for row in rows]
        except ValueError as error:
            self._send_to_supervisor(protocol.StartRefused(request, 0, False, str(error)))
            return
        started: list[tuple[int, int]] = []
        links: list[int] = []
        for boot, outcome in zip(boots, self._agents.start(boots), strict=True):
            if isinstance(outcome, NotStarted):
                self._send_to_supervisor(protocol.StartRefused(request, boot.agent_id, False, str(outcome)))
            else:
                started.append((boot.agent_id, outcome.pid))
                links.append(outcome.link)
        for start in range(0, len(started), protocol.DESCRIPTORS_AT_ONCE):
            part = slice(start, start + protocol.DESCRIPTORS_AT_ONCE)
            self._send_to_supervisor(protocol.Started(request, tuple(started[part])), links[part])

    def _reap(self, signalled: bool) -> None:
        if signalled:
            self._wakeup.recv(4096)
        for died in self._agents.reap():
            _log(f"aMussel {died.agent_id} (process {died.pid}) {died.reason}")
            self._send_to_supervisor(died)

    def _send_to_supervisor(self, message: protocol.NurseryMessage, links: list[int] | None = None) -> None:
        if self._supervisor is not None:
            self._send(self._supervisor, message, links or [])

    def _send(
        self, sock: socket.socket, message: protocol.NurseryMessage, links: list[int] | None = None
    ) -> bool:
        try:
            protocol.send(sock, message, links or [])
        except OSError:
            self._leave(sock)
            return False
        return True

    def _leave(self, sock: socket.socket) -> None:
        if sock is self._supervisor:
            self._supervisor = None
            self._left_at_s = time.monotonic()
        self._newcomers.pop(sock.fileno(), None)
        sock.close()


def _log(line: str) -> None:
    with suppress(OSError):  # a full disk is no reason to end
        print(f"nursery: {line}", file=sys.stderr, flush=True)

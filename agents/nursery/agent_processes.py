"""Forks the nursery's agents, keeps their links, reaps them, and lets one that dies at once, again and again, stay dead."""

from __future__ import annotations

import ctypes
import fcntl
import gc
import os
import resource
import signal
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from agents.hosting.agent_loop import WindowHandler, message_buffer
from agents.hosting.link_protocol import Key, readable
from agents.mussel.agent import Agent
from agents.mussel.physical import Physical
from agents.nursery.flash_file import FLASH_NAME, FlashRegion
from agents.nursery.fleet_file import PHYSICAL_NAME, FleetFile
from agents.nursery.forked_agent import FIRMWARE_FAILED, FIRMWARE_HUNG, FIRMWARE_SPUN, live
from agents.nursery.protocol import WATCHDOG_FIRED, Died
from agents.nursery.state_file import RECORD_BYTES, RING_BYTES, RecordRing, StateRecord
from agents.nursery.warm_up import warm_up, warm_up_port
from firmware_model.packets.codec import load_codec
from firmware_model.stimuli import ResetCause

# Reduces the memory that forked agents copy, and lets the kernel share equal pages.
_MERGEABLE = 12
"""MADV_MERGEABLE of madvise(2)."""
_LIBC = ctypes.CDLL(None)


def return_freed_memory() -> None:
    """Returns malloc's free pages to the system. A forked process would copy those that it touches."""
    _LIBC.malloc_trim(0)


def offer_for_merging() -> None:
    """Lets the kernel keep equal pages once, those of this process and of its children.

    Most of the pages that an agent copies equal another agent's, because reference counts rose and fell alike. A kernel
    without merging, or with merging switched off, ignores the call.
    """
    with open("/proc/self/maps") as maps:
        spans = [line.split()[0].split("-") for line in maps if " rw-p " in line and "[stack]" not in line]
    for begin, end in spans:
        _LIBC.madvise(
            ctypes.c_void_p(int(begin, 16)), ctypes.c_size_t(int(end, 16) - int(begin, 16)), _MERGEABLE
        )


_TRUTH_ROOM_BYTES = 4 * 2**20
_LOCK_TIMEOUT_S = 2.0
_ENDS_WITH_AGENT_S = 0.2
"""The wall time in which the kernel ends firmware after its agent."""
_STRAYS_S = 1.0


@dataclass(slots=True)
class LivingAgent:
    """A living agent: its process, and the supervisor's end of its link."""

    pid: int
    link: int


@dataclass(frozen=True, slots=True)
class Boot:
    """An agent to boot at agent time `at_ms` as it was at the end of window `up_to`."""

    agent_id: int
    at_ms: int
    cause: ResetCause
    up_to: Key


@dataclass(frozen=True, slots=True)
class PendingFork:
    """Everything prepared for a fork. `place` is its index in the request."""

    place: int
    agent_id: int
    name: bytes
    handler: WindowHandler
    supervisor_end: int
    """The supervisor's end of the link."""
    agent_end: int


class NotStarted(ValueError):
    """An agent was not started, for this reason."""


class AgentProcesses:
    """All agents of one fleet file. Its process forks, and so must have no threads and little memory."""

    def __init__(self, run_dir: str, file: FleetFile) -> None:
        """ValueError if another nursery, or an agent of one, locks the physical file, or another version wrote it."""
        self._records_fd = os.open(os.path.join(run_dir, PHYSICAL_NAME), os.O_RDWR | os.O_CREAT, 0o600)
        _lock(self._records_fd)
        self._flash_fd = os.open(os.path.join(run_dir, FLASH_NAME), os.O_RDWR | os.O_CREAT, 0o600)
        # These descriptors lie below those of all links, so that a child closes its siblings' links in one call.
        truth_fd = os.open(os.devnull, os.O_RDONLY)
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        """A placeholder: in a child, the child's link takes its descriptor."""
        self.truth, agents_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with agents_end:
            os.dup2(agents_end.fileno(), truth_fd, inheritable=False)
        self._truth_out = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, 0, truth_fd)
        self._truth_out.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _TRUTH_ROOM_BYTES)
        self._buffer = message_buffer()
        self._descriptors = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        self._restart_policy = file.restart_policy
        self._codec = load_codec(file.fleet.codec)
        self._configs = file.fleet.maker()
        self._has_programs = bool(file.fleet.firmware)
        self._flash_pages = file.fleet.flash_pages
        self._index = {agent_id: index for index, agent_id in enumerate(sorted(file.initial_states))}
        self._restarts_in_a_row: dict[int, int] = {}
        self._settles_ms: dict[int, int] = {}
        """The agent time at which an agent's newest life has settled."""
        self.children: dict[int, LivingAgent] = {}
        self._id_of_pid: dict[int, int] = {}
        self._hung: set[int] = set()
        """The agents whose firmware did not end its turn: it would hang again, and hold up the fleet."""
        self._have_room(file.initial_states)

    def _have_room(self, initial_states: Mapping[int, Physical]) -> None:
        """Gives each agent its room and its first record, in a new file. ValueError for a file with other rooms."""
        size, whole = os.fstat(self._records_fd).st_size, RING_BYTES * len(self._index)
        if size == whole:
            return
        # First records are written in order before the file has its size, so such a file has never been used.
        if size > whole or (size and not 0 < size % RING_BYTES < RECORD_BYTES):
            raise ValueError(
                f"{PHYSICAL_NAME} has {size} bytes instead of {whole}: another version of musselbed wrote it; continue the "
                "run with that version"
            )
        for agent_id in self._index:
            self._ring(agent_id).initial_state(initial_states[agent_id])
        # An agent's state has its room from the start, so that a disk that fills up later ends no agent.
        os.posix_fallocate(self._records_fd, 0, whole)

    def warm(self) -> None:
        """Runs all code of an agent, then freezes its objects: the garbage collector must not write to shared pages."""
        agent_id = next(iter(self._index), 0)
        warm_up(self._configs, self._codec, agent_id)
        if self._has_programs:
            warm_up_port(self._configs.config(agent_id), self._codec)
        gc.collect()
        gc.freeze()
        return_freed_memory()
        offer_for_merging()

    def rows(self) -> list[tuple[int, int, int, int, int]]:
        """(agent_id, pid or 0, epoch, sequence, granted_ms) of each agent's newest record."""
        rows = []
        for agent_id in self._index:
            record = _newest(self._ring(agent_id), None, None)
            child = self.children.get(agent_id)
            rows.append((agent_id, child.pid if child else 0, *record.key, record.granted_ms))
        return rows

    def start(self, wanted: Sequence[Boot]) -> list[LivingAgent | NotStarted]:
        """Forks agents. Returns a LivingAgent, or why there is none, for each boot in order."""
        outcomes: dict[int, LivingAgent | NotStarted] = {}
        pending: list[PendingFork] = []
        for place, boot in enumerate(wanted):
            try:
                if any(other.agent_id == boot.agent_id for other in pending):
                    raise NotStarted(f"aMussel {boot.agent_id} is asked for twice")
                pending.append(self._prepare_fork(place, boot))
            except NotStarted as refusal:
                outcomes[place] = refusal
        # Each page that this process writes between two forks costs every later agent a copy: the forks come last, alone.
        # An agent's garbage collector writes to every young object: freezing leaves none of them.
        gc.collect()
        return_freed_memory()
        gc.freeze()
        nursery_pid = os.getpid()
        link, link_fd, buffer, descriptors = self._link, self._link.fileno(), self._buffer, self._descriptors
        pids: list[int | None] = []
        # An agent whose end is ordered before it has handlers of its own must not run this process' handlers.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGTERM, signal.SIGCHLD))
        for agent in pending:
            try:
                pid = os.fork()
            except OSError as error:
                pids.append(None)
                outcomes[agent.place] = NotStarted(f"aMussel {agent.agent_id}: no process: {error.strerror}")
                continue
            if pid == 0:
                live(
                    nursery_pid,
                    agent.name,
                    agent.agent_end,
                    link_fd,
                    descriptors,
                    link,
                    buffer,
                    agent.handler,
                )
            pids.append(pid)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for forked, agent in zip(pids, pending, strict=True):
            os.close(agent.agent_end)
            if forked is None:
                os.close(agent.supervisor_end)
                continue
            outcomes[agent.place] = self.children[agent.agent_id] = LivingAgent(forked, agent.supervisor_end)
            self._id_of_pid[forked] = agent.agent_id
        return [outcomes[place] for place in range(len(wanted))]

    def _prepare_fork(self, place: int, boot: Boot) -> PendingFork:
        agent_id = boot.agent_id
        if agent_id not in self._index:
            raise NotStarted(f"aMussel {agent_id} is not of this fleet")
        if agent_id in self.children:
            raise NotStarted(f"aMussel {agent_id} lives already, as process {self.children[agent_id].pid}")
        if agent_id in self._hung:
            raise NotStarted(f"aMussel {agent_id}: its firmware hangs, so it stays dead; see nursery.log")
        ring = self._ring(agent_id)
        record = _newest(ring, boot.up_to, boot.at_ms)
        config = self._configs.config(agent_id)
        if boot.cause is not ResetCause.POWER_ON:
            self._count_restart(agent_id, record.granted_ms)
        settles_after_ms = config.board.boot_ms + round(1000 * self._restart_policy.settled_s)
        self._settles_ms[agent_id] = boot.at_ms + settles_after_ms
        try:
            supervisor_end, agent_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        except OSError as error:
            raise NotStarted(
                f"aMussel {agent_id}: {error.strerror} (ulimit -n is {self._descriptors})"
            ) from None
        # Made before the fork, the agent costs its own process none of the memory that its making touches.
        flash = FlashRegion(self._flash_fd, self._index[agent_id], self._flash_pages)
        flash.roll_back(record.physical.samples)
        agent = Agent(config, self._codec, record.physical, boot.at_ms, boot.cause, flash)
        handler = WindowHandler(agent, ring, self._truth_out, record.key, boot.at_ms)
        name = b"amussel-%d" % agent_id
        return PendingFork(place, agent_id, name, handler, supervisor_end.detach(), agent_end.detach())

    def kill(self, agent_id: int) -> None:
        """Kills a stopped or stuck agent and waits for its end; a SIGKILL ends it in any state."""
        child = self.children[agent_id]
        os.kill(child.pid, signal.SIGKILL)
        os.waitpid(child.pid, 0)
        self._forget(agent_id)

    def reap(self) -> list[Died]:
        """The agents that have ended since the last call."""
        died = []
        while self.children:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                break
            if pid not in self._id_of_pid:
                continue  # a dead agent's firmware, or a process that this left behind
            agent_id = self._id_of_pid[pid]
            self._forget(agent_id)
            if os.WIFEXITED(status) and os.WEXITSTATUS(status) == FIRMWARE_HUNG:
                self._hung.add(agent_id)
            died.append(Died(agent_id, pid, _ending(status)))
        return died

    def end(self) -> None:
        """Ends every agent: SIGTERM, and SIGKILL for those still alive after the policy's time."""
        for child in self.children.values():
            os.kill(child.pid, signal.SIGTERM)
        deadline_s = time.monotonic() + self._restart_policy.ending_s
        for agent_id, child in list(self.children.items()):
            descriptor = os.pidfd_open(child.pid)
            if not readable(descriptor, deadline_s - time.monotonic()):
                os.kill(child.pid, signal.SIGKILL)
            os.close(descriptor)
            os.waitpid(child.pid, 0)
            self._forget(agent_id)
        if self._has_programs:
            _end_strays()
        os.fsync(self._records_fd)
        os.fsync(self._flash_fd)

    def _count_restart(self, agent_id: int, lived_to_ms: int) -> None:
        policy = self._restart_policy
        if lived_to_ms >= self._settles_ms.get(agent_id, 0):
            self._restarts_in_a_row[agent_id] = 0
        if self._restarts_in_a_row.get(agent_id, 0) >= policy.restarts:
            raise NotStarted(
                f"aMussel {agent_id} was restarted {policy.restarts} times in a row and lived for less than "
                f"{policy.settled_s:g} s of its time after each boot: it stays dead"
            )
        self._restarts_in_a_row[agent_id] = self._restarts_in_a_row.get(agent_id, 0) + 1

    def _forget(self, agent_id: int) -> None:
        child = self.children.pop(agent_id)
        del self._id_of_pid[child.pid]
        os.close(child.link)

    def _ring(self, agent_id: int) -> RecordRing:
        return RecordRing(self._records_fd, self._index[agent_id], agent_id)


def _end_strays() -> None:
    """Ends the processes that firmware left behind, and says how many. Firmware itself ends with its agent."""
    begun_s, strays = time.monotonic(), set[int]()
    while (children := _children()) and time.monotonic() < begun_s + _STRAYS_S:
        for pid in children:
            descriptor = os.pidfd_open(pid)
            if not readable(descriptor, begun_s + _ENDS_WITH_AGENT_S - time.monotonic()):
                strays.add(pid)
                os.kill(pid, signal.SIGKILL)
            os.close(descriptor)
            os.waitpid(pid, 0)
    if strays:
        print(f"ended {len(strays)} processes that firmware had left behind", file=sys.stderr, flush=True)


def _children() -> list[int]:
    with open(f"/proc/self/task/{os.getpid()}/children") as file:
        return [int(it) for it in file.read().split()]


def _lock(descriptor: int) -> None:
    """Locks the file. Agents inherit the lock, so a dead nursery's lock is free once its last agent has ended, too."""

    def give_up(*_: object) -> None:
        raise ValueError("another nursery, or an agent of one, lives there")

    signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, _LOCK_TIMEOUT_S)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    signal.setitimer(signal.ITIMER_REAL, 0)


def _newest(ring: RecordRing, up_to: Key | None, until_ms: int | None) -> StateRecord:
    if (record := ring.newest(up_to, until_ms)) is None:
        raise NotStarted(
            f"the physical file has no whole record of aMussel {ring.agent_id} up to window {up_to} and {until_ms} ms"
        )
    return record


def _ending(status: int) -> str:
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    code = os.WEXITSTATUS(status)
    ended = {
        FIRMWARE_FAILED: "its firmware failed",
        FIRMWARE_HUNG: "its firmware hung",
        FIRMWARE_SPUN: WATCHDOG_FIRED,
    }
    return f"{ended.get(code, f'ended with exit status {code}')}; see nursery.log"

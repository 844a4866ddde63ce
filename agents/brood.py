"""The nursery's agents: forks them, knows their links, reaps them, and refuses to start one that dies too often."""

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
from dataclasses import dataclass

from agents.agent import Agent
from agents.control import Died
from agents.fleet_file import PHYSICAL_NAME, FleetFile
from agents.link import Key, readable
from agents.process import Servant, serve
from agents.rehearsal import rehearse
from agents.slots import Slot, SlotPair
from firmware_model.codec import load_codec
from firmware_model.stimuli import ResetCause

_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15
_LIBC = ctypes.CDLL(None)
_TRUTH_ROOM_BYTES = 4 * 2**20


@dataclass(slots=True)
class Child:
    """A living agent: its process, and the supervisor's end of its link."""

    pid: int
    link: int


class NotStarted(ValueError):
    """Why an agent was not started."""


class Brood:
    """All agents of one fleet file. It forks: its process must have no threads and little memory."""

    def __init__(self, run_dir: str, file: FleetFile) -> None:
        """BlockingIOError when another nursery, or an agent of one, still has the physical file."""
        self._slots_fd = os.open(os.path.join(run_dir, PHYSICAL_NAME), os.O_RDWR | os.O_CREAT, 0o644)
        # Agents inherit the lock: it is free once a dead nursery's last agent is gone, too.
        fcntl.flock(self._slots_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self.truth, self._teller = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._teller.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _TRUTH_ROOM_BYTES)
        # A place below every sibling's descriptor, so that a child closes those in one call.
        self._link_fd = os.open(os.devnull, os.O_RDONLY)
        self._upbringing = file.upbringing
        self._codec = load_codec(file.fleet.codec)
        self._configs = file.fleet.maker()
        self._index = {agent_id: index for index, agent_id in enumerate(sorted(file.births))}
        self._restarted_at_s: dict[int, list[float]] = {}
        self.children: dict[int, Child] = {}
        self._id_of_pid: dict[int, int] = {}
        if os.fstat(self._slots_fd).st_size == 0:
            for agent_id, physical in file.births.items():
                self._pair(agent_id).birth(physical)

    def warm(self) -> None:
        """Runs and touches all that an agent uses, then sets it apart from the garbage collector, to be shared."""
        rehearse(self._configs, self._codec, next(iter(self._index), 0))
        gc.collect()
        gc.freeze()
        _LIBC.malloc_trim(0)

    def rows(self) -> list[tuple[int, int, int, int, int]]:
        """(agent_id, pid or 0, epoch, sequence, granted_ms) of each agent's newest slot."""
        rows = []
        for agent_id in self._index:
            slot = self._slot(agent_id, None)
            child = self.children.get(agent_id)
            rows.append((agent_id, child.pid if child else 0, *slot.key, slot.granted_ms))
        return rows

    def start(self, agent_id: int, at_ms: int, cause: ResetCause, up_to: Key) -> Child:
        """Forks an agent that boots at agent time `at_ms` as it was at `up_to`; NotStarted says why not."""
        if agent_id not in self._index:
            raise NotStarted(f"aMussel {agent_id} is not of this fleet")
        if agent_id in self.children:
            raise NotStarted(f"aMussel {agent_id} lives already, as process {self.children[agent_id].pid}")
        slot = self._slot(agent_id, up_to)
        if at_ms < slot.granted_ms:
            raise NotStarted(
                f"aMussel {agent_id} has lived to {slot.granted_ms} ms: it cannot boot at {at_ms} ms"
            )
        if cause is not ResetCause.POWER_ON:
            self._count_restart(agent_id)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        nursery_pid = os.getpid()
        pid = os.fork()
        if pid == 0:
            self._live(nursery_pid, agent_id, theirs, at_ms, cause, slot)
        theirs.close()
        child = self.children[agent_id] = Child(pid, ours.detach())
        self._id_of_pid[pid] = agent_id
        return child

    def kill(self, agent_id: int) -> None:
        """Kills a stopped or stuck agent and waits for its end, which a SIGKILL brings in any state."""
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
            agent_id = self._id_of_pid[pid]
            self._forget(agent_id)
            died.append(Died(agent_id, pid, _words(status)))
        return died

    def end(self) -> None:
        """Ends every agent: SIGTERM, and SIGKILL for those that are still there after the stated time."""
        for child in self.children.values():
            os.kill(child.pid, signal.SIGTERM)
        deadline_s = time.monotonic() + self._upbringing.ending_s
        for agent_id, child in list(self.children.items()):
            descriptor = os.pidfd_open(child.pid)
            if not readable(descriptor, deadline_s - time.monotonic()):
                os.kill(child.pid, signal.SIGKILL)
            os.close(descriptor)
            os.waitpid(child.pid, 0)
            self._forget(agent_id)
        os.fsync(self._slots_fd)

    def _live(
        self,
        nursery_pid: int,
        agent_id: int,
        theirs: socket.socket,
        at_ms: int,
        cause: ResetCause,
        slot: Slot,
    ) -> None:
        """The forked agent's whole life; it never returns."""
        status = 1
        try:
            os.dup2(theirs.fileno(), self._link_fd)
            os.closerange(self._link_fd + 1, resource.getrlimit(resource.RLIMIT_NOFILE)[0])
            _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            if os.getppid() != nursery_pid:
                os._exit(0)  # the nursery died before its death could be a signal
            _LIBC.prctl(_PR_SET_NAME, f"amussel-{agent_id}".encode(), 0, 0, 0)
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            agent = Agent(self._configs.config(agent_id), self._codec, slot.physical, at_ms, cause)
            pair = self._pair(agent_id)
            pair.newest(slot.key)
            link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, 0, self._link_fd)
            serve(link, Servant(agent, pair, self._teller, slot.key, at_ms))
            status = 0
        except BaseException:
            sys.excepthook(*sys.exc_info())
            sys.stderr.flush()
        finally:
            os._exit(status)

    def _count_restart(self, agent_id: int) -> None:
        limit = self._upbringing
        now_s = time.monotonic()
        recent = [at_s for at_s in self._restarted_at_s.get(agent_id, []) if at_s > now_s - limit.within_s]
        self._restarted_at_s[agent_id] = recent
        if len(recent) >= limit.restarts:
            raise NotStarted(
                f"aMussel {agent_id} was restarted {limit.restarts} times within {limit.within_s:g} s: it stays dead"
            )
        recent.append(now_s)

    def _forget(self, agent_id: int) -> None:
        child = self.children.pop(agent_id)
        del self._id_of_pid[child.pid]
        os.close(child.link)

    def _pair(self, agent_id: int) -> SlotPair:
        return SlotPair(self._slots_fd, self._index[agent_id], agent_id)

    def _slot(self, agent_id: int, up_to: Key | None) -> Slot:
        slot = self._pair(agent_id).newest(up_to)
        if slot is None:
            raise NotStarted(
                f"the physical file has no whole slot of aMussel {agent_id} up to window {up_to}"
            )
        return slot


def _words(status: int) -> str:
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return f"ended with exit status {os.WEXITSTATUS(status)}; nursery.log says why"

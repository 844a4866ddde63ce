"""A Host with a process per agent: windows go over the agents' links, and a nursery restarts dead agents."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress

from agents.fleet_config import FleetConfig
from agents.hosting.agent_links import AgentLinks, WindowAnswered
from agents.hosting.descriptors import raise_descriptor_limit
from agents.hosting.host import Death, Grant, Reply
from agents.hosting.link_protocol import NEVER, Key, Repeat, WindowGrant
from agents.hosting.look_ahead import LookAhead
from agents.hosting.nursery_client import Fenced, NurseryDied, NurseryLink
from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.nursery.fleet_file import RestartPolicy
from agents.nursery.launch import NurseryFailed, StartedNursery, launch_nursery, prepare
from firmware_model.stimuli import ResetCause

__all__ = ["Fenced", "NurseryFailed", "ProcessHost"]

WINDOW_TIMEOUT_S = 2.0
_END_TIMEOUT_S = 5.0
_NURSERIES = 3
_NURSERIES_SPAN_S = 60.0
"""After more than `_NURSERIES` deaths of nurseries within this time, the host starts no other, and its fleet is lost."""


class ProcessHost:
    """A supervisor's connection to its fleet. Made by `start` or `adopt`.

    At the time of `adopt`, `granted_ms` is the agent time that each agent has lived to, and `repeated` its last reply: a
    journal that ends before that window lacks those outputs. Every method but `close` raises Fenced once a supervisor
    with a higher epoch has taken over the fleet.
    """

    def __init__(
        self,
        run_dir: str,
        epoch: int,
        window_timeout_s: float,
        process: subprocess.Popen[bytes] | None,
        *,
        looks_ahead: bool = False,
    ) -> None:
        """Use `start` or `adopt`."""
        self.epoch = epoch
        self.lost: str | None = None
        self.granted_ms: dict[int, int] = {}
        self.repeated: dict[int, Reply] = {}
        self._run_dir = run_dir
        self._window_timeout_s = window_timeout_s
        self._process = process
        self._sequence = 0
        self._committed: dict[int, Key] = {}
        """The key of each agent's last answered window."""
        self._look_ahead = LookAhead(self._next_key) if looks_ahead else None
        self._truths: list[Truth] = []
        self._nurseries_died_at_s: list[float] = []
        self._dropped_before: Counter[str] = Counter()
        raise_descriptor_limit()
        self._nursery = NurseryLink(run_dir, epoch)
        self.links = AgentLinks(self._nursery, window_timeout_s)

    @classmethod
    def start(
        cls,
        run_dir: str | os.PathLike[str],
        fleet: FleetConfig,
        initial_states: Mapping[int, Physical],
        *,
        epoch: int = 1,
        window_timeout_s: float = WINDOW_TIMEOUT_S,
        restart_policy: RestartPolicy | None = None,
        looks_ahead: bool = False,
    ) -> ProcessHost:
        """Starts a new fleet, under its own nursery, in an existing directory without one.

        With `looks_ahead` its agents run ahead, which pays where windows end at the mission's seconds and nobody waits for
        a clock. The boards must be the paper's worst case, and no other supervisor can take over the fleet.

        Raises ValueError or FileExistsError for a fleet that cannot be, NurseryFailed if its nursery does not come up.
        """
        prepare(run_dir, fleet, initial_states, restart_policy)
        return cls.adopt(run_dir, epoch, window_timeout_s=window_timeout_s, looks_ahead=looks_ahead)

    @classmethod
    def adopt(
        cls,
        run_dir: str | os.PathLike[str],
        epoch: int,
        *,
        window_timeout_s: float = WINDOW_TIMEOUT_S,
        looks_ahead: bool = False,
        nursery: StartedNursery | None = None,
    ) -> ProcessHost:
        """Takes over the fleet of a run directory, as supervisor number `epoch`; starts a nursery if there is none.

        `nursery` is one that its caller has started there and not waited for. The host starts agents that have never run.
        An agent that has died dies in its next window, so that the death is recorded.

        Raises Fenced if `epoch` is not above that of a former supervisor, NurseryFailed if no nursery comes up.
        """
        process, run_dir = None if nursery is None else nursery.ready(), os.fspath(run_dir)
        try:
            host = cls(run_dir, epoch, window_timeout_s, process, looks_ahead=looks_ahead)
        except OSError:
            process = launch_nursery(run_dir)
            host = cls(run_dir, epoch, window_timeout_s, process, looks_ahead=looks_ahead)
        try:
            host._take_child_list()
        except BaseException:
            host.close()
            raise
        return host

    @property
    def pids(self) -> dict[int, int]:
        """The pids of the living agents, by id."""
        return self.links.pids

    @property
    def nursery_pid(self) -> int:
        return self._nursery.pid

    @property
    def dropped(self) -> Counter[str]:
        """Dropped messages, counted by reason."""
        return self._dropped_before + self.links.dropped + self._nursery.dropped

    def kill(self, agent_id: int) -> None:
        self._signal(agent_id, signal.SIGKILL)

    def stop(self, agent_id: int) -> None:
        self._signal(agent_id, signal.SIGSTOP)

    def _signal(self, agent_id: int, number: int) -> None:
        if (pid := self.pids.get(agent_id)) is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, number)
            if self._look_ahead is not None:
                self._look_ahead.forget(self.links, agent_id)

    def _next_key(self) -> Key:
        self._sequence += 1
        return (self.epoch, self._sequence)

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        ahead = self._look_ahead
        found = {} if ahead is None else ahead.take(self.links, grants)
        key = self._next_key()
        frames = {
            agent_id: WindowGrant(key, grant, None if ahead is None else ahead.lived_ms(agent_id)).encode()
            for agent_id, grant in grants.items()
            if agent_id not in found
        }
        answers = self.links.ask(key, frames) if frames else {}
        outcomes: dict[int, Reply | Death] = {}
        for agent_id, grant in grants.items():
            its_key, outcome = found.get(agent_id) or (key, answers[agent_id])
            if isinstance(outcome, Death):
                outcomes[agent_id] = outcome
                continue
            self._committed[agent_id] = its_key
            self._truths += outcome.truths
            outcomes[agent_id] = outcome.reply
            if ahead is not None:
                ahead.run_on(self.links, agent_id, grant)
        return outcomes

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        if self.lost is not None:
            return self.lost
        row = (agent_id, at_ms, cause, *self._committed.get(agent_id, NEVER))
        try:
            if self.links.nursery_died:
                self._replace_nursery()
            outcome = None
            while outcome is None:
                try:
                    outcome = self._nursery.start([row])
                except (
                    NurseryDied
                ):  # after the agents were asked; one after the other, until the fleet is lost
                    self._replace_nursery()
        except NurseryFailed as error:
            return str(error)
        for pid, descriptor in outcome.living.values():
            self.links.add(agent_id, pid, descriptor)
        if self._look_ahead is not None:
            self._look_ahead.forget(self.links, agent_id)
        return outcome.refused.get(agent_id)

    def take_truths(self) -> list[Truth]:
        truths, self._truths = self._truths, []
        return truths

    def close(self) -> None:
        """Ends the fleet and its nursery, unless a newer supervisor has taken them over."""
        try:
            self._nursery.end(_END_TIMEOUT_S)
        except Fenced:
            if self._process is not None:
                self._process.returncode = 0  # it lives on for another supervisor: no need to wait for it
        self._disconnect()

    def _take_child_list(self) -> None:
        entries = self._nursery.entries
        self._committed = {agent.agent_id: (agent.epoch, agent.sequence) for agent in entries}
        self.granted_ms = {agent.agent_id: agent.granted_ms for agent in entries}
        for agent in entries:
            if agent.link is not None:
                self.links.add(agent.agent_id, agent.pid, agent.link)
        key = (self.epoch, 0)
        repeats = {agent.agent_id: Repeat(key).encode() for agent in entries if agent.pid}
        for agent_id, outcome in self.links.ask(key, repeats).items():
            if isinstance(outcome, WindowAnswered):
                self._committed[agent_id] = outcome.window
                self.granted_ms[agent_id] = outcome.granted_ms
                self.repeated[agent_id] = outcome.reply
                self._truths += outcome.truths
        self._start_pending(
            [
                agent.agent_id
                for agent in entries
                if not agent.pid and self._committed[agent.agent_id] == NEVER
            ]
        )

    def _start_pending(self, agent_ids: list[int]) -> None:
        outcome = self._nursery.start([(agent_id, 0, ResetCause.POWER_ON, *NEVER) for agent_id in agent_ids])
        for agent_id, (pid, descriptor) in outcome.living.items():
            self.links.add(agent_id, pid, descriptor)
        if outcome.refused:
            reasons = list(outcome.refused.values())
            more = f", and {len(reasons) - 1} more" if len(reasons) > 1 else ""
            raise NurseryFailed(f"{reasons[0]}{more}")

    def _replace_nursery(self) -> None:
        """Starts another nursery for this run directory, which restarts agents from the file; or the fleet is lost."""
        why = ""
        while True:
            now_s = time.monotonic()
            recent = [at_s for at_s in self._nurseries_died_at_s if at_s > now_s - _NURSERIES_SPAN_S]
            self._nurseries_died_at_s = [*recent, now_s]
            if len(recent) >= _NURSERIES:
                died = f"its nursery died {len(recent) + 1} times within {_NURSERIES_SPAN_S:g} s"
                self.lost = f"{died}, and no other is started{why}"
                raise NurseryFailed(self.lost)
            try:
                process = launch_nursery(self._run_dir)
            except (NurseryFailed, OSError) as error:
                why = f" ({error})"
                continue
            try:
                nursery = NurseryLink(self._run_dir, self.epoch)
                break
            except (NurseryDied, OSError) as error:
                process.kill()
                process.wait()
                why = f" ({error})"
        self._dropped_before = self.dropped
        self._disconnect()
        self._process, self._nursery = process, nursery
        self.links = AgentLinks(self._nursery, self._window_timeout_s)

    def _disconnect(self) -> None:
        self.links.close()
        self._nursery.close()
        if self._process is not None:
            self._process.wait(_END_TIMEOUT_S)

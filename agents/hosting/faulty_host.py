"""A Host behind defects: links that lose, delay or flip what passes, modems that are deaf, processes that are ended.

Everything else passes as it is. A packet that is lost here comes back as a Dropped, so that it is counted.
"""

from __future__ import annotations

import random
import resource
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from enum import Enum, auto

from agents.hosting.host import Death, Grant, Host, Reply
from agents.mussel.outputs import Output, PingAnswered, SoundSent, StimulusDropped, WifiSent
from agents.mussel.stimuli import AgentStimulus, PingArrived, SoundArrived, WifiArrived

_CUT = "a packet on a link that was cut"
_DEAF = "a sound that a deaf modem did not hear"


class LinkDefect(Enum):
    """A defect of the link between one aMussel and the world, and what its value is."""

    CUT = auto()
    """Nothing passes either way."""
    DEAF = auto()
    """The modem hears nothing; it still sends."""
    DELAY = auto()
    """Each packet passes so many agent ms later, either way."""
    FLIPS = auto()
    """Each bit of a packet flips with this probability, either way."""


class FaultyHost:
    """A Host whose aMussels may be given defects."""

    def __init__(self, host: Host, seed: int) -> None:
        """`seed` decides which bits flip."""
        self._host = host
        self._seed = seed
        self._defects: dict[int, dict[LinkDefect, float]] = {}
        """Empty for an aMussel that still has late packets on their way."""
        self._to_come: dict[int, list[tuple[int, AgentStimulus]]] = {}
        """Late packets to an aMussel, with the agent time at which each arrives, rising."""
        self._to_go: dict[int, list[Output]] = {}
        """Late packets from an aMussel, stamped with the agent time at which each is sent, rising."""
        self.restart = host.restart
        self.take_truths = host.take_truths
        self.close = host.close
        self.kill = host.kill
        self.stop = host.stop

    @property
    def lost(self) -> str | None:
        return self._host.lost

    @property
    def pids(self) -> Mapping[int, int]:
        return self._host.pids

    def limit_memory(self, agent_id: int, megabytes: float | None) -> None:
        """Limits the address space of the agent's process; None lifts the limit."""
        if (pid := self._host.pids.get(agent_id)) is None:
            return
        with suppress(ProcessLookupError):
            _, most = resource.prlimit(pid, resource.RLIMIT_AS)
            limit = most if megabytes is None else round(megabytes * 2**20)
            resource.prlimit(pid, resource.RLIMIT_AS, (limit, most))

    def set_defect(self, agent_id: int, defect: LinkDefect, value: float = 0.0) -> None:
        self._defects.setdefault(agent_id, {})[defect] = value

    def heal(self, agent_id: int, defect: LinkDefect) -> None:
        """The link is without this defect from now on. What is late by then arrives at its time."""
        self._defects.get(agent_id, {}).pop(defect, None)
        self._forget_healthy(agent_id)

    def _forget_healthy(self, agent_id: int) -> None:
        late = self._to_come.get(agent_id) or self._to_go.get(agent_id)
        if not late and not self._defects.get(agent_id):
            for of in (self._defects, self._to_come, self._to_go):
                of.pop(agent_id, None)

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        if not self._defects:
            return self._host.grant(grants)
        passed: dict[int, tuple[list[tuple[int, AgentStimulus]], list[Output]]] = {}
        """For each faulty aMussel: the stimuli that are late after this window, and the ones that were lost."""
        changed = dict(grants)
        for agent_id in self._defects.keys() & grants.keys():
            changed[agent_id], late, lost = self._toward(agent_id, grants[agent_id])
            passed[agent_id] = late, lost
        outcomes = self._host.grant(changed)
        for agent_id, (late, lost) in passed.items():
            outcome = outcomes[agent_id]
            if isinstance(outcome, Reply):  # after a death the same window comes again
                self._to_come[agent_id] = late
                outcomes[agent_id] = self._from(agent_id, outcome, lost, grants[agent_id].until_ms)
                self._forget_healthy(agent_id)
        return outcomes

    def _toward(
        self, agent_id: int, grant: Grant
    ) -> tuple[Grant, list[tuple[int, AgentStimulus]], list[Output]]:
        """The window with the packets that arrive in it, those that are still late after it, and those that are lost."""
        defects = self._defects[agent_id]
        delay_ms = round(defects.get(LinkDefect.DELAY, 0))
        arriving, lost = list(self._to_come.get(agent_id, ())), list[Output]()
        for at_ms, stimulus in grant.stimuli:
            match stimulus:
                case SoundArrived() | WifiArrived() | PingArrived() if LinkDefect.CUT in defects:
                    lost.append(StimulusDropped(at_ms, agent_id, _CUT))
                case SoundArrived() | PingArrived() if LinkDefect.DEAF in defects:
                    lost.append(StimulusDropped(at_ms, agent_id, _DEAF))
                case SoundArrived(data) | WifiArrived(data):
                    flipped = self._flipped(data, agent_id, at_ms)
                    arriving.append((at_ms + delay_ms, replace(stimulus, data=flipped)))
                case PingArrived():
                    arriving.append((at_ms + delay_ms, stimulus))
                case _:
                    arriving.append((at_ms, stimulus))
        arriving.sort(key=lambda it: it[0])
        now = tuple(it for it in arriving if it[0] <= grant.until_ms)
        return Grant(grant.until_ms, now), arriving[len(now) :], lost

    def _from(self, agent_id: int, reply: Reply, lost: list[Output], until_ms: int) -> Reply:
        """The reply with the packets that leave by the window's end; it is due again when the next late one is."""
        defects = self._defects[agent_id]
        delay_ms = round(defects.get(LinkDefect.DELAY, 0))
        leaving = [*self._to_go.get(agent_id, ()), *lost]
        for output in reply.outputs:
            match output:
                case WifiSent() | SoundSent() | PingAnswered() if LinkDefect.CUT in defects:
                    leaving.append(StimulusDropped(output.at_ms, agent_id, _CUT))
                case WifiSent(at_ms, _, data) | SoundSent(at_ms, _, data):
                    flipped = self._flipped(data, agent_id, at_ms)
                    leaving.append(replace(output, at_ms=at_ms + delay_ms, data=flipped))
                case PingAnswered(at_ms):
                    leaving.append(replace(output, at_ms=at_ms + delay_ms))
                case _:
                    leaving.append(output)
        leaving.sort(key=lambda it: it.at_ms)
        now = tuple(it for it in leaving if it.at_ms <= until_ms)
        self._to_go[agent_id] = leaving[len(now) :]
        dues = [reply.next_due_ms] if reply.next_due_ms is not None else []
        dues += [at_ms for at_ms, _ in self._to_come[agent_id][:1]]
        dues += [it.at_ms for it in self._to_go[agent_id][:1]]
        return Reply(min(dues, default=None), now)

    def _flipped(self, data: bytes, agent_id: int, at_ms: int) -> bytes:
        """The bytes after this link; the same ones flip in the same packet at the same time, whoever asks how often."""
        if not (probability := self._defects[agent_id].get(LinkDefect.FLIPS)):
            return data
        rng = random.Random(f"{self._seed} {agent_id} {at_ms} {data.hex()}")
        mask = sum(1 << bit for bit in range(8 * len(data)) if rng.random() < probability)
        return (int.from_bytes(data, "big") ^ mask).to_bytes(len(data), "big")

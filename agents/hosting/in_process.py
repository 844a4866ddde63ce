"""Agents as plain objects in this process: the reference that a process per agent must equal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from agents.fleet_config import FleetConfig
from agents.hosting.host import Death, Grant, Reply
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, Truth
from agents.mussel.physical import Physical
from firmware_model.packets.codec import load_codec
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.stimuli import ResetCause


class InProcessHost:
    """A Host without processes. After `kill`, an agent's next window stays unanswered, as after kill -9."""

    def __init__(self, fleet: FleetConfig, initial_states: Mapping[int, Physical]) -> None:
        self._codec = load_codec(fleet.codec)
        # Without processes there is none for somebody's firmware: ours stands in.
        self._configs = replace(fleet, firmware=()).maker()
        self._flashes = {agent_id: MemoryFlash(fleet.flash_pages) for agent_id in initial_states}
        self._agents = {
            agent_id: self._boot(agent_id, physical, 0, ResetCause.POWER_ON)
            for agent_id, physical in initial_states.items()
        }
        self._doomed: set[int] = set()
        self._kept = dict(initial_states)
        """Each agent's physical state at the end of its last answered window."""
        self._truths: list[Truth] = []
        self.lost: str | None = None

    @property
    def pids(self) -> Mapping[int, int]:
        return {}

    def kill(self, agent_id: int) -> None:
        self._doomed.add(agent_id)

    def stop(self, agent_id: int) -> None:
        pass

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        return {agent_id: self._run(agent_id, grant) for agent_id, grant in grants.items()}

    def _run(self, agent_id: int, grant: Grant) -> Reply | Death:
        if agent_id in self._doomed:
            self._doomed.discard(agent_id)
            del self._agents[agent_id]
            return Death(ResetCause.BROWN_OUT, "killed by SIGKILL")
        agent = self._agents[agent_id]
        outputs: list[Output] = []
        for at_ms, stimulus in grant.stimuli:
            outputs += agent.receive(stimulus, at_ms)
        outputs += agent.advance(grant.until_ms)
        self._truths += agent.take_truths()
        self._kept[agent_id] = agent.physical
        return Reply(agent.next_due_ms, tuple(outputs))

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        self._agents[agent_id] = self._boot(agent_id, self._kept[agent_id], at_ms, cause)
        return None

    def _boot(self, agent_id: int, physical: Physical, at_ms: int, cause: ResetCause) -> Agent:
        config, flash = self._configs.config(agent_id), self._flashes[agent_id]
        return Agent(config, self._codec, physical, at_ms, cause, flash)

    def take_truths(self) -> list[Truth]:
        truths, self._truths = self._truths, []
        return truths

    def close(self) -> None:
        self._agents.clear()

"""The one clock authority of the fleet: keeps a heap of due times and grants windows. No agent reads a clock.

When an agent's process dies in a window, the coordinator has it restarted and grants the window again, or drops the agent
for good: `agents/nursery/fleet_file.py` has the rule of restarts.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from agents.hosting.host import Death, Grant, Host
from agents.mussel.outputs import Output
from agents.mussel.stimuli import AgentStimulus
from agents.time_scale import AgentMs, MissionMs, TimeScale
from firmware_model.stimuli import ResetCause

_NEVER_MS = AgentMs(2**63)
_START_MS = MissionMs(0)


@dataclass(frozen=True, slots=True)
class AgentDied:
    """An agent died at `agent_ms`, the end of its last answered window; `gave_up` is the reason why it stays dead."""

    mission_ms: MissionMs
    agent_id: int
    agent_ms: AgentMs
    cause: ResetCause
    reason: str
    gave_up: str | None


class Coordinator:
    """Grants windows to a fleet. Public times are mission milliseconds, an agent's own times are `AgentMs`."""

    def __init__(
        self, host: Host, granted_ms: Mapping[int, int], scale: TimeScale, now_ms: MissionMs = _START_MS
    ) -> None:
        """`granted_ms`: for each agent, the agent time that it has lived to (0 for a new one)."""
        self._host = host
        self.scale = scale
        self._now_ms = now_ms
        self._granted_ms = {agent_id: AgentMs(at_ms) for agent_id, at_ms in granted_ms.items()}
        # An agent's first window is due at once, because only its answer has the agent's next due time.
        self._due_ms = dict(self._granted_ms)
        self._heap = [(due_ms, agent_id) for agent_id, due_ms in self._due_ms.items()]
        heapq.heapify(self._heap)
        self._waiting: dict[int, list[tuple[AgentMs, AgentStimulus]]] = {}
        self._muted_until_ms: dict[int, AgentMs] = {}

    def mute(self, agent_id: int) -> None:
        """Discards the agent's outputs from now on."""
        self._muted_until_ms[agent_id] = _NEVER_MS

    def unmute(self, agent_id: int, now_ms: MissionMs) -> None:
        """Keeps the agent's outputs again from mission time `now_ms` on."""
        self._muted_until_ms[agent_id] = self.scale.agent_ms(now_ms)

    @property
    def agent_ids(self) -> list[int]:
        return sorted(self._granted_ms)

    @property
    def granted_ms(self) -> Mapping[int, AgentMs]:
        """The agent time that each aMussel has lived to."""
        return MappingProxyType(self._granted_ms)

    @property
    def next_due_ms(self) -> MissionMs | None:
        """The mission time by which some agent acts."""
        if self._waiting:
            return self._now_ms
        while self._heap and self._due_ms.get(self._heap[0][1]) != self._heap[0][0]:
            heapq.heappop(self._heap)
        return self.scale.mission_ms(self._heap[0][0]) if self._heap else None

    @property
    def due_agent_ms(self) -> AgentMs | None:
        """The agent time at which some agent next acts by itself, or has a waiting stimulus."""
        waiting_ms = min((facts[0][0] for facts in self._waiting.values()), default=None)
        while self._heap and self._due_ms.get(self._heap[0][1]) != self._heap[0][0]:
            heapq.heappop(self._heap)
        if not self._heap:
            return waiting_ms
        return self._heap[0][0] if waiting_ms is None else min(waiting_ms, self._heap[0][0])

    def receive(self, agent_id: int, stimulus: AgentStimulus, now_ms: MissionMs) -> AgentMs | None:
        """Takes a fact of the world at mission time `now_ms`, for one agent.

        Returns the fact's stamp in agent time. For an agent outside the fleet it keeps nothing and returns None.
        """
        return self.receive_at(agent_id, stimulus, self.scale.agent_ms(now_ms))

    def receive_at(self, agent_id: int, stimulus: AgentStimulus, agent_ms: AgentMs) -> AgentMs | None:
        """`receive` for a fact with a stamp in agent time."""
        if (granted_ms := self._granted_ms.get(agent_id)) is None:
            return None
        at_ms = max(agent_ms, granted_ms)
        self._waiting.setdefault(agent_id, []).append((at_ms, stimulus))
        return at_ms

    def advance(self, now_ms: MissionMs) -> list[Output | AgentDied]:
        """Grants everything due by mission time `now_ms`. Returns the outputs by (mission time, agent, order)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        self._now_ms = now_ms
        return self.grant(self.scale.agent_ms(now_ms))

    def grant(self, until_ms: AgentMs) -> list[Output | AgentDied]:
        """Grants everything due by agent time `until_ms`, within a tick; returns as `advance` does."""
        waiting, self._waiting = self._waiting, {}
        chosen = set(waiting)
        while self._heap and self._heap[0][0] <= until_ms:
            due_ms, agent_id = heapq.heappop(self._heap)
            if self._due_ms.get(agent_id) == due_ms:
                chosen.add(agent_id)
        grants = dict.fromkeys(sorted(chosen), Grant(until_ms))
        for agent_id in grants:
            # An adopted agent may have lived past this time, under a supervisor that died before it recorded that.
            if agent_id in waiting or self._granted_ms[agent_id] > until_ms:
                facts = tuple(waiting.get(agent_id, ()))
                grants[agent_id] = Grant(max(until_ms, self._granted_ms[agent_id]), facts)
        events: list[Output | AgentDied] = []
        while grants:
            grants = self._grant(grants, events)
        events.sort(key=self._order)
        return events

    def _order(self, event: Output | AgentDied) -> tuple[MissionMs, int]:
        if isinstance(event, AgentDied):
            return event.mission_ms, event.agent_id
        return self.scale.mission_ms(AgentMs(event.at_ms)), event.agent_id

    def _grant(self, grants: dict[int, Grant], events: list[Output | AgentDied]) -> dict[int, Grant]:
        """Grants one round. Returns the windows of agents that died in it and boot again."""
        again: dict[int, Grant] = {}
        for agent_id, outcome in self._host.grant(grants).items():
            if isinstance(outcome, Death):
                at_ms = self._granted_ms[agent_id]
                gave_up = self._host.restart(agent_id, at_ms, outcome.cause)
                mission_ms = self.scale.mission_ms(at_ms)
                events.append(AgentDied(mission_ms, agent_id, at_ms, outcome.cause, outcome.reason, gave_up))
                if gave_up is None:
                    again[agent_id] = grants[agent_id]
                else:
                    del self._granted_ms[agent_id]
                    self._due_ms.pop(agent_id, None)
                continue
            self._granted_ms[agent_id] = AgentMs(grants[agent_id].until_ms)
            if outcome.next_due_ms is None:
                self._due_ms.pop(agent_id, None)
            else:
                due_ms = self._due_ms[agent_id] = AgentMs(outcome.next_due_ms)
                heapq.heappush(self._heap, (due_ms, agent_id))
            kept_from_ms = self._muted_until_ms.get(agent_id, 0)
            events += [output for output in outcome.outputs if output.at_ms >= kept_from_ms]
        return again

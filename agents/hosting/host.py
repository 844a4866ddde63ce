"""The coordinator's interface to agents, in one process or a process each. Stamps are agent time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import AgentStimulus
from firmware_model.stimuli import ResetCause
from firmware_model.value import value


@value
class Grant:
    """A window: time up to `until_ms`, and its facts as (at_ms, stimulus) in order."""

    until_ms: int
    stimuli: tuple[tuple[int, AgentStimulus], ...] = ()


@value
class Reply:
    """A window's whole outcome. `next_due_ms` is when the agent next acts by itself."""

    next_due_ms: int | None
    outputs: tuple[Output, ...]


@dataclass(frozen=True, slots=True)
class Death:
    """The agent died with the window unanswered: nothing in that window happened."""

    cause: ResetCause
    reason: str


class Host(Protocol):
    @property
    def lost(self) -> str | None:
        """The reason why no agent can be restarted any more; None as long as one can."""

    @property
    def pids(self) -> Mapping[int, int]:
        """The processes of the living agents, by id; empty where they have none of their own."""

    def kill(self, agent_id: int) -> None:
        """Ends an agent as kill -9 does: its next window stays unanswered. Nothing for one that is dead."""

    def stop(self, agent_id: int) -> None:
        """Stops an agent's process (SIGSTOP); the watchdog finds it. Nothing for an agent without a process."""

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        """Grants windows and waits for the outcome of each: an answer or a death, within a stated time-out."""

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        """Restarts a dead agent's board at `at_ms`. Returns None, or why it stays dead (it died too often)."""

    def take_truths(self) -> list[Truth]:
        """The truths of answered windows since the last call, for the recorder alone."""

    def close(self) -> None:
        """Ends every agent."""

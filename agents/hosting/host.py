"""Where agents live, as the coordinator sees it: in one process, or a process each. Stamps are agent time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import Stimulus
from firmware_model.stimuli import ResetCause


@dataclass(frozen=True, slots=True)
class Grant:
    """A window: time up to `until_ms`, and the facts in it as (at_ms, stimulus) in order."""

    until_ms: int
    stimuli: tuple[tuple[int, Stimulus], ...] = ()


@dataclass(frozen=True, slots=True)
class Reply:
    """A window's whole outcome. `next_due_ms` is when the agent next has something to do by itself."""

    next_due_ms: int | None
    outputs: tuple[Output, ...]


@dataclass(frozen=True, slots=True)
class Death:
    """The agent died with the window unanswered: nothing in that window happened."""

    cause: ResetCause
    reason: str


class Host(Protocol):
    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        """Grants windows and waits for each one's outcome: an answer or a death, never longer than a stated time-out."""
        ...

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        """Starts a dead agent's board again at `at_ms`; None, or why it is not started again (it died too often)."""
        ...

    def take_truths(self) -> list[Truth]:
        """Truths of answered windows since the last call. For the recorder alone."""
        ...

    def close(self) -> None:
        """Ends every agent."""
        ...

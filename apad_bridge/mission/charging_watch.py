"""Watches a charging batch: full is full; what neither speaks nor gains is not waited for."""

from __future__ import annotations

from collections.abc import Mapping

from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.schema import FullWhen


class ChargingWatch:
    """`patience_ms` is mission time: after so long without a gain in believed charge an aMussel is not waited for."""

    def __init__(self, full_threshold: float, full_when: FullWhen, patience_ms: int) -> None:
        self._full_threshold = full_threshold
        self._full_when = full_when
        self._patience_ms = patience_ms
        self._start_ms = 0
        self._best: dict[int, tuple[float, int]] = {}
        self._given_up: set[int] = set()

    def start(self, now_ms: int) -> None:
        self._start_ms = now_ms
        self._best = {}
        self._given_up = set()

    def look(self, docked: Mapping[int, Belief | None], now_ms: int) -> list[tuple[int, str]]:
        """Takes the beliefs of the docked ones; (agent, reason) for those given up by this look."""
        given_up: list[tuple[int, str]] = []
        for agent_id, belief in sorted(docked.items()):
            best, gained_ms = self._best.get(agent_id, (-1.0, self._start_ms))
            if belief is not None and self._level(belief) > best:
                best, gained_ms = self._level(belief), now_ms
            self._best[agent_id] = (best, gained_ms)
            if (
                not self.is_full(belief)
                and agent_id not in self._given_up
                and now_ms - gained_ms > self._patience_ms
            ):
                self._given_up.add(agent_id)
                given_up.append((agent_id, "its believed charge does not rise"))
        return given_up

    def done(self, docked: Mapping[int, Belief | None]) -> bool:
        """Whether every docked one is believed full, or was given up."""
        return all(agent_id in self._given_up or self.is_full(belief) for agent_id, belief in docked.items())

    def is_full(self, belief: Belief | None) -> bool:
        return belief is not None and self._level(belief) > self._full_threshold

    def _level(self, belief: Belief) -> float:
        """The charge that counts: where both batteries do, the lower one's."""
        return (
            belief.primary if self._full_when is FullWhen.PRIMARY else min(belief.primary, belief.secondary)
        )

"""Watches a charging batch: full is full; what neither speaks nor gains is not waited for."""

from __future__ import annotations

from collections.abc import Mapping

from apad_bridge.beliefs.belief import Belief


class ChargingWatch:
    """`patience_ms` is mission time: after so long without a gain in believed charge an aMussel is not waited for."""

    def __init__(self, full_threshold: float, patience_ms: int) -> None:
        self._full_threshold = full_threshold
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
            if belief is not None and belief.primary > best:
                best, gained_ms = belief.primary, now_ms
            self._best[agent_id] = (best, gained_ms)
            is_full = belief is not None and belief.primary > self._full_threshold
            if not is_full and agent_id not in self._given_up and now_ms - gained_ms > self._patience_ms:
                self._given_up.add(agent_id)
                given_up.append((agent_id, "its believed charge does not rise"))
        return given_up

    def done(self, docked: Mapping[int, Belief | None]) -> bool:
        """Whether every docked one is believed full, or was given up."""
        return all(
            agent_id in self._given_up or (belief is not None and belief.primary > self._full_threshold)
            for agent_id, belief in docked.items()
        )

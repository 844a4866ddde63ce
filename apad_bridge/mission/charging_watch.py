"""Watches a charging batch; the mission does not wait for aMussels that are silent or whose charge does not rise."""

from __future__ import annotations

from collections.abc import Mapping

from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.schema import FullWhen


class ChargingWatch:
    """Gives an aMussel up after `patience_ms` of mission time without a gain in believed charge."""

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

    def give_up_stalled(self, docked: Mapping[int, Belief | None], now_ms: int) -> list[tuple[int, str]]:
        """Takes the docked aMussels' beliefs; returns (agent, reason) for each aMussel that it gives up now."""
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
        """Every docked aMussel is believed full, or was given up."""
        return all(agent_id in self._given_up or self.is_full(belief) for agent_id, belief in docked.items())

    def is_full(self, belief: Belief | None) -> bool:
        return belief is not None and self._level(belief) > self._full_threshold

    def _level(self, belief: Belief) -> float:
        """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
        return (
            belief.primary if self._full_when is FullWhen.PRIMARY else min(belief.primary, belief.secondary)
        )

"""Watches a charging batch; the mission does not wait for aMussels that are silent or whose charge does not rise."""

from __future__ import annotations

from collections.abc import Mapping

from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.schema import FullWhen, Mission


def is_full(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed full, by the scenario's definition; one that was never heard is not."""
    return belief is not None and _level(belief, config.full_when) > config.full_threshold


def _level(belief: Belief, full_when: FullWhen) -> float:
    """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
    return belief.primary if full_when is FullWhen.PRIMARY else min(belief.primary, belief.secondary)


class ChargingWatch:
    """Gives an aMussel up after the scenario's `silence_timeout_s` without a gain in believed charge."""

    def __init__(self, config: Mission) -> None:
        self._config = config
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
            if belief is not None and (level := _level(belief, self._config.full_when)) > best:
                best, gained_ms = level, now_ms
            self._best[agent_id] = (best, gained_ms)
            if (
                not is_full(belief, self._config)
                and agent_id not in self._given_up
                and now_ms - gained_ms > self._config.silence_timeout_s * 1000
            ):
                self._given_up.add(agent_id)
                given_up.append((agent_id, "its believed charge does not rise"))
        return given_up

    def done(self, docked: Mapping[int, Belief | None]) -> bool:
        """Every docked aMussel is believed full, or was given up."""
        return all(
            agent_id in self._given_up or is_full(belief, self._config) for agent_id, belief in docked.items()
        )

"""Watches the docked aMussels; the mission does not wait for one that is silent or whose charge does not rise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.schema import FullWhen, Mission


def is_full(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed full, by the scenario's definition; one that was never heard is not."""
    return belief is not None and _level(belief, config.full_when) > config.full_threshold


def is_charged(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed full, or above the scenario's `charge_to`, at which it makes room for others."""
    threshold = config.full_threshold if config.charge_to is None else config.charge_to
    return belief is not None and _level(belief, config.full_when) > threshold


def _level(belief: Belief, full_when: FullWhen) -> float:
    """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
    return belief.primary if full_when is FullWhen.PRIMARY else min(belief.primary, belief.secondary)


class ChargingWatch:
    """Gives an aMussel up after the scenario's `silence_timeout_s` without a gain in believed charge.

    The time begins with `begin`, and anew after `restart`.
    """

    def __init__(self, config: Mission) -> None:
        self.config = config
        self._best: dict[int, tuple[float, int]] = {}
        self._given_up: set[int] = set()

    def begin(self, docked: Iterable[int], now_ms: int) -> None:
        """Watches these docked aMussels from now on; nothing changes for those that it watches already."""
        for agent_id in docked:
            self._best.setdefault(agent_id, (-1.0, now_ms))

    def restart(self, agent_id: int) -> None:
        """Watches an aMussel anew, as one that was docked just now."""
        self._best.pop(agent_id, None)
        self._given_up.discard(agent_id)

    def give_up_stalled(self, docked: Mapping[int, Belief | None], now_ms: int) -> list[tuple[int, str]]:
        """Takes the beliefs of all docked aMussels; returns (agent, reason) for each aMussel that it gives up now."""
        for agent_id in self._best.keys() - docked.keys():
            self.restart(agent_id)
        given_up: list[tuple[int, str]] = []
        for agent_id, belief in sorted(docked.items()):
            best, gained_ms = self._best.get(agent_id, (-1.0, now_ms))
            if belief is not None and (level := _level(belief, self.config.full_when)) > best:
                best, gained_ms = level, now_ms
            self._best[agent_id] = (best, gained_ms)
            if (
                not is_full(belief, self.config)
                and agent_id not in self._given_up
                and now_ms - gained_ms > self.config.silence_timeout_s * 1000
            ):
                self._given_up.add(agent_id)
                given_up.append((agent_id, "its believed charge does not rise"))
        return given_up

    def has_given_up(self, agent_id: int) -> bool:
        return agent_id in self._given_up

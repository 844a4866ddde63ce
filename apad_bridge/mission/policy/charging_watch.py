"""Watches the docked aMussels; the mission does not wait for one that is silent or whose charge does not rise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.policy.charged_enough import counted_charge, is_full
from apad_bridge.scenario.blocks.mission_options import Mission


class ChargingWatch:
    """Gives an aMussel up after the scenario's `silence_timeout_s` without a gain in believed charge.

    The time begins with `begin`, and anew after `restart`, which has to follow each change of a dock.
    """

    def __init__(self, config: Mission) -> None:
        self.config = config
        self._best: dict[int, tuple[float, int]] = {}
        self._given_up: set[int] = set()

    def begin(self, docked: Iterable[int], now_ms: MissionMs) -> None:
        """Watches these docked aMussels from now on; nothing changes for those that it watches already."""
        for agent_id in docked:
            self._best.setdefault(agent_id, (-1.0, now_ms))

    def restart(self, agent_id: int) -> None:
        """Forgets an aMussel that was docked or released, or whose dock did not open: it is watched anew."""
        self._best.pop(agent_id, None)
        self._given_up.discard(agent_id)

    def give_up_stalled(
        self, docked: Mapping[int, Belief | None], now_ms: MissionMs
    ) -> list[tuple[int, str]]:
        """Takes the beliefs of all docked aMussels; returns (agent, reason) for each aMussel that it gives up now."""
        for agent_id in self._best.keys() - docked.keys():
            self.restart(agent_id)
        given_up: list[tuple[int, str]] = []
        for agent_id, belief in sorted(docked.items()):
            best, gained_ms = self._best.get(agent_id, (-1.0, now_ms))
            if belief is not None and (level := counted_charge(belief, self.config)) > best:
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

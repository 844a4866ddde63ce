"""Watches the docked aMussels; the mission does not wait for one that is silent or whose charge does not rise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.planning import exchange_of_places
from apad_bridge.scenario.schema import FullWhen, Mission


def is_full(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed full, by the scenario's definition; one that was never heard is not."""
    return belief is not None and counted_charge(belief, config) > config.full_threshold


def is_charged(belief: Belief | None, config: Mission) -> bool:
    """The aMussel is believed to have charge enough to make room for an empty one at least."""
    return makes_room(belief, config, 0.0)


def makes_room(belief: Belief | None, config: Mission, waiting_charge: float) -> bool:
    """The aMussel makes room for one with `waiting_charge`: it is believed above the scenario's `charge_to`, or to lead."""
    if belief is None:
        return False
    charge, above = counted_charge(belief, config), room_above(config)
    return exchange_of_places.makes_room(charge, waiting_charge, above, config.charge_lead)


def room_above(config: Mission) -> float:
    """The charge above which a docked aMussel makes room for any that waits."""
    return config.full_threshold if config.charge_to is None else config.charge_to


def counted_charge(belief: Belief, config: Mission) -> float:
    """The charge that counts: the primary battery's, or the lower of both, as the scenario says."""
    is_primary = config.full_when is FullWhen.PRIMARY
    return belief.primary if is_primary else min(belief.primary, belief.secondary)


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

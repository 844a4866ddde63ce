"""Selects aMussels for collection, by beliefs only.

An aMussel's believed state is that of its last packet, or of a belief that is carried past that packet.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import DOCKED, LIKELY, Mode
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.scenario.blocks.mission_options import Mission, Suspects
from firmware_model.state_groups import BEYOND_HELP, TO_BE_FETCHED
from firmware_model.states import State


def floats(belief: Belief) -> bool:
    if belief.is_predicted:
        return belief.probability_of(Mode.FLOATING) >= LIKELY
    return belief.state is State.FLOATING


def is_surfacing_or_floating(belief: Belief) -> bool:
    """The aMussel floats, or is on its way to the surface."""
    if belief.is_predicted:
        return belief.probability_of(Mode.SURFACING, Mode.FLOATING) >= LIKELY
    return belief.state in (State.FLOATING, State.SURFACING)


def can_be_fetched(belief: Belief) -> bool:
    """An aPad that goes there and permits surfacing finds the aMussel."""
    if belief.is_predicted:
        return belief.probability_of(*DOCKED, Mode.LOST) < LIKELY
    return belief.state in TO_BE_FETCHED


class ChargingPool:
    """The paper's charging selection pool, without the aMussels that are excluded for a while."""

    def __init__(self, config: Mission, beliefs: BeliefSource) -> None:
        self.config = config
        self._beliefs = beliefs
        self._excluded_until_ms: dict[int, int] = {}

    def candidates(
        self, now_ms: MissionMs, left_alone: Container[int] = (), served: Container[int] = ()
    ) -> list[Belief]:
        """The aMussels heard of late, in the water, at or below the pool's threshold and not lost, by id; with suspects
        that the scenario has fetched for a look.

        Without those that are `left_alone`. Those that were `served` wait until one is at or below `again_threshold`, but
        for those that float: at the surface an aMussel spends most.
        """
        low = [
            belief
            for belief in self._beliefs.all()
            if belief.agent_id not in left_alone and self._is_candidate(belief, now_ms)
        ]
        again = self.config.again_threshold
        if again is None or any(it.probability_at_most(again) >= LIKELY for it in low):
            return low
        return [it for it in low if it.agent_id not in served or floats(it)]

    def batch_of(self, candidates: Sequence[Belief], left_alone: Container[int] = ()) -> int:
        """The number of candidates to collect now; 0 means to wait for more.

        The batch is never larger than the number of aMussels that can still come up and are not `left_alone`.
        The mission does not wait at all while a candidate floats, which surfaced to survive or was not docked when the
        aPad came for it: at the surface it spends most.
        """
        left = sum(
            belief.state not in BEYOND_HELP and belief.agent_id not in left_alone
            for belief in self._beliefs.all()
        )
        batch = min(self.config.batch, max(1, left))
        if len(candidates) >= batch:
            return batch
        return len(candidates) if any(it.state is State.FLOATING for it in candidates) else 0

    def is_low(self, belief: Belief) -> bool:
        """The aMussel is likely at or below the pool's threshold."""
        return belief.probability_at_most(self.config.pool_threshold) >= LIKELY

    def _wants_a_look(self, belief: Belief) -> bool:
        suspicion = belief.suspicion
        return self.config.suspects is Suspects.FETCHED and suspicion is not None and not suspicion.was_docked

    def exclude(self, agent_id: int, now_ms: MissionMs) -> None:
        self._excluded_until_ms[agent_id] = now_ms + self._silence_ms

    @property
    def _silence_ms(self) -> int:
        return round(self.config.silence_timeout_s * 1000)

    def _is_candidate(self, belief: Belief, now_ms: MissionMs) -> bool:
        return (
            can_be_fetched(belief)
            and (self.is_low(belief) or self._wants_a_look(belief))
            and (belief.primary > 0 or belief.secondary > 0)
            and self._excluded_until_ms.get(belief.agent_id, now_ms) <= now_ms
            and (belief.is_predicted or now_ms - belief.heard_ms <= self._silence_ms)
            and not belief.is_of_another_board
        )

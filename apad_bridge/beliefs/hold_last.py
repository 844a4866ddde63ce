"""The plainest estimator: an aMussel is what its newest packet said. What is not heard is not known."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from apad_bridge.beliefs.belief import Belief
from firmware_model.packets import ShortStatus, StatusPacket


class HoldLast:
    """Beliefs by agent id, for the ids of one fleet."""

    def __init__(self, agent_ids: Iterable[int]) -> None:
        self._known = frozenset(agent_ids)
        self._beliefs: dict[int, Belief] = {}
        self._newest_ms: dict[int, int] = {}

    def get(self, agent_id: int) -> Belief | None:
        return self._beliefs.get(agent_id)

    def all(self) -> list[Belief]:
        """Every aMussel that was ever heard, by id."""
        return [self._beliefs[agent_id] for agent_id in sorted(self._beliefs)]

    def hear(self, packet: StatusPacket, at_ms: int) -> str | None:
        """Believes the packet heard at mission time `at_ms`; or says why not, and nothing has changed."""
        if packet.agent_id not in self._known:
            return "a status of an unknown aMussel"
        numbers = (packet.north_m, packet.east_m, packet.depth_m, packet.primary, packet.secondary)
        if not all(map(math.isfinite, numbers)):
            return "a status with a number that is not finite"
        if not (0 <= packet.primary <= 1 and 0 <= packet.secondary <= 1):
            return "a status with a charge outside [0, 1]"
        if packet.agent_ms < self._newest_ms.get(packet.agent_id, -1):
            return "a status that a newer one overtook"
        self._newest_ms[packet.agent_id] = packet.agent_ms
        self._beliefs[packet.agent_id] = Belief(
            packet.agent_id,
            at_ms,
            packet.state,
            packet.primary,
            packet.secondary,
            packet.north_m,
            packet.east_m,
        )
        return None

    def hear_short(self, packet: ShortStatus, at_ms: int) -> str | None:
        """As `hear`; the place stays what it was believed to be."""
        before = self._beliefs.get(packet.agent_id)
        if before is None:
            return "a short status of an aMussel whose place is not known"
        self._beliefs[packet.agent_id] = replace(
            before, heard_ms=at_ms, state=packet.state, primary=packet.primary, secondary=packet.secondary
        )
        return None

"""Rules of a mission that plans for its end: more charge than lasts until then is of no use to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from apad_bridge.scenario.schema import Mission

LEAST_SERVICE = 0.2
"""A service for less charge than this is taken as not worth its way."""


@dataclass(frozen=True, slots=True)
class KnownEnd:
    """`end_s` is of mission time, and `drain_per_s` the charge that an aMussel at work spends in a second of it."""

    end_s: float
    drain_per_s: float

    def lasting_charge(self, now_ms: int) -> float:
        """The charge with which an aMussel works from now until the end."""
        return max(0.0, self.drain_per_s * (self.end_s - now_ms / 1000))

    def is_worth_a_service(self, now_ms: int) -> bool:
        return self.lasting_charge(now_ms) >= LEAST_SERVICE

    def rules(self, rules: Mission, now_ms: int) -> Mission:
        """The mission's rules with no threshold above the charge that lasts."""
        most = self.lasting_charge(now_ms)
        return replace(
            rules,
            pool_threshold=min(rules.pool_threshold, most),
            again_threshold=None if rules.again_threshold is None else min(rules.again_threshold, most),
            full_threshold=min(rules.full_threshold, most),
            charge_to=None if rules.charge_to is None else min(rules.charge_to, most),
        )

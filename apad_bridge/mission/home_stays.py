"""When the aPad goes home, and when it may leave: because of its battery, or because it is unavailable."""

from __future__ import annotations

from collections.abc import Sequence

from agents.time_scale import MissionMs
from apad_bridge.mission.end_by import EndBy
from apad_bridge.scenario.schema import DockedAtHome, Home, Unavailable


class HomeStays:
    """Answers for a mission; `place_m` is home, (north, east) in metres. The aPad's battery is None until it was heard."""

    def __init__(
        self,
        place_m: tuple[float, float],
        home: Home | None,
        unavailable: Sequence[Unavailable],
        end_by: EndBy | None = None,
    ) -> None:
        """`end_by` says when it goes home for good; None for never."""
        self.place_m = place_m
        self._home = home
        self._unavailable = unavailable
        self.end_by = end_by

    @property
    def releases_first(self) -> bool:
        """Docked aMussels leave before the aPad goes home."""
        return self._home is not None and self._home.docked is DockedAtHome.RELEASED

    def must_go(self, now_ms: MissionMs, battery: float | None) -> bool:
        is_low = self._home is not None and battery is not None and battery <= self._home.go_at
        return is_low or self._is_unavailable(now_ms)

    def may_leave(self, now_ms: MissionMs, battery: float | None) -> bool:
        is_charged = battery is None or battery >= self.leaves_at
        return is_charged and not self._is_unavailable(now_ms)

    @property
    def leaves_at(self) -> float:
        """The battery from which on it may leave; 0 if that does not matter."""
        return 0.0 if self._home is None else self._home.leave_at

    def next_call_ms(self, now_ms: MissionMs) -> int | None:
        """When it becomes unavailable next; None for never."""
        starts_ms = [round(it.from_s * 1000) for it in self._unavailable]
        return min((it for it in starts_ms if it > now_ms), default=None)

    def _is_unavailable(self, now_ms: MissionMs) -> bool:
        return any(it.from_s * 1000 <= now_ms < it.until_s * 1000 for it in self._unavailable)


NO_HOME = HomeStays((0.0, 0.0), None, ())
"""The rule of an aPad that is never called home."""

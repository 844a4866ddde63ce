"""The way home: because of the aPad's battery, while it is unavailable, or for good when the time to be there is near."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionEnd, Phase
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.end_by import EndBy
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.phase_behaviour import PhaseAct, PhaseBehaviour
from apad_bridge.mission.policy.planner import Planner
from apad_bridge.scenario.schema import DockedAtHome, Home, Unavailable

HOME_AGAIN_MS = 10_000
"""A failed way home for good is tried again after so long: the time to be there is near."""


class HomeStays:
    """Decides when a mission's aPad goes home, and when it may leave.

    `place_m` is home, (north, east) in metres. The aPad's battery is None until it was heard.
    """

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


class GoingHome:
    """Brings the aPad home: to be charged, while it is unavailable, or for good when the time to be there is near."""

    def __init__(
        self,
        book: OrderBook,
        planner: Planner,
        stays: HomeStays,
        next_step: PhaseAct,
        end: Callable[[MissionEnd, MissionMs], None],
    ) -> None:
        self._book = book
        self._planner = planner
        self._stays = stays
        self._next_step = next_step
        self._end = end
        self.for_good = False
        """The docked aMussels go back as they are, and the aPad goes home. A resumed mission finds it out again."""
        self._failed_ms: int | None = None
        """The time at which a way home failed; it is not tried again for a while."""

    @property
    def phases(self) -> dict[Phase, PhaseBehaviour]:
        return {
            Phase.GO_HOME: PhaseBehaviour(self.go, success=self._arrive, failure=self._miss),
            Phase.AT_HOME: PhaseBehaviour(self.go, decide=self._decide),
        }

    @property
    def releases_first(self) -> bool:
        """Docked aMussels leave before the aPad goes home."""
        return self.for_good or self._stays.releases_first

    @property
    def leaves_at(self) -> float | None:
        """The aPad's battery at which it leaves its home; None while it is not there."""
        return self._stays.leaves_at if self._book.state.phase is Phase.AT_HOME else None

    def must_return(self, now_ms: MissionMs, fetched: Belief | None) -> bool:
        """True once no time is left but for the way home, with the aMussel that the aPad is fetching."""
        if self._stays.end_by is None:
            return False
        homes, here = self._planner.places.all(), self._book.here
        releases_m = [homes.get(it, here) for it in self._planner.to_release]
        fetched_m = None if fetched is None else (fetched.north_m, fetched.east_m)
        return self._stays.end_by.must_return(now_ms, here, releases_m, fetched_m)

    def is_called(self, now_ms: MissionMs) -> bool:
        patience_ms = HOME_AGAIN_MS if self.for_good else self._planner.config.silence_timeout_s * 1000
        if self._failed_ms is not None and now_ms - self._failed_ms <= patience_ms:
            return False
        return self.for_good or self._stays.must_go(now_ms, self._book.apad_battery)

    def go(self, now_ms: MissionMs) -> None:
        self._book.order_go_to(self._stays.place_m, self._planner.config)
        self._book.enter(Phase.GO_HOME, now_ms, plan=())

    def _arrive(self, now_ms: MissionMs) -> None:
        self._failed_ms = None
        if self.for_good:
            self._end(MissionEnd(EndReason.END_BY), now_ms)
            return
        self._book.order_hold()
        self._book.enter(Phase.AT_HOME, now_ms)

    def _miss(self, reason: str, now_ms: MissionMs) -> None:
        self._failed_ms = now_ms
        self._next_step(now_ms)

    def _decide(self, now_ms: MissionMs) -> PhaseAct | None:
        leaves = self.for_good or self._stays.may_leave(now_ms, self._book.apad_battery)
        return self._next_step if leaves else None

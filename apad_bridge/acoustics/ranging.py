"""The aPad's acoustic service beside its mission: schedules its packets, and turns answered pings into places."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

from agents.time_scale import MissionMs
from apad_bridge.acoustics.locator import Locator, RangeTaken
from apad_bridge.acoustics.schedule import AcousticScheduler
from apad_bridge.beliefs import modes
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import Fixed, Ranged
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.pings import PingPolicy, ids_to_ping
from apad_bridge.events.sound_events import PlaceFixed, RangeMeasured
from apad_bridge.mission.facts import Ping, RangeHeard, Send, SupervisorAction
from apad_bridge.vehicle.commands import PoseReported
from firmware_model.state_groups import DOCKED, UP_AND_UNDOCKED

_AWAY = DOCKED | UP_AND_UNDOCKED
_RANGE, _MOVED = "range", "moved"


@dataclass(frozen=True, slots=True)
class Moved:
    """The aMussel was moved: its ranges hold no longer."""

    agent_id: int


RangesChanged = RangeTaken | Moved


def _row_of(change: RangesChanged) -> list[Any]:
    return [_MOVED if isinstance(change, Moved) else _RANGE, *astuple(change)]


def _change_of(row: Sequence[Any]) -> RangesChanged:
    """The inverse of `_row_of`; KeyError or TypeError for another row."""
    kind: type[RangesChanged] = {_RANGE: RangeTaken, _MOVED: Moved}[row[0]]
    return kind(*row[1:])


class RangingService:
    """Ranges aMussels and asks for their status. The supervisor owns it and calls it at ticks."""

    def __init__(
        self,
        scheduler: AcousticScheduler,
        locator: Locator | None,
        keel_m: float,
        depth_m: float,
        deviation_m: float,
        places: PingPolicy | None = None,
        charges: PingPolicy | None = None,
    ) -> None:
        """`deviation_m` is the standard deviation of a range. Without a `locator` pings give delays and no places.

        `places` decides which aMussels are pinged because their place is too uncertain, `charges` which are asked for their
        status.
        """
        self._places = places
        self._charges = charges
        self._scheduler = scheduler
        self._locator = locator
        self._keel_m = keel_m
        self._depth_m = depth_m
        self._deviation_m = deviation_m
        self._to_ping: set[int] = set()
        """The aMussels that a person wants pinged."""
        self._changes: list[RangesChanged] = []
        """Changes since the last `full_state` or `updates`."""
        self._last_scheduler_state: dict[str, Any] = scheduler.full_state()

    @property
    def dropped(self) -> Counter[str]:
        counts = Counter() if self._locator is None else self._locator.dropped.copy()
        if self._scheduler.unanswered:
            counts["sound: asked how it was, and no answer came in time"] = self._scheduler.unanswered
        return counts

    def full_state(self) -> dict[str, Any]:
        """Everything that was learned, as plain data; `updates` returns the later changes."""
        self._changes, self._last_scheduler_state = [], self._scheduler.full_state()
        ranges = [] if self._locator is None else [_row_of(it) for it in self._locator.ranges]
        return {"talk": self._last_scheduler_state, "ranges": ranges}

    def updates(self) -> dict[str, Any] | None:
        """The changes since the last call of `full_state` or `updates`; None if there are none."""
        scheduler_state = self._scheduler.full_state()
        if scheduler_state == self._last_scheduler_state and not self._changes:
            return None
        changes, self._changes, self._last_scheduler_state = self._changes, [], scheduler_state
        return {"talk": scheduler_state, "rows": [_row_of(it) for it in changes]}

    def restore(self, state: dict[str, Any]) -> None:
        """Takes over another service's `full_state`; KeyError, TypeError or ValueError for any other data."""
        self._scheduler.restore(state["talk"])
        self.apply_updates({"talk": state["talk"], "rows": state["ranges"]})

    def apply_updates(self, updates: dict[str, Any]) -> None:
        """Applies another service's `updates`."""
        self._scheduler.restore(updates["talk"])
        for row in updates["rows"]:
            if self._locator is None:
                continue
            match _change_of(row):
                case Moved(agent_id):
                    self._locator.forget(agent_id)
                case RangeTaken() as taken:
                    self._locator.remember(taken)

    def advance(self, beliefs: Sequence[Belief], now_ms: MissionMs) -> list[SupervisorAction]:
        away = frozenset(it.agent_id for it in beliefs if _is_away(it))
        cannot_hear, self._to_ping = self._to_ping & away, self._to_ping - away
        unanswered = [RangeMeasured(it, None) for it in sorted(cannot_hear)]
        near = [it for it in beliefs if not (it.agent_id in away or it.is_of_another_board)]
        whereabouts, charges = (
            [] if policy is None else ids_to_ping(policy, near, now_ms)
            for policy in (self._places, self._charges)
        )
        actions = self._scheduler.advance(now_ms, away, [*sorted(self._to_ping), *whereabouts], charges)
        self._to_ping -= {it.agent_id for it in actions if isinstance(it, Ping)}
        return [*unanswered, *actions]

    def ping(self, agent_id: int) -> None:
        """Pings the aMussel for a person as soon as the aPad may; one that is afloat or in a dock hears no ping."""
        self._to_ping.add(agent_id)

    def short_status_received(self, agent_id: int) -> None:
        """Called for each short status of an aMussel, requested or not."""
        self._scheduler.short_status_received(agent_id)

    def send(self, send: Send, now_ms: MissionMs) -> Send | None:
        """The packet with the time at which the modem may send it; None if the same packet waits already."""
        return self._scheduler.send(send, now_ms)

    def moved(self, agent_id: int, now_ms: MissionMs) -> None:
        """Called when a dock closed around an aMussel or released it, or when another body has its id."""
        self._scheduler.moved(agent_id, now_ms)
        if self._locator is not None:
            self._locator.forget(agent_id)
            self._changes.append(Moved(agent_id))

    def start_serving(self, agent_id: int, now_ms: MissionMs) -> None:
        """Called when this aPad serves an aMussel that another one served."""
        self._scheduler.start_serving(agent_id, now_ms)

    def stop_serving(self, agent_id: int) -> None:
        """Called when another aPad serves an aMussel from now on: nothing more is sent to it of this aPad's own accord."""
        self._scheduler.stop_serving(agent_id)
        self._to_ping.discard(agent_id)

    def hear(
        self, fact: RangeHeard, pose: PoseReported | None, beliefs: FleetBeliefs, now_ms: MissionMs
    ) -> list[SupervisorAction]:
        """Takes a ping's outcome, which may give a timeslot, and a place or range that `beliefs` learn."""
        if fact.range_m is None:
            return []
        actions = self._scheduler.ping_answered(fact.agent_id, fact.range_m, now_ms)
        if self._locator is None or pose is None:
            return actions
        taken = RangeTaken(fact.at_ms, fact.agent_id, fact.range_m, pose.north_m, pose.east_m, self._keel_m)
        self._changes.append(taken)
        belief = beliefs.get(fact.agent_id)
        fix = self._locator.take(taken, None if belief is None else (belief.north_m, belief.east_m))
        if fix is None:
            self._learn_range(taken, beliefs)
            return actions
        variance_m2 = (fix.covariance[0] + fix.covariance[2]) / 2
        beliefs.learn(taken.agent_id, Fixed(fix.north_m, fix.east_m, variance_m2), taken.at_ms)
        return [*actions, _rounded(fix)]

    def _learn_range(self, taken: RangeTaken, beliefs: FleetBeliefs) -> None:
        down_m = self._depth_m - self._keel_m
        along_m = math.sqrt(max(0.0, taken.range_m**2 - down_m**2))
        ranged = Ranged(along_m, taken.north_m, taken.east_m, self._deviation_m**2)
        beliefs.learn(taken.agent_id, ranged, taken.at_ms)


def _is_away(belief: Belief) -> bool:
    """True if an aMussel is docked or afloat, and cannot receive: for a carried belief, more probably than not."""
    if belief.is_predicted:
        return belief.probability_of(*modes.DOCKED, Mode.FLOATING) > 0.5
    return belief.state in _AWAY


def _rounded(fix: PlaceFixed) -> PlaceFixed:
    return replace(
        fix,
        north_m=round(fix.north_m, 3),
        east_m=round(fix.east_m, 3),
        covariance=[round(it, 6) for it in fix.covariance],
        hdop=round(fix.hdop, 3),
        residual_m=round(fix.residual_m, 4),
    )

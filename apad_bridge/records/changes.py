"""Decides which changes get a line in the journal, so that a long run's journal stays small."""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, isnan, radians

from agents.mussel.outputs import Truth
from apad_bridge.beliefs.belief import Belief, CapacityLeft
from apad_bridge.events.fleet import BeliefChanged, CapacityLearned
from apad_bridge.events.vehicle import APadMoved
from apad_bridge.records.samples import APadSample

MUSSEL_MOVED_UM = 250_000
APAD_MOVED_M = 0.05
APAD_TURNED_COS = cos(radians(5))
APAD_BATTERY = 0.005
APAD_PERIOD_MS = 60_000
BELIEVED_CHARGE = 0.01
CAPACITY_LEFT = 0.01
HEARD_AGAIN_MS = 60_000
"""A carried belief is journaled again when its newest packet is newer by this."""


def differs_in_kind(now: Truth, before: Truth) -> bool:
    """True if the state, a battery's anchor, the log, or being in a dock changed."""
    new, old = now.physical, before.physical
    return (
        now.state is not before.state
        or new.docked is not old.docked
        or new.samples != old.samples
        or new.acknowledged != old.acknowledged
        or (new.primary is not old.primary and new.primary != old.primary)
        or (new.secondary is not old.secondary and new.secondary != old.secondary)
    )


def has_moved(now: Truth, before: Truth) -> bool:
    """True if it moved by more than a quarter of a metre by itself: a docked aMussel moves with the aPad."""
    new, old = now.physical, before.physical
    if new.docked:
        return False
    return hypot(new.north_um - old.north_um, new.east_um - old.east_um) > MUSSEL_MOVED_UM


class APadChanges:
    """Journals the aPad when it moved, turned, used energy, changed its primitive or docks, or had no line for a minute."""

    def __init__(self) -> None:
        self._last: tuple[int, APadSample] | None = None

    def event(self, now_ms: int, apad: APadSample) -> APadMoved | None:
        if self._last is not None and not self._differs(now_ms, apad, *self._last):
            return None
        self._last = (now_ms, apad)
        return APadMoved(
            round(apad.north_m, 3),
            round(apad.east_m, 3),
            round(apad.heading_rad, 4),
            _or_none(apad.voltage_v),
            _or_none(apad.battery_fraction),
            apad.primitive,
            list(apad.docks),
        )

    def _differs(self, now_ms: int, apad: APadSample, before_ms: int, before: APadSample) -> bool:
        return (
            now_ms - before_ms >= APAD_PERIOD_MS
            or hypot(apad.north_m - before.north_m, apad.east_m - before.east_m) > APAD_MOVED_M
            or cos(apad.heading_rad - before.heading_rad) < APAD_TURNED_COS
            or isnan(apad.battery_fraction) is not isnan(before.battery_fraction)
            or abs(apad.battery_fraction - before.battery_fraction) >= APAD_BATTERY
            or (apad.primitive, apad.docks) != (before.primitive, before.docks)
        )


class BeliefChanges:
    """Journals a belief when its state changed, its charge moved by a hundredth, or a reported quantity by its step."""

    def __init__(self) -> None:
        self._last: dict[int, Belief] = {}

    def events(self, beliefs: list[Belief]) -> list[BeliefChanged]:
        return [_event_of(belief) for belief in beliefs if self._is_new(belief)]

    def _is_new(self, belief: Belief) -> bool:
        before = self._last.get(belief.agent_id)
        if before is belief or (before is not None and not _differs(before, belief)):
            return False
        self._last[belief.agent_id] = belief
        return True


class CapacityChanges:
    """Journals what is left of a capacity when an end of its interval moved by a hundredth."""

    def __init__(self) -> None:
        self._last: dict[int, CapacityLeft] = {}

    def events(self, beliefs: list[Belief]) -> list[CapacityLearned]:
        return [
            CapacityLearned(belief.agent_id, round(now.low, 4), round(now.high, 4))
            for belief in beliefs
            if (now := belief.capacity_left) is not None and self._is_new(belief.agent_id, now)
        ]

    def _is_new(self, agent_id: int, now: CapacityLeft) -> bool:
        before = self._last.get(agent_id)
        if before is not None and max(abs(now.low - before.low), abs(now.high - before.high)) < CAPACITY_LEFT:
            return False
        self._last[agent_id] = now
        return True


def _event_of(belief: Belief) -> BeliefChanged:
    event = BeliefChanged(
        belief.agent_id,
        belief.heard_ms,
        belief.state,
        round(belief.primary, 5),
        round(belief.secondary, 5),
        round(belief.north_m, 3),
        round(belief.east_m, 3),
        reported=belief.reported.stated or None,
    )
    if not belief.is_predicted:
        return event
    low, high = belief.charge_interval()
    return replace(
        event,
        sd=round(belief.charge_cov[0] ** 0.5, 5),
        low=round(low, 5),
        high=round(high, 5),
        mode=belief.mode,
        place_cov=_rounded(belief.place_cov),
    )


def _differs(before: Belief, belief: Belief) -> bool:
    """True if a belief changed enough for a line. A carried belief's mode, deviation and packet time count too."""
    if belief.reported is not before.reported and belief.reported.is_news_after(before.reported):
        return True
    if not belief.is_predicted:
        return before.state is not belief.state or abs(before.primary - belief.primary) >= BELIEVED_CHARGE
    sds = before.charge_cov[0] ** 0.5, belief.charge_cov[0] ** 0.5
    step = max(min(BELIEVED_CHARGE, 0.3 * sds[1]), BELIEVED_CHARGE / 10)
    return (
        before.state is not belief.state
        or before.mode is not belief.mode
        or belief.heard_ms - before.heard_ms >= HEARD_AGAIN_MS
        or abs(before.primary - belief.primary) >= step
        or abs(sds[0] - sds[1]) >= step
    )


def _rounded(place_cov: tuple[float, float, float]) -> tuple[float, float, float]:
    north, between, east = place_cov
    return round(north, 4), round(between, 4), round(east, 4)


def _or_none(number: float) -> float | None:
    return None if isnan(number) else round(number, 5)

"""Decides which changes get a line in the journal, so that a long run's journal stays small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import cos, hypot, isnan, radians

from agents.mussel.outputs import Truth
from apad_bridge.beliefs.belief import NUMBERS, Belief, CapacityLeft
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import BeliefChanged, CapacityLearned
from apad_bridge.events.vehicle_events import APadMoved
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
    return not new.docked and hypot(new.north_um - old.north_um, new.east_um - old.east_um) > MUSSEL_MOVED_UM


class Changes:
    """Chooses from each tick the aPad, beliefs and capacities that get a line.

    The aPad, when it moved, turned, used energy, changed its primitive or docks, or had no line for a minute. A belief,
    when its state changed, its charge moved by a hundredth, or one of `NUMBERS` by its step. A capacity, when an end of
    its interval moved by a hundredth.
    """

    def __init__(self) -> None:
        self._apad: tuple[int, APadSample] | None = None
        self._beliefs: dict[int, Belief] = {}
        self._capacities: dict[int, CapacityLeft] = {}

    def events(self, now_ms: int, apad: APadSample | None, beliefs: Sequence[Belief]) -> list[Event]:
        events: list[Event] = []
        if apad is not None and (self._apad is None or _apad_differs(now_ms, apad, *self._apad)):
            self._apad = now_ms, apad
            events.append(_apad_event(apad))
        learned: list[Event] = []
        for belief in beliefs:
            agent_id, now = belief.agent_id, belief.capacity_left
            before, capacity = self._beliefs.get(agent_id), self._capacities.get(agent_id)
            if before is not belief and (before is None or _differs(before, belief)):
                self._beliefs[agent_id] = belief
                events.append(_event_of(belief))
            if now is not None and (
                capacity is None
                or max(abs(now.low - capacity.low), abs(now.high - capacity.high)) >= CAPACITY_LEFT
            ):
                self._capacities[agent_id] = now
                learned.append(CapacityLearned(agent_id, round(now.low, 4), round(now.high, 4)))
        return events + learned


def _apad_event(apad: APadSample) -> APadMoved:
    return APadMoved(
        north_m=round(apad.north_m, 3),
        east_m=round(apad.east_m, 3),
        heading_rad=round(apad.heading_rad, 4),
        voltage_v=_or_none(apad.voltage_v),
        battery=_or_none(apad.battery_fraction),
        primitive=apad.primitive,
        docks=list(apad.docks),
    )


def _apad_differs(now_ms: int, apad: APadSample, before_ms: int, before: APadSample) -> bool:
    return (
        now_ms - before_ms >= APAD_PERIOD_MS
        or hypot(apad.north_m - before.north_m, apad.east_m - before.east_m) > APAD_MOVED_M
        or cos(apad.heading_rad - before.heading_rad) < APAD_TURNED_COS
        or isnan(apad.battery_fraction) is not isnan(before.battery_fraction)
        or abs(apad.battery_fraction - before.battery_fraction) >= APAD_BATTERY
        or (apad.primitive, apad.docks) != (before.primitive, before.docks)
    )


def _event_of(belief: Belief) -> BeliefChanged:
    event = BeliefChanged(
        id=belief.agent_id,
        heard=belief.heard_ms,
        state=belief.state,
        charge=round(belief.primary, 5),
        secondary=round(belief.secondary, 5),
        north_m=round(belief.north_m, 3),
        east_m=round(belief.east_m, 3),
        reported={name: value for name, it in NUMBERS.items() if (value := it.of(belief)) is not None}
        or None,
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
    for it in NUMBERS.values():
        was, now = it.of(before), it.of(belief)
        if now is not was and now is not None and (was is None or abs(now - was) >= it.quantity.step):
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

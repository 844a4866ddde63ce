"""A forecast of a flight: the next pick-up, when the batch is full, when the mission ends, and the aPad's battery then.

It rests on what was measured in this flight: how fast aMussels were believed to discharge and to charge of late, and how
fast the aPad's battery fell. Ways are straight lines at the mission's speed, and every docking succeeds. What was not
measured yet is not foretold. It is for people and programs that watch; the mission does not use it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission import MissionState, Phase
from apad_bridge.mission.pool import can_be_fetched
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.schema import Mission
from firmware_model.state_groups import DOCKED

_LOOK_MS = 5_000
"""Beliefs are looked at so often."""
_WINDOW_MS, _SHORTEST_MS = 60_000, 15_000
"""Charges of this time, and at least of this, give a rate."""
_BATTERY_MS = 60_000
"""The aPad's battery is foretold after so long a flight."""
Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Forecast:
    """Mission seconds from now; None for what cannot be foretold."""

    next_pickup_s: float | None = None
    """Until a dock closes around the next aMussel."""
    batch_full_s: float | None = None
    """Until the batch that is aboard, or that is collected next, is full."""
    mission_end_s: float | None = None
    apad_fraction_at_end: float | None = None
    """Charge of the aPad's battery then, 0 to 1."""


@dataclass(frozen=True, slots=True)
class _Reading:
    at_ms: int
    charge: float


class _Rates:
    """Recent rates of the aMussels' believed charges, per second; docked ones and others apart."""

    def __init__(self) -> None:
        self._readings: dict[tuple[int, bool], deque[_Reading]] = {}
        self._begun: dict[int, _Reading] = {}
        self._charged: deque[float] = deque(maxlen=32)
        """The mean rates of the charges that have ended."""
        self._looked_ms = -_LOOK_MS

    def is_due(self, now_ms: int) -> bool:
        return now_ms >= self._looked_ms + _LOOK_MS

    def take(self, beliefs: Iterable[Belief], now_ms: int) -> None:
        if not self.is_due(now_ms):
            return
        self._looked_ms = now_ms
        for belief in beliefs:
            docked = belief.state in DOCKED
            reading = _Reading(now_ms, belief.primary)
            readings = self._readings.setdefault((belief.agent_id, docked), deque())
            self._readings.pop((belief.agent_id, not docked), None)
            readings.append(reading)
            while now_ms - readings[0].at_ms > _WINDOW_MS:
                readings.popleft()
            if docked:
                self._begun.setdefault(belief.agent_id, reading)
            elif (begun := self._begun.pop(belief.agent_id, None)) is not None:
                self._end_charge(begun, reading)

    def of(self, agent_id: int, *, docked: bool) -> float | None:
        """The aMussel's own rate, or else the median of the others'."""
        own = _rate(self._readings.get((agent_id, docked), ()))
        if own is not None:
            return own
        others = [
            rate for (_, it), readings in self._readings.items() if it is docked and (rate := _rate(readings))
        ]
        if not others and docked:
            return median(self._charged) if self._charged else None
        return median(others) if others else None

    def _end_charge(self, begun: _Reading, ended: _Reading) -> None:
        span_s = (ended.at_ms - begun.at_ms) / 1000
        if span_s > 0 and ended.charge > begun.charge:
            self._charged.append((ended.charge - begun.charge) / span_s)


def _rate(readings: Sequence[_Reading]) -> float | None:
    if len(readings) < 2 or readings[-1].at_ms - readings[0].at_ms < _SHORTEST_MS:
        return None
    first, last = readings[0], readings[-1]
    return 1000 * (last.charge - first.charge) / (last.at_ms - first.at_ms)


class Forecaster:
    """Made once for a flight; `look` is called at least at every tick at which it `is_due`."""

    def __init__(self, config: Mission, duration_ms: int) -> None:
        self._config = config
        self._duration_ms = duration_ms
        self._rates = _Rates()
        self._battery: _Reading | None = None
        """The aPad's battery when it was first heard."""

    def is_due(self, now_ms: int) -> bool:
        """True if beliefs are to be looked at again, so that their rates are known."""
        return self._rates.is_due(now_ms)

    def look(
        self,
        now_ms: int,
        state: MissionState,
        beliefs: Sequence[Belief],
        place_m: Place | None,
        apad_fraction: float | None,
    ) -> Forecast:
        """The forecast as of now. `beliefs` are those of the aMussels that this aPad serves."""
        self._rates.take(beliefs, now_ms)
        if apad_fraction is not None and self._battery is None:
            self._battery = _Reading(now_ms, apad_fraction)
        if state.phase is Phase.ENDED:
            return Forecast()
        end_s, fraction = self._end(now_ms, apad_fraction)
        pickup_s = full_s = None
        if place_m is not None and state.phase not in (Phase.COMMANDED, Phase.STANDS_DOWN):
            pickup_s, full_s = self._next(now_ms, state, {it.agent_id: it for it in beliefs}, place_m)
        return Forecast(_before(pickup_s, end_s), _before(full_s, end_s), end_s, fraction)

    def _end(self, now_ms: int, apad_fraction: float | None) -> tuple[float, float | None]:
        left_s = max(0.0, (self._duration_ms - now_ms) / 1000)
        begun = self._battery
        if apad_fraction is None or begun is None or now_ms - begun.at_ms < _BATTERY_MS:
            return left_s, None
        fall = 1000 * (begun.charge - apad_fraction) / (now_ms - begun.at_ms)
        spare = max(0.0, apad_fraction - self._config.end_at_apad_fraction)
        if fall > 0:
            left_s = min(left_s, spare / fall)
        return left_s, max(0.0, apad_fraction - fall * left_s)

    def _next(
        self, now_ms: int, state: MissionState, known: dict[int, Belief], here_m: Place
    ) -> tuple[float | None, float | None]:
        """Until the next pick-up, and until a batch is full."""
        aboard = [known[agent_id] for _, agent_id in state.docked if agent_id in known]
        steps = [it for it in state.plan if it.agent_id in known]
        since_s = (now_ms - state.since_ms) / 1000
        if steps and steps[0].kind is StepKind.COLLECT:
            targets = [known[it.agent_id] for it in steps]
            done_s = since_s if state.phase is Phase.DOCK else 0.0
            times_s = self._pickups(targets, here_m, -min(done_s, self._config.docking.dock_s))
            return times_s[0], self._full_after(times_s, targets, aboard)
        if state.phase is Phase.CHARGE:
            full_s = self._full_after([0.0] * len(aboard), aboard, [])
            free_s, at_m = self._released(full_s, aboard, state, here_m)
            return self._collected(free_s, at_m, known, exclude=set())[0], full_s
        if steps:
            left = [known[it.agent_id] for it in steps]
            done_s = since_s if state.phase is Phase.UNDOCK else 0.0
            begin_s = -min(done_s, self._config.docking.undock_s)
            free_s, at_m = self._released(begin_s, left, state, here_m)
            return self._collected(free_s, at_m, known, exclude=set())
        return self._collected(0.0, here_m, known, exclude={it.agent_id for it in aboard})

    def _pickups(self, targets: Sequence[Belief], here_m: Place, begin_s: float) -> list[float]:
        """When each of the targets is docked, one after the other."""
        times_s, at_s = [], begin_s
        for target in targets:
            place_m = (target.north_m, target.east_m)
            at_s += self._way_s(here_m, place_m) + self._config.docking.dock_s
            times_s.append(max(0.0, at_s))
            here_m = place_m
        return times_s

    def _full_after(
        self, docked_s: Sequence[float], targets: Sequence[Belief], aboard: Sequence[Belief]
    ) -> float | None:
        """When all are full: the targets from when they are docked on, and those aboard from now on."""
        times_s = []
        for from_s, it in (*zip(docked_s, targets, strict=True), *((0.0, it) for it in aboard)):
            missing = self._config.full_threshold - it.primary
            rate = self._rates.of(it.agent_id, docked=True)
            if missing > 0 and (rate is None or rate <= 0):
                return None
            times_s.append(from_s + (missing / rate if missing > 0 and rate else 0.0))
        return max(times_s, default=None)

    def _released(
        self, begin_s: float | None, aboard: Sequence[Belief], state: MissionState, here_m: Place
    ) -> tuple[float | None, Place]:
        """When all are brought home and let go, the nearest home next; and where the aPad is then."""
        if begin_s is None:
            return None, here_m
        homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in state.homes}
        left = [homes.get(it.agent_id, here_m) for it in aboard]
        at_s = begin_s
        while left:
            place_m = min(left, key=lambda it: math.dist(it, here_m))
            left.remove(place_m)
            at_s += self._way_s(here_m, place_m) + self._config.docking.undock_s
            here_m = place_m
        return max(0.0, at_s), here_m

    def _collected(
        self, free_s: float | None, here_m: Place, known: dict[int, Belief], exclude: set[int]
    ) -> tuple[float | None, float | None]:
        """The next pick-up, and when that batch is full, of an aPad that is free from `free_s` on."""
        if free_s is None:
            return None, None
        low: list[tuple[float, Belief]] = []
        for belief in known.values():
            if belief.agent_id not in exclude and can_be_fetched(belief):
                above = belief.primary - self._config.pool_threshold
                rate = self._rates.of(belief.agent_id, docked=False)
                if above <= 0:
                    low.append((0.0, belief))
                elif rate is not None and rate < 0:
                    low.append((above / -rate, belief))
        low.sort(key=lambda it: it[0])
        batch = min(self._config.batch, max(1, len(known)))
        if len(low) < batch:
            return None, None
        begin_s = max(free_s, low[batch - 1][0])
        targets = []
        left, at_m = [it for _, it in low[:batch]], here_m
        while left:
            nearest = min(left, key=lambda it: math.dist((it.north_m, it.east_m), at_m))
            left.remove(nearest)
            targets.append(nearest)
            at_m = (nearest.north_m, nearest.east_m)
        times_s = self._pickups(targets, here_m, begin_s)
        return times_s[0], self._full_after(times_s, targets, [])

    def _way_s(self, here_m: Place, there_m: Place) -> float:
        way_m = math.dist(here_m, there_m) - self._config.victory_radius_m
        return max(0.0, way_m) / self._config.speed_m_s


def _before(time_s: float | None, end_s: float) -> float | None:
    """None for what comes after the mission's end."""
    return None if time_s is None or time_s > end_s else time_s

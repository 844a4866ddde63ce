"""A forecast of a flight: the next pick-up, when the batch is full, when the mission ends, and the aPad's battery then.

It projects the mission (`planning/projection.py`) by what was measured in this flight: how fast aMussels were believed to
discharge and to charge of late, and how fast the aPad's battery fell. The aPad goes to the nearest of the pool, and every
docking succeeds. What was not measured yet is not foretold. It is for people and programs that watch; the mission does not
use it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf
from statistics import median

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState, Phase
from apad_bridge.mission.policy.pool import can_be_fetched
from apad_bridge.mission.policy.situation import situation_of
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.projection import LEG_S, Projection
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.blocks.mission_options import Mission
from firmware_model.state_groups import DOCKED

_LOOK_MS = 5_000
"""Beliefs are looked at so often."""
_WINDOW_MS, _SHORTEST_MS = 60_000, 15_000
"""Charges of this time, and at least of this, give a rate."""
_BATTERY_MS = 60_000
"""The aPad's battery is foretold after so long a flight."""
_LEAST_DRAIN = 1e-12
"""The charge of an aMussel lasts beyond any mission; a projection divides by its drain."""
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
        self._typical: dict[bool, float | None] = {False: None, True: None}
        """The median of those in the water, and of the docked ones."""
        self._looked_ms = -_LOOK_MS

    def is_due(self, now_ms: MissionMs) -> bool:
        return now_ms >= self._looked_ms + _LOOK_MS

    def take(self, beliefs: Iterable[Belief], now_ms: MissionMs) -> None:
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
        for is_docked in (False, True):
            found = [_rate(it) for (_, at), it in self._readings.items() if at is is_docked]
            rates = [it for it in found if it] or (self._charged if is_docked else ())
            self._typical[is_docked] = median(rates) if rates else None

    def of(self, agent_id: int, *, docked: bool) -> float | None:
        """The aMussel's own rate, or else the median of the others'."""
        own = _rate(self._readings.get((agent_id, docked), ()))
        return self._typical[docked] if own is None else own

    def _end_charge(self, begun: _Reading, ended: _Reading) -> None:
        if (span_s := (ended.at_ms - begun.at_ms) / 1000) > 0 and ended.charge > begun.charge:
            self._charged.append((ended.charge - begun.charge) / span_s)


def _rate(readings: Sequence[_Reading]) -> float | None:
    if len(readings) < 2 or readings[-1].at_ms - readings[0].at_ms < _SHORTEST_MS:
        return None
    first, last = readings[0], readings[-1]
    return 1000 * (last.charge - first.charge) / (last.at_ms - first.at_ms)


class Forecaster:
    """Made once for a flight; `take` is called before each `look`, and at every tick at which it `is_due`."""

    def __init__(self, config: Mission, model: EnergyModel, duration_ms: int) -> None:
        """`model` has the times and thresholds; its rates give way to what is measured."""
        self._config = config
        self._model = model
        self._duration_ms = duration_ms
        self._rates = _Rates()
        self._battery: _Reading | None = None
        """The aPad's battery when it was first heard."""
        self._fraction: float | None = None
        self._known: dict[int, Belief] = {}

    def is_due(self, now_ms: MissionMs) -> bool:
        """True if beliefs are to be looked at again, so that their rates are known."""
        return self._rates.is_due(now_ms)

    def take(self, now_ms: MissionMs, beliefs: Iterable[Belief], apad_fraction: float | None) -> None:
        """Takes the beliefs of the aMussels that this aPad serves, and the aPad's battery."""
        self._known, self._fraction = {it.agent_id: it for it in beliefs}, apad_fraction
        self._rates.take(self._known.values(), now_ms)
        if apad_fraction is not None and self._battery is None:
            self._battery = _Reading(now_ms, apad_fraction)

    def look(self, now_ms: MissionMs, state: MissionState, place_m: Place | None) -> Forecast:
        """The forecast as of now."""
        if state.phase is Phase.ENDED:
            return Forecast()
        end_s, fraction = self._end(now_ms)
        pickup_s = full_s = inf
        if place_m is not None and state.phase not in (Phase.COMMANDED, Phase.STANDS_DOWN):
            pickup_s, full_s = self._next(now_ms, state, place_m, end_s)
        return Forecast(_before(pickup_s, end_s), _before(full_s, end_s), end_s, fraction)

    def _end(self, now_ms: MissionMs) -> tuple[float, float | None]:
        left_s = max(0.0, (self._duration_ms - now_ms) / 1000)
        begun, apad_fraction = self._battery, self._fraction
        if apad_fraction is None or begun is None or now_ms - begun.at_ms < _BATTERY_MS:
            return left_s, None
        fall = 1000 * (begun.charge - apad_fraction) / (now_ms - begun.at_ms)
        spare = max(0.0, apad_fraction - self._config.end_at_apad_fraction)
        if fall > 0:
            left_s = min(left_s, spare / fall)
        return left_s, max(0.0, apad_fraction - fall * left_s)

    def _model_of(self, agent_id: int) -> EnergyModel:
        """The model with the aMussel's rates; where none was measured, its charge neither falls nor rises."""
        falls, rises = (self._rates.of(agent_id, docked=it) or 0.0 for it in (False, True))
        curve = ((1.0, rises),) if rises > 0 else ()
        return replace(self._model, drain_per_s=max(_LEAST_DRAIN, -falls), curve=curve)

    def _done_s(self, now_ms: MissionMs, state: MissionState) -> float:
        """The time of the step under way that has passed since the aPad was there."""
        step_s = {Phase.DOCK: self._model.dock_s, Phase.UNDOCK: self._model.undock_s}.get(state.phase)
        return 0.0 if step_s is None else LEG_S + min((now_ms - state.since_ms) / 1000, step_s)

    def _next(
        self, now_ms: MissionMs, state: MissionState, here_m: Place, left_s: float
    ) -> tuple[float, float]:
        """Until the next pick-up, and until a batch is full; infinite for what cannot be foretold."""
        known = self._known
        held = {agent_id for _, agent_id in state.docked}
        steps = {it.agent_id: it.kind for it in state.plan if it.agent_id in known}
        targets = [known[it] for it, kind in steps.items() if kind is StepKind.COLLECT and it not in held]
        leaving = [known[it] for it, kind in steps.items() if kind is StepKind.DEPLOY and it in held]
        rest = known.keys() - {it.agent_id for it in (*targets, *leaving)}
        others = [known[it] for it in sorted(rest) if it in held or can_be_fetched(known[it])]
        situation = situation_of(state, here_m, targets, now_ms, others, self._model, leaving=leaving)
        agents = (*situation.candidates, *situation.others, *situation.leaving)
        rates = [self._model_of(it.agent_id) for it in agents]
        projection = Projection(situation, self._model, left_s, 0.0, rates)
        projection.begin(range(len(targets)), -self._done_s(now_ms, state))
        full_s = inf
        while True:
            if state.phase is Phase.CHARGE or projection.first_docking_s < inf:
                full_s = min(full_s, max(map(projection.full_s, projection.docked), default=inf))
            if projection.first_docking_s < inf or projection.now_s >= left_s or not projection.advance():
                return projection.first_docking_s, full_s


def _before(time_s: float, end_s: float) -> float | None:
    """None for what comes after the mission's end."""
    return None if time_s > end_s else max(0.0, time_s)

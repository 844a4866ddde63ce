"""Updates a twin's state with a packet: weighs the hypotheses of how the aMussel came to the mode that it states.

Each hypothesis has a filter of filterpy's, and the likelihoods decide between them. A gate keeps gross outliers out first,
because they would make all likelihoods alike.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

from apad_bridge.beliefs import charge_filter as charge
from apad_bridge.beliefs.charge_filter import PRIMARY, SECONDARY, SENSOR, Anchor, Array
from apad_bridge.beliefs.modes import DOCKED, SUBMERGED, Mode, mode_of
from apad_bridge.beliefs.spent_charge import Load, Spent
from apad_bridge.beliefs.twin_parameters import NO_OFFSETS, Schedule, TwinParameters
from apad_bridge.beliefs.twin_state import (
    NOTHING,
    TwinState,
    charge_now,
    listening,
    load_of_all,
    load_when_spent,
    mode_observed,
    obey_probability,
    paths,
    released,
    settled,
    spent_hypotheses,
    surfaced_hypotheses,
    way_variance,
)
from firmware_model.power.charge import MS_PER_MIN
from firmware_model.states import State

_NEGLIGIBLE = 0.001
"""A less probable hypothesis is not weighed, unless the reading contradicts the likely one."""
_CONTRADICTION = 2.0
_DROPPED_WEIGHT = 1e-6
_GATE = 5.0
"""The gate in deviations of the reading; a reading beyond it is not believed, and the next one decides."""
_UNREPORTED_EVENT_SD = 0.3
"""Deviation of a charge after an event that nobody reported: a docking by hand, or a release."""
_AFTER_RELEASE = (State.RELEASED, State.SINKING)
_TRANSIENT = (State.RELEASED, State.SINKING, State.BOOTING)
"""Short states that carry no information about the mode on the bottom."""


class Reading(NamedTuple):
    """The power part of a packet of any kind: everything that the charge filters take from it."""

    state: State
    mode: Mode
    """Usually the mode of `state`."""
    primary: float
    secondary: float

    @classmethod
    def stated(cls, state: State, primary: float, secondary: float) -> Reading:
        return cls(state, mode_of(state, primary, secondary), primary, secondary)


class HypothesisWeigher:
    def __init__(self, parameters: TwinParameters) -> None:
        self.parameters = parameters

    def weigh(
        self, twin_state: TwinState, schedule: Schedule, reading: Reading, *, may_rest: bool = True
    ) -> TwinState:
        """Corrects the charges with a reading, by one filter or by several weighed against each other."""
        hypotheses = self._hypotheses(twin_state, reading)
        return self.corrected(twin_state, schedule, hypotheses, reading, may_rest=may_rest)

    def _hypotheses(self, twin_state: TwinState, reading: Reading) -> list[Anchor]:
        if reading.mode in DOCKED or twin_state.situation is Mode.CHARGING_PRIMARY:
            return self._dock_hypotheses(twin_state, reading.mode)
        if reading.state in _AFTER_RELEASE and twin_state.since_ms == twin_state.anchor_ms:
            spent = [self._spent_since_release(twin_state, reading.state)]
        else:
            spent = self._spending_hypotheses(twin_state, reading.mode)
        return charge_now(twin_state, self.parameters, spent)

    def _dock_hypotheses(self, twin_state: TwinState, mode: Mode) -> list[Anchor]:
        """The docking was known; or somebody else docked or released the aMussel, and the charge may be anything."""
        if mode in DOCKED and twin_state.situation is Mode.CHARGING_PRIMARY:
            return charge_now(twin_state, self.parameters, ())
        weight, mean, cov = charge.moment_matched(
            charge_now(twin_state, self.parameters, spent_hypotheses(twin_state, self.parameters))
        )
        cov[PRIMARY, PRIMARY] += _UNREPORTED_EVENT_SD**2
        return [Anchor(weight, mean, cov)]

    def _spent_since_release(self, twin_state: TwinState, state: State) -> Spent:
        """The charge spent since a release at the anchor; the motors have not run yet, or are running."""
        drain = self.parameters.drain
        waited = drain.per_min[Mode.IDLE] * (twin_state.at_ms - twin_state.anchor_ms) / MS_PER_MIN
        running = self._partial_motor_run() if state is State.SINKING else NOTHING
        return Spent(1.0, waited + running.mean, way_variance(self.parameters) + running.variance)

    def _partial_motor_run(self) -> Spent:
        """The charge that running motors have taken so far, or will still take: uniform between 0 and one run."""
        run = self.parameters.drain.motor_run
        return Spent(1.0, run / 2, run**2 / 12)

    def _spending_hypotheses(self, twin_state: TwinState, mode: Mode) -> list[Spent]:
        """The ways in which the aMussel can have come to the stated mode, each with the charge spent on the way."""
        load = load_when_spent(twin_state)
        if mode in SUBMERGED:
            rows = self._submerged_hypotheses(twin_state, load, mode)
        elif twin_state.situation is None:
            # It comes up by itself, or somebody else permitted it.
            load = load_of_all(twin_state, self.parameters)
            _, mean, variance = load.total()
            run = self.parameters.drain.motor_run
            rows = [Spent(1.0, mean + run, variance + run**2)]
        else:
            rows = surfaced_hypotheses(twin_state, self.parameters)
            if mode is Mode.SURFACING:
                _, left, its_variance = self._partial_motor_run()
                rows = [Spent(p, mean - left, variance + its_variance) for p, mean, variance in paths(load)]
        total = math.fsum(row[0] for row in rows)
        if total < _NEGLIGIBLE**2:  # the packet states a mode that cannot be: only the total is known
            _, mean, variance = load.total()
            return [Spent(1.0, mean, variance + self.parameters.drain_deviation**2)]
        return [Spent(row[0] / total, row[1], row[2]) for row in rows if row[0] > 0]

    def _submerged_hypotheses(self, twin_state: TwinState, load: Load, mode: Mode) -> list[Spent]:
        """One that should float did not obey; one that should have sunk again may have obeyed before, or not."""
        if twin_state.unobeyed is None:
            return _in_mode(load, mode)
        stayed = _in_mode(twin_state.unobeyed[0], mode)
        if twin_state.situation is not None:
            return stayed
        obeyed = obey_probability(twin_state, self.parameters, twin_state.at_ms)
        return [Spent(obeyed * p, mean, variance) for p, mean, variance in _in_mode(load, mode)] + [
            Spent((1 - obeyed) * p, mean, variance) for p, mean, variance in stayed
        ]

    def corrected(
        self,
        twin_state: TwinState,
        schedule: Schedule,
        hypotheses: list[Anchor],
        reading: Reading,
        *,
        may_rest: bool = True,
    ) -> TwinState:
        """Corrects by one filter for each hypothesis; skips the unlikely ones while a likely one explains the reading.

        A battery of which nothing is known may not rest at an end: the wide Gaussian that stands for its charge has a fifth
        of its weight beyond each, and a reading near an end would then tell the sensor's bias.
        """
        charges = (reading.primary, reading.secondary)
        sensor = self.parameters.sensor
        offsets = sensor.offsets.get(reading.state, NO_OFFSETS)
        total = math.fsum(row.weight for row in hypotheses)
        learns = self.parameters.untold is not None
        if learns and may_rest:
            hypotheses = [part for row in hypotheses for part in charge.split_at_ends(row)]
        else:
            hypotheses = list(map(_clamped_if_outside, hypotheses))
        hypotheses.sort(key=lambda row: -row.weight)
        rows: list[tuple[float, Array, Array]] = []
        surprise = math.inf
        for weight, mean, cov in hypotheses:
            if rows and weight < _NEGLIGIBLE * total and surprise < _CONTRADICTION:
                break
            new_mean, new_cov, density, its_surprise = charge.measured(
                mean, cov, sensor, reading.mode, charges, offsets
            )
            rows.append((math.log(weight) + density, new_mean, new_cov))
            surprise = min(surprise, its_surprise)
        if surprise > _GATE:
            return self._widened(twin_state, schedule, hypotheses, reading)
        best = max(row[0] for row in rows)
        after = [Anchor(math.exp(density - best), mean, cov) for density, mean, cov in rows]
        likely = [row for row in after if row.weight > _DROPPED_WEIGHT]
        if learns:
            # A battery that rests at an end stays there; only one that does not is held inside.
            anchor = charge.moment_matched([bounded(row, after_measuring=True) for row in likely])
        else:
            anchor = bounded(charge.moment_matched(likely), after_measuring=True)
        return self._anchored_at_packet(twin_state, schedule, anchor, reading)

    def doubted(self, twin_state: TwinState, schedule: Schedule, reading: Reading) -> TwinState:
        """Takes a reading that contradicts physics: no charge that this sensor stated so far is believed."""
        doubted = self._doubted_state(twin_state, any_bias=True)
        return self.corrected(twin_state, schedule, [doubted], reading, may_rest=False)

    def stood(self, twin_state: TwinState, schedule: Schedule, reading: Reading) -> TwinState:
        """Takes the packet in which a reading is found to stand: neither it nor those before are believed."""
        return self._anchored_at_packet(
            twin_state, schedule, self._doubted_state(twin_state, any_bias=False), reading
        )

    def unread(self, twin_state: TwinState, schedule: Schedule, reading: Reading) -> TwinState:
        """Takes the mode of a packet whose reading stands, and no charge.

        The charge is not clamped to [0, 1] again with each packet, which would narrow what is unknown. So a dock keeps its
        anchor.
        """
        if reading.mode in DOCKED and twin_state.situation is Mode.CHARGING_PRIMARY:
            return replace(twin_state, measured_ms=twin_state.at_ms, measured_mode=reading.mode)
        anchor = charge.moment_matched(self._hypotheses(twin_state, reading))
        return self._anchored_at_packet(twin_state, schedule, anchor, reading)

    def _doubted_state(self, twin_state: TwinState, any_bias: bool) -> Anchor:
        before = charge.moment_matched(
            charge_now(twin_state, self.parameters, spent_hypotheses(twin_state, self.parameters))
        )
        return charge.doubted_state(self.parameters, before, any_bias)

    def _widened(
        self, twin_state: TwinState, schedule: Schedule, hypotheses: list[Anchor], reading: Reading
    ) -> TwinState:
        """Takes a reading beyond the gate: believes its mode, not its charge.

        Either the reading or the estimate may be wrong. So the variance grows so much that the next reading decides.
        """
        before = charge.moment_matched(hypotheses)
        stated = self.parameters.sensor.primary_of(reading.state, reading.primary)
        away = stated - float(before.mean[PRIMARY] + before.mean[SENSOR])
        doubted = before.cov.copy()
        doubted[PRIMARY, PRIMARY] += (away / 2) ** 2
        anchor = bounded(Anchor(1.0, before.mean, doubted), after_measuring=False)
        return self._anchored_at_packet(
            replace(twin_state, gated=twin_state.gated + 1), schedule, anchor, reading
        )

    def _anchored_at_packet(
        self,
        twin_state: TwinState,
        schedule: Schedule,
        anchor: Anchor,
        reading: Reading,
    ) -> TwinState:
        """Moves the anchor to the packet's time and takes the situation from its mode."""
        situation: Mode | None = Mode.CHARGING_PRIMARY if reading.mode in DOCKED else reading.mode
        if reading.mode in SUBMERGED or reading.mode is Mode.LOST or reading.state in _TRANSIENT:
            situation = None
        since_ms = twin_state.since_ms if situation is twin_state.situation else twin_state.at_ms
        twin_state = anchored(
            twin_state,
            (anchor._replace(weight=1.0),),
            situation,
            since_ms=since_ms,
            measured_ms=twin_state.at_ms,
            measured_mode=reading.mode,
            **mode_observed(twin_state, self.parameters, reading.mode),
        )
        if reading.state in _TRANSIENT:
            if reading.state is State.RELEASED:
                return released(twin_state, self.parameters, schedule, twin_state.at_ms - since_ms)
            spent = self._partial_motor_run() if reading.state is State.SINKING else NOTHING
            return settled(twin_state, self.parameters, schedule, spent)
        if reading.state is State.SURFACING:
            _, left, variance = self._partial_motor_run()
            return replace(twin_state, load=twin_state.load.add(left, variance))
        if reading.state is State.ACTIVE and reading.mode is Mode.ASLEEP:
            return listening(twin_state, self.parameters, schedule)
        return twin_state


def _in_mode(load: Load, mode: Mode) -> list[Spent]:
    """The hypotheses of a submerged aMussel in `mode`."""
    rest = load.skewed_parts(load.unexpected(mode))
    return [load.expected, *rest] if mode is load.expected_mode else rest


def _clamped_if_outside(row: Anchor) -> Anchor:
    """Clamps a charge below 0 or above 1 to that end, because only then can a reading confirm it."""
    if 0 <= row.mean[PRIMARY] <= 1 and 0 <= row.mean[SECONDARY] <= 1:
        return row
    return bounded(row, after_measuring=False)


def bounded(row: Anchor, after_measuring: bool) -> Anchor:
    return Anchor(row.weight, *charge.bounded(row.mean, row.cov, after_measuring))


def anchored(
    twin_state: TwinState, anchors: tuple[Anchor, ...], situation: Mode | None, **changes: Any
) -> TwinState:
    """The twin state with `anchors` at its own `at_ms`, and nothing spent since."""
    settled: dict[str, Any] = {
        "anchors": anchors,
        "anchor_ms": twin_state.at_ms,
        "load": Load.known(Mode.ASLEEP),
        "situation": situation,
        "since_ms": twin_state.at_ms,
        "from_secondary": (0.0, 0.0),
        "unobeyed": None,
        "earlier": None,
        "pending": None,
    }
    return replace(twin_state, **(settled | changes))

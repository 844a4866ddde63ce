"""What a packet does to a twin's memory: weighing how the aMussel can have come to where it says it is.

Filters are filterpy's, one for each hypothesis; their likelihoods decide between them, after a gate that a gross outlier
does not pass, for it would make all of them alike.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

from apad_bridge.beliefs import charge_state as charge
from apad_bridge.beliefs.charge_state import PRIMARY, SECONDARY, Anchor, Array
from apad_bridge.beliefs.knowledge import Knowledge, Schedule
from apad_bridge.beliefs.load import MS_PER_MIN, Load, Spent, carried, spending
from apad_bridge.beliefs.memory import Memory, charge_now, choices, heard_in, paths, sinking, submerged
from apad_bridge.beliefs.modes import DOCKED, SUBMERGED, Mode, mode_of
from firmware_model.states import State

_NEGLIGIBLE = 0.001
"""A hypothesis less probable than this is not weighed, unless the likely one is contradicted."""
_CONTRADICTION = 2.0
_FORGOTTEN = 1e-6
_GATE = 5.0
"""In deviations of the reading; beyond the gate it is not believed, and the next one decides."""
_UNTOLD_SD = 0.3
"""Of a charge after something that nobody told of: docked by hand, or let go."""
NOTHING = Spent(1.0, 0.0, 0.0)
_NO_OFFSETS = (0.0, 0.0)
_AFTER_A_RELEASE = (State.RELEASED, State.SINKING)
_ON_THE_WAY = (State.RELEASED, State.SINKING, State.BOOTING)
"""They do not last, and say nothing of what it will do on the bottom."""


class Reading(NamedTuple):
    """What a packet states of its sender's power: all that the filters of charges take from it, whatever kind it is of."""

    state: State
    mode: Mode
    """What to make of the state: usually, that of which it is one."""
    primary: float
    secondary: float

    @classmethod
    def stated(cls, state: State, primary: float, secondary: float) -> Reading:
        return cls(state, mode_of(state, primary, secondary), primary, secondary)


class Ear:
    def __init__(self, knowledge: Knowledge) -> None:
        self.knowledge = knowledge

    def weigh(self, memory: Memory, schedule: Schedule, reading: Reading) -> Memory:
        """Corrects the charges by a reading: by one filter, or by several weighed against each other."""
        if reading.mode in DOCKED or memory.situation is Mode.CHARGING_PRIMARY:
            hypotheses = self._about_the_dock(memory, reading.mode)
        elif reading.state in _AFTER_A_RELEASE and memory.since_ms == memory.anchor_ms:
            hypotheses = charge_now(memory, self.knowledge, [self._since_a_release(memory, reading.state)])
        else:
            hypotheses = charge_now(memory, self.knowledge, self._paths(memory, schedule, reading.mode))
        return self.corrected(memory, schedule, hypotheses, reading)

    def _about_the_dock(self, memory: Memory, mode: Mode) -> list[Anchor]:
        """Docked as was known; or docked, or let go, by somebody else: then the charge may be anything."""
        if mode in DOCKED and memory.situation is Mode.CHARGING_PRIMARY:
            return charge_now(memory, self.knowledge, ())
        weight, mean, cov = charge.matched(charge_now(memory, self.knowledge, paths(memory.load)))
        cov[PRIMARY, PRIMARY] += _UNTOLD_SD**2
        return [Anchor(weight, mean, cov)]

    def _since_a_release(self, memory: Memory, state: State) -> Spent:
        """It was let go at the anchor, or heard to wait there since; its motors have not run yet, or are running."""
        drain = self.knowledge.drain
        waited = drain.per_min[Mode.IDLE] * (memory.at_ms - memory.anchor_ms) / MS_PER_MIN
        running = self._half_a_run() if state is State.SINKING else NOTHING
        return Spent(1.0, waited + running.mean, drain.motor_deviation**2 + running.variance)

    def _half_a_run(self) -> Spent:
        """What motors that run have taken so far, and what they will still take: any share is as probable."""
        run = self.knowledge.drain.motor_run
        return Spent(1.0, run / 2, run**2 / 12)

    def _paths(self, memory: Memory, schedule: Schedule, mode: Mode) -> list[Spent]:
        """The ways in which it can have come to the stated mode, each with what it spent on it."""
        load = memory.load
        if mode in SUBMERGED:
            if memory.unobeyed is not None:
                load = self.without_permission(memory, schedule)
            rest = load.as_it_lies(load.unexpected(mode))
            rows = [load.expected, *rest] if mode is load.expected_mode else rest
        elif memory.situation is None:
            # It comes up unasked, or was told by somebody else.
            _, mean, variance = load.total()
            run = self.knowledge.drain.motor_run
            rows = [Spent(1.0, mean + run, variance + run**2)]
        else:
            rows = paths(load)
            if mode is Mode.SURFACING:
                _, left, its_variance = self._half_a_run()
                rows = [Spent(p, mean - left, variance + its_variance) for p, mean, variance in rows]
        total = math.fsum(row[0] for row in rows)
        if total < _NEGLIGIBLE**2:  # what cannot be has been heard: all that is known is the total
            _, mean, variance = load.total()
            return [Spent(1.0, mean, variance + self.knowledge.drain_deviation**2)]
        return [Spent(row[0] / total, row[1], row[2]) for row in rows if row[0] > 0]

    def without_permission(self, memory: Memory, schedule: Schedule) -> Load:
        """What it spent if it never heard the permission."""
        assert memory.unobeyed is not None
        before, at_ms = memory.unobeyed
        chosen = choices(memory, self.knowledge, schedule)
        goes_on = spending(self.knowledge.drain.per_min, schedule.cycle)
        return carried(before, at_ms, memory.at_ms, goes_on, self.knowledge.habits.every_ms, chosen)

    def corrected(
        self, memory: Memory, schedule: Schedule, hypotheses: list[Anchor], reading: Reading
    ) -> Memory:
        """By one filter for each hypothesis; the unlikely ones are not weighed while the likely one explains it."""
        charges = (reading.primary, reading.secondary)
        sensor = self.knowledge.sensor
        offsets = sensor.offsets.get(reading.state, _NO_OFFSETS)
        total = math.fsum(row.weight for row in hypotheses)
        hypotheses = sorted(map(_possible, hypotheses), key=lambda row: -row.weight)
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
            return self._doubted(memory, schedule, hypotheses, reading)
        best = max(row[0] for row in rows)
        after = [Anchor(math.exp(density - best), mean, cov) for density, mean, cov in rows]
        likely = [row for row in after if row.weight > _FORGOTTEN]
        return self._settled(memory, schedule, within(charge.matched(likely), after_measuring=True), reading)

    def _doubted(
        self, memory: Memory, schedule: Schedule, hypotheses: list[Anchor], reading: Reading
    ) -> Memory:
        """A reading beyond the gate: its mode is believed and its charge is not.

        Until the next one either may be wrong, and the belief says so: it is so wide then that the next one decides.
        """
        before = charge.matched(hypotheses)
        offset, _ = self.knowledge.sensor.offsets.get(reading.state, _NO_OFFSETS)
        away = reading.primary - offset - float(before.mean[PRIMARY])
        doubted = before.cov.copy()
        doubted[PRIMARY, PRIMARY] += (away / 2) ** 2
        anchor = within(Anchor(1.0, before.mean, doubted), after_measuring=False)
        return self._settled(replace(memory, gated=memory.gated + 1), schedule, anchor, reading)

    def _settled(
        self,
        memory: Memory,
        schedule: Schedule,
        anchor: Anchor,
        reading: Reading,
    ) -> Memory:
        """The anchor moves to the packet, which says what it is doing."""
        situation: Mode | None = Mode.CHARGING_PRIMARY if reading.mode in DOCKED else reading.mode
        if reading.mode in SUBMERGED or reading.mode is Mode.LOST or reading.state in _ON_THE_WAY:
            situation = None
        since_ms = memory.since_ms if situation is memory.situation else memory.at_ms
        memory = anchored(
            memory,
            (anchor._replace(weight=1.0),),
            situation,
            since_ms=since_ms,
            measured_ms=memory.at_ms,
            measured_mode=reading.mode,
            **heard_in(memory, self.knowledge, reading.mode),
        )
        if reading.state in _ON_THE_WAY:
            spent = NOTHING
            if reading.state is State.RELEASED:
                spent = sinking(NOTHING, self.knowledge)
            elif reading.state is State.SINKING:
                spent = self._half_a_run()
            return submerged(memory, self.knowledge, schedule, spent)
        if reading.state is State.SURFACING:
            _, left, variance = self._half_a_run()
            return replace(memory, load=memory.load.add(left, variance))
        return memory


def _possible(row: Anchor) -> Anchor:
    """What would have run empty, or be more than full, is at that end: only then can a reading confirm it."""
    if 0 <= row.mean[PRIMARY] <= 1 and 0 <= row.mean[SECONDARY] <= 1:
        return row
    return within(row, after_measuring=False)


def within(row: Anchor, after_measuring: bool) -> Anchor:
    return Anchor(row.weight, *charge.within(row.mean, row.cov, after_measuring))


def anchored(memory: Memory, anchors: tuple[Anchor, ...], situation: Mode | None, **changes: Any) -> Memory:
    """The charges stand at `at_ms`; nothing was spent since."""
    settled: dict[str, Any] = {
        "anchors": anchors,
        "anchor_ms": memory.at_ms,
        "load": Load.known(Mode.ASLEEP),
        "situation": situation,
        "since_ms": memory.at_ms,
        "from_secondary": (0.0, 0.0),
        "unobeyed": None,
    }
    return replace(memory, **(settled | changes))

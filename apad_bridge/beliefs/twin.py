"""The twin: what an aMussel is thought to be, by the firmware's own rules run forward and corrected by what is heard.

Prediction follows what was commanded and what the aPad did (permission, docking, release); only where an aMussel may
have chosen for itself is there more than one hypothesis. A packet states its mode, so that hearing one in time corrects
a single Kalman filter. The mixture is weighed only after silence, or when a packet contradicts what was expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from apad_bridge.beliefs import charge_state as charge
from apad_bridge.beliefs import clock as clocks
from apad_bridge.beliefs.belief import Belief, Source
from apad_bridge.beliefs.charge_state import PRIMARY, SECONDARY, Anchor, Array
from apad_bridge.beliefs.knowledge import UNKNOWN, Knowledge, Schedule
from apad_bridge.beliefs.load import Load, Spent, carried
from apad_bridge.beliefs.measurement import (
    Docked,
    Fixed,
    Heard,
    Measurement,
    Permitted,
    Ranged,
    Rejected,
    Released,
    SlotSilent,
)
from apad_bridge.beliefs.memory import (
    Memory,
    advanced,
    charge_now,
    choices,
    paths,
    sinking,
    submerged,
    with_heard,
)
from apad_bridge.beliefs.modes import DOCKED, SUBMERGED, Mode, mode_of
from apad_bridge.beliefs.place import Place
from apad_bridge.beliefs.told import told
from firmware_model.packets import StatusPacket
from firmware_model.states import State

_NEGLIGIBLE = 0.001
"""A hypothesis less probable than this is not weighed, unless the likely one is contradicted."""
_CONTRADICTION = 2.0
_FORGOTTEN = 1e-6
_GATE = 5.0
"""In deviations of the reading; beyond the gate it is not believed until another agrees with it."""
_AGREES = 4.0
_UNTOLD_SD = 0.3
"""Of a charge after something that nobody told of: docked by hand, or let go."""
_CLOCK_APART_MS = 600_000
"""Agent time between two readings of a clock."""
_FIX_APART_MS = 10_000
"""Mission time between two fixes that a packet brings along."""
_TURN_MS = 7_919
_DOCK_VARIANCE_M2 = 1.0
_NOTHING = Spent(1.0, 0.0, 0.0)
_ON_THE_WAY = (State.RELEASED, State.SINKING, State.BOOTING)
"""They do not last, and say nothing of what it will do on the bottom."""


class Twin:
    """An `Estimator`. `schedules` are those that were commanded, by agent id; an aMussel without one does as is usual."""

    def __init__(self, knowledge: Knowledge, schedules: Mapping[int, Schedule]) -> None:
        self.knowledge = knowledge
        self._schedules = schedules

    def predict(self, belief: Belief, to_ms: int) -> Belief:
        if to_ms < belief.at_ms:
            raise ValueError(f"time went back: {to_ms} before {belief.at_ms}")
        memory = self._carried(belief, to_ms)
        return self._tell(belief, memory, to_ms, belief.learned_from)

    def update(self, belief: Belief | None, measurement: Measurement) -> Belief | None:
        if isinstance(measurement, Heard):
            return self._hear(belief, measurement.packet, measurement.at_ms)
        if belief is None:
            return None
        at_ms = max(measurement.at_ms, belief.at_ms)
        memory = self._carried(belief, at_ms)
        match measurement:
            case SlotSilent():
                silent = replace(belief, silent_slots=belief.silent_slots + 1)
                return self._tell(silent, memory, at_ms, belief.learned_from | Source.SILENCE)
            case Permitted():
                memory = self._permitted(memory, belief.agent_id)
                return self._tell(belief, memory, at_ms, belief.learned_from)
            case Docked():
                return self._tell(belief, self._docked(memory), at_ms, belief.learned_from | Source.DOCKING)
            case Released(_, north_m, east_m):
                memory = self._released(memory, belief.agent_id)
                place = Place.at(north_m, east_m, _DOCK_VARIANCE_M2, self.knowledge.water)
                memory = replace(memory, place=place, place_ms=at_ms)
                return self._tell(belief, memory, at_ms, belief.learned_from | Source.RELEASE)
            case Fixed(_, north_m, east_m, variance_m2):
                place = self._place(memory, at_ms).fixed(north_m, east_m, variance_m2, self.knowledge.water)
            case Ranged(_, range_m, north_m, east_m, variance_m2):
                place = self._place(memory, at_ms).ranged(range_m, north_m, east_m, variance_m2)
        memory = replace(memory, place=place, place_ms=at_ms)
        return self._tell(belief, memory, at_ms, belief.learned_from | Source.RANGE)

    # Time.

    def _schedule(self, agent_id: int) -> Schedule:
        return self._schedules.get(agent_id, UNKNOWN)

    def _agent_ms(self, memory: Memory, at_ms: int) -> int:
        """What its own clock shows at mission time `at_ms`, as far as that is known."""
        return self.knowledge.theta * at_ms + round(memory.clock.offset_ms)

    def _carried(self, belief: Belief, to_ms: int) -> Memory:
        memory = belief.memory
        assert isinstance(memory, Memory), "a belief of another estimator"
        schedule = self._schedule(belief.agent_id)
        return advanced(memory, self.knowledge, schedule, self._agent_ms(memory, to_ms))

    def _place(self, memory: Memory, at_ms: int) -> Place:
        afloat = memory.situation in (Mode.SURFACING, Mode.FLOATING)
        return memory.place.carried(self.knowledge.water, (at_ms - memory.place_ms) / 1000, afloat)

    def _tell(self, belief: Belief, memory: Memory, at_ms: int, learned_from: Source) -> Belief:
        return told(
            memory,
            self.knowledge,
            belief.agent_id,
            belief.heard_ms,
            belief.state,
            at_ms,
            self._place(memory, at_ms),
            learned_from,
            belief.silent_slots,
        )

    # What the aPad did.

    def _permitted(self, memory: Memory, agent_id: int) -> Memory:
        """It surfaces, most probably; the permission may be repeated."""
        if memory.situation is not None:
            return memory
        drain = self.knowledge.drain
        return replace(
            memory,
            load=memory.load.add(drain.motor_run, drain.motor_deviation**2),
            situation=Mode.SURFACING,
            since_ms=memory.at_ms,
            unobeyed=(memory.load, memory.at_ms),
        )

    def _docked(self, memory: Memory) -> Memory:
        if memory.situation is Mode.CHARGING_PRIMARY:
            return memory
        return _anchored(memory, self._held_now(memory), Mode.CHARGING_PRIMARY)

    def _released(self, memory: Memory, agent_id: int) -> Memory:
        memory = _anchored(memory, self._held_now(memory), None)
        spent = sinking(_NOTHING, self.knowledge)
        return submerged(memory, self.knowledge, self._schedule(agent_id), spent)

    def _held_now(self, memory: Memory) -> tuple[Anchor, ...]:
        """What may be, held at the ends: a few hypotheses, for a low charge stays far behind in a dock."""
        rows = charge_now(memory, self.knowledge, paths(memory.load))
        return charge.condensed([_within(row, after_measuring=False) for row in rows])

    # What was heard.

    def _hear(self, belief: Belief | None, packet: StatusPacket, at_ms: int) -> Belief:
        mode = mode_of(packet.state, packet.primary, packet.secondary)
        if belief is None:
            return self._first(packet, mode, at_ms)
        memory = belief.memory
        assert isinstance(memory, Memory), "a belief of another estimator"
        if (packet.sequence, packet.agent_ms) == memory.packet:
            raise Rejected("a status that was heard already")
        if packet.agent_ms < memory.packet[1]:
            raise Rejected("a status that a newer one overtook")
        at_ms = max(at_ms, belief.at_ms)
        memory = self._carried(belief, at_ms)
        if self._tells_news(memory, belief.agent_id, mode):
            if memory.at_ms - memory.clock_ms >= _CLOCK_APART_MS:
                memory = self._read_clock(memory, packet, at_ms)
            if at_ms - memory.place_ms >= _FIX_APART_MS:
                memory = self._fixed(memory, packet, at_ms)
            memory = self._weigh(memory, belief.agent_id, packet, mode)
        memory = replace(memory, packet=(packet.sequence, packet.agent_ms))
        heard = replace(belief, heard_ms=at_ms, carried_ms=0, state=packet.state, silent_slots=0)
        return self._tell(heard, memory, at_ms, Source.PACKET)

    def _tells_news(self, memory: Memory, agent_id: int, mode: Mode) -> bool:
        """Of readings near to each other in one mode only the first is used; fleets take turns, so that ticks are alike."""
        if mode is not memory.measured_mode:
            return True
        apart_ms = self.knowledge.sensor.apart_ms
        turn_ms = agent_id * _TURN_MS % apart_ms
        return (memory.at_ms + turn_ms) // apart_ms > (memory.measured_ms + turn_ms) // apart_ms

    def _first(self, packet: StatusPacket, mode: Mode, at_ms: int) -> Belief:
        knowledge = self.knowledge
        mean, cov = charge.unmeasured(knowledge)
        nominal_ms = knowledge.theta * at_ms
        clock = clocks.read(
            clocks.unread(knowledge.clock.offset_ms, knowledge.clock.drift_ppm),
            packet.agent_ms - nominal_ms,
            knowledge.clock.reading_ms,
        )
        place = Place.at(packet.north_m, packet.east_m, knowledge.water.fix_deviation_m**2, knowledge.water)
        memory = Memory(
            nominal_ms + round(clock.offset_ms),
            (Anchor(1.0, mean, cov),),
            nominal_ms,
            Load.known(mode if mode in SUBMERGED else Mode.IDLE),
            None,
            nominal_ms,
            place,
            at_ms,
            clock,
            nominal_ms,
            (packet.sequence, packet.agent_ms),
        )
        memory = self._corrected(memory, [Anchor(1.0, mean, cov)], packet, mode)
        return told(memory, knowledge, packet.agent_id, at_ms, packet.state, at_ms, place, Source.PACKET, 0)

    def _read_clock(self, memory: Memory, packet: StatusPacket, at_ms: int) -> Memory:
        nominal_ms = self.knowledge.theta * at_ms
        clock = clocks.carried(memory.clock, nominal_ms - memory.clock_ms)
        clock = clocks.read(clock, packet.agent_ms - nominal_ms, self.knowledge.clock.reading_ms)
        return replace(memory, clock=clock, clock_ms=nominal_ms)

    def _fixed(self, memory: Memory, packet: StatusPacket, at_ms: int) -> Memory:
        water = self.knowledge.water
        variance_m2 = water.fix_deviation_m**2
        place = self._place(memory, at_ms).fixed(packet.north_m, packet.east_m, variance_m2, water)
        return replace(memory, place=place, place_ms=at_ms)

    def _weigh(self, memory: Memory, agent_id: int, packet: StatusPacket, mode: Mode) -> Memory:
        """Corrects the charges by a packet that states `mode`: by one filter, or by several weighed against each other."""
        if mode in DOCKED or memory.situation is Mode.CHARGING_PRIMARY:
            hypotheses = self._about_the_dock(memory, mode)
        else:
            hypotheses = charge_now(memory, self.knowledge, self._paths(memory, agent_id, mode))
        return self._corrected(memory, hypotheses, packet, mode)

    def _about_the_dock(self, memory: Memory, mode: Mode) -> list[Anchor]:
        """Docked as was known; or docked, or let go, by somebody else: then the charge may be anything."""
        if mode in DOCKED and memory.situation is Mode.CHARGING_PRIMARY:
            return charge_now(memory, self.knowledge, ())
        weight, mean, cov = charge.matched(charge_now(memory, self.knowledge, paths(memory.load)))
        cov[PRIMARY, PRIMARY] += _UNTOLD_SD**2
        return [Anchor(weight, mean, cov)]

    def _paths(self, memory: Memory, agent_id: int, mode: Mode) -> list[Spent]:
        """The ways in which it can have come to the stated mode, each with what it spent on it."""
        load = memory.load
        if mode in SUBMERGED:
            if memory.unobeyed is not None:
                load = self._without_permission(memory, agent_id)
            rest = load.as_it_lies(load.unexpected(mode))
            rows = [load.expected, *rest] if mode is load.expected_mode else rest
        elif memory.situation is None:
            # It comes up unasked, or was told by somebody else.
            _, mean, variance = load.total()
            run = self.knowledge.drain.motor_run
            rows = [Spent(1.0, mean + run, variance + run**2)]
        else:
            rows = paths(load)
        total = math.fsum(row[0] for row in rows)
        if total < _NEGLIGIBLE**2:  # what cannot be has been heard: all that is known is the total
            _, mean, variance = load.total()
            return [Spent(1.0, mean, variance + self.knowledge.drain_deviation**2)]
        return [Spent(row[0] / total, row[1], row[2]) for row in rows if row[0] > 0]

    def _without_permission(self, memory: Memory, agent_id: int) -> Load:
        """What it spent if it never heard the permission."""
        assert memory.unobeyed is not None
        before, at_ms = memory.unobeyed
        chosen = choices(memory, self.knowledge, self._schedule(agent_id))
        drain, habits = self.knowledge.drain, self.knowledge.habits
        return carried(before, at_ms, memory.at_ms, drain.per_min, habits.every_ms, chosen)

    def _corrected(
        self, memory: Memory, hypotheses: list[Anchor], packet: StatusPacket, mode: Mode
    ) -> Memory:
        charges = (packet.primary, packet.secondary)
        sensor = self.knowledge.sensor
        total = math.fsum(row.weight for row in hypotheses)
        hypotheses = sorted(map(_possible, hypotheses), key=lambda row: -row.weight)
        rows: list[tuple[float, Array, Array]] = []
        surprise = math.inf
        for weight, mean, cov in hypotheses:
            if rows and weight < _NEGLIGIBLE * total and surprise < _CONTRADICTION:
                break
            new_mean, new_cov, density, its_surprise = charge.measured(mean, cov, sensor, mode, charges)
            rows.append((math.log(weight) + density, new_mean, new_cov))
            surprise = min(surprise, its_surprise)
        if surprise > _GATE:
            return self._doubted(memory, hypotheses, packet, mode)
        best = max(row[0] for row in rows)
        after = [Anchor(math.exp(density - best), mean, cov) for density, mean, cov in rows]
        likely = [row for row in after if row.weight > _FORGOTTEN]
        return self._settled(
            memory, _within(charge.matched(likely), after_measuring=True), packet, mode, None
        )

    def _doubted(self, memory: Memory, hypotheses: list[Anchor], packet: StatusPacket, mode: Mode) -> Memory:
        """A reading beyond the gate: its mode is believed and its charge is not, until the next one agrees with it.

        Until then either may be wrong, and the belief says so.
        """
        before = charge.matched(hypotheses)
        away = packet.primary - float(before.mean[PRIMARY])
        memory = replace(memory, gated=memory.gated + 1)
        near = _AGREES * self.knowledge.sensor.noise
        if memory.suspect is None or abs(away - memory.suspect) > near:
            doubted = before.cov.copy()
            doubted[PRIMARY, PRIMARY] += (away / 2) ** 2
            anchor = Anchor(1.0, before.mean, doubted)
            return self._settled(memory, _within(anchor, after_measuring=False), packet, mode, suspect=away)
        cov = before.cov.copy()
        cov[PRIMARY, PRIMARY] += away**2
        charges = (packet.primary, packet.secondary)
        mean, cov, _, _ = charge.measured(before.mean, cov, self.knowledge.sensor, mode, charges)
        return self._settled(
            memory, _within(Anchor(1.0, mean, cov), after_measuring=True), packet, mode, None
        )

    def _settled(
        self, memory: Memory, anchor: Anchor, packet: StatusPacket, mode: Mode, suspect: float | None
    ) -> Memory:
        """The anchor moves to the packet, which says what it is doing."""
        situation: Mode | None = Mode.CHARGING_PRIMARY if mode in DOCKED else mode
        if mode in SUBMERGED or mode is Mode.LOST or packet.state in _ON_THE_WAY:
            situation = None
        since_ms = memory.since_ms if situation is memory.situation else memory.at_ms
        memory = replace(
            _anchored(memory, (anchor._replace(weight=1.0),), situation),
            since_ms=since_ms,
            measured_ms=memory.at_ms,
            measured_mode=mode,
            suspect=suspect,
        )
        if packet.state in _ON_THE_WAY:
            spent = sinking(_NOTHING, self.knowledge) if packet.state is State.RELEASED else _NOTHING
            return submerged(memory, self.knowledge, self._schedule(packet.agent_id), spent)
        if mode not in SUBMERGED:
            return memory
        return with_heard(replace(memory, load=Load.known(mode)), self.knowledge, mode)


def _possible(row: Anchor) -> Anchor:
    """What would have run empty, or be more than full, is at that end: only then can a reading confirm it."""
    if 0 <= row.mean[PRIMARY] <= 1 and 0 <= row.mean[SECONDARY] <= 1:
        return row
    return _within(row, after_measuring=False)


def _within(row: Anchor, after_measuring: bool) -> Anchor:
    return Anchor(row.weight, *charge.within(row.mean, row.cov, after_measuring))


def _anchored(memory: Memory, anchors: tuple[Anchor, ...], situation: Mode | None) -> Memory:
    """The charges stand at `at_ms`; nothing was spent since."""
    return replace(
        memory,
        anchors=anchors,
        anchor_ms=memory.at_ms,
        load=Load.known(Mode.ASLEEP),
        situation=situation,
        since_ms=memory.at_ms,
        from_secondary=(0.0, 0.0),
        unobeyed=None,
    )

"""The twin: what an aMussel is thought to be, by the firmware's own rules run forward and corrected by what is heard.

Prediction follows what was commanded and what the aPad did (permission, docking, release); only where an aMussel may
have chosen for itself is there more than one hypothesis. A packet states its mode, so that hearing one in time corrects
a single Kalman filter. The mixture is weighed only after silence, or when a packet contradicts what was expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from apad_bridge.beliefs import charge_state as charge
from apad_bridge.beliefs import clock as clocks
from apad_bridge.beliefs.belief import Belief, Clock, Source
from apad_bridge.beliefs.charge_state import Anchor
from apad_bridge.beliefs.hearing import NOTHING, Ear, Reading, anchored, within
from apad_bridge.beliefs.knowledge import UNKNOWN, Knowledge, Schedule
from apad_bridge.beliefs.load import Load
from apad_bridge.beliefs.measurement import (
    ClockSet,
    Docked,
    Fixed,
    Heard,
    HeardShort,
    Measurement,
    Permitted,
    Ranged,
    Rejected,
    Released,
    TimeslotSilent,
)
from apad_bridge.beliefs.memory import (
    Memory,
    advanced,
    at_its_clock,
    charge_now,
    obeys,
    paths,
    sinking,
    submerged,
)
from apad_bridge.beliefs.modes import LIKELY, SUBMERGED, Mode
from apad_bridge.beliefs.place import Place
from apad_bridge.beliefs.told import told
from apad_bridge.beliefs.twin_lines import memory_data, memory_of
from firmware_model.packets import StatusPacket
from firmware_model.states import State

_CLOCK_APART_MS = 600_000
"""Agent time between two readings of a clock."""
_FIX_APART_MS = 10_000
"""Mission time between two fixes that a packet brings along."""
_TURN_MS = 7_919
_FAR = 5.0
"""In deviations of a first reading; a clock that is farther off was never set to nominal time."""
_DOCK_VARIANCE_M2 = 1.0
_OF_A_WAKE = (State.ACTIVE, State.PROCESSING)
"""A minute each; whoever is heard in its slot is past them."""


class Twin:
    """An `Estimator`. `schedules` are those that were commanded, by agent id; an aMussel without one does as is usual."""

    def __init__(self, knowledge: Knowledge, schedules: Mapping[int, Schedule]) -> None:
        self.knowledge = knowledge
        self._schedules = schedules
        self._ear = Ear(knowledge)

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
        if isinstance(measurement, HeardShort):
            return self._glimpse(belief, measurement)
        at_ms = max(measurement.at_ms, belief.at_ms)
        memory = self._carried(belief, at_ms)
        match measurement:
            case TimeslotSilent():
                silent = replace(belief, silent_timeslots=belief.silent_timeslots + 1)
                return self._tell(silent, memory, at_ms, belief.learned_from | Source.SILENCE)
            case Permitted():
                memory = self._permitted(memory, belief.agent_id)
                return self._tell(belief, memory, at_ms, belief.learned_from)
            case ClockSet(_, agent_ms):
                clock, nominal_ms = self._clock_set(agent_ms, at_ms), self.knowledge.theta * at_ms
                memory = replace(at_its_clock(memory, agent_ms), clock=clock, clock_ms=nominal_ms)
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

    def kept(self, belief: Belief) -> dict[str, Any]:
        memory = belief.memory
        assert isinstance(memory, Memory), "a belief of another estimator"
        return {
            "heard_ms": belief.heard_ms,
            "state": int(belief.state),
            "at_ms": belief.at_ms,
            "learned_from": int(belief.learned_from),
            "silent_slots": belief.silent_timeslots,
            "memory": memory_data(memory),
        }

    def restored(self, agent_id: int, data: dict[str, Any]) -> Belief:
        return told(
            memory_of(data["memory"]),
            self.knowledge,
            agent_id,
            data["heard_ms"],
            State(data["state"]),
            data["at_ms"],
            Source(data["learned_from"]),
            data["silent_slots"],
        )

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
            learned_from,
            belief.silent_timeslots,
        )

    # What the aPad did.

    def _permitted(self, memory: Memory, agent_id: int) -> Memory:
        """It surfaces, most probably. Repeated, it counts if it is most probably still down."""
        if memory.situation is not None:
            if memory.unobeyed is None or obeys(memory, self.knowledge) >= LIKELY:
                return memory
            stayed = self._ear.without_permission(memory, self._schedule(agent_id))
            memory = replace(memory, load=stayed)
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
        return anchored(memory, self._held_now(memory), Mode.CHARGING_PRIMARY)

    def _released(self, memory: Memory, agent_id: int) -> Memory:
        memory = anchored(memory, self._held_now(memory), None)
        spent = sinking(NOTHING, self.knowledge)
        return submerged(memory, self.knowledge, self._schedule(agent_id), spent)

    def _held_now(self, memory: Memory) -> tuple[Anchor, ...]:
        """What may be, held at the ends: a few hypotheses, for a low charge stays far behind in a dock."""
        rows = charge_now(memory, self.knowledge, paths(memory.load))
        return charge.condensed([within(row, after_measuring=False) for row in rows])

    # What was heard.

    def _hear(self, belief: Belief | None, packet: StatusPacket, at_ms: int) -> Belief:
        reading = Reading.stated(packet.state, packet.primary, packet.secondary)
        if belief is None:
            return self._first(packet, reading, at_ms)
        memory = belief.memory
        assert isinstance(memory, Memory), "a belief of another estimator"
        if (packet.sequence, packet.agent_ms) == memory.packet:
            raise Rejected("a status that was heard already")
        if packet.agent_ms < memory.packet[1]:
            raise Rejected("a status that a newer one overtook")
        at_ms = max(at_ms, belief.at_ms)
        memory = replace(self._carried(belief, at_ms), packet=(packet.sequence, packet.agent_ms))
        if self._tells_news(memory, belief.agent_id, reading.mode):
            if memory.at_ms - memory.clock_ms >= _CLOCK_APART_MS:
                memory = self._read_clock(memory, packet, at_ms)
            if at_ms - memory.place_ms >= _FIX_APART_MS:
                memory = self._fixed(memory, packet, at_ms)
            memory = self._ear.weigh(memory, self._schedule(belief.agent_id), reading)
        return self._heard(belief, memory, reading, at_ms)

    def _glimpse(self, belief: Belief, heard: HeardShort) -> Belief:
        """A short status says nothing of place and time: they stay what is believed. Asked for, it may fall into a short
        wake of one that sleeps, which is not awake for that."""
        at_ms = max(heard.at_ms, belief.at_ms)
        memory = self._carried(belief, at_ms)
        schedule = self._schedule(belief.agent_id)
        reading = Reading.stated(heard.state, heard.primary, heard.secondary)
        if heard.state in _OF_A_WAKE and schedule.at(self._agent_ms(memory, at_ms)) is Mode.ASLEEP:
            reading = reading._replace(mode=Mode.ASLEEP)
        if self._tells_news(memory, belief.agent_id, reading.mode):
            memory = self._ear.weigh(memory, schedule, reading)
        return self._heard(belief, memory, reading, at_ms)

    def _heard(self, belief: Belief, memory: Memory, reading: Reading, at_ms: int) -> Belief:
        heard = replace(belief, heard_ms=at_ms, carried_ms=0, state=reading.state, silent_timeslots=0)
        return self._tell(heard, memory, at_ms, Source.PACKET)

    def _tells_news(self, memory: Memory, agent_id: int, mode: Mode) -> bool:
        """Of readings near to each other in one mode only the first is used; fleets take turns, so that ticks are alike."""
        if mode is not memory.measured_mode:
            return True
        apart_ms = self.knowledge.sensor.apart_ms
        turn_ms = agent_id * _TURN_MS % apart_ms
        return (memory.at_ms + turn_ms) // apart_ms > (memory.measured_ms + turn_ms) // apart_ms

    def _first(self, packet: StatusPacket, reading: Reading, at_ms: int) -> Belief:
        knowledge = self.knowledge
        mean, cov = charge.unmeasured(knowledge)
        nominal_ms = knowledge.theta * at_ms
        ahead_ms, usual = packet.agent_ms - nominal_ms, knowledge.clock
        clock = clocks.read(clocks.unread(usual.offset_ms, usual.drift_ppm), ahead_ms, usual.reading_ms)
        if abs(ahead_ms) > _FAR * math.hypot(usual.offset_ms, usual.reading_ms):
            clock = self._clock_set(packet.agent_ms, at_ms)
        place = Place.at(packet.north_m, packet.east_m, knowledge.water.fix_deviation_m**2, knowledge.water)
        memory = Memory(
            nominal_ms + round(clock.offset_ms),
            (Anchor(1.0, mean, cov),),
            nominal_ms,
            Load.known(reading.mode if reading.mode in SUBMERGED else Mode.IDLE),
            None,
            nominal_ms,
            place,
            at_ms,
            clock,
            nominal_ms,
            (packet.sequence, packet.agent_ms),
        )
        schedule = self._schedule(packet.agent_id)
        memory = self._ear.corrected(memory, schedule, [Anchor(1.0, mean, cov)], reading)
        return told(memory, knowledge, packet.agent_id, at_ms, packet.state, at_ms, Source.PACKET, 0)

    def _clock_set(self, agent_ms: int, at_ms: int) -> Clock:
        known = self.knowledge.clock
        return clocks.set_to(agent_ms - self.knowledge.theta * at_ms, known.reading_ms, known.drift_ppm)

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

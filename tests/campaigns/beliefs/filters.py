"""The study's filters, each turning one aMussel's events into a belief at every hour: ours, the oracle, and hold-last."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import Estimator
from apad_bridge.beliefs.hold_last import LastPacket
from apad_bridge.beliefs.measurement import Docked, Permitted, Released, TimeslotSilent
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.twin import Twin
from apad_bridge.beliefs.twin_parameters import (
    ChargerParameters,
    ClockParameters,
    Drain,
    Habits,
    Schedule,
    SensorParameters,
    TwinParameters,
    WaterParameters,
)
from beliefs.truth import Array, Doing, Event, Life
from firmware_model.config import BoardConfig
from firmware_model.packets import StatusPacket
from firmware_model.sinking import Sinking
from firmware_model.states import State
from firmware_model.table_one import WORST_CASE

MINUTE = 60_000
_STATES = {
    Doing.ASLEEP: State.SLEEPING,
    Doing.IDLE: State.ACTIVE,
    Doing.HIGH: State.PROCESSING,
    Doing.SURFACING: State.SURFACING,
    Doing.FLOATING: State.FLOATING,
    Doing.DOCKED: State.CHARGING,
    Doing.SINKING: State.SINKING,
    Doing.EMPTY: State.EMPTY,
}
NOMINAL = TwinParameters(
    scale=TimeScale(1),
    drain=Drain(
        # Asleep, idle, high load, surfacing, floating, docked three times, lost: what the nominal kind draws.
        (0.0000674, 0.0010427, 0.0018, 0.0010427, 0.0031824, 0.0000674, 0.0000674, 0.0000674, 0.0),
        motor_run=0.0268,
        motor_deviation=0.003,
        in_dock=0.6037,
    ),
    charger=ChargerParameters(
        ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)), primary=1.2435, deviation=0.04
    ),
    sensor=SensorParameters(
        0.015, (0.0, -0.01, -0.03, 0.03), (0.004, 0.006, 0.011, 0.011), apart_ms=5 * MINUTE
    ),
    habits=Habits(
        every_ms=60 * MINUTE,
        unscheduled=0.033,
        stays=0.55,
        shares=(0.80, 0.16, 0.04),
        daily=0.92,
        plan_lasts_ms=5 * 24 * 60 * MINUTE,
        plan_deviation=0.009 / 60,
        seen_before=40,
    ),
    water=WaterParameters(
        step_variance_m2=0.0, current_deviation_m_s=0.0, current_lasts_s=3600.0, fix_deviation_m=1.0
    ),
    drain_deviation=0.06,
    ageing_per_day=0.002,
    clock=ClockParameters(1000.0, 20.0, 1000.0),
    board=BoardConfig(0, WORST_CASE, 50, 2000, float_timeout_ms=12 * 60 * MINUTE, release_wait_ms=0),
    sinking=Sinking(3_000_000, 4 * MINUTE, 4 * MINUTE),
)
"""A filter's knowledge of the study's aMussels: the nominal kind, not the individual."""


def twin(life: Life, agent: int, knows_schedule: bool) -> Twin:
    return Twin(NOMINAL, _schedules(life, agent, knows_schedule))


def oracle(life: Life, agent: int, knows_schedule: bool) -> Twin:
    """The same filter with the true drain and the true biases of this aMussel."""
    parameters = NOMINAL
    drain = parameters.drain
    factor = float(life.drain[agent])
    sag = life.sag[agent]
    known = replace(
        parameters,
        drain=replace(
            drain,
            per_min=tuple(rate * factor for rate in drain.per_min),
            motor_run=drain.motor_run * factor,
        ),
        sensor=replace(
            parameters.sensor,
            bias=(
                float(sag[Doing.ASLEEP]),
                float(sag[Doing.IDLE]),
                float(sag[Doing.HIGH]),
                float(sag[Doing.DOCKED]),
            ),
            bias_deviation=(1e-4, 1e-4, 1e-4, 1e-4),
        ),
        drain_deviation=1e-3,
    )
    return Twin(known, _schedules(life, agent, knows_schedule))


def hold_last(life: Life, agent: int, knows_schedule: bool) -> LastPacket:
    return LastPacket()


def _schedules(life: Life, agent: int, knows_schedule: bool) -> dict[int, Schedule]:
    if not knows_schedule:
        return {}
    modes = life.scheduled[agent]
    changes = [0, *(np.flatnonzero(np.diff(modes)) + 1)]
    schedule = Schedule(
        tuple(int(hour) * 60 * MINUTE for hour in changes), tuple(Mode(int(modes[hour])) for hour in changes)
    )
    return {agent: schedule}


def beliefs(life: Life, agent: int, estimator: Estimator, heard: Array) -> Iterator[tuple[int, Belief]]:
    """(hour, belief) at each timeslot, from the first packet on; `heard` marks the hours in which the packet arrived."""
    belief: Belief | None = None
    events = iter([*life.events[agent], (1 << 60, Event.RELEASED)])
    at_min, event = next(events)
    for hour in range(life.primary.shape[1]):
        timeslot_min = 60 * hour + int(life.timeslot_minute[agent])
        while at_min <= timeslot_min:
            belief = estimator.update(belief, _done(event), MissionMs(at_min * MINUTE))
            at_min, event = next(events)
        now_ms = timeslot_min * MINUTE
        if heard[hour]:
            belief = estimator.update(belief, _packet(life, agent, hour, now_ms), MissionMs(now_ms))
        elif belief is not None:
            belief = estimator.update(belief, TimeslotSilent(), MissionMs(now_ms))
        if belief is not None:
            yield hour, belief


def _done(event: Event) -> Permitted | Docked | Released:
    if event is Event.PERMITTED:
        return Permitted()
    return Docked() if event is Event.DOCKED else Released(0.0, 0.0)


def _packet(life: Life, agent: int, hour: int, now_ms: int) -> StatusPacket:
    state = _STATES[Doing(int(life.doing[agent, hour]))]
    primary, secondary = (float(one) for one in life.measured[agent, hour])
    return StatusPacket(agent, hour, state, primary, secondary, 0.0, 0.0, 3.0, now_ms)

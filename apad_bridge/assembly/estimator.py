"""Builds the configuration of a scenario's estimator: the kind of board, the water, and the trust in both.

The numbers come from the scenario's block `beliefs.twin`. Those that no scenario gives stand here; all of them are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from agents.mussel.body import BodyConfig
from agents.mussel.reporter import ReportConfig
from agents.time_scale import TimeScale
from apad_bridge.beliefs.charge_checker import NOT_ON_THE_PRIMARY
from apad_bridge.beliefs.modes import DOCKED as DOCKED_MODES
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.twin_parameters import (
    CallParameters,
    ChargerParameters,
    ClockParameters,
    CycleParameters,
    Drain,
    Habits,
    Schedule,
    SensorParameters,
    TwinParameters,
    UntoldParameters,
    WaterParameters,
)
from apad_bridge.scenario.blocks.estimator_options import TwinModel
from apad_bridge.scenario.schema import DriftMode, HearingMode, Positioning, Scenario
from firmware_model.config import PATH_UNIT, BoardConfig, FullFirmware, timeslots_of
from firmware_model.power.charge import FULL, MS_PER_HOUR, MS_PER_MIN, ChargeModel, Segments
from firmware_model.power.rails import Rail, rails_of
from firmware_model.power.voltage_curve import STRAIGHT
from firmware_model.state_groups import DOCKED
from firmware_model.states import State

_STATES = {
    Mode.IDLE: State.ACTIVE,
    Mode.HIGH_LOAD: State.PROCESSING,
    Mode.SURFACING: State.SURFACING,
    Mode.FLOATING: State.FLOATING,
    Mode.CHARGING_PRIMARY: State.CHARGING,
    Mode.CHARGING_SECONDARY: State.CHARGING,
    Mode.FULL: State.CHARGING,
    Mode.LOST: State.LOST,
}
_SAMPLED_IN = {State.TRANSMITTING: State.AWAITING_SLOT, State.REPORTING: State.CHARGING}
"""The state whose load a reading has that a packet of another state reports."""
_READING_APART_MS = 300_000
_MISSION_APART_MS = 20_000
"""The least time between used readings of one aMussel, in agent and in mission time. Because of it, fleets that report each
second cost less."""
_MISSED = 0.1
"""The largest fraction of Wi-Fi reports from the surface that an aPad beside the aMussel misses. An aPad farther off
receives none, assumes that the aMussel stayed below, and repeats the permission; it receives them when it has come."""
_CAPACITY_DEVIATION = 0.1
"""Relative, between aMussels: a battery that holds less drains and charges faster."""
_AGEING_PER_DAY = 0.001
"""Relative: a drain that was learnt may be off by so much more after each day."""
_STEADY_CURRENT_S = 3600.0
"""The time after which a current may have turned."""


@dataclass(frozen=True, slots=True)
class TwinConfig:
    """The configuration of an estimator with a twin for each aMussel."""

    parameters: TwinParameters
    schedules: dict[int, Schedule]
    """The boards' schedules by id."""


def twin_config(
    scenario: Scenario, board: BoardConfig, body: BodyConfig, reports: ReportConfig
) -> TwinConfig | None:
    """Builds the twins' configuration; None for the estimator that holds the last packet."""
    if (model := scenario.beliefs.twin) is None:
        return None
    return TwinConfig(
        twin_parameters(scenario, model, board, body, reports),
        schedules(board.whole, scenario.fleet.all_ids, scenario.fleet.ids),
    )


def schedules(
    firmware: FullFirmware | None, all_ids: Sequence[int], ids: Sequence[int]
) -> dict[int, Schedule]:
    """Builds the schedules of the boards of `ids`.

    A board is always awake, as the paper's worst case, or asleep but for the wakes of its cycle.

    `all_ids` are the whole fleet's.
    """
    if firmware is None or firmware.cycle is None:
        return dict.fromkeys(ids, Schedule((0,), (Mode.IDLE,)))
    served = set(ids)
    return {
        agent_id: Schedule((0,), (Mode.ASLEEP,), _cycle_of(firmware, timeslot))
        for agent_id, timeslot in timeslots_of(all_ids).items()
        if agent_id in served
    }


def twin_parameters(
    scenario: Scenario, model: TwinModel, board: BoardConfig, body: BodyConfig, reports: ReportConfig
) -> TwinParameters:
    scale, firmware, untold = scenario.time_scale, board.whole, _untold(scenario, model)
    metering = None if firmware is None else firmware.power.metering
    deviations = (model.bias_deviation,) * 4
    drift = scenario.fleet.drift
    step_m = drift.amplitude_m if drift.mode is DriftMode.PAPER else 0.0
    return TwinParameters(
        scale=scale,
        drain=_drain(board, model.motor_deviation),
        charger=_charger(board.charge, model.coil_deviation, 0.0 if untold else _CAPACITY_DEVIATION),
        sensor=SensorParameters(
            model.sensor_noise,
            (0.0,) * 4,
            deviations,
            readings_apart_ms(scale),
            _offsets(firmware),
            curve=STRAIGHT if metering is None else metering.curve,
            saturates=metering is not None,
        ),
        habits=Habits(
            every_ms=MS_PER_HOUR,
            unscheduled=model.unscheduled,
            stays=1.0,
            shares=(1.0, 0.0, 0.0),
            daily=0.0,
            plan_lasts_ms=24 * MS_PER_HOUR,
            plan_deviation=0.0,
            seen_before=1.0,
        ),
        water=WaterParameters(
            step_m**2 / 3,
            model.current_deviation_m_s,
            _STEADY_CURRENT_S,
            model.fix_deviation_m,
            is_ground_truth=scenario.hearing.positioning is Positioning.GROUND_TRUTH,
            way_down_s=body.sinking.sinking_ms / scale.agent_span(1000),
        ),
        drain_deviation=math.hypot(model.drain_deviation, 0.0 if untold else _CAPACITY_DEVIATION),
        ageing_per_day=_AGEING_PER_DAY,
        clock=ClockParameters(1000.0, 20.0, scale.agent_time(1000.0)),
        board=board,
        sinking=body.sinking,
        calls=None if scenario.water is None else CallParameters(reports.period_ms, _MISSED),
        untold=untold,
    )


def _untold(scenario: Scenario, model: TwinModel) -> UntoldParameters | None:
    """Returns the ranges of what the twins learn; None where every packet is received, as in the paper."""
    if scenario.hearing.mode is HearingMode.PAPER:
        return None
    untold = model.untold
    return UntoldParameters(untold.ageing, untold.drain, untold.bias, untold.drain_swing)


def readings_apart_ms(scale: TimeScale) -> int:
    """Returns the least agent time between two used readings of one aMussel; of nearer readings only one is used."""
    return max(_READING_APART_MS, scale.agent_span(_MISSION_APART_MS))


def _drain(board: BoardConfig, motor_deviation: float) -> Drain:
    if (firmware := board.whole) is None:
        # Equation (1) for every state in the water; in a dock equation (2) covers everything.
        per_min = board.charge.discharge * MS_PER_MIN / FULL
        return Drain(
            tuple(0.0 if mode >= Mode.CHARGING_PRIMARY else per_min for mode in Mode),
            0.0,
            1e-4,
            1.0,
        )
    draw_per_min = _draws(firmware)
    rates = {mode: draw_per_min(state) for mode, state in _STATES.items()}
    rates[Mode.ASLEEP] = draw_per_min(State.SLEEPING)
    if firmware.cycle is not None:
        reports = firmware.cycle.report_ms / firmware.cycle.alarm_ms
        for mode in DOCKED_MODES:
            rates[mode] += (draw_per_min(State.REPORTING) - rates[mode]) * reports
        cycle = _cycle_of(firmware, 0)
        rates[Mode.ASLEEP] = cycle.in_all * MS_PER_MIN / cycle.period_ms
    motor_run = firmware.power.loads.of[Rail.MOTORS] * firmware.power.motor_run_ms / FULL
    scheduled_per_min = rates[Mode.IDLE if firmware.cycle is None else Mode.ASLEEP]
    listening_ms = 0 if firmware.cycle is None else firmware.cycle.listen_ms
    release_wait_ms = board.release_wait_ms
    return Drain(
        tuple(rates[mode] for mode in Mode),
        motor_run,
        motor_deviation * motor_run,
        firmware.power.path / PATH_UNIT,
        listening=(rates[Mode.IDLE] - scheduled_per_min) * listening_ms / MS_PER_MIN,
        release_wait=(draw_per_min(State.RELEASED) - scheduled_per_min) * release_wait_ms / MS_PER_MIN,
    )


def _draws(firmware: FullFirmware) -> Callable[[State], float]:
    """Returns the draw per minute, as a function of the state."""
    loads, never_asleep = firmware.power.loads, firmware.cycle is None
    return lambda state: (
        loads.total(rails_of(state, firmware.power.kept_on, never_asleep, 0)) * MS_PER_MIN / FULL
    )


def _cycle_of(firmware: FullFirmware, timeslot: int) -> CycleParameters:
    """Builds the cycle of a sleeping board: it wakes, samples, processes and, with timeslots, awaits its own and transmits.

    Frames begin at whole multiples of their length, so the board waits equally long in every cycle that is a multiple of a
    frame.
    """
    cycle_config, draw_per_min = firmware.cycle, _draws(firmware)
    assert cycle_config is not None
    awake_ms = cycle_config.sample_ms + cycle_config.processing_ms
    lasting = [
        (cycle_config.sample_ms, draw_per_min(State.SAMPLING)),
        (cycle_config.processing_ms, draw_per_min(State.PROCESSING)),
    ]
    if cycle_config.slots is not None:
        opens_ms = timeslot * cycle_config.slots.slot_ms + cycle_config.slots.guard_ms
        waits_ms = (opens_ms - awake_ms) % cycle_config.slots.frame_ms
        lasting += [
            (waits_ms, draw_per_min(State.AWAITING_SLOT)),
            (firmware.transmit_ms, draw_per_min(State.TRANSMITTING)),
        ]
    return CycleParameters.of(
        [*lasting, (cycle_config.alarm_ms, draw_per_min(State.SLEEPING))], cycle_config.alarm_ms
    )


def _offsets(firmware: FullFirmware | None) -> dict[State, tuple[float, float]]:
    """Computes the shift of the readings by load and charger, for boards that meter (firmware_model.hardware.voltage).

    The primary feeds the whole load in the water, and in the dock the part of it that the path lets through.
    """
    metering = None if firmware is None else firmware.power.metering
    if firmware is None or metering is None:
        return {}

    def sag(load: float) -> float:
        return metering.sag_ms * max(0.0, load - metering.sag_from) / FULL

    power, never_asleep, lift = firmware.power, firmware.cycle is None, metering.lift / FULL
    offsets = {}
    for state in State:
        # A transmission is over before the monitor samples again, and a docked board reports as soon as its alarm rings.
        before = _SAMPLED_IN.get(state, state)
        load = power.loads.total(rails_of(before, power.kept_on, never_asleep, 0))
        if state in DOCKED:
            offsets[state] = lift - sag(load * power.path / PATH_UNIT), lift
        elif state not in NOT_ON_THE_PRIMARY:
            offsets[state] = -sag(load), 0.0
    return offsets


def _charger(model: ChargeModel, coil_deviation: float, rate_deviation: float) -> ChargerParameters:
    def per_min(segments: Segments) -> tuple[tuple[float, float], ...]:
        return tuple((end / FULL, rate * MS_PER_MIN / FULL) for end, rate in segments)

    one_coil = per_min(model.segments)
    coils = per_min(model.segments_by_two)[-1][1] / one_coil[-1][1] if model.segments_by_two else 1.0
    return ChargerParameters(one_coil, coils, coil_deviation, rate_deviation)

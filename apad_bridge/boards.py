"""What a scenario's board becomes: the one model of its batteries, for all who ask what they hold, and its firmware."""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Decimal

from apad_bridge.scenario.schema import Board
from apad_bridge.scenario.whole_board import BoardPower, LastResort, SleepCycle
from firmware_model import plan
from firmware_model.charge import FULL, Battery, ChargeModel, Flow, grains, grains_per_ms
from firmware_model.rails import Loads, Rail, bits, rails_of
from firmware_model.states import State

_MS_PER_HOUR = 3_600_000
_COIL_UNIT = 10_000


def charge_model(board: Board) -> ChargeModel:
    """How the batteries of such a board charge and discharge."""
    if board.whole is None:
        assert board.discharge_per_min is not None and board.charge_segments is not None  # a Board sees to it
        return ChargeModel.from_minutes(board.discharge_per_min, board.charge_segments)
    power = board.whole.power
    one_coil = tuple((grains(end), grains_per_ms(rate)) for end, rate in power.charge_segments)
    factor = round(power.two_coils * _COIL_UNIT)
    return ChargeModel(0, one_coil, tuple((end, rate * factor // _COIL_UNIT) for end, rate in one_coil))


def whole_firmware(board: Board) -> plan.Whole | None:
    """The whole firmware's numbers; None for the paper's worst case."""
    whole = board.whole
    if whole is None:
        return None
    return plan.Whole(
        _power(whole.power, whole.last_resort),
        None if whole.cycle is None else _cycle(whole.cycle),
        whole.transmit_ms,
        _ms(whole.last_resort.call_period_s),
        _ms(whole.hover_period_s),
    )


def can_fill(board: Board, start: float, level: float) -> bool:
    """Whether the primary battery of a board in a dock gets from `start` above `level` under what is on there, ever."""
    whole = whole_firmware(board)
    load = 0
    if whole is not None:
        on = rails_of(State.CHARGING, whole.power.kept_on, whole.cycle is None, 0)
        load = whole.power.loads.total(on) * whole.power.path // plan.PATH_UNIT
    docked = Battery(0, grains(start), Flow.CHARGING, load, coils=1 if whole is None else 2)
    return charge_model(board).reaches_at_ms(docked, min(FULL, grains(level) + 1)) is not None


def _power(power: BoardPower, last_resort: LastResort) -> plan.Power:
    return plan.Power(
        loads=Loads(
            tuple(
                grains_of_milliwatts(getattr(power.loads_mw, rail.name.lower()), power.capacity_wh)
                for rail in Rail
            )
        ),
        path=round(power.path * plan.PATH_UNIT),
        motor_run_ms=_ms(power.motor_run_s),
        receive_ms=power.receive_ms,
        switch_back=grains(power.switch_back),
        safe_level=grains(last_resort.safe_level),
        last_resort=plan.LastResort[last_resort.action.name],
        kept_on=bits(*{Rail[name.upper()] for name in power.kept_on}),
    )


def _cycle(cycle: SleepCycle) -> plan.Cycle:
    slots = cycle.slots
    return plan.Cycle(
        alarm_ms=_ms(cycle.alarm_s),
        sample_ms=_ms(cycle.sample_s),
        processing_ms=_ms(cycle.processing_s),
        slots=None if slots is None else plan.Slots(_ms(slots.frame_s), _ms(slots.slot_s)),
        listen_ms=_ms(cycle.listen_s),
    )


def grains_of_milliwatts(load_mw: float, capacity_wh: float) -> int:
    """What a load takes from a battery of that capacity, in grains a millisecond; decimal, so that it is exact."""
    capacity_mwh = Decimal(repr(capacity_wh)) * 1000
    share = Decimal(repr(load_mw)) * FULL / (capacity_mwh * _MS_PER_HOUR)
    return int(share.to_integral_value(ROUND_HALF_EVEN))


def _ms(seconds: float) -> int:
    return round(seconds * 1000)

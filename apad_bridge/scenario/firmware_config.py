"""Builds the firmware model's configuration of a scenario's board, and the one model of its batteries for all users."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from decimal import ROUND_HALF_EVEN, Decimal
from functools import cache
from typing import Any

from agents.fleet_config import Spread
from agents.modem.frames import ModemGeneration, duration_ms
from apad_bridge.scenario.blocks.board_options import BoardOptions
from apad_bridge.scenario.blocks.full_firmware_options import (
    BoardPower,
    FullFirmwareOptions,
    LastResortOptions,
    MeteringOptions,
    SleepCycle,
    TimekeepingOptions,
)
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.schema import Scenario
from firmware_model import config
from firmware_model.packets import ShortStatus
from firmware_model.packets.codec import Codec, load_codec
from firmware_model.power.ageing import AS_NEW, aged, capacity_left
from firmware_model.power.charge import (
    FULL,
    MS_PER_HOUR,
    Battery,
    ChargeModel,
    Flow,
    grains,
)
from firmware_model.power.rails import Loads, Rail, bits, rails_of
from firmware_model.power.voltage_curve import VoltageCurve
from firmware_model.sinking import Sinking
from firmware_model.states import State
from firmware_model.table_one import CELL_MV, RANGE_MV

_PPB_OF_PPM = 1000


def codec_of(scenario: Scenario) -> Codec:
    """Loads the codec of the scenario's packets, ours or an installed package's. ScenarioError if it cannot be loaded."""
    try:
        return load_codec(scenario.hearing.codec)
    except Exception as error:  # a package's import or constructor may raise anything
        raise ScenarioError([f"{scenario.name}: hearing.codec: {error}"]) from error


def board_config(
    board: BoardOptions, seed: int = 0, modems: ModemGeneration = ModemGeneration.V3
) -> config.BoardConfig:
    """Builds the configuration that all boards share, with their batteries at their age.

    `seed` is for the noise of readings. An aMussel's id, timeslot and clock's drift are its own, and 0 here.
    """
    as_new = config.BoardConfig(
        agent_id=0,
        charge=board.charge_as_new(),
        whole=None if board.whole is None else _full_firmware(board.whole, seed, modems),
        motor_run=grains(board.motor_run_charge),
        **{"surfacing_timeout_ms": _ms(3 * board.surfacing_s)} | _times(board, config.BoardConfig),
    )
    ageing = None if board.whole is None else board.whole.power.ageing
    return as_new if ageing is None else aged(as_new, capacity_left(ageing.cycles, ageing.years))


def charge_model(board: BoardOptions) -> ChargeModel:
    """Builds the charge model of the board's batteries at their age."""
    return board_config(board).charge


def sinking_of(scenario: Scenario) -> Sinking:
    """Builds the rates at which the bodies rise and sink."""
    board = scenario.board
    return Sinking(round(scenario.area.depth_m * 1e6), _ms(board.surfacing_s), _ms(board.sinking_s))


def spread_of(scenario: Scenario) -> Spread:
    """Converts the spread among the fleet's boards."""
    spread = scenario.fleet.spread
    return Spread(
        round(spread.drain * AS_NEW), round(spread.capacity * AS_NEW), round(spread.drain_bias * AS_NEW)
    )


def charge_models(scenario: Scenario) -> Callable[[int], ChargeModel]:
    """Returns the charge model of each aMussel's own batteries, by id."""
    nominal, spread = charge_model(scenario.board), spread_of(scenario)
    return cache(lambda agent_id: spread.charge_model(nominal, scenario.seed, agent_id))


def _full_firmware(whole: FullFirmwareOptions, seed: int, modems: ModemGeneration) -> config.FullFirmware:
    return config.FullFirmware(
        power=_power(whole.power, whole.last_resort, seed),
        cycle=None if whole.cycle is None else _cycle(whole.cycle),
        call_ms=_ms(whole.last_resort.call_period_s),
        hover_ms=_ms(whole.hover_period_s),
        timekeeping=None if whole.timekeeping is None else _timekeeping(whole.timekeeping),
        answer_ms=duration_ms(modems, ShortStatus.BYTES),
        **_times(whole.last_resort, config.FullFirmware) | _times(whole, config.FullFirmware),
    )


def takes_samples(board: BoardOptions) -> bool:
    """Returns True if such boards wake to read sensors; the paper's worst case and a board that never sleeps do not."""
    return board.whole is not None and board.whole.cycle is not None


def works_on_secondary(board: BoardOptions) -> bool:
    """Returns True if such boards work on their secondary battery, too."""
    return board.whole is not None and board.whole.power.secondary == "in_use"


def clock_drift_ppb(board: BoardOptions) -> int:
    """Returns the largest drift of the boards' clocks in parts of 10^9."""
    return 0 if board.whole is None else round(board.whole.clock_drift_ppm * _PPB_OF_PPM)


def can_fill(board: BoardOptions, start: float, level: float) -> bool:
    """Returns True if a docked board's primary battery ever gets from `start` above `level` under the docked load."""
    firmware, load = board_config(board), 0
    whole = firmware.whole
    if whole is not None:
        on = rails_of(State.CHARGING, whole.power.kept_on, whole.cycle is None, 0)
        load = whole.power.loads.total(on) * whole.power.path // config.PATH_UNIT
    docked = Battery(0, grains(start), Flow.CHARGING, load, coils=1 if whole is None else 2)
    return firmware.charge.reaches_at_ms(docked, min(FULL, grains(level) + 1)) is not None


def _power(power: BoardPower, last_resort: LastResortOptions, seed: int) -> config.Power:
    return config.Power(
        loads=Loads(
            tuple(
                grains_of_milliwatts(getattr(power.loads_mw, rail.name.lower()), power.capacity_wh)
                for rail in Rail
            )
        ),
        path=round(power.path * config.PATH_UNIT),
        switch_back=grains(power.switch_back),
        safe_level=grains(last_resort.safe_level),
        last_resort=last_resort.action,
        kept_on=bits(*{Rail[name.upper()] for name in power.kept_on}),
        metering=None if power.metering is None else _metering(power.metering, power.capacity_wh, seed),
        low_level=grains(power.low_level),
        secondary_in_use=power.secondary == "in_use",
        **_times(power, config.Power),
    )


def _metering(metering: MeteringOptions, capacity_wh: float, seed: int) -> config.Metering:
    """Converts the metering: 1 mW is 1 / 3700 A through the resistance, and a number of grains a ms of this battery."""
    mv_per_mw = metering.internal_resistance_ohm * 1000 / CELL_MV
    grains_per_ms_of_mw = FULL / (capacity_wh * 1000) / MS_PER_HOUR
    return config.Metering(
        sag_ms=round(mv_per_mw * FULL / RANGE_MV / grains_per_ms_of_mw),
        sag_from=grains_of_milliwatts(metering.idle_mw, capacity_wh),
        lift=round(metering.lift_mv * FULL / RANGE_MV),
        noise=round(metering.noise_mv * FULL / RANGE_MV),
        seed=seed,
        curve=VoltageCurve(tuple((grains(charge), grains(it)) for charge, it in metering.discharge_curve)),
        **_times(metering, config.Metering),
    )


def _timekeeping(timekeeping: TimekeepingOptions) -> config.Timekeeping:
    bound_ppb = round(timekeeping.bound_ppm * _PPB_OF_PPM)
    return config.Timekeeping(bound_ppb, **_times(timekeeping, config.Timekeeping))


def _cycle(cycle: SleepCycle) -> config.Cycle:
    slots = None if cycle.slots is None else config.Timeslots(**_times(cycle.slots, config.Timeslots))
    return config.Cycle(slots=slots, **_times(cycle, config.Cycle))


def grains_of_milliwatts(load_mw: float, capacity_wh: float) -> int:
    """Converts a load to grains a millisecond of a battery of this capacity; decimal, so that it is exact."""
    capacity_mwh = Decimal(repr(capacity_wh)) * 1000
    exact = Decimal(repr(load_mw)) * FULL / (capacity_mwh * MS_PER_HOUR)
    return int(exact.to_integral_value(ROUND_HALF_EVEN))


def _times(block: Any, target: type[Any]) -> dict[str, Any]:
    """A block's times that the firmware's configuration has by the same name: `boot_ms`, or `boot_s` in seconds."""
    keys = vars(block).items()
    times = {key: value for key, value in keys if key.endswith("_ms")} | {
        f"{key[:-2]}_ms": _ms(value) for key, value in keys if key.endswith("_s") and value is not None
    }
    return {it.name: times[it.name] for it in fields(target) if it.name in times}


def _ms(seconds: float) -> int:
    return round(seconds * 1000)

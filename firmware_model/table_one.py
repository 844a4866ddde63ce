"""The numbers of an aMussel's power, and the row of the paper's Table I that each was fitted to.

Everything is scaled voltage a simulated minute, as in the paper, which measured nothing else. Four parameters are fitted
here (`FITTED`), against six rows. Equations (1) and (2) are the paper's own fits. Values that Table I cannot distinguish
(`ASSUMED`) come from data sheets, for a battery of 7400 mWh.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.config import (
    PATH_UNIT,
    BoardConfig,
    Cycle,
    FullFirmware,
    LastResort,
    Metering,
    Power,
    Timeslots,
)
from firmware_model.power.charge import (
    EMPTY_MV,
    FULL,
    FULL_MV,
    MS_PER_HOUR,
    ChargeModel,
    grains,
    grains_per_ms,
)
from firmware_model.power.rails import SENSOR_RAILS, Loads, Rail
from firmware_model.sampling.sensors import SENSORS

EQUATION_1 = 0.0010427134
EQUATION_2 = ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
REFERENCE_MWH = 7400.0


def _milliwatts(power_mw: float) -> float:
    """The power as scaled voltage a minute of the reference battery."""
    return round(power_mw / REFERENCE_MWH / 60, 10)


@dataclass(frozen=True, slots=True)
class ModelNumber:
    """A number of the model, its source, and the row of Table I that it was fitted to."""

    name: str
    value: float
    unit: str
    source: str
    fitted_to: str = ""


FITTED = (
    ModelNumber(
        "mu_asleep",
        0.0000392756,
        "a minute",
        "deep sleep of the MU without the modem",
        "discharging, hourly wakes: 14057 min",
    ),
    ModelNumber(
        "two_coils",
        1.2435,
        "of equation (2)",
        "the primary's charger has two coils",
        "charging, primary, hourly wakes: 398 min",
    ),
    ModelNumber(
        "path",
        0.6037,
        "of the load",
        "power path: what of the load reaches the battery while charging",
        "charging, primary, idle: 575 min",
    ),
    ModelNumber(
        "motor_run",
        0.0268,
        "a run",
        "one run of the buoyancy motors",
        "Pi on, motors every 10 min: within 3 hours, so 165 min",
    ),
)
TAKEN = (
    ModelNumber("idle", EQUATION_1, "a minute", "equation (1): MU on and modem listening"),
    ModelNumber("charge_segments", 3, "segments", "equation (2): the secondary battery, one coil"),
)
"""The paper's own fits to its recordings."""

_NANOMODEM = "nanomodem data sheet, at 5 V"
ASSUMED = (
    ModelNumber(
        "reference_capacity",
        REFERENCE_MWH,
        "mWh",
        "2 Ah at 3.7 V; turns the milliwatts below into scaled voltage",
    ),
    ModelNumber("modem_listening", 12.5, "mW", f"{_NANOMODEM}: 2.5 mA"),
    ModelNumber("modem_receiving", 25, "mW", f"{_NANOMODEM}: 5 mA"),
    ModelNumber("modem_transmitting", 1500, "mW", f"{_NANOMODEM}: up to 300 mA"),
    *(ModelNumber(it.name, it.load_mw, "mW", it.load_source) for it in SENSORS),
    ModelNumber("pi", 1000, "mW", "a small Raspberry Pi at work"),
    ModelNumber("wifi", 500, "mW", "a module of this class"),
    ModelNumber("gsm", 400, "mW", "a module of this class"),
    ModelNumber("bluetooth", 50, "mW", "a module of this class"),
    ModelNumber("motor_run_time", 60, "s", "the energy of a run is what was fitted, not its time"),
)
METERED = (
    ModelNumber("internal_resistance", 0.1, "ohm", "a lithium polymer cell of 2 Ah"),
    ModelNumber("lift", 24, "mV", "0.24 A of the primary's charger through that resistance"),
    ModelNumber("noise", 3, "mV", "a converter of 12 bits, and what is on its wires"),
    ModelNumber("monitor_period", 10, "s", "cheap enough for deep sleep"),
    ModelNumber("monitor_settle", 120, "s", "twice a motor run, which pulls the voltage down most"),
)
"""The parameters of the optional battery monitor (`METERING`)."""
_FITTED = {parameter.name: parameter.value for parameter in FITTED}
_ASSUMED = {parameter.name: parameter.value for parameter in ASSUMED}
_METERED = {parameter.name: parameter.value for parameter in METERED}
_LISTENING = _milliwatts(_ASSUMED["modem_listening"])
_MOTOR_RUN_MS = round(_ASSUMED["motor_run_time"] * 1000)

LOADS = Loads.from_minutes(
    {
        Rail.MU_ASLEEP: _FITTED["mu_asleep"],
        Rail.MU_ACTIVE: round(EQUATION_1 - _LISTENING, 10),
        **{rail: _milliwatts(_ASSUMED[rail.name.lower()]) for rail in SENSOR_RAILS},
        Rail.PI: _milliwatts(_ASSUMED["pi"]),
        Rail.MODEM_LISTENING: _LISTENING,
        Rail.MODEM_RECEIVING: _milliwatts(_ASSUMED["modem_receiving"]),
        Rail.MODEM_TRANSMITTING: _milliwatts(_ASSUMED["modem_transmitting"]),
        Rail.WIFI: _milliwatts(_ASSUMED["wifi"]),
        Rail.GSM: _milliwatts(_ASSUMED["gsm"]),
        Rail.BLUETOOTH: _milliwatts(_ASSUMED["bluetooth"]),
        Rail.MOTORS: round(_FITTED["motor_run"] * 60_000 / _MOTOR_RUN_MS, 10),
    }
)
WORST_CASE = ChargeModel.from_minutes(EQUATION_1, EQUATION_2)
"""The paper's experiments (section IV-A): one battery, one load, the secondary's charging curve."""
CELL_MV = 3700
RANGE_MV = FULL_MV - EMPTY_MV
# A milliwatt is 1 / 3700 A: the ratio of millivolts across the resistance to grains a millisecond.
_SAG_MS = round(
    _METERED["internal_resistance"] * 1000 / CELL_MV * FULL / RANGE_MV / (FULL / REFERENCE_MWH / MS_PER_HOUR)
)
METERING = Metering(
    period_ms=round(_METERED["monitor_period"] * 1000),
    settle_ms=round(_METERED["monitor_settle"] * 1000),
    sag_ms=_SAG_MS,
    sag_from=grains_per_ms(EQUATION_1),
    lift=round(_METERED["lift"] * FULL / RANGE_MV),
    noise=round(_METERED["noise"] * FULL / RANGE_MV),
)
"""A monitor that infers charge from voltage. Table I holds with it too."""
_ONE_COIL = tuple((grains(end), grains_per_ms(rate)) for end, rate in EQUATION_2)
MODEL = ChargeModel(
    discharge=0,
    segments=_ONE_COIL,
    segments_by_two=tuple(
        (end, rate * round(_FITTED["two_coils"] * 10_000) // 10_000) for end, rate in _ONE_COIL
    ),
)
HOURLY = Cycle(
    alarm_ms=MS_PER_HOUR, sample_ms=10_000, processing_ms=0, slots=None, listen_ms=60_000, report_ms=10_000
)
"""Table I's short wakes: the sensors for 10 s every hour."""
FIELD = Cycle(
    alarm_ms=MS_PER_HOUR,
    sample_ms=10_000,
    processing_ms=60_000,
    slots=Timeslots(frame_ms=300_000, slot_ms=5000),
    listen_ms=60_000,
    report_ms=60_000,
)
"""Wakes of several minutes, as in Fig. 4 a: sample, process a little, await the timeslot, transmit."""

CYCLES = {"never": None, "hourly": HOURLY, "field": FIELD}
"""The cycles by the names that scripts and tests use."""


def power(
    last_resort: LastResort = LastResort.WAIT,
    kept_on: int = 0,
    metering: Metering | None = None,
    low_level: int = 0,
    secondary_in_use: bool = False,
) -> Power:
    return Power(
        loads=LOADS,
        path=round(_FITTED["path"] * PATH_UNIT),
        motor_run_ms=_MOTOR_RUN_MS,
        receive_ms=105,
        switch_back=FULL // 10,
        safe_level=FULL // 5,
        last_resort=last_resort,
        kept_on=kept_on,
        metering=metering,
        low_level=low_level,
        secondary_in_use=secondary_in_use,
    )


def board(cycle: Cycle | None, a_power: Power, agent_id: int = 1) -> BoardConfig:
    """A board with these loads; `cycle` None never sleeps."""
    whole = FullFirmware(a_power, cycle, transmit_ms=1000, call_ms=600_000, hover_ms=600_000)
    return BoardConfig(agent_id, MODEL, 50, 2000, 12 * MS_PER_HOUR, 120_000, whole)


def worst_case_board(agent_id: int = 1) -> BoardConfig:
    """The board of the paper's experiments: one battery, one load, never asleep."""
    return BoardConfig(agent_id, WORST_CASE, 50, 2000, 12 * MS_PER_HOUR, 120_000)

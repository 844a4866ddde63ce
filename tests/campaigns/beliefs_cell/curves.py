"""Prints a cell's curves as JSON, from PyBaMM: `python curves.py SET`. It runs in a venv of its own, without musselbed.

The single particle model with electrolyte (SPMe), isothermal at each temperature. `q` is the share that is left of what the
cell gives between resting voltages of 4.2 V and 3.6 V, the paper's range; `window_ah` is that amount. Currents are in
windows an hour, positive in discharge. `voltage` has rows of temperature, current and volts by `q`. `lost` is the share
lost by days on the shelf, by SEI growth that solvent diffusion limits.
"""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

os.environ["PYBAMM_DISABLE_TELEMETRY"] = "true"
pybamm: Any = import_module("pybamm")
Numbers = npt.NDArray[np.float64]

KELVIN = 273.15
TEMPERATURES = (5.0, 15.0, 25.0)
IDLE = 1 / 16
"""The paper's discharge takes 16 h under the idle load."""
FLOATING = 3 * IDLE
ONE_COIL = 1 / 8
TWO_COILS = 1.2435 * ONE_COIL
RESTING = 1 / 200
GRID = np.linspace(0.0, 1.0, 101)
SHELF_DAYS = (0, 30, 90, 180, 365, 730)
CUT_V, FULL_V, EMPTY_V = 3.2, 4.2, 3.6


def solved(
    values: Any, steps: list[Any], celsius: float, soc: float, options: dict[str, str] | None = None
) -> Any:
    values = values.copy()
    for name in ("Ambient temperature [K]", "Initial temperature [K]"):
        values[name] = celsius + KELVIN
    model = pybamm.lithium_ion.SPMe(options or {})
    # A bound at its own cut-off would end a charge at 4.2 V before the constant voltage.
    values["Upper voltage cut-off [V]"] = FULL_V + 0.005
    experiment = pybamm.Experiment([tuple(steps)])
    return pybamm.Simulation(model, parameter_values=values, experiment=experiment).solve(initial_soc=soc)


def entries(solution: Any, *names: str) -> list[Numbers]:
    return [np.asarray(solution[name].entries, dtype=float) for name in names]


def discharged(values: Any, amps: float, celsius: float) -> list[Numbers]:
    """Minutes, volts and Ah given, from full on."""
    step = pybamm.step.current(amps, termination=f"{CUT_V} V", duration="400 hours", period="10 minutes")
    return entries(
        solved(values, [step], celsius, 1.0), "Time [min]", "Terminal voltage [V]", "Discharge capacity [A.h]"
    )


def charged(values: Any, amps: float, celsius: float, least_amps: float) -> tuple[Numbers, Numbers, Numbers]:
    """Minutes, volts and Ah taken, from a low charge to a taper of `least_amps`; and the Ah at which it began."""
    steps = [
        pybamm.step.current(-amps, termination=f"{FULL_V} V", duration="40 hours", period="5 minutes"),
        pybamm.step.voltage(FULL_V, termination=f"{least_amps} A", duration="20 hours", period="5 minutes"),
    ]
    solution = solved(values, steps, celsius, 0.02)
    minutes, volts, given = entries(
        solution, "Time [min]", "Terminal voltage [V]", "Discharge capacity [A.h]"
    )
    return minutes, volts, -given


def curves(name: str) -> dict[str, Any]:
    values = pybamm.ParameterValues(name)
    nominal = float(values["Nominal cell capacity [A.h]"])
    _, volts, given = discharged(values, nominal * RESTING, 15.0)
    window = float(np.interp(-EMPTY_V, -volts, given))
    down = {
        (celsius, current): discharged(values, current * window, celsius)
        for celsius in TEMPERATURES
        for current in (RESTING, IDLE, FLOATING)
    }
    up = {
        (celsius, current): charged(values, current * window, celsius, current * window / 10)
        for celsius, current in (*((it, TWO_COILS) for it in TEMPERATURES), (15.0, ONE_COIL))
    }
    # A charge begins at a lower voltage, and ends at full but for the rest of its taper.
    taken = {key: (minutes, v, 1 + (ah - ah[-1]) / window) for key, (minutes, v, ah) in up.items()}
    voltage = [
        [celsius, current, np.interp((1 - GRID) * window, ah, v).tolist()]
        for (celsius, current), (_, v, ah) in down.items()
    ]
    voltage += [
        [celsius, -current, np.interp(GRID, q, v).tolist()]
        for (celsius, current), (_, v, q) in taken.items()
        if current == TWO_COILS
    ]
    rest = pybamm.step.current(0.0, duration=f"{24 * SHELF_DAYS[-1]} hours", period="240 hours")
    aged = solved(values, [rest], 15.0, 0.7, {"SEI": "solvent-diffusion limited"})
    hours, loss = entries(aged, "Time [h]", "Loss of capacity to negative SEI [A.h]")
    log_down, log_up = down[15.0, IDLE], taken[15.0, ONE_COIL]
    return {
        "set": name,
        "pybamm": pybamm.__version__,
        "window_ah": window,
        "q": GRID.tolist(),
        "voltage": voltage,
        "discharge": {"min": log_down[0].tolist(), "v": log_down[1].tolist()},
        "charge": {"min": log_up[0].tolist(), "v": log_up[1].tolist()},
        "taken": [
            {"min": taken[15.0, current][0].tolist(), "q": taken[15.0, current][2].tolist()}
            for current in (ONE_COIL, TWO_COILS)
        ],
        "lost": [[day, float(np.interp(24 * day, hours, loss)) / window] for day in SHELF_DAYS],
    }


if __name__ == "__main__":
    pybamm.set_logging_level("ERROR")
    print(json.dumps(curves(sys.argv[1])))

"""Beliefs over ten days of boards whose true cell is PyBaMM's: a Kokam (Ecker2015) and an Enertech pouch cell (Ai2020).

`curves.py` gives each cell's curves, in a venv of its own that this campaign makes. `musselbed fit battery` makes one line
and three of them, as a person would. The boards behind carry the cell: its charge is counted in coulombs, fills as its
voltage allows, and reads as its voltage under load, at its temperature. The supervisor is told the fit, one resistance and
one lift, all measured half full at 15 degrees. The true charge is the resting voltage on the paper's range, and where the
supervisor is told the discharge's curve the share of the energy that is left. The row `linear` has boards that are as the
fit of Ai2020 says.

Water is 9 to 21 degrees: each aMussel has its own temperature, which swings by 2 degrees within a day. Cells have lain for
up to two years. A reading has a noise of 0.005. The aPad's battery lasts for the ten days.
"""

from __future__ import annotations

import json
import math
import os
import random
import subprocess
import sys
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from beliefs_untold.campaign import (
    SCENARIO,
    TWIN,
    Boards,
    Case,
    Drawn,
    Judge,
    Row,
    binned_scores,
    heard_by_sensors,
    in_one_row,
    told_of_losses,
)

from agents.fleet_config import Spread
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.field.battery_fit.battery_fit import BatteryFit, along, fit_log
from apad_bridge.field.battery_fit.battery_log import LogFormat, read_log
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.flying import in_process_context
from apad_bridge.runs.in_memory import mission_figures
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.sample_collection import SampleCollection
from benchmarks.rows import told
from firmware_model.config import BoardConfig
from firmware_model.hardware import whole
from firmware_model.hardware.power_path import PowerPath
from firmware_model.power.ageing import AS_NEW, rescaled
from firmware_model.power.charge import FULL, MS_PER_HOUR, Battery, ChargeModel, Flow, fraction

KEPT = Path(__file__).parents[3] / "studies" / "beliefs_cell"
"""The venv, the curves and the picture; no part of the repository."""
PIP_S, CURVES_S = 1800, 1800
SETS = ("Ai2020", "Ecker2015")
LINEAR = "linear"
CURVED = {f"{it}, told its curve": it for it in SETS}
CURVE_PIECES = 6
SEED = 917053
"""Written down before any of these was flown; twins that are told a curve were tuned on 917051 and 917052."""
DAYS, SHORT_DAYS = 10, 1
HEARD = (1.0, 0.1)
PIECES = 12
"""The segments of the true cell's charge, where the paper has three."""
MEAN_C, OWN_C, SWING_C = 15.0, 4.0, 2.0
IDLE = 1 / 16
"""The idle load, in windows an hour."""
CURVED_TWIN = TWIN | {"bias_deviation": 0.06, "coil_deviation": 0.05}
"""A twin that is told a curve: temperature and charge change one resistance, and the charging rate."""


class Unavailable(Exception):
    """PyBaMM cannot be had; the text is one line."""


@dataclass(frozen=True)
class Cell:
    """PyBaMM's curves. `q` is the share of the window between resting voltages of 3.6 and 4.2 V that is left."""

    name: str
    rows: dict[float, list[tuple[float, list[float]]]]
    """By temperature: (current in windows an hour, volts by q in hundredths), with rising currents."""
    taken: list[tuple[list[float], list[float]]]
    """Minutes and q of a charge by one coil, and by two."""
    lost: list[tuple[float, float]]
    logs: dict[str, tuple[list[float], list[float]]]

    @classmethod
    def read(cls, path: Path) -> Cell:
        data = json.loads(path.read_text())
        rows: dict[float, list[tuple[float, list[float]]]] = {}
        for celsius, current, volts in sorted(data["voltage"]):
            rows.setdefault(celsius, []).append((current, volts))
        return cls(
            data["set"],
            rows,
            [(it["min"], it["q"]) for it in data["taken"]],
            [(day, share) for day, share in data["lost"]],
            {name: (data[name]["min"], data[name]["v"]) for name in ("discharge", "charge")},
        )

    def scaled(self, q: float, current: float, celsius: float) -> float:
        """The voltage on the paper's range, linear between the curves."""
        known = list(self.rows)
        after = _after(known, celsius)
        low, high = known[after - 1], known[after]
        share = (celsius - low) / (high - low)
        volts = (1 - share) * self._volts(low, q, current) + share * self._volts(high, q, current)
        return (volts - 3.6) / 0.6

    def resting(self, q: float, celsius: float) -> float:
        return min(1.0, max(0.0, self.scaled(q, 0.0, celsius)))

    def _volts(self, celsius: float, q: float, current: float) -> float:
        rows = self.rows[celsius]
        after = _after([it for it, _ in rows], current)
        (first, below), (second, above) = rows[after - 1], rows[after]
        share = (current - first) / (second - first)
        at = min(q * 100, 99.999)
        n = int(at)
        part = at - n
        return (1 - share) * (below[n] + part * (below[n + 1] - below[n])) + share * (
            above[n] + part * (above[n + 1] - above[n])
        )

    def lost_after(self, days: float) -> float:
        known, shares = zip(*self.lost, strict=True)
        return float(np.interp(days, known, shares))

    def segments(self, coils: int) -> tuple[tuple[int, int], ...]:
        """(end, rate) in grains and grains a ms of the coulombs that a charge takes."""
        minutes, shares = self.taken[coils - 1]
        ends = [n / PIECES for n in range(PIECES + 1)]
        times = np.interp(ends, shares, minutes)
        pieces = zip(pairwise(ends), pairwise(times), strict=True)
        return tuple(
            (round(high * FULL), round((high - low) * FULL / ((end - begin) * 60_000)))
            for (low, high), (begin, end) in pieces
        )


def _after(values: list[float], at: float) -> int:
    """The index of the rising value after `at`; beyond an end that of the last pair there, which extrapolates."""
    return min(max(bisect_right(values, at), 1), len(values) - 1)


def curves(name: str) -> Cell:
    """The set's curves, kept from an earlier time or made. Unavailable without PyBaMM."""
    path = KEPT / f"{name}.json"
    if not path.exists():
        python = _interpreter()
        print(f"{name}: PyBaMM solves its curves", file=sys.stderr, flush=True)
        script = Path(__file__).with_name("curves.py")
        solved = _run([python, script, name], CURVES_S)
        path.write_text(solved.stdout)
    return Cell.read(path)


def _interpreter() -> Path:
    python = KEPT / "venv" / "bin" / "python"
    if not (KEPT / "installed").exists():
        print("pip installs PyBaMM in a venv of its own", file=sys.stderr, flush=True)
        KEPT.mkdir(parents=True, exist_ok=True)
        _run([sys.executable, "-m", "venv", KEPT / "venv"], PIP_S)
        _run([python, "-m", "pip", "install", "--quiet", "pybamm~=26.10"], PIP_S)
        (KEPT / "installed").touch()
    return python


def _run(command: Sequence[object], timeout_s: float) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYBAMM_DISABLE_TELEMETRY": "true"}
    try:
        return subprocess.run(
            [str(it) for it in command],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=timeout_s,
        )
    except subprocess.TimeoutExpired:
        raise Unavailable(f"{command[0]} took longer than {timeout_s} s") from None
    except (subprocess.CalledProcessError, OSError) as error:
        last = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
        raise Unavailable(last) from None


def fits(cell: Cell, curved: bool = False) -> tuple[BatteryFit, BatteryFit]:
    """`musselbed fit battery` of the cell's discharge and charge, which it reads from files as a person's."""
    logs = {}
    for name in ("discharge", "charge"):
        path = KEPT / f"{cell.name}-{name}.csv"
        rows = zip(*cell.logs[name], strict=True)
        path.write_text("t [min],voltage [V]\n" + "".join(f"{at:.3f},{volts:.5f}\n" for at, volts in rows))
        logs[name] = read_log(path, LogFormat())
    discharge = fit_log(logs["discharge"], CURVE_PIECES if curved else 1)
    charge = along(logs["charge"], discharge, _lift(cell, IDLE)) if curved else logs["charge"]
    return discharge, fit_log(charge, 3)


def _lift(cell: Cell, from_current: float) -> float:
    """The voltage of a charge by one coil above that at another current, half full at 15 degrees, on the paper's range."""
    charging = -1 / 8
    return cell.scaled(0.5, charging, 15.0) - cell.scaled(0.5, from_current, 15.0)


def scenario_of(cell: Cell, seed: int, curved: bool = False) -> Scenario:
    """The numbers that the supervisor is told: the fit, and the cell's resistance and lift half full at 15 degrees.

    With `curved` the fit has six pieces of the discharge, taken at the idle load, from which then sag and lift count.
    """
    discharge, charge = fits(cell, curved)
    shipped = load(SCENARIO)
    data = resolve(shipped)
    data |= {"seed": seed, "duration_s": DAYS * 86_400 // data["theta"]}
    data["fleet"]["start"] = {"charge": [0.5, 1.0]}
    data["apad"]["battery"]["capacity_wh"] = 1000.0
    data["beliefs"] = {"estimator": "twin", "twin": TWIN}
    power = data["board"]["whole"]["power"]
    idle_w = power["loads_mw"]["mu_active"] / 1000
    power["capacity_wh"] = round(idle_w / 60 / discharge.discharge_per_min, 4)
    power["charge_segments"] = [list(it) for it in charge.charge_segments]
    rest, idle, lifted = (cell.scaled(0.5, it, 15.0) * 600 for it in (0.0, *_told_currents(cell)))
    power["metering"] = {
        "profile": "table-one",
        "internal_resistance_ohm": round((rest - idle) / 1000 / (idle_w / 3.7), 4),
        "idle_mw": 0.0,
        "lift_mv": round(lifted - rest, 2),
        "noise_mv": 0.0,
    }
    if curved:
        curve = [list(point) for point in discharge.discharge_curve]
        power["metering"] |= {
            "discharge_curve": curve,
            "idle_mw": power["loads_mw"]["mu_active"],
            "lift_mv": round(600 * _lift(cell, IDLE), 2),
        }
        power["capacity_wh"] = round(idle_w * (discharge.minutes[-1] - discharge.minutes[0]) / 60, 4)
        data["beliefs"]["twin"] = CURVED_TWIN
    return from_data(data, shipped.name)


def _told_currents(cell: Cell) -> tuple[float, float]:
    currents = [it for it, _ in cell.rows[15.0]]
    return currents[-2], currents[0]


@dataclass(frozen=True, slots=True)
class Behind:
    """One board of the fleet: its share lost, and the middle and phase of its temperature."""

    lost: float
    middle_c: float
    phase: float

    def celsius(self, at_ms: int) -> float:
        return self.middle_c + SWING_C * math.sin(math.tau * (at_ms / (24 * MS_PER_HOUR) + self.phase))


def population(cell: Cell | None, seed: int, ids: Sequence[int]) -> dict[int, Behind]:
    luck = random.Random(f"cells {seed}")
    return {
        it: Behind(
            0.0 if cell is None else cell.lost_after(luck.uniform(0, 730)),
            MEAN_C + luck.uniform(-OWN_C, OWN_C),
            luck.random(),
        )
        for it in ids
    }


class Cells(Spread):
    """A spread that gives each board its cell."""

    def __init__(self, cell: Cell | None, boards: dict[int, Behind]) -> None:
        super().__init__()
        object.__setattr__(self, "behind", (cell, boards))

    def applied(self, board: BoardConfig, seed: int) -> BoardConfig:
        cell, boards = self.behind  # type: ignore[attr-defined]  # a frozen class, set above
        return config_behind(board, cell, boards[board.agent_id])


def config_behind(board: BoardConfig, cell: Cell | None, behind: Behind) -> BoardConfig:
    """A cell's board switches by coulombs; one without a cell is as the supervisor is told, its readings too."""
    if cell is None:
        return board
    assert board.whole is not None
    power = replace(board.whole.power, metering=None)
    board = replace(board, whole=replace(board.whole, power=power))
    # A window holds 16 h of the idle load, by the curves' own unit of current.
    nominal = power.loads.of[1] * MS_PER_HOUR / FULL
    left = round(AS_NEW * (1 - behind.lost))
    board = rescaled(board, round(AS_NEW / 16 / nominal), left)

    def faster(segments: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
        return tuple((end, rate * AS_NEW // left) for end, rate in segments)

    return replace(
        board,
        charge=ChargeModel(board.charge.discharge, faster(cell.segments(1)), faster(cell.segments(2))),
    )


def carrying(cell: Cell, boards: dict[int, Behind]) -> type[PowerPath]:
    """The batteries of boards that read the cell's voltage under its present current."""

    class Carrying(PowerPath):
        def __init__(self, *arguments: Any, **further: Any) -> None:
            super().__init__(*arguments, **further)
            self._behind = boards[arguments[5]]

        def readings(self, now_ms: int) -> tuple[int, int]:
            primary, secondary = (self._reading(it, now_ms) for it in (self.primary, self.secondary))
            return primary, secondary

        def _reading(self, battery: Battery, now_ms: int) -> int:
            q = fraction(self._model.charge_at(battery, now_ms))
            current = battery.load * MS_PER_HOUR / FULL
            if battery.flow is Flow.CHARGING:
                current += -1.2435 / 8 if battery.coils == 2 else -1 / 8
            scaled = cell.scaled(q, current, self._behind.celsius(now_ms))
            return round(FULL * min(1.0, max(0.0, scaled)))

    return Carrying


class CellJudge(Judge):
    """Judges by the resting voltage of the cell behind each board; `curved`: by the share of its window that is left."""

    def __init__(
        self,
        scenario: Scenario,
        nominal: BoardConfig,
        cell: Cell | None,
        boards: dict[int, Behind],
        curved: bool,
    ) -> None:
        super().__init__(scenario, nominal, {it: Drawn(ageing=behind.lost) for it, behind in boards.items()})
        self._models = {it: config_behind(nominal, cell, behind).charge for it, behind in boards.items()}
        self.meter = UptimeMeter(self._scale, self._models.__getitem__)
        self._cell, self._behind, self._curved = cell, boards, curved

    def _true(self, truth: Truth, at_ms: int) -> float:
        q = super()._true(truth, at_ms)
        if self._cell is None:
            return q
        if self._curved:
            return q
        return self._cell.resting(q, self._behind[truth.agent_id].celsius(at_ms))


def cell_behind(name: str) -> str:
    """The set of a row's cell; the straight boards are told the fit of the first set."""
    return SETS[0] if name == LINEAR else CURVED.get(name, name)


def flown(name: str, heard: float, seed: int, days: float = DAYS) -> tuple[list[Row], dict[str, Any]]:
    """The rows of a flight, and its mission's figures."""
    told_cell, curved = curves(cell_behind(name)), name in CURVED
    cell = None if name == LINEAR else told_cell
    scenario = scenario_of(told_cell, seed, curved)
    scenario = replace(scenario, duration_s=scenario.duration_s * days / DAYS)
    config = told_of_losses(flight_config(scenario), Case(Boards.UNTOLD, heard))
    boards = population(cell, seed, scenario.fleet.ids)
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    drawn = replace(fleet_parts.fleet_config(config), spread=Cells(cell, boards))
    path = PowerPath if cell is None else carrying(cell, boards)
    with patch.object(whole, "PowerPath", path):
        host = InProcessHost(drawn, initial_states)
        fleet = fleet_parts.fleet_of(config, host, dict.fromkeys(initial_states, 0))
        judge = CellJudge(scenario, config.board, cell, boards, curved)
        context = in_process_context(config, fleet)
        flight = flight_parts.flight(config, context, judge, samples=SampleCollection(config.ids))
        unbiased = dict.fromkeys(boards, Drawn())
        heard_by_sensors(flight, unbiased, seed, heard, scenario.time_scale)
        flight.run()
    figures = uptime_figures(judge.meter, flight.now_ms) | mission_figures(flight.supervisor.mission.state)
    return judge.rows, figures


def measure(short: bool = False, row: Sequence[str] | None = None) -> dict[str, Any]:
    """`told`: what each fit tells the supervisor, and how far it lies from the curves. `summary`, `bins`: the scores of
    the charge. `mission`: what the mission did with those beliefs. `picture`: the file with both charges and the paper's.
    """
    rows_here = (LINEAR, *SETS, *CURVED)
    names = rows_here if row is None else tuple(row)
    if unknown := set(names) - set(rows_here):
        raise SystemExit(f"no row {unknown.pop()!r}: the rows are {', '.join(rows_here)}")
    try:
        cells = {name: curves(name) for name in dict.fromkeys(map(cell_behind, names))}
    except Unavailable as error:
        return {"skipped": f"PyBaMM cannot be had: {error}"}
    result: dict[str, Any] = {
        "seed": SEED,
        "days": SHORT_DAYS if short else DAYS,
        "told": [_told_of(it) for it in cells.values()],
    }
    summary: list[Any] = []
    bins: list[Any] = []
    mission: list[Any] = []
    for name in names:
        for heard in HEARD[:1] if short else HEARD:
            rows, figures = flown(name, heard, SEED, SHORT_DAYS if short else DAYS)
            head = {"boards": name, "heard": heard}
            summary.append(told(in_one_row(head, [rows])))
            bins += binned_scores(head, [rows])
            mission.append(told(head | _short(figures)))
    result |= {"summary": summary, "bins": bins, "mission": mission}
    return result | {"picture": str(draw(list(cells.values()), KEPT / "charge.png"))}


def _short(figures: dict[str, Any]) -> dict[str, Any]:
    kept = ("services", "cost_m", "emptied", "amussels_lost", "final_charge_mean")
    means = {it: figures[it]["mean"] for it in ("uptime_paper", "uptime_submerged")}
    return means | {it: figures[it] for it in kept}


def _told_of(cell: Cell) -> dict[str, Any]:
    discharge, charge = fits(cell)
    return {
        "set": cell.name,
        "discharge_per_min": discharge.discharge_per_min,
        "discharge_rmse": discharge.rmse,
        "discharge_max_abs": discharge.max_abs,
        "charge_rmse": charge.rmse,
        "charge_max_abs": charge.max_abs,
        "lost_in_ten_days": cell.lost_after(DAYS),
        "lost_in_two_years": cell.lost_after(730),
        "charge_segments": [list(it) for it in charge.charge_segments],
    }


def draw(cells: list[Cell], path: Path) -> Path:
    """Scaled voltage by time: each cell's charge and discharge, the fit's lines, and the paper's equations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.5), layout="constrained")
    down, up = figure.subplots(1, 2, sharey=True)
    for cell, color in zip(cells, ("#3b6ea5", "#b5542c"), strict=False):
        for panel, name, fitted in zip((down, up), ("discharge", "charge"), fits(cell), strict=True):
            minutes, volts = cell.logs[name]
            scaled = [(it - 3.6) / 0.6 for it in volts]
            panel.plot([it / 60 for it in minutes], scaled, color=color, label=cell.name)
            at = fitted.minutes - fitted.minutes[0]
            begin = float(np.interp(fitted.scaled[0], scaled if name == "charge" else scaled[::-1],
                                    minutes if name == "charge" else minutes[::-1]))  # fmt: skip
            panel.plot((at + begin) / 60, fitted.curve.at(fitted.minutes), "--", color=color, label="its fit")
    down.plot([0, 1 / 0.0010427134 / 60], [1, 0], ":k", label="the paper's (1)")
    hours, charge = [0.0], [0.0]
    for end, rate in ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)):
        hours.append(hours[-1] + (end - charge[-1]) / rate / 60)
        charge.append(end)
    up.plot(hours, charge, ":k", label="the paper's (2)")
    down.set_ylabel("scaled voltage")
    for panel, title in ((down, "discharge, h"), (up, "charge by one coil, h")):
        panel.set_xlabel(title)
        panel.set_ylim(-0.05, 1.05)
        panel.legend()
    figure.savefig(path, dpi=110)
    return path

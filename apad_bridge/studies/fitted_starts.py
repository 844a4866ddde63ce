"""Starts that give rows of the paper's Table II, found by a search: the paper prints none.

Equation (3) divides an aMussel's active steps by N_step, or by t_max / dt. The paper's Active is a mean over the recorded
steps, and its uptime a part of the known length of the mission. So a flight that was recorded for the part q of t_max has
Active = N * Avg / (100 q). Both Greedy rows have such a q (`PaperRow.recorded`), the others have 1. Such a flight here
lasts q times as long, and its uptimes are parts of the whole 40 minutes. This is a reading of the table, and no proof.

The search anneals: it moves one aMussel, or charge from one to another, and keeps what brings the figures of its goals
nearer to the paper's. The row without charging gives the mean, the least and the greatest charge of the pool's fleet:
uptime is charge over drain there; the search keeps these three. Nothing is known of the bay's charges.
"""

from __future__ import annotations

import itertools
import math
import random
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing import Pool, TimeoutError, Value
from pathlib import Path
from typing import Any

from rich.table import Table

from apad_bridge.scenario.area.polygon import bounding_box, contains
from apad_bridge.scenario.loader import SHIPPED, load, with_values
from apad_bridge.scenario.paper_rows import PAPER, PaperRow
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import save_starts, starts_of
from apad_bridge.scenario.starts_table import Start
from apad_bridge.studies.event_driven import fly_event_driven
from apad_bridge.studies.findings import Findings, table_of
from apad_bridge.studies.runner import Block, Fly, Row
from apad_bridge.studies.specification import StudyPlan, plan_of
from apad_bridge.studies.table_two import BESIDE, COLUMNS, FIGURES, beside

GOALS = {"cautious": ("Cautious",), "greedy": ("Cautious", "Greedy"), "bay": ("Greedy (bay)",)}
"""The rows that a search fits. The same starts show what the others are."""
FOUND = "shipped"
"""Searches nothing: flies the shipped scenarios with starts that searches found."""
_SUFFIX = "-fitted"
"""The end of their names, after those of the scenarios that were searched."""
FLIGHTS = 12_000
"""The most flights of a search for one set of starts."""
TOLERANCES = {"mean": 0.25, "max": 0.5, "min": 0.5, "cost_m": 3.0, "active_mean": 0.03}
"""A row fits if each figure lies so near to the paper's: points of uptime, metres, aMussels."""
_REPORT_S = 1.0
_MOVES = 0.6
"""The part of the tries that move an aMussel; the others change charges."""
_STEP_M = 4.0
_STEP_CHARGE = 0.04
_HOT, _COLD = 2.0, 0.02
"""Temperatures of the annealing, in tolerances."""
_BAY_CHARGES = (0.5, 1.0)


def fitted_study(goal: str, seeds: int = 200) -> StudyPlan:
    """The study that flies each strategy from starts that fit the goal's rows, for the mission and its recorded part."""
    paper = PAPER if goal == FOUND else [it for it in PAPER if it.scenario == _row(GOALS[goal][0]).scenario]
    suffix = _SUFFIX if goal == FOUND else ""
    names = [f"{it}{suffix}.yaml" for it in dict.fromkeys(it.scenario for it in paper)]
    scenarios = [load(SHIPPED / it) for it in names]
    parts = {round(scenarios[0].duration_s * it.recorded) for it in paper}
    name = f"table2-fit-{goal}"
    data = {
        "name": name,
        "scenarios": names,
        "strategies": ["cautious", "greedy", "none"],
        "seeds": sorted({it.seed for it in scenarios}) if goal == FOUND else seeds,
        **({"start": "scenario"} if goal == FOUND else {}),
        "parameters": {"duration_s": sorted(parts, reverse=True)},
    }
    return replace(plan_of(data, name, SHIPPED), fitted_to="" if goal == FOUND else goal)


def fly_fitted(
    goal: str, directory: Path, workers: int, report: Callable[[str], None] = lambda text: None
) -> Fly:
    """Searches the starts of each seed and flies its blocks from them; keeps the starts as `starts-SEED.csv` there.

    A search flies for minutes before its first block: `report` gets the number of its flights each second.
    """

    def fly(plan: StudyPlan, blocks: Sequence[Block]) -> Iterator[tuple[Block, list[Row]]]:
        by_seed: dict[int, list[Block]] = {}
        for block in blocks:
            by_seed.setdefault(block[1], []).append(block)
        flights = Value("q", 0)
        # Its end kills the workers: a search takes minutes.
        with Pool(workers, initializer=_begin_worker, initargs=(flights,)) as pool:
            searched = pool.imap_unordered(partial(_fly_seed, plan, goal, directory), by_seed.values())
            for _ in by_seed:
                while True:
                    with suppress(TimeoutError):
                        flown = searched.next(_REPORT_S)
                        break
                    report(f"search: {flights.value} of {FLIGHTS * len(by_seed)} flights at most")
                yield from flown

    return fly


_flights: Any = None
"""In a worker: the shared number of flights of all searches."""


def _begin_worker(flights: Any) -> None:
    """The study's process ends its workers, and they have no handlers of its own."""
    global _flights
    _flights = flights
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _count_flight() -> None:
    with _flights.get_lock():
        _flights.value += 1


def _fly_seed(
    plan: StudyPlan, goal: str, directory: Path, blocks: list[Block]
) -> list[tuple[Block, list[Row]]]:
    seed = blocks[0][1]
    rows = [_row(name) for name in GOALS[goal]]
    scenario = with_values(load(SHIPPED / f"{rows[0].scenario}.yaml"), {"seed": seed}, f"seed {seed}")
    starts = Search(scenario, rows, random.Random(seed), _count_flight).run()
    path = directory / f"starts-{seed}.csv"
    save_starts(path, starts, scenario.area.origin)

    def row(setting: int, index: int) -> Row:
        flown = with_values(plan.scenario(setting, index, seed), {"fleet.start": str(path.absolute())}, "")
        name = plan.strategies[index]
        return {"setting": setting, "strategy": name, "seed": seed, **asdict(fly_event_driven(flown))}

    return [(block, [row(block[0], index) for index in range(len(plan.strategies))]) for block in blocks]


@dataclass(frozen=True, slots=True)
class _Tried:
    starts: tuple[Start, ...]
    distance: float
    """The sum of the figures' differences from the paper's, in tolerances. Squares left the search with one bad figure."""
    is_fit: bool


class Search:
    """Searches starts from which these rows come out as in the paper."""

    def __init__(
        self, scenario: Scenario, rows: Sequence[PaperRow], rng: random.Random, count: Callable[[], None]
    ) -> None:
        """`count` is called for each set of starts that is tried."""
        self._scenario = scenario
        self._count = count
        self._rows = rows
        self._rng = rng
        self._are_charges_free = rows[0].scenario != _row("No charging").scenario

    def run(self, flights: int = FLIGHTS) -> tuple[Start, ...]:
        """The first starts that fit, or the best of all."""
        now = best = self._tried(self._drawn(), math.inf)
        for count in range(1, flights):
            if best.is_fit:
                break
            heat = _HOT * (_COLD / _HOT) ** (count / flights)
            other = self._tried(
                self._changed(now.starts), now.distance - heat * math.log(1 - self._rng.random())
            )
            if other.distance < math.inf:
                now = other
            if now.distance < best.distance:
                best = now
        return best.starts

    def _tried(self, starts: tuple[Start, ...], most: float) -> _Tried:
        """Flies the rows in turn; the distance is infinite if it exceeds `most`, and no further row is flown then."""
        self._count()
        distance, worst = 0.0, 0.0
        for row in self._rows:
            figures = figures_of(row, self._flown(row, starts), row.recorded)
            gaps = [abs(it - getattr(row, column)) / TOLERANCES[column] for column, it in figures.items()]
            distance, worst = distance + math.fsum(gaps), max(worst, *gaps)
            if distance > most:
                return _Tried(starts, math.inf, is_fit=False)
        return _Tried(starts, distance, worst <= 1)

    def _flown(self, row: PaperRow, starts: tuple[Start, ...]) -> dict[str, Any]:
        with tempfile.NamedTemporaryFile(suffix=".csv") as file:
            save_starts(Path(file.name), starts, self._scenario.area.origin)
            values = {
                "fleet.start": file.name,
                "mission.collection": row.collection,
                "duration_s": round(self._scenario.duration_s * row.recorded),
            }
            return asdict(fly_event_driven(with_values(self._scenario, values, row.name)))

    def _drawn(self) -> tuple[Start, ...]:
        charges = [it.primary for it in starts_of(self._scenario)]
        self._rng.shuffle(charges)
        ids = self._scenario.fleet.ids
        return tuple(Start(it, *self._place(), u) for it, u in zip(ids, charges, strict=True))

    def _place(self) -> tuple[float, float]:
        corners = self._scenario.area.polygon_m
        (south, west), (north, east) = bounding_box(corners)
        while True:
            place = (round(self._rng.uniform(south, north), 3), round(self._rng.uniform(west, east), 3))
            if contains(corners, place):
                return place

    def _changed(self, starts: tuple[Start, ...]) -> tuple[Start, ...]:
        changed = list(starts)
        i, j = self._rng.sample(range(len(starts)), 2)
        if self._rng.random() < _MOVES:
            changed[i] = self._moved(starts[i])
        elif self._are_charges_free:
            changed[i] = replace(starts[i], primary=round(self._rng.uniform(*_BAY_CHARGES), 4))
        else:
            changed[i], changed[j] = self._shared(starts[i], starts[j], [it.primary for it in starts])
        return tuple(changed)

    def _moved(self, start: Start) -> Start:
        place = (
            round(start.north_m + self._rng.gauss(0, _STEP_M), 3),
            round(start.east_m + self._rng.gauss(0, _STEP_M), 3),
        )
        is_inside = contains(self._scenario.area.polygon_m, place)
        return replace(start, north_m=place[0], east_m=place[1]) if is_inside else start

    def _shared(self, one: Start, other: Start, charges: Sequence[float]) -> tuple[Start, Start]:
        """Two charges with the same sum: the least and the greatest of the fleet change their places alone."""
        low, high = min(charges), max(charges)
        if {low, high} & {one.primary, other.primary}:
            return replace(one, primary=other.primary), replace(other, primary=one.primary)
        most = min(high - one.primary, other.primary - low)
        least = -min(high - other.primary, one.primary - low)
        given = round(max(least, min(most, self._rng.gauss(0, _STEP_CHARGE))), 4)
        return (
            replace(one, primary=round(one.primary + given, 4)),
            replace(other, primary=round(other.primary - given, 4)),
        )


def figures_of(row: PaperRow, flown: dict[str, Any], recorded: float) -> dict[str, float]:
    """The row's columns from a mission's `Figures` that was flown for the part `recorded` of the paper's."""
    return {
        column: flown[figure] * (recorded if column in ("mean", "max", "min") else 1.0)
        for column, figure in FIGURES.items()
    }


def _row(name: str) -> PaperRow:
    return next(it for it in PAPER if it.name == name)


class FittedStarts(Findings):
    """Each row of the paper beside ours from the searched starts: flown whole, and for the part that was recorded."""

    def as_data(self) -> dict[str, Any]:
        return {**super().as_data(), "fitted": self._compared()}

    def lines(self, width: int) -> Iterator[Table | str]:
        for row in self._compared():
            count = len(self.plan.seeds)
            starts = f"{count} searched starts" if count > 1 else "starts that were searched to fit"
            title = f"{row['row']}, {row['seconds']:g} s, {starts}"
            table = table_of(title, ["", *COLUMNS.values(), *BESIDE.values()])
            for key, heading in (_SHOWN if count > 1 else _SHOWN_OF_ONE).items():
                values = [row[column][key] for column in (*COLUMNS, *BESIDE)]
                table.add_row(heading, *("–" if it is None else f"{it:.2f}" for it in values))
            yield table

    def _compared(self) -> list[dict[str, Any]]:
        """A row of the paper in each length of flight; by column its value, ours, and its percentile among ours."""
        whole_s = self.plan.named[0].duration_s
        found = []
        for row, (setting, each) in itertools.product(PAPER, enumerate(self.plan.settings)):
            flown = [it for it in self.rows if it["setting"] == setting and it["strategy"] == row.collection]
            seconds = dict(each.parameters)["duration_s"]
            lengths = (whole_s, round(whole_s * row.recorded))
            if row.scenario != each.scenario.removesuffix(_SUFFIX) or seconds not in lengths:
                continue
            figures = [figures_of(row, it, seconds / whole_s) for it in flown]
            columns = {it: beside(getattr(row, it), [each[it] for each in figures]) for it in COLUMNS}
            columns |= {it: beside(None, [each[it] for each in flown]) for it in BESIDE}
            found.append({"row": row.name, "seconds": seconds} | columns)
        return found


_SHOWN = {
    "paper": "paper",
    "median": "ours, median",
    "p5": "ours, 5 %",
    "p95": "ours, 95 %",
    "percentile": "percentile",
}
_SHOWN_OF_ONE = {"paper": "paper", "median": "ours"}

"""Upper bounds: a search for missions that beat what `musselbed capacity` and the studies print as the most possible.

Each try draws a scenario of the paper's worst-case board: its curve and drain, the motors' charge, theta, docks, fleet,
starting charges, area, and every threshold and rule of the mission. Or it changes a few of these in a mission that was near
a bound before. The event-driven model flies it, and its figures are held against each printed bound. A bound is beaten when
a figure exceeds it by more than what a flight counts in whole ticks. `ratio` is the greatest figure over its bound.

One try in eight is of whole boards, whose services a script times to skip wakes (`timed_services.py`).

The search begins with motor runs of up to a fifth of a battery, at which an aMussel is best left to run down.

With `--resume DIR` each try is a line of DIR/tries.jsonl, and the same command goes on from there. A try's random numbers
follow from its number, and its starting points from the tries before it. So an ended search finds what a whole one finds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import Any

from apad_bridge.assembly.capacity_bounds import (
    Bounds,
    bounds_of,
    rates_of,
    uptime_with_closing,
)
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.studies.mission_figures import Figures
from apad_bridge.studies.models import Model, fly
from benchmarks.rows import told
from bounds import timed_services
from bounds.service_bounds import sustained_by_balance, uptime_with_services

SCENARIOS = Path(__file__).parents[3] / "launch_scripts/scenarios"
TIMED = 1 / 8
"""The part of the tries that are of timed services."""
TRIES, SHORT_TRIES = 2000, 20
SEED = 34
KEPT = 12
"""The missions nearest to each bound, from which half of the tries begin."""
KEPT_TRIES = "tries.jsonl"
CHANGED = 0.2
"""The probability with which such a try draws a key anew."""
STRATEGIES = (
    "cautious",
    "greedy",
    "blend",
    "njnp",
    "edf",
    "triage",
    "by-load",
    "core",
    "shortest-order",
    "charge-groups",
    "none",
)

Draws = dict[str, Callable[[Random], Any]]
Drawn = dict[str, Any]


def _curve(random: Random) -> list[list[float]]:
    """One to four parts that end at 1, with rates between a third of the paper's slowest and twice its fastest."""
    ends = sorted(round(random.uniform(0.02, 0.98), 6) for _ in range(random.randrange(4)))
    return [[end, round(random.uniform(0.0003, 0.006), 10)] for end in [*dict.fromkeys(ends), 1.0]]


def _or_none(draw: Callable[[Random], float]) -> Callable[[Random], float | None]:
    return lambda random: None if random.random() < 0.5 else draw(random)


def _charges(random: Random) -> list[float]:
    return sorted(round(random.random() ** random.choice((1, 3)), 4) for _ in range(2))


def _fraction(random: Random) -> float:
    return round(random.random(), 4)


DRAWS: Draws = {
    "board.charge_segments": _curve,
    "board.discharge_per_min": lambda random: round(10 ** random.uniform(-3.7, -2.2), 10),
    "board.motor_run_charge": lambda random: random.choice((0.0, round(random.uniform(0, 0.2), 4))),
    "board.surfacing_s": lambda random: random.choice((1.0, 60.0, 300.0)),
    "board.sinking_s": lambda random: random.choice((1.0, 60.0, 300.0)),
    "theta": lambda random: random.choice((1, 5, 10, 30, 60, 120)),
    "agent_hours": lambda random: random.choice((3, 5, 10, 20)),
    "apad.docks": lambda random: random.randint(1, 8),
    "fleet.count": lambda random: random.randint(1, 12),
    "fleet.start": lambda random: {"charge": _charges(random)},
    "seed": lambda random: random.randint(1, 10**6),
    "side_m": lambda random: random.choice((1.0, 5.0, 20.0, 100.0)),
    "mission.collection": lambda random: random.choice(STRATEGIES),
    "mission.costs": lambda random: {
        "distance_per_m": 1.0,
        "energy_per_charge": random.choice((1.0, 50.0, 500.0)),
    },
    "mission.batch": lambda random: random.randint(1, 8),
    "mission.pool_threshold": _fraction,
    "mission.charge_to": _or_none(_fraction),
    "mission.full_threshold": lambda random: random.choice((0.99, 0.9, 0.999)),
    "mission.charge_lead": _or_none(_fraction),
    "mission.again_threshold": _or_none(lambda random: round(0.3 * random.random(), 4)),
    "mission.dispatch": lambda random: random.choice(("batch", "asynchronous")),
    "mission.places": lambda random: random.choice(("own", "exchanged")),
    "mission.horizon": lambda random: random.choice(("open", "end")),
    "mission.docking.dock_s": lambda random: random.choice((1.0, 15.0)),
    "mission.docking.undock_s": lambda random: random.choice((0.0, 5.0)),
}
"""The keys that a try draws; each follows from the random numbers alone."""


@dataclass(frozen=True, slots=True)
class Held:
    """A figure of a flight against its bound, both in the bound's unit; `slack` is what counting in ticks may add."""

    bound: str
    figure: float
    limit: float
    slack: float

    @property
    def ratio(self) -> float:
        """The figure over its bound, or 0 for a bound of 0 that is not exceeded."""
        if self.limit <= 0:
            return 0.0 if self.figure <= self.limit + self.slack else float("inf")
        return self.figure / self.limit

    @property
    def is_beaten(self) -> bool:
        return self.figure > self.limit + self.slack


def scenario_of(drawn: Drawn) -> Scenario:
    """The pool's scenario with these keys. ScenarioError for keys that exclude each other."""
    data = resolve(load(SCENARIOS / "pool-12.yaml"))
    keys = dict(drawn)
    side, hours = keys.pop("side_m"), keys.pop("agent_hours")
    data["area"] |= {"polygon_m": [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]], "chart": None}
    data["duration_s"] = float(hours * 3600 // keys["theta"])
    keys["mission.batch"] = min(keys["mission.batch"], keys["apad.docks"])
    data["fleet"] |= {"agent_ids": [], "drift": {"mode": "physical"}}
    data["apad"] |= {"start_m": [side / 2, side / 2], "profile": None}
    data["apad"]["battery"]["capacity_wh"] = 1e7
    data["board"]["profile"] = None
    for key, value in keys.items():
        *path, name = key.split(".")
        block = data
        for it in path:
            block = block[it]
        block[name] = value
    return from_data(data, "a try")


def held_against(scenario: Scenario, bounds: Bounds, flown: Figures) -> list[Held]:
    """Each printed bound with the flight's figure."""
    count, minutes = bounds.amussels, scenario.duration_s * scenario.theta / 60
    rates = rates_of(scenario)[0]
    # An aMussel that is docked at the end still has to pay for its way down.
    unpaid = 2 * bounds.docks * scenario.board.motor_run_charge
    tick = 1 / scenario.duration_s
    found = [
        Held("uptime", flown.uptime_paper_mean, bounds.uptime_percent, 100 * tick),
        Held(
            "uptime with the closing of docks",
            flown.uptime_paper_mean,
            uptime_with_closing(scenario),
            100 * tick,
        ),
        Held("active aMussels", flown.active_mean, bounds.active, count * tick),
        Held(
            "uptime with so many services",
            flown.uptime_paper_mean,
            uptime_with_services(scenario, flown.services + bounds.docks),
            100 * tick,
        ),
    ]
    if bounds.samples is not None:
        found.append(Held("samples", flown.samples_taken, bounds.samples, count))
    gained = count * flown.charge_gain_mean
    equal_slack = 100 * unpaid / (count * rates.drain * minutes) + 100 * tick
    found.append(
        Held(
            "uptime in the long run, at equal charge",
            flown.uptime_equal_charge,
            bounds.uptime_for_ever_percent,
            equal_slack,
        )
    )
    if flown.dead_time_h == 0 and scenario.board.motor_run_charge == 0:
        balance = sustained_by_balance(count, gained, rates.drain, minutes)
        found.append(Held("sustained aMussels", balance, bounds.sustained, (1 + count) * tick * 10))
    return found


@dataclass(frozen=True, slots=True)
class Try:
    """A try's keys, and its figures against the bounds; none for keys that exclude each other."""

    drawn: Drawn
    held: list[Held]


def measure(tries: int = TRIES, short: bool = False, resume: Path | None = None) -> dict[str, Any]:
    """Flies `tries` missions; the greatest ratio for each bound, and the keys of the missions that beat one."""
    tries = SHORT_TRIES if short else tries
    nearest: dict[str, list[tuple[float, int, Drawn]]] = {}
    counts: dict[str, int] = {}
    beaten: list[dict[str, Any]] = []
    kept = [] if resume is None else list(_kept(resume))
    number = flown = 0
    while flown < tries:
        if number < len(kept):
            tried = kept[number]
        else:
            tried = _tried(_next(Random(f"{SEED} {number}"), nearest))
            if resume is not None:
                _keep(resume, tried)
        number += 1
        flown += bool(tried.held)
        for it in tried.held:
            counts[it.bound] = counts.get(it.bound, 0) + 1
            close = nearest.setdefault(it.bound, [])
            close.append((it.ratio, -flown, tried.drawn))
            close.sort(key=lambda entry: entry[:2], reverse=True)
            if close[0][2] is tried.drawn and number > len(kept):
                told({"flown": flown, "bound": it.bound, "ratio": it.ratio})
            del close[KEPT:]
            if it.is_beaten:
                beaten.append(
                    {"bound": it.bound, "figure": it.figure, "limit": it.limit, "keys": tried.drawn}
                )
    rows = [
        {"bound": name, "flights": counts[name], "ratio": close[0][0], "nearest": close[0][2]}
        for name, close in nearest.items()
    ]
    return {"tries": flown, "refused": number - flown, "rows": rows, "beaten": beaten}


def _tried(drawn: Drawn) -> Try:
    if timed_services.LEAD in drawn:
        return Try(drawn, _timed(drawn))
    try:
        scenario = scenario_of(drawn)
    except ScenarioError:
        return Try(drawn, [])
    return Try(drawn, held_against(scenario, bounds_of([scenario]), fly(scenario, Model.EVENT_DRIVEN)))


def _timed(drawn: Drawn) -> list[Held]:
    scenario = timed_services.scenario_of(drawn, load(SCENARIOS / "whole-board-12.yaml"))
    limit = bounds_of([scenario]).timed_uptime_percent
    assert limit is not None
    uptime = timed_services.uptime_of(drawn, scenario)
    return [Held("uptime, services timed to wakes", uptime, limit, 100 / scenario.duration_s)]


def _kept(directory: Path) -> Iterator[Try]:
    """The tries of an ended search, in order."""
    path = directory / KEPT_TRIES
    for line in path.read_text().splitlines(keepends=True) if path.exists() else ():
        if not line.endswith("\n"):
            raise SystemExit(f"{path}: its last line is cut: delete that line")
        data = json.loads(line)
        yield Try(data["drawn"], [Held(**it) for it in data["held"]])


def _keep(directory: Path, tried: Try) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    with (directory / KEPT_TRIES).open("a") as file:
        file.write(json.dumps({"drawn": tried.drawn, "held": [asdict(it) for it in tried.held]}) + "\n")


def _next(random: Random, nearest: dict[str, list[tuple[float, int, Drawn]]]) -> Drawn:
    """A mission drawn anew, or one near to a bound with some keys drawn anew."""
    if not nearest or random.random() < 0.5:
        draws = timed_services.DRAWS if random.random() < TIMED else DRAWS
        return {key: draw(random) for key, draw in draws.items()}
    close = random.choice(nearest[random.choice(sorted(nearest))])[2]
    draws = timed_services.DRAWS if timed_services.LEAD in close else DRAWS
    return {key: draw(random) if random.random() < CHANGED else close[key] for key, draw in draws.items()}

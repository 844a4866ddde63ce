"""The rules in the goal's cells, by a second model of a mission: no code of the flights moves or charges anybody here.

The model has one aPad on straight legs at one speed, docks, and the paper's equations (1) and (2). It leaves out how the
aPad speeds up, drift, packets and ticks. Cells, places, start charges and seeds are those of rules.yaml. A mission takes
milliseconds, so many configurations make the intervals narrow. Its own trials choose a rule for each cell, by the same
`choice_of` as the flights.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import dist, inf
from pathlib import Path
from statistics import fmean
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.scenario.starts import starts_of
from apad_bridge.studies.rule_choice import LEAST, LOST, METRES, RULES, TRIALS, UPTIME, choice_of
from apad_bridge.studies.specification import StudyPlan, load_study
from apad_bridge.studies.statistics import estimate_of
from benchmarks.rows import told

ROOT = Path(__file__).parents[1]
STUDY, FLOWN = ROOT / "launch_scripts/studies/rules.yaml", ROOT / "docs/results/rules.csv"
TRIES, SHORT_TRIES = 60, 2
FIRST_JUDGE = 101
GOAL_HOURS = (80, 240)
THETA, SPEED_M_S, DOCK_S, UNDOCK_S = 30, 0.5, 15.0, 5.0
DRAIN = 0.0010427134 * THETA / 60
CURVE = tuple(
    (end, rate * THETA / 60) for end, rate in ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
)
"""Charges a second of the mission, on [0, 1]."""
KNEE, FULL, BATCH_BELOW = 0.5634, 0.99, 0.8
LIFE_S = 1 / DRAIN
Place = tuple[float, float]


@dataclass(eq=False)
class AMussel:
    place_m: Place
    charge: float
    known_s: float = 0.0
    docked: bool = False
    active_s: float = 0.0
    released_s: float = 0.0
    was_served: bool = False


def charging_s(charge: float, to: float) -> float:
    seconds = 0.0
    for end, per_s in CURVE:
        if charge < min(end, to):
            seconds += (min(end, to) - charge) / per_s
            charge = min(end, to)
    return seconds


def charged(charge: float, seconds: float) -> float:
    for end, per_s in CURVE:
        if charge < end:
            needed_s = (end - charge) / per_s
            if seconds <= needed_s:
                return charge + seconds * per_s
            seconds, charge = seconds - needed_s, end
    return charge


@dataclass
class Mission:
    amussels: list[AMussel]
    docks: int
    place_m: Place
    end_s: float
    now_s: float = 0.0
    metres: float = 0.0

    def settle(self, *which: AMussel) -> None:
        at_s = min(self.now_s, self.end_s)
        for it in which or self.amussels:
            seconds = at_s - it.known_s
            if seconds <= 0:
                continue
            if it.docked:
                it.charge = charged(it.charge, seconds)
            else:
                it.active_s += min(seconds, it.charge / DRAIN)
                it.charge = max(0.0, it.charge - seconds * DRAIN)
            it.known_s = at_s

    def go(self, place_m: Place) -> None:
        way_m = dist(self.place_m, place_m)
        self.metres += way_m
        self.now_s += way_m / SPEED_M_S
        self.place_m = place_m

    def collect(self, it: AMussel) -> None:
        self.go(it.place_m)
        self.now_s += DOCK_S
        self.settle(it)
        it.docked = True

    def release(self, it: AMussel, place_m: Place) -> None:
        self.go(place_m)
        self.now_s += UNDOCK_S
        self.settle(it)
        it.docked, it.place_m, it.released_s, it.was_served = False, place_m, self.now_s, True

    @property
    def in_docks(self) -> list[AMussel]:
        return [it for it in self.amussels if it.docked]

    @property
    def in_water(self) -> list[AMussel]:
        return [it for it in self.amussels if not it.docked]

    def figures(self) -> dict[str, float]:
        self.now_s = self.end_s
        self.settle()
        shares = [100 * it.active_s / self.end_s for it in self.amussels]
        left = fmean(it.charge for it in self.amussels)
        return {UPTIME: fmean(shares), LEAST: min(shares), METRES: self.metres, "left": left}


Choose = Callable[[Mission, list[AMussel], int], list[AMussel]]
"""Takes the mission, those that wait, and how many to collect; returns whom, in order."""
Key = Callable[[Mission, AMussel, Place], Any]


def by_least(key: Key) -> Choose:
    def choose(mission: Mission, waiting: list[AMussel], count: int) -> list[AMussel]:
        left, chosen, place_m = list(waiting), list[AMussel](), mission.place_m
        while left and len(chosen) < count:
            following = min(left, key=lambda it: key(mission, it, place_m))
            left.remove(following)
            chosen.append(following)
            place_m = following.place_m
        return chosen

    return choose


greedy = by_least(lambda _, it, place_m: dist(place_m, it.place_m))
cautious = by_least(lambda _, it, __: it.charge)
PAPERS = {"cautious": cautious, "greedy": greedy}
blend = by_least(lambda _, it, place_m: dist(place_m, it.place_m) - 50 * (1 - it.charge))


def by_load(threshold: float) -> Choose:
    """Triage that spares metres, in overload."""
    usual_s = charging_s(threshold, FULL)

    def key(mission: Mission, it: AMussel, place_m: Place) -> tuple[int, float]:
        unserved_s, way_m = mission.now_s - it.released_s, dist(place_m, it.place_m)
        if unserved_s > 8 * LIFE_S:
            return 0, -unserved_s
        seconds = way_m / SPEED_M_S + DOCK_S + UNDOCK_S + charging_s(it.charge, FULL)
        return 1, way_m - 50 * (FULL - it.charge) / seconds * usual_s

    return by_least(key)


def core(mission: Mission, waiting: list[AMussel], count: int) -> list[AMussel]:
    """Holds those that the docks sustain, near to each other."""
    kept = sustained(mission.docks)
    late_s = max(8 * LIFE_S, 670 * (len(mission.amussels) - kept) / (0.1 * mission.docks))
    late = [it for it in waiting if mission.now_s - it.released_s > late_s]
    if late:
        return sorted(late, key=lambda it: it.released_s)[:count]
    water, wanted = mission.in_water, max(1, kept - len(mission.in_docks))
    alive = [it for it in water if it.charge >= 0.2]
    members = alive if len(alive) >= wanted else water

    def about(centre: AMussel) -> tuple[float, list[AMussel]]:
        near = sorted(members, key=lambda it: (it.charge < 0.2, dist(centre.place_m, it.place_m)))[:wanted]
        return sum(dist(centre.place_m, it.place_m) for it in near), near

    held = min((about(it) for it in alive or water), key=lambda it: it[0])[1]
    ready = [it for it in waiting if it in held]
    if not ready:
        once = (it for it in waiting if not it.was_served and it.charge >= KNEE)
        return sorted(once, key=lambda it: it.charge)[:count]
    best = (1 - KNEE) / (charging_s(KNEE, 1.0) + DOCK_S + UNDOCK_S)

    def key(_: Mission, it: AMussel, place_m: Place) -> float:
        way_m = dist(place_m, it.place_m)
        seconds = way_m / SPEED_M_S + DOCK_S + UNDOCK_S + charging_s(it.charge, FULL)
        return best * seconds + way_m / 50 - (FULL - it.charge)

    return by_least(key)(mission, ready, count)


def sustained(docks: int) -> int:
    fast_s, handling_s = charging_s(KNEE, 1.0), DOCK_S + UNDOCK_S
    return int(docks * (1 + ((1 - KNEE) / DRAIN - handling_s) / (fast_s + handling_s)))


def in_batches(mission: Mission, choose: Choose) -> None:
    """The paper's rule: collects as many as there are docks, and brings all back when all are full."""
    while mission.now_s < mission.end_s:
        mission.settle()
        docked = mission.in_docks
        waiting = [it for it in mission.in_water if it.charge <= BATCH_BELOW]
        if docked:
            mission.now_s += max(charging_s(it.charge, FULL) for it in docked) + 1e-6
            while docked and mission.now_s < mission.end_s:
                following = min(docked, key=lambda it: dist(mission.place_m, it.place_m))
                docked.remove(following)
                mission.release(following, following.place_m)
        elif len(waiting) >= mission.docks:
            for it in choose(mission, waiting, mission.docks):
                mission.collect(it)
        else:
            falls = [(it.charge - BATCH_BELOW) / DRAIN for it in mission.in_water if it.charge > BATCH_BELOW]
            mission.now_s += min(falls, default=inf) + 1e-6


@dataclass(frozen=True)
class OneByOne:
    """Collects one as soon as a dock is free. Released ones take the places of collected ones, or the nearest empty."""

    choose: Choose
    begins: float
    makes_room: float
    again: float = inf
    """Those that were served wait until one has at most this charge."""

    def fly(self, mission: Mission) -> None:
        while mission.now_s < mission.end_s:
            self._step(mission)

    def _step(self, mission: Mission) -> None:
        mission.settle()
        lasting = (mission.end_s - mission.now_s) * DRAIN
        begins, room, full = (min(it, lasting) for it in (self.begins, self.makes_room, FULL))
        waits = lasting >= 0.2
        docked = mission.in_docks
        waiting = [it for it in mission.in_water if waits and it.charge <= begins]
        if all(it.charge > self.again + 1e-9 for it in waiting):
            waiting = [it for it in waiting if not it.was_served]
        done = [it for it in docked if it.charge > full - 1e-9]
        if not done and waiting:
            done = sorted((it for it in docked if it.charge > room), key=lambda it: -it.charge)[:1]
        if done:
            early = min((it.charge for it in done if it.charge <= full - 1e-9), default=inf)
            led = [it for it in waiting if it.charge < early]
            self._exchange(mission, done, led, mission.docks - len(docked))
            return
        if len(docked) < mission.docks and waiting:
            chosen = self.choose(mission, waiting, 1)
            for it in chosen:
                mission.collect(it)
            if chosen:
                return
        mission.now_s += self._wait_s(mission, docked, waiting, begins, room, full)

    def _exchange(self, mission: Mission, done: list[AMussel], led: list[AMussel], free: int) -> None:
        leaving = sorted(done, key=lambda it: -it.charge)
        for it in self.choose(mission, led, min(len(led), len(done))) if led else ():
            place_m, following = it.place_m, leaving.pop(0)
            empty_m = following.place_m
            if free:
                mission.collect(it)
                mission.release(following, place_m)
            else:
                mission.release(following, place_m)
                mission.collect(it)
            it.place_m = empty_m
        for it in leaving:
            owner = min(mission.in_docks, key=lambda other: dist(mission.place_m, other.place_m))
            place_m, owner.place_m = owner.place_m, it.place_m
            mission.release(it, place_m)

    def _wait_s(
        self,
        mission: Mission,
        docked: Sequence[AMussel],
        waiting: Sequence[AMussel],
        begins: float,
        room: float,
        full: float,
    ) -> float:
        """Until somebody is charged or comes to wait; the known end is asked for each 5 s."""
        waits = [charging_s(it.charge, full) for it in docked]
        waits += [charging_s(it.charge, room) for it in docked if it.charge <= room]
        waits += [(it.charge - begins) / DRAIN for it in mission.in_water if it.charge > begins]
        return max(1e-3, min([*waits, 5.0]) + 1e-6)


def missions(plan: StudyPlan, setting: int, seed: int) -> Callable[[], Mission]:
    scenario = plan.scenario(setting, 0, seed)
    starts = starts_of(scenario)

    def new() -> Mission:
        amussels = [AMussel((it.north_m, it.east_m), it.primary) for it in starts]
        return Mission(amussels, scenario.apad.docks, scenario.apad.start_m, scenario.duration_s)

    return new


def flown_one_by_one(
    new: Callable[[], Mission], begins: float, makes_room: float = FULL, again: float = inf
) -> dict[str, float]:
    """A rule of rules.yaml: `core`, which in lighter overload is `by-load`, and without it a blend."""
    mission = new()
    if len(mission.amussels) > 2 * sustained(mission.docks):
        choose: Choose = core
    elif is_overloaded(mission, begins):
        choose = by_load(begins)
    else:
        choose = blend
    OneByOne(choose, begins, makes_room, again).fly(mission)
    return mission.figures()


def is_overloaded(mission: Mission, begins: float) -> bool:
    per_s = (FULL - begins) / charging_s(begins, FULL)
    return len(mission.amussels) > mission.docks * (1 + per_s / DRAIN)


def flown_in_batches(new: Callable[[], Mission], choose: Choose) -> dict[str, float]:
    mission = new()
    in_batches(mission, choose)
    return mission.figures()


Fly = Callable[[Callable[[], Mission]], dict[str, float]]


def rules_of(plan: StudyPlan) -> dict[str, Fly]:
    """The paper's strategies, and the rules of the study that the choice is among."""
    flies: dict[str, Fly] = {it: partial(flown_in_batches, choose=PAPERS[it]) for it in PAPERS}
    for given in plan.study.strategies:
        if isinstance(given, dict) and given["name"] in RULES:
            keys = (given["pool_threshold"], given.get("charge_to", FULL), given.get("again_threshold", inf))
            flies[given["name"]] = partial(
                flown_one_by_one, begins=keys[0], makes_room=keys[1], again=keys[2]
            )
    return flies


def measure(tries: int = TRIES, short: bool = False) -> dict[str, Any]:
    """`rows`: by cell and hours, the gain of the chosen rule with its interval. `apart`: from archived flights."""
    tries, plan, rows = SHORT_TRIES if short else tries, load_study(STUDY), []
    flies = rules_of(plan)
    for index, setting in enumerate(plan.settings):
        keys = dict(setting.parameters)
        hours = round(keys["duration_s"] * THETA / 3600)
        if hours not in GOAL_HOURS:
            continue
        seeds = [*range(1, TRIALS + 1), *range(FIRST_JUDGE, FIRST_JUDGE + tries)]
        found = [
            {"strategy": name, "seed": seed, **fly(missions(plan, index, seed)), LOST: 0}
            for name, fly in flies.items()
            for seed in seeds
        ]
        choice = choice_of([it for it in found if it["seed"] <= TRIALS], tuple(PAPERS), UPTIME)
        rows.append(_row(keys["cell"], hours, choice.rule, [it for it in found if it["seed"] > TRIALS]))
        told(rows[-1])
    return {"tries": tries, "rows": rows, "apart": _apart(plan, 1 if short else 8)}


def _row(cell: str, hours: int, rule: str, found: list[dict[str, Any]]) -> dict[str, Any]:
    def values(name: str, key: str) -> list[float]:
        return [it[key] for it in found if it["strategy"] == name]

    better = max(PAPERS, key=lambda name: fmean(values(name, UPTIME)))
    row: dict[str, Any] = {"cell": cell, "hours": hours, "better": better, "rule": rule}
    for key, name in ((UPTIME, "uptime"), (LEAST, "least"), (METRES, "metres")):
        theirs = values(better, key)
        gain = estimate_of([own - other for own, other in zip(values(rule, key), theirs, strict=True)], 0.95)
        assert gain is not None
        row |= {f"better_{name}": fmean(theirs), name: gain.mean, f"{name}_half": gain.high - gain.mean}
    row["met"] = row["uptime"] >= 5 and row["least"] >= 0 and row["metres"] <= 0
    return row


def _apart(plan: StudyPlan, seeds: int) -> dict[str, float]:
    """The mean distances in uptime and metres from the archived flights of the same configurations."""
    apart, flies = {"uptime": list[float](), "metres": list[float]()}, rules_of(plan)
    keys = [dict(it.parameters) for it in plan.settings]
    labels = [f"{it['cell']}, {it['duration_s'] * THETA / 3600:.0f} h" for it in keys]
    judged = range(FIRST_JUDGE, FIRST_JUDGE + seeds)
    with FLOWN.open(newline="") as file:
        rows = [it for it in csv.DictReader(file) if it["strategy"] in flies and int(it["seed"]) in judged]
    for row in (it for it in rows if it["setting"].endswith(tuple(f", {hours} h" for hours in GOAL_HOURS))):
        ours = flies[row["strategy"]](missions(plan, labels.index(row["setting"]), int(row["seed"])))
        apart["uptime"].append(ours[UPTIME] - float(row[UPTIME]))
        apart["metres"].append(100 * (ours[METRES] / float(row[METRES]) - 1))
    mean = {f"{key}_mean": fmean(values) for key, values in apart.items()}
    return mean | {f"{key}_distance": fmean(map(abs, values)) for key, values in apart.items()}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        title=f"the chosen rule minus the better one, {result['tries']} configurations a cell, by the second model"
    )
    texts = ("cell", "rule", "better")
    for name in (
        "cell",
        "hours",
        *texts[1:],
        "its uptime %",
        "uptime",
        "least",
        "its metres",
        "metres",
        "met",
    ):
        table.add_column(name, justify="left" if name in texts else "right")
    for it in result["rows"]:
        gains = [f"{it[key]:+.1f} +- {it[f'{key}_half']:.1f}" for key in ("uptime", "least", "metres")]
        names = (it["cell"], str(it["hours"]), it["rule"], it["better"])
        head = (*names, f"{it['better_uptime']:.1f}", *gains[:2])
        table.add_row(*head, f"{it['better_metres']:.0f}", gains[2], "yes" if it["met"] else "no")
    console.print(table)
    apart = result["apart"]
    console.print(
        f"From the archived flights of the same configurations: {apart['uptime_mean']:+.2f} points of uptime on the mean "
        f"({apart['uptime_distance']:.2f} either way), {apart['metres_mean']:+.1f} % of metres "
        f"({apart['metres_distance']:.1f})"
    )

#!/usr/bin/env python3
"""Scores a plan for one of these instances. It needs Python 3.9 and nothing else, and shares no code with musselbed.

    check.py 001.json plan.json     prints the figures of a plan
    check.py --row NAME FOLDER      scores the plans FOLDER/001.json to FOLDER/060.json, and adds a row to results.csv

`--row` adds nothing for a name that the table has, or if a plan is missing or breaks a rule.

An instance is one aPad with docks, and aMussels that lie at places on the bottom. Units are metres, seconds, and charge
from 0 to 1. Places are `[north, east]`. All aMussels begin at work with their `charges`.

- At work an aMussel loses `drain_per_s` until it is empty. It is active while it has charge. In a dock it is not.
- In a dock it gains by `curve`: a list of `[upper end of charge, gain per second]`, rising; the last part ends at 1.
- Each way up and down takes `motor_run` of charge, or what is left of it.
- The aPad goes straight with `speed_m_s` from `start_m`. To dock takes `dock_s`, to undock `undock_s`.

A plan is `{"steps": [...]}`. The steps are flown in order, and aMussels count from 0. Each step is one of

- `["collect", i]`: go to the place of aMussel i, which is at work, and dock it. A dock must be free.
- `["deploy", i]`: go to the place of aMussel i, which is docked, and undock it.
- `["wait", s]`: wait s seconds.

A step that does not end by `horizon_s` is not flown, nor is any after it. A step that breaks these rules is an error.

The score is the uptime at equal charge, in percent: U + 100 w (q_end - q_begin) / T. U is the mean share of the horizon T
in which the aMussels are active, q their mean charge, and w `battery_worth_s`. Who is docked at the end has not paid for
its way down, so q_end is less by `motor_run` for it. `bound_percent` is an upper bound of the score, and
`uptime_bound_percent` one of U. 001-best.json is the best plan that we know for 001.json.
"""

from __future__ import annotations

import csv
import json
import math
import reprlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
COLUMNS = ("name", "score_large", "gap_large", "score_small", "gap_small")
SMALL = 6
"""An instance with so many aMussels, or fewer, is a small one."""
_LONGEST_NAME = 60
_GREATEST = 1e300
"""A number beyond it could overflow."""


class World:
    """The instance as it is at `now_s`. ValueError for a step that cannot be flown."""

    def __init__(self, instance: dict[str, Any]) -> None:
        self.instance = instance
        self.now_s = 0.0
        self.metres = 0.0
        self.place_m = tuple(instance["start_m"])
        count = len(instance["places_m"])
        self.docked: set[int] = set()
        self.active_s = [0.0] * count
        self.steps: list[list[Any]] = []
        self._charges = [float(it) for it in instance["charges"]]
        self._since_s = [0.0] * count

    def charge(self, agent: int, at_s: float | None = None) -> float:
        """The charge of an aMussel now, or at a later time if nothing happens to it before."""
        seconds = (self.now_s if at_s is None else at_s) - self._since_s[agent]
        charge = self._charges[agent]
        if agent not in self.docked:
            return max(0.0, charge - float(self.instance["drain_per_s"]) * seconds)
        for end, per_s in self.instance["curve"]:
            if charge < end:
                needed_s = (end - charge) / per_s
                if seconds <= needed_s:
                    return float(charge + seconds * per_s)
                seconds -= needed_s
                charge = end
        return float(charge)

    def goal_m(self, agent: int) -> tuple[float, float]:
        north_m, east_m = self.instance["places_m"][agent]
        return north_m, east_m

    def fly(self, step: list[Any]) -> bool:
        """Flies a step; False if it would not end by the horizon."""
        kind, value = step
        if kind == "wait":
            if not (_is_number(value) and value >= 0):
                raise ValueError("a wait is a number of seconds")
            return self._pass(value, step)
        if kind not in ("collect", "deploy") or type(value) is not int:
            raise ValueError("no such step")
        if not 0 <= value < len(self._charges):
            raise ValueError("no such aMussel")
        if (value in self.docked) is not (kind == "deploy"):
            raise ValueError(f"it is {'docked' if value in self.docked else 'not docked'}")
        if kind == "collect" and len(self.docked) >= self.instance["docks"]:
            raise ValueError("no dock is free")
        goal_m = self.goal_m(value)
        way_m = math.dist(self.place_m, goal_m)
        works_s = self.instance["dock_s" if kind == "collect" else "undock_s"]
        if not self._pass(way_m / self.instance["speed_m_s"] + works_s, step):
            return False
        self.metres += way_m
        self.place_m = goal_m
        self._settle(value)
        self._charges[value] = max(0.0, self._charges[value] - self.instance["motor_run"])
        self.docked ^= {value}
        return True

    def score(self) -> dict[str, Any]:
        """Ends the mission at the horizon; returns its figures."""
        horizon_s, count = self.instance["horizon_s"], len(self._charges)
        self.now_s = horizon_s
        for agent in range(count):
            self._settle(agent)
        uptimes = [100 * it / horizon_s for it in self.active_s]
        left = sum(self._charges) - len(self.docked) * self.instance["motor_run"]
        gain = (left - sum(self.instance["charges"])) / count
        uptime = sum(uptimes) / count
        return {
            "score": uptime + 100 * self.instance["battery_worth_s"] * gain / horizon_s,
            "uptime_percent": uptime,
            "least_uptime_percent": min(uptimes),
            "charge_gained": gain,
            "metres": self.metres,
            "services": sum(kind == "deploy" for kind, _ in self.steps),
        }

    def _pass(self, seconds: float, step: list[Any]) -> bool:
        if self.now_s + seconds > self.instance["horizon_s"]:
            return False
        self.now_s += seconds
        self.steps.append(step)
        return True

    def _settle(self, agent: int) -> None:
        if agent not in self.docked:
            lasts_s = self._charges[agent] / self.instance["drain_per_s"]
            self.active_s[agent] += min(self.now_s - self._since_s[agent], lasts_s)
        self._charges[agent] = self.charge(agent)
        self._since_s[agent] = self.now_s


def scored(instance: dict[str, Any], plan: Any) -> dict[str, Any]:
    """The figures of a plan. ValueError, with the step's number, for what is no plan or cannot be flown."""
    steps = plan.get("steps") if isinstance(plan, dict) else None
    if not isinstance(steps, list):
        raise ValueError('it is no plan: {"steps": [["collect", 3], ["wait", 60], ["deploy", 3]]}')
    if plan.get("instance", instance.get("name")) != instance.get("name"):
        raise ValueError(f"it is a plan for the instance {reprlib.repr(plan['instance'])}")
    world = World(instance)
    for number, step in enumerate(steps, start=1):
        try:
            if not (isinstance(step, list) and len(step) == 2):
                raise ValueError("no such step")
            if not world.fly(step):
                break
        except ValueError as error:
            raise ValueError(f"step {number}: {reprlib.repr(step)}: {error}") from error
    return world.score()


def checked(instance: Any) -> dict[str, Any]:
    """Returns the instance. ValueError, with the key, for what is none."""
    if not isinstance(instance, dict):
        raise ValueError("it is no instance: it has no keys")
    are_right = {
        **dict.fromkeys(("horizon_s", "speed_m_s", "drain_per_s"), lambda it: _is_number(it) and it > 0),
        **dict.fromkeys(("dock_s", "undock_s", "battery_worth_s"), lambda it: _is_number(it) and it >= 0),
        **dict.fromkeys(("bound_percent", "uptime_bound_percent"), _is_number),
        "motor_run": _is_charge,
        "docks": lambda it: type(it) is int and it >= 1,
        "start_m": _is_place,
        "places_m": lambda it: isinstance(it, list) and len(it) > 0 and all(map(_is_place, it)),
        "charges": lambda it: isinstance(it, list) and all(map(_is_charge, it)),
        "curve": _is_curve,
    }
    for key, is_right in are_right.items():
        if key not in instance:
            raise ValueError(f"it is no instance: it has no {key}")
        if not is_right(instance[key]):
            raise ValueError(f"it is no instance: {key} is {reprlib.repr(instance[key])}")
    if len(instance["charges"]) != len(instance["places_m"]):
        raise ValueError("it is no instance: charges and places_m differ in length")
    return instance


def _is_number(value: Any) -> bool:
    # True and False are no numbers here; Python would take them for 1 and 0.
    return type(value) in (int, float) and -_GREATEST <= value <= _GREATEST


def _is_charge(value: Any) -> bool:
    return _is_number(value) and 0 <= value <= 1


def _is_place(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def _is_curve(value: Any) -> bool:
    if not (isinstance(value, list) and value and all(map(_is_place, value))):
        return False
    ends = [end for end, _ in value]
    rises = ends == sorted(set(ends)) and ends[0] > 0 and ends[-1] == 1
    return rises and all(rate > 0 for _, rate in value)


def scored_files(instance_path: Path, plan_path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """An instance, and the figures of a plan for it. ValueError, with the path, for a file that is none of these."""
    instance = _of(instance_path, checked)
    return instance, _of(plan_path, lambda plan: scored(instance, plan))


def _of(path: Path, take: Any) -> Any:
    try:
        return take(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from error


def row_of(name: str, folder: Path) -> tuple[list[str], list[str]]:
    """A row of results.csv, and the instances whose best known plan is worse. ValueError for a bad name or plan."""
    if not (name == name.strip() and name.isprintable() and 0 < len(name) <= _LONGEST_NAME):
        raise ValueError(
            f"{reprlib.repr(name)}: a name is printable, and has up to {_LONGEST_NAME} characters"
        )
    if name.casefold() in (it[0].casefold() for it in rows()):
        raise ValueError(f"{name}: results.csv has a row of this name")
    scores: dict[bool, list[float]] = {False: [], True: []}
    gaps: dict[bool, list[float]] = {False: [], True: []}
    better = []
    for path in sorted(HERE.glob("[0-9][0-9][0-9].json")):
        instance, found = scored_files(path, folder / path.name)
        _, best = scored_files(path, HERE / f"{path.stem}-best.json")
        is_small = len(instance["charges"]) <= SMALL
        scores[is_small].append(found["score"])
        gaps[is_small].append(instance["bound_percent"] - found["score"])
        if found["score"] > best["score"] + 1e-9:
            better.append(path.stem)
    figures = (it for is_small in (False, True) for it in (scores[is_small], gaps[is_small]))
    return [name, *(f"{math.fsum(it) / len(it):.3f}" for it in figures)], better


def rows() -> list[list[str]]:
    """The rows of results.csv, in the order in which they were added."""
    with (HERE / "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))[1:]


def main(arguments: Sequence[str]) -> int:
    try:
        if len(arguments) == 3 and arguments[0] == "--row":
            row, better = row_of(arguments[1], Path(arguments[2]))
            with (HERE / "results.csv").open("a", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerow(row)
            print(", ".join(f"{column} {row[n]}" for n, column in enumerate(COLUMNS)))
            if better:
                print(f"better than the best known plans of {', '.join(better)}")
        elif len(arguments) == 2:
            instance, found = scored_files(Path(arguments[0]), Path(arguments[1]))
            print(json.dumps({**found, "bound_percent": instance["bound_percent"]}, indent=2))
        else:
            print("use: check.py INSTANCE.json PLAN.json, or check.py --row NAME FOLDER", file=sys.stderr)
            return 2
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

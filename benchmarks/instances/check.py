#!/usr/bin/env python3
"""Scores a plan for one of these instances. It needs Python 3.9 and nothing else, and shares no code with musselbed.

    check.py 001.json plan.json

An instance is one aPad with docks, and aMussels that lie at places on the bottom. Units are metres, seconds, and charge on
[0, 1]. All aMussels begin at work with their `charges`.

- At work an aMussel loses `drain_per_s` until it is empty. It is active while it has charge. In a dock it is not.
- In a dock it gains by `curve`: a list of [upper end of charge, gain per second], rising; the last part ends at 1.
- Each way up and down takes `motor_run` of charge, or what is left of it.
- The aPad goes straight with `speed_m_s` from `start_m`. To dock takes `dock_s`, to undock `undock_s`.

A plan is {"steps": [...]}. The steps are flown in order; each is one of

- ["collect", i]: go to the place of aMussel i, which is at work, and dock it. A dock must be free.
- ["deploy", i]: go to the place of aMussel i, which is docked, and undock it.
- ["wait", s]: wait s seconds.

A step that does not end by `horizon_s` is not flown, nor is any after it. A step that breaks these rules is an error.

The score is the uptime at equal charge, in percent: U + 100 w (q_end - q_begin) / T. U is the mean share of the horizon T
in which the aMussels are active, q their mean charge, and w `battery_worth_s`. Who is docked at the end has not paid for
its way down, so q_end is less by `motor_run` for it. `bound_percent` is an upper bound of the score, and
`uptime_bound_percent` one of U.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any


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
            if type(value) not in (int, float) or not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{step}: a wait is a number of seconds")
            return self._pass(value, step)
        if kind not in ("collect", "deploy") or type(value) is not int:
            raise ValueError(f"{step}: no such step")
        if not 0 <= value < len(self._charges):
            raise ValueError(f"{step}: no such aMussel")
        if (value in self.docked) is not (kind == "deploy"):
            raise ValueError(f"{step}: it is {'docked' if value in self.docked else 'not docked'}")
        if kind == "collect" and len(self.docked) >= self.instance["docks"]:
            raise ValueError(f"{step}: no dock is free")
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
    world = World(instance)
    for number, step in enumerate(steps, start=1):
        try:
            if not (isinstance(step, list) and len(step) == 2):
                raise ValueError(f"{step}: no such step")
            if not world.fly(step):
                break
        except (ValueError, OverflowError) as error:
            raise ValueError(f"step {number}: {error}") from error
    return world.score()


def read(path: str) -> Any:
    """ValueError, with the path, for a file that is no JSON text or cannot be read."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from error


def main(arguments: list[str]) -> int:
    if len(arguments) != 2:
        print("use: check.py INSTANCE.json PLAN.json", file=sys.stderr)
        return 2
    try:
        instance, plan = (read(it) for it in arguments)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    try:
        found = scored(instance, plan)
    except ValueError as error:
        print(f"{arguments[1]}: {error}", file=sys.stderr)
        return 1
    print(json.dumps({**found, "bound_percent": instance["bound_percent"]}, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

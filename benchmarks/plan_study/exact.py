"""The best plan of a small instance, by branch and bound.

It is the best of all plans whose waits are whole multiples of a stated time, and in which no step undoes the step before.

A node is the world after some steps. Its children are each aMussel's collection or release, and one wait. A node is left
out where even its bound is no better than the best plan so far. The bound forgets that there is one aPad: whoever is at
work can be docked as soon as the aPad could be there, the docks fill one after the other, and each docked second goes to
whom it helps most.

An aMussel with charge q that is docked for y of the R seconds left has at most the charge G = q + g(y). Here g is the curve
from q on, and its fastest part above: it is never full. So it is active for at most a(y) = min(R - y, G / d), and ends with
the value a + w (G - d a). The bound takes the smallest concave function above, and gives out the docked seconds by its
slopes, the steepest first.
"""

from __future__ import annotations

import time
from itertools import pairwise
from math import dist, inf
from typing import Any, NamedTuple

Instance = dict[str, Any]
Step = tuple[str, Any]
_EPSILON = 1e-9


class Node(NamedTuple):
    """The world after some steps: times in seconds, charges on [0, 1]; `place` counts the start after the aMussels."""

    now_s: float
    place: int
    docked: frozenset[int]
    charges: tuple[float, ...]
    active_s: float
    """The sum over all aMussels until now."""


class ExactSearch:
    """A search for a plan with a score above `known_score`; waits are multiples of `wait_s`."""

    def __init__(self, instance: Instance, wait_s: float, known_score: float = -inf) -> None:
        self.instance, self.wait_s = instance, wait_s
        self.nodes = 0
        self.plan: list[Step] | None = None
        """The best plan so far; None while none is better than the known one."""
        self._horizon_s: float = instance["horizon_s"]
        self._docks: int = instance["docks"]
        self._drain: float = instance["drain_per_s"]
        self._worth_s: float = instance["battery_worth_s"]
        self._motor_run: float = instance["motor_run"]
        self._dock_s: float = instance["dock_s"]
        curve: list[tuple[float, float]] = [(end, per_s) for end, per_s in instance["curve"]]
        self._slow, self._fastest = curve[:-1], curve[-1][1]
        places_m = [*instance["places_m"], instance["start_m"]]
        self._way_s = [[dist(a, b) / instance["speed_m_s"] for b in places_m] for a in places_m]
        self.start = Node(0.0, len(places_m) - 1, frozenset(), tuple(instance["charges"]), 0.0)
        at_start_s = self._worth_s * sum(self.start.charges)
        self._best = known_score / 100 * len(self.start.charges) * self._horizon_s + at_start_s
        self._until_s = 0.0

    def search(self, at_most_s: float) -> bool:
        """Finds the best plan; False if the search did not end within so many seconds of processor time."""
        self._until_s = time.process_time() + at_most_s
        return self._below(self.start, [])

    def value(self, node: Node) -> float:
        """The value of waiting to the horizon: active seconds, and the charge left at its worth."""
        end = self.after(node, self._horizon_s - node.now_s)
        left = sum(end.charges) - self._motor_run * len(node.docked)
        return end.active_s + self._worth_s * left

    def after(self, node: Node, seconds: float) -> Node:
        """The world so many seconds later, if nothing is done."""
        charges, active_s = [], node.active_s
        for agent, charge in enumerate(node.charges):
            if agent in node.docked:
                charges.append(min(1.0, self._charged(charge, seconds)))
            else:
                lasts_s = min(seconds, charge / self._drain)
                active_s += lasts_s
                charges.append(max(0.0, charge - self._drain * seconds))
        return Node(node.now_s + seconds, node.place, node.docked, tuple(charges), active_s)

    def children(self, node: Node, last: Step | None) -> list[tuple[Step, Node]]:
        """Each step that ends by the horizon, with the world after it; none undoes the `last` one."""
        found: list[tuple[Step, Node]] = []
        for agent, way_s in enumerate(self._way_s[node.place][:-1]):
            kind = "deploy" if agent in node.docked else "collect"
            if kind == "collect" and len(node.docked) >= self._docks:
                continue
            works_s = self._dock_s if kind == "collect" else self.instance["undock_s"]
            if (
                last and last[0] != "wait" and last[1] == agent
            ) or node.now_s + way_s + works_s > self._horizon_s:
                continue
            there = self.after(node, way_s + works_s)
            charges = list(there.charges)
            charges[agent] = max(0.0, charges[agent] - self._motor_run)
            docked = node.docked ^ {agent}
            found.append(
                ((kind, agent), Node(there.now_s, agent, docked, tuple(charges), there.active_s)),
            )
        if node.now_s + self.wait_s <= self._horizon_s:
            found.append((("wait", self.wait_s), self.after(node, self.wait_s)))
        return found

    def bound(self, node: Node) -> float:
        """A value that no plan from this node on exceeds."""
        left_s = self._horizon_s - node.now_s
        total, slopes = node.active_s, []
        for agent, charge in enumerate(node.charges):
            reach_s = 0.0 if agent in node.docked else self._way_s[node.place][agent] + self._dock_s
            points = self._values(charge, left_s, left_s - reach_s)
            total += points[0][1]
            slopes += [
                ((up - low) / (end - begin), end - begin) for (begin, low), (end, up) in pairwise(points)
            ]
        budget_s = self._dock_seconds(node, left_s)
        for slope, lasts_s in sorted(slopes, reverse=True):
            if budget_s <= 0 or slope <= 0:
                break
            total += slope * min(lasts_s, budget_s)
            budget_s -= lasts_s
        return total

    def _below(self, node: Node, steps: list[Step]) -> bool:
        """Searches from a node on; False if the time is over."""
        self.nodes += 1
        if time.process_time() > self._until_s:
            return False
        if (value := self.value(node)) > self._best + _EPSILON:
            self._best, self.plan = value, list(steps)
        last = steps[-1] if steps else None
        children = [(self.bound(child), step, child) for step, child in self.children(node, last)]
        for bound, step, child in sorted(children, key=lambda it: -it[0]):
            if bound > self._best + _EPSILON and not self._below(child, [*steps, step]):
                return False
        return True

    def _dock_seconds(self, node: Node, left_s: float) -> float:
        """The greatest sum of docked seconds: the aPad goes to the nearest, and then docks one after the other."""
        total = left_s * len(node.docked)
        ways_s = [
            way_s for agent, way_s in enumerate(self._way_s[node.place][:-1]) if agent not in node.docked
        ]
        ready_s = min(ways_s, default=left_s) + self._dock_s
        for _ in range(self._docks - len(node.docked)):
            total += max(0.0, left_s - ready_s)
            ready_s += self._dock_s
        return total

    def _values(self, charge: float, left_s: float, docked_s: float) -> list[tuple[float, float]]:
        """Corners of the smallest concave function above the value, from 0 to `docked_s` docked seconds."""
        ends = [0.0, max(0.0, docked_s)]
        reached, at_s = charge, 0.0
        for end, per_s in self._slow:
            if reached < end and (at_s := at_s + (end - reached) / per_s) < docked_s:
                ends.append(at_s)
            reached = max(reached, end)
        ends.sort()
        for begin, end in pairwise(tuple(ends)):
            # Between two corners both are straight: the time in the water, and that for which the charge lasts.
            at_begin, at_end = (
                self._charged(charge, it) / self._drain - (left_s - it) for it in (begin, end)
            )
            if at_begin < 0 < at_end:
                ends.append(begin - (end - begin) * at_begin / (at_end - at_begin))
        hull: list[tuple[float, float]] = []
        for at_s in sorted(set(ends)):
            gained = self._charged(charge, at_s)
            active_s = min(left_s - at_s, gained / self._drain)
            point = (at_s, active_s + self._worth_s * (gained - self._drain * active_s))
            while len(hull) > 1 and _is_below(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        return hull

    def _charged(self, charge: float, seconds: float) -> float:
        """The charge after so many docked seconds, as if the last part of the curve had no end."""
        for end, per_s in self._slow:
            if charge < end:
                needed_s = (end - charge) / per_s
                if seconds <= needed_s:
                    return charge + seconds * per_s
                charge, seconds = end, seconds - needed_s
        return charge + seconds * self._fastest


def _is_below(before: tuple[float, float], point: tuple[float, float], after: tuple[float, float]) -> bool:
    """True if `point` is not above the line from `before` to `after`."""
    return (point[1] - before[1]) * (after[0] - before[0]) <= (after[1] - before[1]) * (point[0] - before[0])

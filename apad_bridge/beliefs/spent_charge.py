"""The charge that a submerged aMussel has spent since its last measurement, while its modes were not observed.

The charge spent is the integral of the modes' drains over a Markov chain that may change mode at whole hours. Its first
two moments, given the present mode, follow exactly from the mixing step of an interacting-multiple-model filter. The
expected path, on which nothing unexpected happened, is kept apart, because it alone has a sharp answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from apad_bridge.beliefs.modes import SUBMERGED, Mode
from apad_bridge.beliefs.twin_parameters import CycleParameters, Habits
from firmware_model.power.charge import MS_PER_MIN
from firmware_model.value import value

_NEVER = 1e-12


Rows = tuple[tuple[float, float, float], ...]
"""Probabilities [from][to] of a decision, in the order of `SUBMERGED`; filterpy's estimators use the same order."""


class ChargeChoice(NamedTuple):
    """One decision. `expected` None means to stay. `deviation` is of an unknown plan's charge until the next decision."""

    rows: Rows
    expected: Mode | None
    deviation: float


Choices = Callable[[int], ChargeChoice]
"""The choice at the agent time of a decision."""


Spending = Callable[[int, int], tuple[float, float, float]]
"""The charge that each mode of `SUBMERGED` takes from one time to another."""


class Spent(NamedTuple):
    """With `probability`, a charge of this mean and variance, at the nominal drain."""

    probability: float
    mean: float
    variance: float


@value
class Load:
    """Charge spent by present mode, in the order of `SUBMERGED`; `by_mode` also contains the path `expected`."""

    by_mode: tuple[Spent, Spent, Spent]
    expected: Spent
    expected_mode: Mode
    unscheduled_decisions: int = 0
    """Decisions so far that no schedule covered."""

    @classmethod
    def known(cls, mode: Mode, spent: float = 0.0) -> Load:
        """The aMussel is certainly in `mode`."""
        rows = tuple(Spent(float(mode is one), spent, 0.0) for one in SUBMERGED)
        return cls((rows[0], rows[1], rows[2]), Spent(1.0, spent, 0.0), mode)

    @classmethod
    def from_shares(cls, shares: tuple[float, float, float], spent: float, variance: float = 0.0) -> Load:
        """The aMussel is in one of the modes, with these probabilities."""
        a, b, c = (Spent(share, spent, variance) for share in shares)
        likely = max(SUBMERGED, key=shares.__getitem__)
        return cls((a, b, c), Spent(shares[likely], spent, variance), likely)

    def total(self) -> Spent:
        return merged(self.by_mode)

    def add(self, amount: float, its_variance: float = 0.0) -> Load:
        """Adds the same amount in every mode."""
        a, b, c = (Spent(p, mean + amount, variance + its_variance) for p, mean, variance in self.by_mode)
        p, mean, variance = self.expected
        return Load(
            (a, b, c),
            Spent(p, mean + amount, variance + its_variance),
            self.expected_mode,
            self.unscheduled_decisions,
        )

    def mixed_with(self, other: Load, share: float) -> Load:
        """This load with probability `share`, else the other one; the likelier one's expected path stays the expected."""
        a, b, c = (
            merged([Spent(share * one[0], *one[1:]), Spent((1 - share) * two[0], *two[1:])])
            for one, two in zip(self.by_mode, other.by_mode, strict=True)
        )
        likelier, weight = (self, share) if share >= 0.5 else (other, 1 - share)
        p, mean, variance = likelier.expected
        decisions = max(self.unscheduled_decisions, other.unscheduled_decisions)
        return Load((a, b, c), Spent(weight * p, mean, variance), likelier.expected_mode, decisions)

    def unexpected(self, mode: Mode) -> Spent:
        """The part of `mode` without the expected path."""
        whole = self.by_mode[mode]
        return whole if mode is not self.expected_mode else _without(whole, self.expected)

    def skewed_parts(self, rest: Spent) -> list[Spent]:
        """Splits `rest` into the skewed shape of this load: under an unknown plan small amounts are usual, large ones rare.

        The result is two Gaussians of the same first two moments, the wider one on the side of large amounts.
        """
        if not self.unscheduled_decisions:
            return [rest]
        p, mean, variance = rest
        sd = math.sqrt(variance)
        return [
            Spent(0.65 * p, mean - 0.55 * sd, 0.09 * variance),
            Spent(0.35 * p, mean + 0.55 * 0.65 / 0.35 * sd, 1.08504 * variance),
        ]

    def spend(self, amounts: tuple[float, float, float]) -> Load:
        """Every mode continues, and takes its amount of `amounts`."""
        a, b, c = self.by_mode
        p, mean, variance = self.expected
        return Load(
            (
                Spent(a[0], a[1] + amounts[0], a[2]),
                Spent(b[0], b[1] + amounts[1], b[2]),
                Spent(c[0], c[1] + amounts[2], c[2]),
            ),
            Spent(p, mean + amounts[self.expected_mode], variance),
            self.expected_mode,
            self.unscheduled_decisions,
        )

    def choose(self, choice: ChargeChoice) -> Load:
        """A decision, at which the mode may change."""
        rows, expected, deviation = choice
        a, b, c = (self._entering(to, rows) for to in range(3))
        unscheduled_decisions = self.unscheduled_decisions
        if deviation:
            # Plans last for days and differ in drain hour after hour: so the deviation grows with time, not with its root.
            unscheduled_decisions += 1
            more = (2 * unscheduled_decisions - 1) * deviation**2
            a, b, c = (Spent(p, mean, variance + more) for p, mean, variance in (a, b, c))
        new_mode = self.expected_mode if expected is None else expected
        p, mean, variance = self.expected
        path = Spent(p * rows[self.expected_mode][new_mode], mean, variance)
        return Load((a, b, c), path, new_mode, unscheduled_decisions)

    def _entering(self, to: int, rows: Rows) -> Spent:
        return merged([Spent(one[0] * rows[n][to], one[1], one[2]) for n, one in enumerate(self.by_mode)])


def merged(parts: tuple[Spent, ...] | list[Spent]) -> Spent:
    """One `Spent` of the same first two moments; parts without probability do not count."""
    probability = mean = square = 0.0
    for p, m, v in parts:
        probability += p
        mean += p * m
        square += p * (v + m * m)
    if probability < _NEVER:
        return Spent(0.0, parts[0][1], 0.0)
    mean /= probability
    return Spent(probability, mean, max(0.0, square / probability - mean * mean))


def _without(whole: Spent, part: Spent) -> Spent:
    probability = whole[0] - part[0]
    if probability < 1e-9:
        return Spent(0.0, whole[1], 0.0)
    mean = (whole[0] * whole[1] - part[0] * part[1]) / probability
    square = whole[0] * (whole[2] + whole[1] ** 2) - part[0] * (part[2] + part[1] ** 2)
    return Spent(probability, mean, max(0.0, square / probability - mean * mean))


def spending(per_min: tuple[float, ...], cycle: CycleParameters | None) -> Spending:
    """Spending at steady rates, except in sleep with a known `cycle`."""
    asleep, idle, high = per_min[:3]

    def amounts(from_ms: int, to_ms: int) -> tuple[float, float, float]:
        minutes = (to_ms - from_ms) / MS_PER_MIN
        slept = asleep * minutes if cycle is None else cycle.spent(from_ms, to_ms)
        return slept, idle * minutes, high * minutes

    return amounts


def scheduled_rows(habits: Habits, mode: Mode) -> Rows:
    """Every mode changes to the commanded one, except for the unscheduled share."""
    aside = habits.unscheduled / 2
    row = [aside, aside, aside]
    row[mode] = 1 - habits.unscheduled
    return ((row[0], row[1], row[2]),) * 3


def usual_rows(
    habits: Habits, shares: tuple[float, float, float], remembered: Mode | None, trust: float
) -> Rows:
    """Without a schedule: a mode stays or changes by `shares`; with probability `trust`, it changes to `remembered`."""
    rows = []
    for stays in range(3):
        row = [(1 - trust) * (1 - habits.stays) * share for share in shares]
        row[stays] += (1 - trust) * habits.stays
        if remembered is not None:
            row[remembered] += trust
        rows.append((row[0], row[1], row[2]))
    return tuple(rows)


def propagated(
    load: Load,
    from_ms: int,
    to_ms: int,
    spending: Spending,
    every_ms: int,
    choices: Choices,
) -> Load:
    """The load of `from_ms` at `to_ms`, from decision to decision; each span is in closed form."""
    at_ms = from_ms
    while True:
        decision_ms = (at_ms // every_ms + 1) * every_ms
        load = load.spend(spending(at_ms, min(decision_ms, to_ms)))
        if decision_ms > to_ms:
            return load
        load = load.choose(choices(decision_ms))
        at_ms = decision_ms

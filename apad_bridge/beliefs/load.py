"""How much a submerged aMussel has spent since it was last measured, when nobody heard what it was doing.

The charge spent is the integral of the modes' drains over a chain that may change mode at whole hours. Its first two
moments, given the mode it is in now, follow exactly by the mixing of an interacting-multiple-model filter; the one path
on which nothing unexpected happened is kept apart, because it alone has a sharp answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from apad_bridge.beliefs.knowledge import Habits, Schedule
from apad_bridge.beliefs.modes import SUBMERGED, Mode

MS_PER_MIN = 60_000
_NEVER = 1e-12


class Spent(NamedTuple):
    """With `probability`, an amount of this mean and variance, at the nominal drain."""

    probability: float
    mean: float
    variance: float


@dataclass(frozen=True, slots=True)
class Load:
    """`by_mode` in the order of `SUBMERGED`; `expected` is the path without surprise, also contained in `by_mode`."""

    by_mode: tuple[Spent, Spent, Spent]
    expected: Spent
    expected_mode: Mode

    @classmethod
    def known(cls, mode: Mode, spent: float = 0.0) -> Load:
        """It is in `mode`, surely."""
        rows = tuple(Spent(float(mode is one), spent, 0.0) for one in SUBMERGED)
        return cls((rows[0], rows[1], rows[2]), Spent(1.0, spent, 0.0), mode)

    @classmethod
    def guessed(cls, shares: tuple[float, float, float], spent: float, variance: float = 0.0) -> Load:
        """It is in any of the modes, with these probabilities."""
        a, b, c = (Spent(share, spent, variance) for share in shares)
        likely = max(SUBMERGED, key=shares.__getitem__)
        return cls((a, b, c), Spent(shares[likely], spent, variance), likely)

    def total(self) -> Spent:
        return merged(self.by_mode)

    def add(self, amount: float, its_variance: float = 0.0) -> Load:
        """The same whatever it does."""
        a, b, c = (Spent(p, mean + amount, variance + its_variance) for p, mean, variance in self.by_mode)
        p, mean, variance = self.expected
        return Load((a, b, c), Spent(p, mean + amount, variance + its_variance), self.expected_mode)

    def unexpected(self, mode: Mode) -> Spent:
        """What remains of `mode` without the path on which nothing unexpected happened."""
        whole = self.by_mode[mode]
        return whole if mode is not self.expected_mode else _without(whole, self.expected)

    def spend(self, per_min: tuple[float, ...], elapsed_ms: int) -> Load:
        """Every mode goes on for `elapsed_ms`."""
        minutes = elapsed_ms / MS_PER_MIN
        a, b, c = self.by_mode
        p, mean, variance = self.expected
        return Load(
            (
                Spent(a[0], a[1] + per_min[0] * minutes, a[2]),
                Spent(b[0], b[1] + per_min[1] * minutes, b[2]),
                Spent(c[0], c[1] + per_min[2] * minutes, c[2]),
            ),
            Spent(p, mean + per_min[self.expected_mode] * minutes, variance),
            self.expected_mode,
        )

    def choose(self, rows: tuple[tuple[float, float, float], ...], expected: Mode) -> Load:
        """A time at which it may change its mode: `rows[from][to]`; on the path without surprise it takes `expected`."""
        a, b, c = (self._entering(to, rows) for to in range(3))
        p, mean, variance = self.expected
        return Load((a, b, c), Spent(p * rows[self.expected_mode][expected], mean, variance), expected)

    def _entering(self, to: int, rows: tuple[tuple[float, float, float], ...]) -> Spent:
        return merged([Spent(one[0] * rows[n][to], one[1], one[2]) for n, one in enumerate(self.by_mode)])


def merged(parts: tuple[Spent, ...] | list[Spent]) -> Spent:
    """One of the same first two moments; parts of no probability count for nothing."""
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


def rows_of(
    habits: Habits, scheduled: Mode | None, shares: tuple[float, float, float]
) -> tuple[tuple[float, float, float], ...]:
    """Probabilities [from][to] of the next decision: by schedule where there is one, else by habit."""
    if scheduled is not None:
        aside = habits.unscheduled / 2
        row = [aside, aside, aside]
        row[scheduled] = 1 - habits.unscheduled
        return ((row[0], row[1], row[2]),) * 3
    rows = []
    for stays in range(3):
        row = [(1 - habits.stays) * share for share in shares]
        row[stays] += habits.stays
        rows.append((row[0], row[1], row[2]))
    return tuple(rows)


def carried(
    load: Load,
    from_ms: int,
    to_ms: int,
    per_min: tuple[float, ...],
    habits: Habits,
    schedule: Schedule,
    shares: tuple[float, float, float],
) -> Load:
    """The load of `from_ms` at `to_ms`: from decision to decision, each span in closed form."""
    at_ms = from_ms
    while True:
        decision_ms = (at_ms // habits.every_ms + 1) * habits.every_ms
        end_ms = min(decision_ms, to_ms)
        load = load.spend(per_min, end_ms - at_ms)
        if decision_ms > to_ms:
            return load
        scheduled = schedule.at(decision_ms)
        rows = rows_of(habits, scheduled, shares)
        load = load.choose(rows, load.expected_mode if scheduled is None else scheduled)
        at_ms = decision_ms

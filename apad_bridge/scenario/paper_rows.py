"""The rows of the paper's Table II, by the shipped scenario that flies each."""

from __future__ import annotations

from dataclasses import dataclass

_AGREES = 0.01
"""A ratio of Active to N * Avg / 100 farther than this from 1 is no rounding."""


@dataclass(frozen=True, slots=True)
class PaperRow:
    """A row of Table II. Uptimes are percent; `cost_m` metres; `active_mean` the mean number of active aMussels."""

    name: str
    scenario: str
    collection: str
    amussels: int
    mean: float
    max: float
    min: float
    cost_m: float
    active_mean: float

    @property
    def figures(self) -> tuple[float, ...]:
        """The paper's five columns."""
        return self.mean, self.max, self.min, self.cost_m, self.active_mean

    @property
    def ratio(self) -> float:
        """Active over N * Avg / 100, which is 1 by definition."""
        return self.active_mean / (self.amussels * self.mean / 100)

    @property
    def recorded(self) -> float:
        """The part of the known length for which the flight was recorded, if Active is a mean over recorded steps."""
        return 1 / self.ratio if abs(self.ratio - 1) > _AGREES else 1.0


PAPER = (
    PaperRow("Cautious", "pool-12", "cautious", 12, 74.37, 87.38, 59.88, 307.1746, 8.9243),
    PaperRow("Greedy", "pool-12", "greedy", 12, 72.27, 87.16, 42.84, 247.8026, 8.9495),
    PaperRow("Greedy (bay)", "bay-24", "greedy", 24, 71.98, 90.31, 31.18, 186.4318, 16.2368),
    PaperRow("No charging", "pool-12", "none", 12, 67.36, 79.56, 56.64, 0.0, 8.0837),
)
_ALSO = {("demo", "cautious"): "pool-12", ("no-charging", "none"): "pool-12"}
"""Other scenarios that fly a row."""


def row_of(scenario: str, collection: str) -> PaperRow | None:
    """The paper's row of a shipped scenario by this name, flown by this strategy; None for another.

    Rows that read as recorded for another time than the mission's are left out: docs/paper-figures.md.
    """
    known = {(it.scenario, it.collection): it for it in PAPER if it.recorded == 1.0}
    return known.get((_ALSO.get((scenario, collection), scenario), collection))

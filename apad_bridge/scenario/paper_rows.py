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
    PaperRow(
        name="Cautious",
        scenario="pool-12",
        collection="cautious",
        amussels=12,
        mean=74.37,
        max=87.38,
        min=59.88,
        cost_m=307.1746,
        active_mean=8.9243,
    ),
    PaperRow(
        name="Greedy",
        scenario="pool-12",
        collection="greedy",
        amussels=12,
        mean=72.27,
        max=87.16,
        min=42.84,
        cost_m=247.8026,
        active_mean=8.9495,
    ),
    PaperRow(
        name="Greedy (bay)",
        scenario="bay-24",
        collection="greedy",
        amussels=24,
        mean=71.98,
        max=90.31,
        min=31.18,
        cost_m=186.4318,
        active_mean=16.2368,
    ),
    PaperRow(
        name="No charging",
        scenario="pool-12",
        collection="none",
        amussels=12,
        mean=67.36,
        max=79.56,
        min=56.64,
        cost_m=0.0,
        active_mean=8.0837,
    ),
)
_ALSO = {("demo", "cautious"): "pool-12", ("no-charging", "none"): "pool-12"}
"""Other scenarios that fly a row."""


def row_of(scenario: str, collection: str) -> PaperRow | None:
    """The paper's row of a shipped scenario by this name, flown by this strategy; None for another.

    Rows that read as recorded for another time than the mission's are left out: docs/paper-figures.md.
    """
    known = {(it.scenario, it.collection): it for it in PAPER if it.recorded == 1.0}
    return known.get((_ALSO.get((scenario, collection), scenario), collection))

"""How good beliefs were: error, coverage of the 95 % interval, consistency, by the age of the last packet."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

AGES = (
    ("now", 0, 0),
    ("1-6", 1, 6),
    ("7-12", 7, 12),
    ("13-24", 13, 24),
    ("25-48", 25, 48),
    ("49-", 49, 1 << 30),
)


@dataclass
class Samples:
    """Rows (age in hours, true charge, believed charge, variance, lower and upper tail at the truth, right mode)."""

    rows: list[tuple[float, ...]] = field(default_factory=list)

    def score(self) -> dict[str, object]:
        age, truth, mean, variance, low, high, right = np.array(self.rows).T
        error = mean - truth
        covered = (low >= 0.025) & (high <= 0.975)
        free = (truth > 0) & (truth < 1) & (mean > 1e-3) & (mean < 1 - 1e-3) & (variance > 0)
        bins = {name: (age >= first) & (age <= last) for name, first, last in AGES}
        return {
            "rmse": float(np.sqrt(np.mean(error**2))),
            "coverage": float(covered.mean()),
            "coverage_unclamped": float(covered[free].mean()) if free.any() else None,
            "nees": float(np.mean(error[free] ** 2 / variance[free])) if free.any() else None,
            "coverage_by_age": {n: float(covered[b].mean()) if b.any() else None for n, b in bins.items()},
            "samples_by_age": {n: int(b.sum()) for n, b in bins.items()},
            "rmse_by_age": {
                n: float(np.sqrt(np.mean(error[b] ** 2))) if b.any() else None for n, b in bins.items()
            },
            "nees_by_age": {
                n: float(np.mean(error[b & free] ** 2 / variance[b & free])) if (b & free).any() else None
                for n, b in bins.items()
            },
            "mode_share": float(right.mean()),
            "samples": len(age),
        }

"""Bounds of the numbers that a scenario gives for the water. The scenario's loader checks them; nothing here does."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

LEAST, GREATEST = 1e-9, 1e9
"""The range of any quantity, in whatever unit; beyond this range arithmetic overflows."""

PositiveNumber = Annotated[float, Ge(LEAST), Le(GREATEST)]
NotNegative = Annotated[float, Ge(0), Le(GREATEST)]
OpenFraction = Annotated[float, Gt(0), Lt(1)]
Decibels = Annotated[float, Ge(-300), Le(300)]
Count = Annotated[int, Ge(1), Le(1_000_000_000)]


def not_tiny(quantity: float) -> float:
    if quantity < LEAST:
        raise ValueError(f"must be {LEAST:g} or more")
    return quantity

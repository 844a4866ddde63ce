"""Combines several aPads' flights: the figures of summary.json over all aMussels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from apad_bridge.records.combining import SummaryFigures
from apad_bridge.records.summary import COMBINED


@dataclass(frozen=True, slots=True)
class Flown:
    """The outcome of the flights of one aPad or of several: the summaries and the failures, by aPad."""

    summaries: Mapping[str, dict[str, Any]]
    failures: Mapping[str, str] = field(default_factory=dict)
    handed_on: int = 0
    """The number of aMussels that another aPad served than at the start."""


def combined_summary(name: str, of_each: Mapping[str, SummaryFigures], handed_on: int = 0) -> dict[str, Any]:
    """The summary of the whole run from its aPads' summaries, by name; each percentage is of its own flight's time.

    An aMussel is counted where it is simulated, whichever aPad serves it; `handed_on` is the number of aMussels that
    another aPad served than at the start.
    """
    combined = {it: rule(of_each, it) for it, rule in COMBINED.items()}
    apads = {apad: dict(flight) for apad, flight in of_each.items()}
    return {"name": name, **combined, "handed_on": handed_on, "apads": apads}

"""Rules by which a figure of several aPads' summaries becomes one of the whole run.

A rule takes the summaries by aPad and the figure's name. A figure that one aPad does not know is None for all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import fsum
from typing import Any

from apad_bridge.records.digest import combined_digest

SummaryFigures = Mapping[str, Any]
Summaries = Mapping[str, SummaryFigures]
CombiningRule = Callable[[Summaries, str], Any]


def _values(of_each: Summaries, key: str) -> list[Any]:
    return [flight[key] for flight in of_each.values()]


def total(of_each: Summaries, key: str) -> float | None:
    """The sum, which is a whole number where all values are."""
    values = _values(of_each, key)
    if None in values:
        return None
    return fsum(values) if any(isinstance(it, float) for it in values) else sum(values)


def largest(of_each: Summaries, key: str) -> Any:
    """The largest of the known values."""
    return max((it for it in _values(of_each, key) if it is not None), default=None)


def mean_of_apads(of_each: Summaries, key: str) -> float | None:
    values = _values(of_each, key)
    return None if None in values else fsum(values) / len(values)


def shared(of_each: Summaries, key: str) -> Any:
    """The value that all share; None where they differ."""
    first, *others = _values(of_each, key)
    return first if all(it == first for it in others) else None


def texts(of_each: Summaries, key: str) -> str | None:
    """The text that all share; where they differ, the text of each aPad that has one."""
    found: dict[str, str | None] = {apad: flight[key] for apad, flight in of_each.items()}
    if len(set(found.values())) == 1:
        return next(iter(found.values()))
    return "; ".join(f"{apad}: {text}" for apad, text in found.items() if text is not None)


def first_known(of_each: Summaries, key: str) -> Any:
    return next((it for it in _values(of_each, key) if it is not None), None)


def ids(of_each: Summaries, key: str) -> list[int]:
    return sorted({it for found in _values(of_each, key) for it in found})


def one_after_another(of_each: Summaries, key: str) -> list[Any]:
    return [it for found in _values(of_each, key) for it in found]


def counts(of_each: Summaries, key: str) -> dict[str, float] | None:
    """The sums by name, the largest first; None where nobody counted."""
    found: Counter[str] = Counter()
    for it in _values(of_each, key):
        found.update(it or {})
    return dict(found.most_common()) if found or None not in _values(of_each, key) else None


def counts_by_name(of_each: Summaries, key: str) -> dict[str, float]:
    return dict(sorted((counts(of_each, key) or {}).items()))


def mean_by(weight: str) -> CombiningRule:
    """The mean over aMussels, or their seconds, not over aPads; None if a flight that counts does not have the figure.

    A flight that counted no aMussel has no weight.
    """

    def mean(of_each: Summaries, key: str) -> float | None:
        return _mean(of_each, weight, lambda flight: flight.get(key))

    return mean


def _mean(of_each: Summaries, weight: str, figure: Callable[[SummaryFigures], float | None]) -> float | None:
    flights = of_each.values()
    if any(flight[weight] is None and flight["agents"] for flight in flights):
        return None
    weighed = [(flight[weight], figure(flight)) for flight in flights if flight[weight]]
    summands = [weight * value for weight, value in weighed if value is not None]
    if not weighed or len(summands) < len(weighed):
        return None
    return fsum(summands) / fsum(weight for weight, _ in weighed)


def spread(of_each: Summaries, key: str) -> dict[str, float | None] | None:
    """The mean by the counted seconds, with the greatest and the least of any aMussel."""
    if (mean := _mean(of_each, "counted_s", lambda flight: flight[key]["mean"])) is None:
        return None
    spreads = [flight[key] for flight in of_each.values() if flight["counted_s"]]
    return {"mean": mean, "max": max(it["max"] for it in spreads), "min": min(it["min"] for it in spreads)}


def amussels(of_each: Summaries, key: str) -> dict[str, dict[str, Any]]:
    """Each aMussel's figures from where it is simulated; its services by all aPads."""
    found: dict[str, dict[str, Any]] = {}
    for of_flight in _values(of_each, key):
        for agent_id, figures in of_flight.items():
            known = found.setdefault(agent_id, dict(figures) | {"services": 0})
            known.update({name: it for name, it in figures.items() if it is not None and name != "services"})
            known["services"] += figures["services"]
    return dict(sorted(found.items(), key=lambda it: int(it[0])))


def digest(of_each: Summaries, key: str) -> str:
    return combined_digest(_values(of_each, key))

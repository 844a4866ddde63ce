"""Combines several aPads' flights: the figures of summary.json over all aMussels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import fsum
from typing import Any

from apad_bridge.records.digest import combined_digest


@dataclass(frozen=True, slots=True)
class Flown:
    """The outcome of the flights of one aPad or of several: the summaries and the failures, by aPad."""

    summaries: Mapping[str, dict[str, Any]]
    failures: Mapping[str, str] = field(default_factory=dict)
    handed_on: int = 0
    """The number of aMussels that another aPad served than at the start."""


Summary = Mapping[str, Any]
_SUMS = (
    *("agents", "active_mean", "amussels_lost", "emptied", "dead_time_s", "services", "gave_up"),
    *("cost_m", "planned_m", "steps_given_up"),
    *("samples_taken", "samples_uploaded", "samples_waiting", "samples_lost"),
)


def combined_summary(name: str, of_each: Mapping[str, Summary], handed_on: int = 0) -> dict[str, Any]:
    """The summary of the whole run from its aPads' summaries, by name; each percentage is of its own flight's time.

    An aMussel is counted where it is simulated, whichever aPad serves it; `handed_on` is the number of aMussels that
    another aPad served than at the start. A figure that is None for one aPad is None here. `apad_energy_fraction` is the
    aPads' mean.
    """
    flights = list(of_each.values())
    dropped: Counter[str] = Counter()
    causes: Counter[str] = Counter()
    for flight in flights:
        dropped.update(flight["dropped"])
        causes.update(flight["causes"])
    return {
        "name": name,
        "theta": flights[0]["theta"],
        "seed": flights[0]["seed"],
        "mission_s": max(flight["mission_s"] for flight in flights),
        "stopped_s": _combined(flights, "stopped_s", _total),
        "ended_by": _common_text(of_each, "ended_by"),
        "end_reason": flights[0]["end_reason"] if len({it["end_reason"] for it in flights}) == 1 else None,
        "first_cause": _common_text(of_each, "first_cause"),
        "causes": dict(causes.most_common()),
        "left_alone": sorted({agent_id for flight in flights for agent_id in flight["left_alone"]}),
        "beyond_reach": sorted({agent_id for flight in flights for agent_id in flight["beyond_reach"]}),
        "failed_docks": [dock_index for flight in flights for dock_index in flight["failed_docks"]],
        **{key: _combined(flights, key, _total) for key in ("counted_s", "counted_at_end")},
        "uptime_paper": _spread(flights, "uptime_paper"),
        "uptime_submerged": _spread(flights, "uptime_submerged"),
        "final_charge_mean": _mean(flights, "counted_at_end", lambda flight: flight["final_charge_mean"]),
        "charge_gain_mean": _known_mean(flights, "counted_at_end", "charge_gain_mean"),
        "uptime_equal_charge": _known_mean(flights, "counted_s", "uptime_equal_charge"),
        "apad_energy_fraction": _combined(
            flights, "apad_energy_fraction", lambda values: fsum(values) / len(values)
        ),
        "apad_energy_missing": next(
            (reason for flight in flights if (reason := flight["apad_energy_missing"]) is not None), None
        ),
        **{key: _combined(flights, key, _total) for key in _SUMS},
        "latest_tick_s": max(
            (it for flight in flights if (it := flight["latest_tick_s"]) is not None), default=None
        ),
        "handed_on": handed_on,
        "excluded": _excluded(flights),
        "amussels": _amussels(flights),
        "dropped": dict(sorted(dropped.items())),
        "digest": combined_digest(flight["digest"] for flight in flights),
        "apads": {apad: dict(flight) for apad, flight in of_each.items()},
    }


def _combined(flights: list[Summary], key: str, combine: Callable[[list[Any]], Any]) -> Any:
    values = [flight[key] for flight in flights]
    return None if None in values else combine(values)


def _total(values: Sequence[float]) -> float:
    """The sum, which is a whole number where all of `values` are."""
    return fsum(values) if any(isinstance(it, float) for it in values) else sum(values)


def _mean(flights: list[Summary], weight: str, figure: Callable[[Summary], float]) -> float | None:
    """The mean over aMussels, or their seconds, not over aPads. A flight that counted no aMussel has no weight."""
    if any(flight[weight] is None and flight["agents"] for flight in flights):
        return None
    counted = [flight for flight in flights if flight[weight]]
    total = fsum(flight[weight] for flight in counted)
    return fsum(flight[weight] * figure(flight) for flight in counted) / total if total else None


def _known_mean(flights: list[Summary], weight: str, key: str) -> float | None:
    """The mean of a figure, or None if a flight that counts does not have it; an older run's has neither."""
    if any(flight[weight] and flight.get(key) is None for flight in flights):
        return None
    return _mean(flights, weight, lambda flight: float(flight[key]))


def _spread(flights: list[Summary], key: str) -> dict[str, float | None] | None:
    if (mean := _mean(flights, "counted_s", lambda flight: flight[key]["mean"])) is None:
        return None
    spreads = [flight[key] for flight in flights if flight["counted_s"]]
    return {"mean": mean, "max": max(it["max"] for it in spreads), "min": min(it["min"] for it in spreads)}


def _excluded(flights: list[Summary]) -> dict[str, float] | None:
    """The time that the figures leave out, over all flights."""
    apart: Counter[str] = Counter()
    for flight in flights:
        apart.update(flight["excluded"] or {})
    return dict(apart) or None


def _amussels(flights: list[Summary]) -> dict[str, dict[str, Any]]:
    """Each aMussel's figures from where it is simulated; its services by all aPads."""
    found: dict[str, dict[str, Any]] = {}
    for flight in flights:
        for agent_id, figures in flight["amussels"].items():
            known = found.setdefault(agent_id, dict(figures) | {"services": 0})
            known.update(
                {key: value for key, value in figures.items() if value is not None and key != "services"}
            )
            known["services"] += figures["services"]
    return dict(sorted(found.items(), key=lambda it: int(it[0])))


def _common_text(of_each: Mapping[str, Summary], key: str) -> str | None:
    """The text that all share; where they differ, the text of each aPad that has one."""
    texts: dict[str, str | None] = {apad: flight[key] for apad, flight in of_each.items()}
    if len(set(texts.values())) == 1:
        return next(iter(texts.values()))
    return "; ".join(f"{apad}: {text}" for apad, text in texts.items() if text is not None)

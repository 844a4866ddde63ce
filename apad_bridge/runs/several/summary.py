"""What several aPads' flights come to together: the figures of summary.json over all aMussels.

What several aPads' flights say of themselves, as one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from apad_bridge.runs.status import Status


def together(each: Sequence[Status], apads: int) -> Status:
    """The sums; of times the last one's, for the run ends with it."""
    return Status(
        min(it.now_ms for it in each),
        f"{apads} aPads",
        "",
        sum(it.agents for it in each),
        sum(it.active for it in each),
        sum(it.docked for it in each),
        sum(it.services for it in each),
        sum(it.cost_m for it in each),
        None,
        max(it.behind_s for it in each),
    )


Summary = Mapping[str, Any]
_SUMS = (
    *("agents", "active_mean", "amussels_lost", "emptied", "dead_time_s", "cost_m", "services", "gave_up"),
    *("samples_taken", "samples_uploaded", "samples_waiting", "samples_lost"),
)


def of_all(name: str, of_each: Mapping[str, Summary], handed_on: int = 0) -> dict[str, Any]:
    """The summary of the whole from those of its aPads, by name; each percentage is of its own flight's time.

    An aMussel is counted where it is simulated, whoever serves it; `handed_on` is how many were served by another aPad
    than at the start. A figure that one of them does not know is None. `apad_energy_fraction` is the aPads' mean.
    """
    flights = list(of_each.values())
    dropped: Counter[str] = Counter()
    for flight in flights:
        dropped.update(flight["dropped"])
    return {
        "name": name,
        "theta": flights[0]["theta"],
        "seed": flights[0]["seed"],
        "mission_s": max(flight["mission_s"] for flight in flights),
        "ended_by": _said(of_each, "ended_by"),
        "first_cause": _said(of_each, "first_cause"),
        **{key: _over(flights, key, sum) for key in ("counted_s", "counted_at_end")},
        "uptime_paper": _spread(flights, "uptime_paper"),
        "uptime_submerged": _spread(flights, "uptime_submerged"),
        "final_charge_mean": _mean(flights, "counted_at_end", lambda flight: flight["final_charge_mean"]),
        "apad_energy_fraction": _over(
            flights, "apad_energy_fraction", lambda values: sum(values) / len(values)
        ),
        **{key: _over(flights, key, sum) for key in _SUMS},
        "handed_on": handed_on,
        "apart": _apart(flights),
        "dropped": dict(sorted(dropped.items())),
        "apads": {apad: dict(flight) for apad, flight in of_each.items()},
    }


def _over(flights: list[Summary], key: str, taken: Callable[[list[Any]], Any]) -> Any:
    values = [flight[key] for flight in flights]
    return None if None in values else taken(values)


def _mean(flights: list[Summary], weight: str, figure: Callable[[Summary], float]) -> float | None:
    """Over aMussels, or their seconds, and not over aPads. A flight that counted nobody weighs nothing."""
    if any(flight[weight] is None and flight["agents"] for flight in flights):
        return None
    counted = [flight for flight in flights if flight[weight]]
    total = sum(flight[weight] for flight in counted)
    return sum(flight[weight] * figure(flight) for flight in counted) / total if total else None


def _spread(flights: list[Summary], key: str) -> dict[str, float | None] | None:
    mean = _mean(flights, "counted_s", lambda flight: flight[key]["mean"])
    if mean is None:
        return None
    spreads = [flight[key] for flight in flights if flight["counted_s"]]
    return {"mean": mean, "max": max(it["max"] for it in spreads), "min": min(it["min"] for it in spreads)}


def _apart(flights: list[Summary]) -> dict[str, float] | None:
    """What the figures leave out, of all."""
    apart: Counter[str] = Counter()
    for flight in flights:
        apart.update(flight["apart"] or {})
    return dict(apart) or None


def _said(of_each: Mapping[str, Summary], key: str) -> str | None:
    """What all say; or, where they differ, what each says that says anything."""
    words: dict[str, str | None] = {apad: flight[key] for apad, flight in of_each.items()}
    if len(set(words.values())) == 1:
        return next(iter(words.values()))
    return "; ".join(f"{apad}: {word}" for apad, word in words.items() if word is not None)

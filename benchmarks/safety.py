"""Faults of a vehicle at sea, and what its guards let happen: orders outside the fence, and the time to a safe state.

Port, guards and the core of a generation fly that generation's simulated vehicle, without ROS, in ticks of a second. Faults
of what is around the vehicle take real processes on two machines, a minute for each try (`safety_study/flights.py`). Either
way an `Observer` stands at the vehicle's end of the wire. It judges each order that arrives by arithmetic of its own, and
shares no code with the guards. A stop is counted apart: a hold where the vehicle was last heard, or controllers off.

The limits of the guards are those of `real-apad.yaml`.

A vehicle is safe when it holds a place inside the fence, when its controllers are off, or when a pilot was called. The time
to that counts from the fault where the fault takes the position or the command away. Where the vehicle goes astray under a
good position, it counts from the fence; a vehicle that is safe before it gets there took 0 s. It must be safe within
`limit_s`: 3 s with the link up, and 3 s more than the watchdog's patience where nobody hears the bench.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rich.console import Console
from rich.table import Table
from stack_benches import FAULTS, Bench, is_safe, place_of, real_limits, scenario
from wire_observer import SIDE_M, is_inside

from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.guard_options import GuardOptions
from benchmarks.safety_study import flights

TRIES = 20
TRIES_FOR_A_FLIGHT = 10
"""One of so many tries is made where real processes fly."""
SIDE_BY_SIDE = 2
"""Flights at a time: most of a flight is waiting."""
SEED = 20261122
ASTRAY = ("current across the fence", "primitive that never ends")
"""The vehicle leaves its way under a good position: it is unsafe from the fence on."""
PILOTED = ("pilot", "pilot in a docking")
_WATCHED_TICKS = 240


def try_once(fault: str, generation: Generation, guards: GuardOptions, rng: random.Random) -> dict[str, Any]:
    """Flies one try: the fault under way, and orders that go on being given as if nothing had happened."""
    acts = FAULTS[fault]
    bench = Bench(generation, acts.drift_m_s, guards=guards)
    acts.begin(bench, rng)
    begun_ms = bench.now_ms
    acts.inflict(bench, rng)
    safe_ms = None
    unsafe_ms = None if fault in ASTRAY else begun_ms
    for _ in range(_WATCHED_TICKS):
        bench.run(1)
        if unsafe_ms is None and not is_inside(place_of(bench.link.pose)):
            unsafe_ms = bench.now_ms
        if safe_ms is None and is_safe(bench, begun_ms):
            safe_ms = bench.now_ms
        if rng.random() < 0.1:
            rng.choice(
                (
                    lambda: bench.go(rng.uniform(-20, SIDE_M + 20), rng.uniform(-20, SIDE_M + 20)),
                    lambda: bench.hold(rng.uniform(-20, SIDE_M + 20), rng.uniform(-20, SIDE_M + 20)),
                    lambda: bench.dock(rng.randrange(4), rng.randrange(1, 10)),
                    lambda: bench.undock(rng.randrange(4), rng.randrange(1, 10)),
                )
            )()
    observer = bench.observer
    return {
        "outside": len(observer.outside) + len(observer.blind),
        "against_pilot": len(observer.against_pilot),
        "stops": observer.stops,
        "orders": observer.orders,
        "safe_s": _waited_s(unsafe_ms, safe_ms),
    }


def _waited_s(unsafe_ms: int | None, safe_ms: int | None) -> float | None:
    """None where the vehicle did not come to a safe state."""
    if safe_ms is None:
        return None
    return 0.0 if unsafe_ms is None else max(0, safe_ms - unsafe_ms) / 1000


def measure(tries: int = TRIES) -> dict[str, Any]:
    """Each fault for each generation: counts are sums, and `safe_after_s` is the longest time.

    A fault is tried `tries` times, or a tenth as often where real processes fly. `not_tried` says what was not, and why.
    """
    guards = real_limits()
    rows = [_tried(fault, generation, guards, tries) for fault, generation in _pairs()]
    not_tried = {f"{it}, generation a": "that stack tells nobody of a pilot" for it in PILOTED}
    if why := flights.why_no_flight():
        not_tried |= dict.fromkeys(flights.FAULTS, why)
    else:
        for fault in flights.FAULTS:
            for generation in Generation.A, Generation.B:
                rows.append(_flown(fault, generation, guards, max(1, tries // TRIES_FOR_A_FLIGHT)))
    return {"rows": rows, "not_tried": not_tried}


def _pairs() -> Iterator[tuple[str, Generation]]:
    for fault in FAULTS:
        for generation in (Generation.A, Generation.B):
            if fault not in PILOTED or generation is Generation.B:
                yield fault, generation


def _tried(fault: str, generation: Generation, guards: GuardOptions, tries: int) -> dict[str, Any]:
    rng = random.Random(f"{SEED} {fault} {generation}")
    results = [try_once(fault, generation, guards, rng) for _ in range(tries)]
    return _row(fault, generation, flights.REACTION_S, results)


def _flown(name: str, generation: Generation, guards: GuardOptions, tries: int) -> dict[str, Any]:
    fault, flown = flights.FAULTS[name], scenario(generation, guards=guards)
    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        results = list(
            pool.map(
                lambda it: flights.try_once(
                    fault, flown, it, random.Random(f"{SEED} {name} {generation} {it}")
                ),
                range(tries),
            )
        )
    return _row(name, generation, fault.limit_s, results)


def _row(fault: str, generation: Generation, limit_s: float, results: list[dict[str, Any]]) -> dict[str, Any]:
    times_s = [it["safe_s"] for it in results]
    return {
        "fault": fault,
        "generation": generation.value,
        "tries": len(results),
        "orders": sum(it["orders"] for it in results),
        "stops": sum(it["stops"] for it in results),
        "orders_outside_fence": sum(it["outside"] for it in results),
        "orders_against_pilot": sum(it["against_pilot"] for it in results),
        "safe_after_s": None if None in times_s else max(times_s),
        "limit_s": limit_s,
    }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(*(name.replace("_", " ") for name in result["rows"][0]))
    for row in result["rows"]:
        table.add_row(*("-" if value is None else str(value) for value in row.values()))
    console.print(table)
    for fault, why in result["not_tried"].items():
        console.print(f"not tried: {fault}: {why}")

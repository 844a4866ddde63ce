"""Localisation in sound-12: how far fixes lie from where aMussels are, and whether their covariances are true."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from apad_bridge.events.mission import DockSwitched
from apad_bridge.events.sound import PlaceFixed
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.starts import starts_of
from benchmarks.rows import told

SEEDS, SHORT_SEEDS = range(1, 7), range(1, 2)
SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "sound-12.yaml"
HOURS = 60
"""Agent time: two hours of the aPad's."""


def measure(short: bool = False) -> dict[str, Any]:
    """Scores fixes before an aMussel was first moved, when its place is known; `nees` is 2 if the covariances are true."""
    errors_m, nees, hdops = [], [], []
    seeds = SHORT_SEEDS if short else SEEDS
    for seed in seeds:
        data = resolve(load(SCENARIO))
        data.update(seed=seed, duration_s=HOURS * 3600 / 30)
        data["fleet"].update(hosting="one_process", start={"charge": [0.7, 1.0]})
        data["water"].update(talk={"ping_period_s": 5}, localisation={"apart_m": 3.0, "deviation_m": 0.15})
        scenario = from_data(data, "localisation")
        _, recorder = fly_in_memory(scenario)
        places = {it.agent_id: np.array((it.north_m, it.east_m)) for it in starts_of(scenario)}
        for _, event in recorder.journal.entries:
            if isinstance(event, DockSwitched):
                places.pop(event.agent, None)
            elif isinstance(event, PlaceFixed) and event.id in places:
                off = np.array((event.north_m, event.east_m)) - places[event.id]
                north, cross, east = event.covariance
                errors_m.append(float(np.hypot(*off)))
                nees.append(float(off @ np.linalg.solve([[north, cross], [cross, east]], off)))
                hdops.append(event.hdop)
        told({"seed": seed, "fixes_so_far": len(errors_m)})
    return {
        "fixes": len(errors_m),
        "flights": len(seeds),
        "rms_m": float(np.sqrt(np.mean(np.square(errors_m)))),
        "p95_m": float(np.percentile(errors_m, 95)),
        "nees": float(np.mean(nees)),
        "hdop_median": float(np.median(hdops)),
    }


def show(result: dict[str, Any], console: Console) -> None:
    console.print(
        f"{result['fixes']} fixes in {result['flights']} flights: {result['rms_m']:.2f} m off (root mean square), "
        f"95 % within {result['p95_m']:.2f} m, at a median HDOP of {result['hdop_median']:.2f}; "
        f"normalised squared error {result['nees']:.2f} (2 if covariances are true, less if cautious)"
    )

"""The pool's mission on twins that receive one hourly packet in ten, paired with the same flown on perfect knowledge."""

from __future__ import annotations

import math
import random
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from apad_bridge.mission.facts import Fact, SoundHeard, WifiHeard
from apad_bridge.records.summary import uptime_figures
from apad_bridge.runs.in_memory import fly_in_memory, open_flight
from apad_bridge.scenario.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.loop import Flight
from benchmarks.rows import side_by_side, told

CONFIGURATIONS = 30
SHORT_CONFIGURATIONS = 2
HEARD = 0.1
HOUR_AT_THETA_30_S = 120.0
START_CHARGE = (0.6, 1.0)
SCENARIO = Path(__file__).parents[1] / "launch_scripts/scenarios/pool-12.yaml"
MODEL = TwinModel(
    drain_deviation=0.05,
    sensor_noise=0.005,
    bias_deviation=0.002,
    unscheduled=0.01,
    fix_deviation_m=0.1,
)


def measure(configurations: int = CONFIGURATIONS, short: bool = False) -> dict[str, Any]:
    """`uptime_kept`: mean over configurations of uptime on beliefs over uptime on perfect knowledge, with its interval
    of 95 %. Perfect knowledge: a report of every aMussel each second, all received, without noise."""
    configurations = SHORT_CONFIGURATIONS if short else configurations
    pairs = [told(pair) for _, pair in side_by_side(flown, range(1, configurations + 1))]
    kept = [pair["on_beliefs"]["uptime"] / pair["on_truth"]["uptime"] for pair in pairs]
    half = 1.96 * statistics.stdev(kept) / math.sqrt(len(kept))
    mean = statistics.mean(kept)
    return {
        "configurations": configurations,
        "heard": HEARD,
        "report_period_s": HOUR_AT_THETA_30_S,
        "uptime_kept": mean,
        "uptime_kept_interval": [mean - half, mean + half],
        "worst_uptime_kept": min(kept),
        "lost_on_beliefs": sum(pair["on_beliefs"]["lost"] for pair in pairs),
        "lost_on_truth": sum(pair["on_truth"]["lost"] for pair in pairs),
        "pairs": pairs,
    }


def flown(seed: int) -> dict[str, dict[str, float]]:
    """One random configuration, flown both ways."""
    scenario = load(SCENARIO)
    data = resolve(scenario)
    data["fleet"]["start"] = {"charge": list(START_CHARGE)}
    configured = from_data({**data, "seed": seed}, scenario.name)
    on_truth, _ = fly_in_memory(configured)
    return {"on_truth": _figures(on_truth), "on_beliefs": _figures(_on_beliefs(configured, seed))}


def _on_beliefs(scenario: Scenario, seed: int) -> dict[str, Any]:
    flight, recorder = open_flight(with_twins(scenario))
    hear_few(flight, seed)
    flight.run()
    state = flight.supervisor.mission.state
    figures = uptime_figures(recorder.meter, flight.now_ms)
    return {**figures, "cost_m": state.planned_m, "services": state.services}


def with_twins(scenario: Scenario) -> Scenario:
    """The scenario with hourly packets and twins."""
    hearing = replace(scenario.hearing, report_period_s=HOUR_AT_THETA_30_S)
    return replace(scenario, hearing=hearing, beliefs=Beliefs(estimator=EstimatorKind.TWIN, twin=MODEL))


def hear_few(flight: Flight, seed: int) -> None:
    """Has the flight receive the part `HEARD` of the packets, by chance."""
    receive, luck = flight.supervisor.receive, random.Random(seed)
    first: set[bytes] = set()

    def thinned(fact: Fact) -> None:
        # The first packet of each is received: an aPad knows the aMussels that it has deployed.
        if isinstance(fact, WifiHeard | SoundHeard):
            sender = fact.data[2:4]
            if sender in first and luck.random() >= HEARD:
                return
            first.add(sender)
        receive(fact)

    flight.supervisor.receive = thinned  # type: ignore[method-assign]


def _figures(flight: dict[str, Any]) -> dict[str, float]:
    return {
        "uptime": flight["uptime_paper"]["mean"],
        "lost": flight["amussels_lost"],
        "emptied": flight["emptied"],
        "services": flight["services"],
        "cost_m": flight["cost_m"],
    }


def show(result: dict[str, Any], console: Console) -> None:
    low, high = result["uptime_kept_interval"]
    console.print(
        f"{result['configurations']} configurations, {100 * result['heard']:.0f} % of hourly packets heard: "
        f"{100 * result['uptime_kept']:.1f} % of the uptime on perfect knowledge is kept "
        f"({100 * low:.1f} to {100 * high:.1f} %); lost {result['lost_on_beliefs']} against {result['lost_on_truth']}"
    )

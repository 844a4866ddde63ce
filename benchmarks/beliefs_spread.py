"""Coverage in flight, on fleets whose boards differ from what their twins are told, or that hear nothing for two days.

Every flight is of sound-12. Cases: "spread" and "metered", whose aMussels differ by 10 % (one standard deviation) in drain
and in capacity and start with secondaries below full by 5 %, without and with boards that meter their batteries; "deaf",
in which aMussel 3 and the aPad do not hear each other from 600 to 7000 s; and "aged", on batteries of 400 cycles and
5 years. A bin of age or mode counts from `LEAST_SAMPLES` samples on.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.analysis.belief_scores.comparisons import BeliefComparison, compared
from apad_bridge.analysis.belief_scores.scores import Score, scores_of
from apad_bridge.beliefs.belief import Belief
from apad_bridge.records.samples import Water, belief_sample
from apad_bridge.records.summary import uptime_figures
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from benchmarks.rows import side_by_side, told

SEEDS = (1, 2, 3, 4, 5)
SHORT_S = 1200
"""The short tier flies each case once, for so long."""
LEAST_SAMPLES = 200
SAMPLED_MS = 10_000
SCENARIO = Path(__file__).parents[1] / "launch_scripts/scenarios/sound-12.yaml"
SPREAD = {"drain": 0.1, "capacity": 0.1, "secondary_start": 0.05}
AGEING = {"cycles": 400, "years": 5}
DEAF = "from, to, loss, since_s, until_s\n3, apad, 1, 600, 7000\napad, 3, 1, 600, 7000\n"
CASES = ("spread", "metered", "deaf", "aged")


def measure(seeds: tuple[int, ...] = SEEDS, short: bool = False) -> dict[str, Any]:
    """`flights`: for each case and seed the scores, the least coverage of any bin, and how many were lost."""
    seeds, changes = (seeds[:1], {"duration_s": SHORT_S}) if short else (seeds, {})
    jobs = [
        (case, seed) for case in CASES for seed in (seeds if case in ("spread", "metered") else seeds[:1])
    ]
    flights = [told(it) for _, it in side_by_side(partial(_flight, changes=changes), jobs)]
    return {"scenario": SCENARIO.name, "least_samples": LEAST_SAMPLES, "flights": flights}


def scenario_of(case: str, seed: int, directory: Path, **changes: Any) -> Scenario:
    """The scenario of a case; `directory` takes its file of links. `changes` are keys of the top."""
    shipped = load(SCENARIO)
    data = resolve(shipped) | {"seed": seed} | changes
    if case in ("spread", "metered"):
        data["fleet"]["spread"] = SPREAD
    if case == "metered":
        data["board"]["whole"]["power"]["metering"] = "table-one"
    if case == "aged":
        data["board"]["whole"]["power"]["ageing"] = AGEING
    if case == "deaf":
        links = directory / "links.csv"
        links.write_text(DEAF)
        data |= {"duration_s": 9000} | changes
        data["water"]["links_file"] = str(links)
    return from_data(data, shipped.name)


def flown(scenario: Scenario) -> tuple[list[BeliefComparison], dict[str, Any]]:
    """Every belief beside its truth, each 10 s of the mission, and the figures of the flight."""
    flight, recorder = open_flight(scenario)
    water, newest, take = Water(scenario), {}, recorder.truths
    rows: list[BeliefComparison] = []

    def truths(batch: list[Truth]) -> None:
        take(batch)
        newest.update({truth.agent_id: truth for truth in batch})

    def tick(now_ms: int, beliefs: list[Belief], *_: object) -> None:
        for belief in beliefs if now_ms % SAMPLED_MS == 0 else ():
            truth = water.sample(newest[belief.agent_id], scenario.theta * now_ms)
            rows.append(
                compared(belief_sample(belief, MissionMs(now_ms)), truth, now_ms, scenario.time_scale)
            )

    recorder.truths, recorder.tick = truths, tick  # type: ignore[method-assign, assignment]
    flight.run()
    return rows, uptime_figures(recorder.meter, flight.now_ms)


def _flight(job: tuple[str, int], changes: dict[str, Any]) -> dict[str, Any]:
    case, seed = job
    with tempfile.TemporaryDirectory(prefix="musselbed-") as directory:
        rows, figures = flown(scenario_of(case, seed, Path(directory), **changes))
    scores = scores_of(rows)
    assert scores is not None and scores.overall.coverage is not None
    bins = {f"age up to {name}": score for name, score in scores.by_age.items()}
    bins |= {f"mode {name}": score for name, score in scores.by_mode.items()}
    worst_bin, worst = _least({k: v for k, v in bins.items() if v.samples >= LEAST_SAMPLES})
    worst_agent, of_agent = _least(scores.by_agent)
    return {
        "case": case,
        "seed": seed,
        "coverage": scores.overall.coverage,
        "width": scores.overall.width,
        "rmse": scores.overall.rmse,
        "worst_bin": worst_bin,
        "worst_bin_coverage": worst,
        "worst_agent": worst_agent,
        "worst_agent_coverage": of_agent,
        "lost": figures["amussels_lost"],
        "scores": scores.to_json(),
    }


def _least(bins: dict[str, Score]) -> tuple[str, float]:
    name, score = min(bins.items(), key=lambda it: it[1].coverage or 0.0)
    return name, score.coverage or 0.0


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        title=f"Beliefs in flight, {result['scenario']}: intervals of 95 %; bins of {result['least_samples']} "
        "samples or more"
    )
    for name in (
        "case",
        "seed",
        "covered",
        "mean width",
        "rmse",
        "worst bin",
        "",
        "worst aMussel",
        "",
        "lost",
    ):
        table.add_column(name, justify="left" if name in ("case", "worst bin") else "right")
    for flight in result["flights"]:
        table.add_row(
            flight["case"],
            str(flight["seed"]),
            f"{flight['coverage']:.3f}",
            f"{flight['width']:.3f}",
            f"{flight['rmse']:.4f}",
            flight["worst_bin"],
            f"{flight['worst_bin_coverage']:.3f}",
            flight["worst_agent"],
            f"{flight['worst_agent_coverage']:.3f}",
            str(flight["lost"]),
        )
    console.print(table)

"""The choice among rules for one scenario, by trial missions on random configurations of it.

No rule is best everywhere: what pays depends on the area, the fleet, the docks and the mission's length. So each rule is
flown, and the one with the most uptime is taken of those that cost nothing else. A choice among rules by features of the
situation is a hyper-heuristic; here the features are the trials' own figures.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from rich.table import Table

from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.loader import file_of, load
from apad_bridge.scenario.schema import RandomStart, Scenario
from apad_bridge.studies.event_driven import model_gap
from apad_bridge.studies.findings import Findings, table_of
from apad_bridge.studies.models import Model
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan, plan_of

_COMMON: dict[str, Any] = {
    "collection": "core",
    "costs": {"distance_per_m": 1.0, "energy_per_charge": 50.0},
    "dispatch": "asynchronous",
    "places": "exchanged",
}
RULES: dict[str, dict[str, Any]] = {
    name: {**_COMMON, **thresholds}
    for name, thresholds in {
        "from 0.02": {"pool_threshold": 0.02},
        "from 0.2 when one is empty": {"pool_threshold": 0.2, "again_threshold": 0.0},
        "from 0.3": {"pool_threshold": 0.3},
        "0.5 to 0.9": {"pool_threshold": 0.5, "charge_to": 0.9},
        "0.6 to 0.97": {"pool_threshold": 0.6, "charge_to": 0.97},
        "0.62 to 0.95": {"pool_threshold": 0.62, "charge_to": 0.95},
        "0.65 to 0.92": {"pool_threshold": 0.65, "charge_to": 0.92},
    }.items()
}
RULES |= {
    f"{name}, ways dear": {**RULES[name], "costs": {"distance_per_m": 10.0, "energy_per_charge": 50.0}}
    for name in ("0.5 to 0.9", "0.6 to 0.97")
}
"""The keys of `mission` of each rule.

Found on squares of 40 and 150 m and on 90 x 15 m; those with dear ways on trials of the cells of fair.yaml."""
_LEFT_OUT = ("charge_to", "charge_lead", "again_threshold")
"""A rule is without those of these keys that it does not set, whatever the scenario has."""
AS_IT_IS = "as the scenario has it"
_BATCHES = {"dispatch": "batch", "places": "own"}
PAPERS: dict[str, dict[str, Any]] = {
    "cautious, in batches": {"collection": "cautious", **_BATCHES},
    "greedy, in batches": {"collection": "greedy", **_BATCHES},
}
KNOWN = (AS_IT_IS, *PAPERS)
"""Those with which a choice for a scenario is compared."""
TRIALS = 8
UPTIME, LEAST, METRES, LOST = "uptime_paper_mean", "uptime_paper_min", "metres", "amussels_lost"
EQUAL_CHARGE = "uptime_equal_charge"
_ERRORS = 2.0
"""With one, rules chosen for a square of 80 m and for two islands drove more on other starts."""
LONG_H = 80.0
"""Hours of the aMussels' time. A shorter mission may live on the charge with which it began."""


@dataclass(frozen=True, slots=True)
class ChosenRule:
    """The rule that is taken in one setting, and its mean differences to the better one of the `known` rules."""

    rule: str
    better: str
    figure: str
    """The column by which it was chosen: `UPTIME` or `EQUAL_CHARGE`."""
    gain: float
    """Points of that figure."""
    uptime: float
    """Points of mean uptime."""
    least: float
    """Points of the least aMussel's uptime."""
    metres: float
    """Metres of the straight legs."""


def figure_for(hours: float) -> str:
    """The column by which rules are chosen in missions of so many hours of the aMussels' time."""
    return UPTIME if hours >= LONG_H else EQUAL_CHARGE


def choice_of(rows: Sequence[Row], known: Collection[str], figure: str) -> ChosenRule:
    """Chooses by the rows of one setting: of the rules that spare, the one that has most of `figure` on the mean.

    The better one of the `known` rules has most of these. A rule spares if it loses no more aMussels than that
    one, leaves the least aMussel no worse, and drives no more. Its metres have to be fewer by two standard errors, because
    trials are few. The better one spares by itself, so no choice is worse than it in the trials. All rules need the same
    seeds. Raises ValueError if a known rule has no row.
    """
    by_rule: dict[str, dict[int, Row]] = {}
    for row in rows:
        by_rule.setdefault(row["strategy"], {})[row["seed"]] = row
    if missing := [it for it in known if it not in by_rule]:
        raise ValueError(f"no mission of {', '.join(missing)}")

    def mean(rule: str, column: str) -> float:
        return fmean(row[column] for row in by_rule[rule].values())

    better = max(known, key=lambda it: mean(it, figure))

    def differences(rule: str, column: str) -> list[float]:
        own, others = by_rule[rule], by_rule[better]
        return [own[seed][column] - others[seed][column] for seed in own]

    def spares(rule: str) -> bool:
        metres = differences(rule, METRES)
        error = stdev(metres) / sqrt(len(metres)) if len(metres) > 1 else 0.0
        return (
            fmean(differences(rule, LOST)) <= 0
            and fmean(differences(rule, LEAST)) >= 0
            and fmean(metres) + _ERRORS * error <= 0
        )

    rule = max((it for it in by_rule if spares(it)), key=lambda it: mean(it, figure))
    gains = (fmean(differences(rule, it)) for it in (figure, UPTIME, LEAST, METRES))
    return ChosenRule(rule, better, figure, *gains)


def rules_study(path: Path, seeds: int = TRIALS, trust: Trust | None = None) -> StudyPlan:
    """The study of one scenario: its own rule, the paper's, and `RULES`, on so many random configurations.

    A start that the scenario draws is kept. One from a file is a single draw, so the trials draw others, as each study
    does. ScenarioError for a scenario with a mistake. Strategies in files are executed with `trust` alone.
    """
    scenario = load(path)
    data = {
        "name": f"{scenario.name}-rules",
        "scenarios": [str(file_of(path).absolute())],
        "strategies": [
            {"name": AS_IT_IS, "collection": scenario.mission.collection},
            *({"name": name, **keys_of(name, scenario)} for name in PAPERS | RULES),
        ],
        "seeds": seeds,
        **({"start": "scenario"} if isinstance(scenario.fleet.start, RandomStart) else {}),
        "primary": UPTIME,
        "model": (Model.EVENT_DRIVEN if model_gap(scenario) is None else Model.MISSION).value,
    }
    return plan_of(data, str(path), path.parent, trust)


def keys_of(rule: str, scenario: Scenario) -> dict[str, Any]:
    """The keys that the block `mission` of this scenario needs for a rule of `PAPERS` or `RULES`."""
    unset = dict.fromkeys(key for key in _LEFT_OUT if getattr(scenario.mission, key) is not None)
    return unset | (PAPERS | RULES)[rule]


def is_choice(plan: StudyPlan) -> bool:
    """True for the study of one scenario, also from the `study.yaml` that it wrote."""
    return len(plan.settings) == 1 and set(KNOWN) <= set(plan.strategies)


class RuleChoice(Findings):
    """A line for each rule, and the chosen one as the lines of a scenario.

    The page and `--json` compare all rules with the better one of the paper's, if a study's file names no baseline.
    """

    def __init__(self, plan: StudyPlan, rows: Sequence[Row]) -> None:
        scenario = plan.scenario(0, 0, plan.seeds[0])
        figure = figure_for(scenario.duration_s * scenario.theta / 3600)
        baseline = plan.study.baseline or max(PAPERS, key=lambda it: _mean(rows, it, figure))
        super().__init__(replace(plan, study=replace(plan.study, baseline=baseline)), rows)
        self.choice = choice_of(rows, KNOWN, figure)

    def as_data(self) -> dict[str, Any]:
        return {**super().as_data(), "choice": asdict(self.choice)}

    def answer(self) -> Sequence[str]:
        choice = self.choice
        figure, why = "uptime", ""
        if choice.figure == EQUAL_CHARGE:
            figure = "uptime at equal charge"
            why = f" In less than {LONG_H:g} hours of the aMussels' time a mission may spend charge and not replace it."
        if choice.rule not in RULES:
            return [f"Recommended: {choice.rule}. No other rule has more {figure} without another cost.{why}"]
        at_equal = "" if choice.figure == UPTIME else f" ({choice.gain:+.1f} at equal charge)"
        sentences = (
            f"Recommended: {choice.rule}, one by one, with exchanged places. Against {choice.better!r} it has "
            f"{choice.uptime:+.1f} points of uptime{at_equal}, {choice.least:+.1f} for the least aMussel, and "
            f"{choice.metres:+.0f} m of way. It has the most {figure} of the rules that lose no more aMussels, leave the "
            f"least aMussel no worse and drive no more.{why} In the scenario:"
        )
        keys = keys_of(choice.rule, self.plan.named[0]).items()
        lines = (f"  {key}: {it if isinstance(it, str) else json.dumps(it)}" for key, it in keys)
        return [sentences, "\n".join(["mission:", *lines])]

    def lines(self, width: int) -> Iterator[Table | str]:
        headings = ("", "lost", "uptime %", "equal\ncharge %", "least %", "way m")
        title = f"rules for {self.plan.named[0].name}, means of {len(self.plan.seeds)} configurations"
        table = table_of(title, headings)
        for rule in self.plan.strategies:
            cells = [
                f"{_mean(self.rows, rule, key):.1f}" for key in (LOST, UPTIME, EQUAL_CHARGE, LEAST, METRES)
            ]
            table.add_row(rule, *cells, style="bold" if rule == self.choice.rule else "")
        yield table
        yield from self.answer()
        yield ""


def _mean(rows: Sequence[Row], rule: str, column: str) -> float:
    return fmean(row[column] for row in rows if row["strategy"] == rule)

"""A study: strategies on scenarios, with parameters, each on the same random configurations, one for each seed.

`load_study` checks everything before a mission is flown: each scenario with each strategy and parameter.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from random import Random
from typing import Annotated, Any, Literal

import yaml
from annotated_types import Ge, Gt, Le, Lt, MinLen
from pydantic import TypeAdapter, ValidationError

from apad_bridge.planning import registry
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.flight_readiness import check_code
from apad_bridge.scenario.loader import file_of, from_data, load, put, resolve, write_with_files
from apad_bridge.scenario.quantities import FileName, frozen
from apad_bridge.scenario.schema import RandomStart, Scenario
from apad_bridge.scenario.text.text_file import write_atomically
from apad_bridge.scenario.text.yaml_text import yaml_of
from apad_bridge.studies.event_driven import model_gap
from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.models import Model

PAPER_START = TypeAdapter(RandomStart).validate_python({"charge": (0.6, 1.0)})
"""The interval of the paper's starting charges (section V-A)."""
STUDY_FILE = "study.yaml"
_STRATEGY_KEYS = ("collection", "redeployment")
_Value = bool | int | float | str | list[Any] | dict[str, Any] | None


@dataclass(frozen=True, slots=True)
class StudiedStrategy:
    """Keys of the scenario's block `mission`, under a name for the tables."""

    name: str
    mission: dict[str, Any]


@frozen
class Study:
    """The study as its file has it. The baseline is the strategy with which the others are compared."""

    name: FileName
    """The study's, and that of its directory."""
    scenarios: Annotated[tuple[str, ...], MinLen(1)]
    """Files, relative to the study's."""
    strategies: Annotated[tuple[str | dict[str, Any], ...], MinLen(1)]
    """Names of collection strategies, also of a package of yours (docs/extending.md), or mappings of keys of `mission`.

    A mapping has a `name` for the tables, as `{name: one by one, collection: cautious, batch: 1}`. The file of
    `FILE.py:Class` is relative to the study's."""
    seeds: Annotated[int, Ge(1), Le(1_000_000)] | Annotated[tuple[Annotated[int, Ge(0)], ...], MinLen(1)]
    """Seeds, or the number of seeds from 1 on. A seed decides starts, drift and misses, for each strategy alike."""
    parameters: dict[str, Annotated[tuple[_Value, ...], MinLen(1)]] = field(default_factory=dict)
    """Lists of values by key of the scenario, as `mission.pool_threshold: [0.5, 0.8]`; each combination is flown."""
    cells: dict[str, dict[str, _Value]] = field(default_factory=dict)
    """Values by key of the scenario that belong together, by a name; each cell is flown.

    As `{small: {area.polygon_m: [...], fleet.count: 8}}`."""
    draws: dict[str, Annotated[tuple[_Value, ...], MinLen(1)]] = field(default_factory=dict)
    """Lists of values by key of the scenario, as `area.polygon_m` or `fleet.start.charge`.

    Each seed draws one of each, the same for each strategy."""
    start: RandomStart | Literal["scenario"] = PAPER_START
    """The interval of the starting charges, `{charge: [0.6, 1.0]}` if left out; `scenario` keeps the scenario's starts."""
    baseline: str | None = None
    """The strategy from which differences are taken. None: the first one."""
    primary: str = "samples_taken"
    """The column of the one comparison that was planned; the others' p-values are adjusted by Holm."""
    confidence: Annotated[float, Gt(0.5), Lt(1)] = 0.95
    """The level of the intervals."""
    model: Model = Model.EVENT_DRIVEN


@dataclass(frozen=True, slots=True)
class Setting:
    """A scenario with one cell and one value for each parameter: the missions that compare with each other."""

    scenario: str
    parameters: tuple[tuple[str, Any], ...]
    """The first is the name of a cell, by the key `cell`, if the study has cells."""
    theta: int

    @property
    def label(self) -> str:
        """The setting in words; theta is part of it, because figures at different thetas do not compare."""
        parameters = dict(self.parameters) | {"theta": self.theta}
        return ", ".join([self.scenario, *(f"{key} {value}" for key, value in parameters.items())])


@dataclass(frozen=True, slots=True)
class StudyPlan:
    """A checked study: for each setting, the scenario of each strategy as plain data, and the seeds."""

    study: Study
    settings: tuple[Setting, ...]
    strategies: tuple[str, ...]
    scenarios: tuple[tuple[dict[str, Any], ...], ...]
    """By setting, then by strategy."""
    seeds: tuple[int, ...]
    named: tuple[Scenario, ...]
    """The scenarios as their files have them."""
    trust: registry.Trust | None = None
    """None: strategies in files are not executed."""
    fitted_to: str = ""
    """The search from whose starts the missions are flown; empty for starts that are drawn."""

    @property
    def blocks(self) -> Iterator[tuple[int, int]]:
        """(index of the setting, seed) of the blocks; a block flies all strategies on one configuration."""
        return itertools.product(range(len(self.settings)), self.seeds)

    @property
    def missions(self) -> int:
        return len(self.settings) * len(self.seeds) * len(self.strategies)

    @property
    def baseline(self) -> str:
        return self.study.baseline or self.strategies[0]

    def scenario(self, setting: int, strategy: int, seed: int) -> Scenario:
        """The scenario of one mission."""
        data = deepcopy(self.scenarios[setting][strategy])
        label = f"{self.settings[setting].label}, seed {seed}"
        for key, value in self.drawn(seed).items():
            put(data, key, value, label)
        return from_data({**data, "seed": seed}, label)

    def drawn(self, seed: int) -> dict[str, Any]:
        """Returns the values that a seed draws, by the scenario's keys; those of two keys do not depend on each other."""
        return {key: Random(f"{seed} {key}").choice(values) for key, values in self.study.draws.items()}

    @property
    def fingerprint(self) -> str:
        """A digest of everything that decides a mission's figures; a study resumes the rows of the same digest alone."""
        scenarios = [[_by_content(it) for it in row] for row in self.scenarios]
        decisive = [scenarios, self.strategies, self.study.model, version("musselbed")]
        text = json.dumps([*decisive, *[it for it in (self.study.draws, self.fitted_to) if it]])
        return hashlib.sha256(text.encode()).hexdigest()

    def to_wire(self) -> list[Any]:
        """The part of the study that flies missions, as plain values for a worker; its scenarios' files stay behind."""
        settings = [[it.scenario, it.parameters, it.theta] for it in self.settings]
        study = _STUDY.dump_python(self.study, mode="json")
        return [study, settings, self.strategies, self.scenarios, self.seeds, self.trust is not None]

    @classmethod
    def from_wire(cls, wire: list[Any]) -> StudyPlan:
        """The inverse of `to_wire`."""
        study, settings, strategies, scenarios, seeds, is_trusted = wire
        return cls(
            _STUDY.validate_json(json.dumps(study), strict=True),
            tuple(Setting(scenario, tuple(map(tuple, it)), theta) for scenario, it, theta in settings),
            tuple(strategies),
            tuple(map(tuple, scenarios)),
            tuple(seeds),
            named=(),
            trust=registry.Trust() if is_trusted else None,
        )


_STUDY = TypeAdapter(Study)


def load_study(path: Path, seeds: int | None = None, trust: registry.Trust | None = None) -> StudyPlan:
    """Reads and checks a study's file; `seeds` is as of `with_seeds`, and None for the file's own.

    Strategies in files are executed with `trust` alone.

    ScenarioError with a line for each mistake, before anything is flown.
    """
    if path.suffix == ".py":
        # Some of Python's lines are YAML, too.
        raise ScenarioError([f"{path}: is no YAML but a Python script: fly it by `musselbed script`"])
    data = yaml_of(path)
    if not isinstance(data, dict):
        raise ScenarioError(
            [f"{path}: is no study: a study is a mapping of name, scenarios, strategies and seeds"]
        )
    plan = plan_of(data, str(path), path.parent, trust)
    return plan if seeds is None else with_seeds(plan, seeds)


def is_scenario(path: Path) -> bool:
    """True for the file or the shipped name of a scenario; a file that is neither that nor a study is left to `load_study`.

    ScenarioError for the name of no shipped scenario.
    """
    path = file_of(path)
    try:
        data = yaml_of(path)
    except ScenarioError:
        return False
    return isinstance(data, dict) and "scenarios" not in data and {"fleet", "mission"} <= data.keys()


def plan_of(data: Any, source: str, directory: Path, trust: registry.Trust | None = None) -> StudyPlan:
    """Builds a study from plain data; the scenarios' files are relative to `directory`. ScenarioError as `load_study`."""
    try:
        study = _STUDY.validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        lines = (f"{source}: {'.'.join(map(str, it['loc']))}: {it['msg']}" for it in error.errors())
        raise ScenarioError(dict.fromkeys(lines)) from error
    study = replace(
        study,
        strategies=tuple(
            _with_files(it, lambda _, in_file: (directory / in_file.path).absolute())
            for it in study.strategies
        ),
    )
    strategies = [_strategy_of(given) for given in study.strategies]
    names = tuple(strategy.name for strategy in strategies)
    _check_names(study, names, source)
    _check_draws(study, strategies, source)
    scenarios = [load(directory / file) for file in study.scenarios]
    settings, rows, mistakes = [], [], []
    cells: list[str | None] = [*study.cells] or [None]
    for scenario, cell, values in itertools.product(
        scenarios, cells, itertools.product(*study.parameters.values())
    ):
        parameters = tuple(zip(study.parameters, values, strict=True))
        decided = (*(() if cell is None else study.cells[cell].items()), *parameters)
        row = []
        for strategy in strategies:
            try:
                row.append(_checked(_changed(scenario, study, decided, strategy), study, source, trust))
                for drawn in itertools.product(*study.draws.values()):
                    both = (*decided, *zip(study.draws, drawn, strict=True))
                    _checked(_changed(scenario, study, both, strategy), study, source, trust)
            except ScenarioError as error:
                mistakes += str(error).splitlines()
        rows.append(tuple(row))
        theta = row[0]["theta"] if row else scenario.theta
        named = (() if cell is None else (("cell", cell),)) + parameters
        settings.append(Setting(scenario.name, tuple(it for it in named if it[0] != "theta"), theta))
    if mistakes:
        raise ScenarioError(dict.fromkeys(mistakes))
    labels = [setting.label for setting in settings]
    if len(set(labels)) < len(labels):
        raise ScenarioError([f"{source}: scenarios: two of them have the same name: rename one"])
    seeds = tuple(range(1, study.seeds + 1)) if isinstance(study.seeds, int) else study.seeds
    return StudyPlan(
        study=study,
        settings=tuple(settings),
        strategies=names,
        scenarios=tuple(rows),
        seeds=seeds,
        named=tuple(scenarios),
        trust=trust,
    )


def with_seeds(plan: StudyPlan, seeds: int) -> StudyPlan:
    """The same study on the seeds 1 to `seeds`; missions that were flown count for both."""
    return replace(plan, seeds=tuple(range(1, seeds + 1)))


def write_study(plan: StudyPlan, directory: Path) -> StudyPlan:
    """Writes the study as `study.yaml`, and its scenarios with their files below `scenarios/`: `load_study` reads it again.

    Returns the plan with the copies of strategies' files that are written, too: a file may change while a study flies.
    OSError for a scenario's file that is gone.
    """
    folder = directory / "scenarios"
    folder.mkdir(exist_ok=True)
    files = [f"{folder.name}/{scenario.name}.yaml" for scenario in plan.named]
    for scenario, file in zip(plan.named, files, strict=True):
        write_with_files(directory / file, scenario)
    first_seeds = tuple(range(1, len(plan.seeds) + 1))
    seeds = len(plan.seeds) if plan.seeds == first_seeds else list(plan.seeds)
    strategies = [
        _with_copies(given, directory, Path("strategies", str(n)))
        for n, given in enumerate(plan.study.strategies, 1)
    ]
    data = _STUDY.dump_python(plan.study, mode="json")
    data |= {"scenarios": files, "strategies": strategies, "seeds": seeds}
    write_atomically(directory / STUDY_FILE, yaml.safe_dump(data, sort_keys=False, allow_unicode=True))
    copied = [
        _files_in(_with_files(it, lambda _, copy: (directory / copy.path).absolute())) for it in strategies
    ]
    rows = (
        tuple(_with_rules(it, rules) for it, rules in zip(row, copied, strict=True)) for row in plan.scenarios
    )
    return replace(plan, scenarios=tuple(rows))


def _with_rules(scenario: dict[str, Any], rules: Mapping[str, registry.InFile]) -> dict[str, Any]:
    return {**scenario, "mission": {**scenario["mission"], **{key: str(it) for key, it in rules.items()}}}


def _by_content(scenario: dict[str, Any]) -> dict[str, Any]:
    """The scenario's data with the content of a strategy's file in place of its folder."""
    mission = scenario["mission"]
    return {
        **scenario,
        "mission": {**mission, **{it: registry.identity(mission[it]) for it in _STRATEGY_KEYS}},
    }


def _files_in(given: str | dict[str, Any]) -> dict[str, registry.InFile]:
    """The strategies in files that an entry of `strategies` names, by key of `mission`."""
    named = {"collection": given} if isinstance(given, str) else given
    found = {key: registry.InFile.of(named[key]) for key in _STRATEGY_KEYS if isinstance(named.get(key), str)}
    return {key: it for key, it in found.items() if it is not None}


def _with_files(
    given: str | dict[str, Any], file_of: Callable[[str, registry.InFile], Path]
) -> str | dict[str, Any]:
    """The entry with another file for each of its strategies in files: `file_of` of the key and the strategy."""
    changed = {key: str(it._replace(path=str(file_of(key, it)))) for key, it in _files_in(given).items()}
    return changed.get("collection", given) if isinstance(given, str) else {**given, **changed}


def _with_copies(given: str | dict[str, Any], directory: Path, folder: Path) -> str | dict[str, Any]:
    """The entry with copies of its strategies' files in the folder, relative to the directory."""

    def copy(key: str, in_file: registry.InFile) -> Path:
        path = folder / key / Path(in_file.path).name
        copied = directory / path
        copied.parent.mkdir(parents=True, exist_ok=True)
        if not (copied.exists() and copied.samefile(in_file.path)):  # a study's own copy is flown again
            shutil.copy(in_file.path, copied)
        return path

    return _with_files(given, copy)


def _strategy_of(given: str | dict[str, Any]) -> StudiedStrategy:
    if isinstance(given, str):
        return StudiedStrategy(name=registry.label(given), mission={"collection": given})
    mission = dict(given)
    name = mission.pop("name", None) or ", ".join(
        f"{key} {registry.label(value) if isinstance(value, str) else value}"
        for key, value in mission.items()
    )
    return StudiedStrategy(name=str(name), mission=mission)


def _check_names(study: Study, names: Sequence[str], source: str) -> None:
    if len(set(names)) < len(names):
        raise ScenarioError([f"{source}: strategies: a name occurs twice: give one another `name`"])
    if study.baseline is not None and study.baseline not in names:
        raise ScenarioError(
            [f"{source}: baseline: {study.baseline} is none of the strategies: {', '.join(names)}"]
        )
    if study.primary not in COLUMNS:
        raise ScenarioError(
            [f"{source}: primary: {study.primary} is no column; columns are {', '.join(COLUMNS)}"]
        )
    if not isinstance(study.seeds, int) and len(set(study.seeds)) < len(study.seeds):
        raise ScenarioError([f"{source}: seeds: one occurs twice"])


def _changed(
    scenario: Scenario, study: Study, parameters: Sequence[tuple[str, Any]], strategy: StudiedStrategy
) -> dict[str, Any]:
    """The scenario's data with the study's starts, one value of each parameter, and the strategy's keys."""
    data = resolve(scenario)
    if isinstance(study.start, RandomStart):
        data["fleet"]["start"] = {"charge": list(study.start.charge)}
    for key, value in [*parameters, *((f"mission.{key}", value) for key, value in strategy.mission.items())]:
        put(data, key, value, scenario.name)
    if "fleet.count" in dict(parameters):
        data["fleet"]["agent_ids"] = []
    return data


def _check_draws(study: Study, strategies: Sequence[StudiedStrategy], source: str) -> None:
    """Refuses the keys that settings and strategies decide, and those that a cell and a parameter both decide."""
    decided = {"theta", "fleet.count", "seed", *study.parameters, *itertools.chain(*study.cells.values())}
    decided |= {f"mission.{key}" for strategy in strategies for key in strategy.mission}
    if both := sorted(decided & study.draws.keys()):
        raise ScenarioError(
            [
                f"{source}: draws: {', '.join(both)}: no seed decides this: name it in parameters or strategies alone"
            ]
        )
    twice = sorted({key for cell in study.cells.values() for key in cell} & study.parameters.keys())
    if twice:
        raise ScenarioError([f"{source}: cells: {', '.join(twice)}: parameters has this, too: name it once"])


def _checked(data: dict[str, Any], study: Study, source: str, trust: registry.Trust | None) -> dict[str, Any]:
    scenario = from_data(data, source)
    check_code(scenario, source, trust)
    if scenario.apads:
        raise ScenarioError([f"{source}: {scenario.name} has several aPads: a study flies one"])
    gap = model_gap(scenario) if study.model is Model.EVENT_DRIVEN else None
    if gap is not None:
        raise ScenarioError(
            [f"{source}: {scenario.name}: the event-driven model leaves out {gap}. Say `model: mission`"]
        )
    return resolve(scenario)

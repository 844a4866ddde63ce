"""Strategies by name: the built-in ones, those of a user's file, and those that a user's package adds by entry point.

The name `FILE.py:Class` is a class of that file. A package adds a strategy with an entry point in the group
`musselbed.strategies`. In both cases the class (or a function) returns a strategy when it is called without arguments.
See docs/extending.md. Names are a user's input, so every problem with one is a ValueError of one line.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, TypeVar

from apad_bridge.planning.costs import CostScales, Scales
from apad_bridge.planning.solution import StepKind
from apad_bridge.planning.strategies.by_route import BestOfPool, Blend, Exact, ShortestOrder
from apad_bridge.planning.strategies.charge_groups import ChargeGroups
from apad_bridge.planning.strategies.on_demand import EarliestDeadline, NearestJobNext
from apad_bridge.planning.strategies.paper_strategies import Cautious, Greedy, GreedyRedeploy, NoCollection
from apad_bridge.planning.strategies.rollout import FairRollout, Rollout
from apad_bridge.planning.strategies.triage import ByLoad, Core, Triage
from apad_bridge.planning.strategy import CollectionStrategy, RedeploymentStrategy
from firmware_model.entry_points import EntryPoint, entry_points, in_one_line

GROUP = "musselbed.strategies"
Sort = TypeVar("Sort", CollectionStrategy, RedeploymentStrategy)
A_USERS_ERROR = (Exception, SystemExit)
"""The errors that a strategy of a user may raise: `sys.exit` in it would end the command without a word."""

_BUILT_IN: dict[str, type[CollectionStrategy | RedeploymentStrategy]] = {
    "best-of-pool": BestOfPool,
    "cautious": Cautious,
    "edf": EarliestDeadline,
    "greedy": Greedy,
    "greedy-redeploy": GreedyRedeploy,
    "njnp": NearestJobNext,
    "none": NoCollection,
    "shortest-order": ShortestOrder,
    "triage": Triage,
}
_SCALED: dict[str, Callable[[Scales], CollectionStrategy]] = {
    "blend": Blend,
    "by-load": ByLoad,
    "core": Core,
    "charge-groups": ChargeGroups,
    "exact": Exact,
    "rollout": Rollout,
    "rollout-fair": FairRollout,
}
"""Built-in strategies that weigh distance and energy by the scenario's scale factors."""


@dataclass(frozen=True, slots=True)
class Trust:
    """The permission to execute code of files that a scenario or a run names. Installed packages need none.

    A command gives it (`apad_bridge/commands/trust.py`) to whoever loads such code; nobody else makes one.
    """

    files: frozenset[str] | None = None
    """Absolute names of the files that may be executed; None for all."""

    def covers(self, file: str) -> bool:
        return self.files is None or os.path.abspath(file) in self.files


class NotTrusted(ValueError):
    """Code of a file was named, and not executed; the message is one line with the mend."""


class InFile(NamedTuple):
    """A strategy's name of the form `FILE.py:Class`, in its two parts."""

    path: str
    factory: str

    @classmethod
    def of(cls, name: str) -> InFile | None:
        """The parts of a name; None for the name of a built-in or a package's strategy."""
        path, colon, factory = name.rpartition(":")
        if colon and path.endswith(".py"):
            return cls(path, factory)
        return cls(name, "") if name.endswith(".py") else None

    def __str__(self) -> str:
        return f"{self.path}:{self.factory}" if self.factory else self.path


def label(name: str) -> str:
    """The name for people: that of a strategy in a file is without the file's folder."""
    in_file = InFile.of(name)
    return name if in_file is None else str(in_file._replace(path=Path(in_file.path).name))


def rule_of(name: str) -> str:
    """The rule of a built-in strategy in a sentence; empty for another one, whose code is not executed to be shown."""
    strategy = _BUILT_IN.get(name) or _SCALED.get(name)
    return "" if strategy is None else (inspect.getdoc(strategy) or "").partition("\n")[0]


def words_of_package(name: str) -> str:
    """The words ` (from PACKAGE VERSION)` for a strategy of an installed package; empty for another one."""
    return next((f" (from {it.brought_by})" for it in _entries() if it.name == name), "")


def digest_of_file(name: str) -> str | None:
    """The SHA-256 of the file that this name names; None for other strategies. OSError if the file is gone."""
    in_file = InFile.of(name)
    return None if in_file is None else hashlib.sha256(Path(in_file.path).read_bytes()).hexdigest()


def identity(name: str) -> str:
    """The name by which two rules are the same: of a strategy in a file it has the content, and not the folder."""
    digest = digest_of_file(name)
    return name if digest is None else f"{label(name)} {digest}"


def known_names() -> list[str]:
    """Returns every strategy's name, sorted, without loading the strategies of packages."""
    return sorted({*_BUILT_IN, *_SCALED, *(entry.name for entry in _entries())})


def _known_of(kind: StepKind) -> list[str]:
    """Returns the strategies that can be of this kind: a package's may be of either, for none is loaded."""
    other = {name for name, strategy in _BUILT_IN.items() if strategy.plans is not kind}
    scaled = set() if kind is StepKind.COLLECT else set(_SCALED)
    return [name for name in known_names() if name not in other | scaled]


def collection(name: str, scales: Scales | None = None, trust: Trust | None = None) -> CollectionStrategy:
    """Creates a collection strategy by name. Raises ValueError if there is none, or it cannot be used.

    `scales` are the factors of distance and energy, 1 by default, for the strategies that weigh the two. A strategy in a
    file is executed with `trust` alone.
    """
    return _create(name, CollectionStrategy, scales or CostScales(), trust)


def redeployment(name: str, trust: Trust | None = None) -> RedeploymentStrategy:
    """Creates a redeployment strategy by name. Raises ValueError if there is none, or it cannot be used.

    A strategy in a file is executed with `trust` alone.
    """
    return _create(name, RedeploymentStrategy, CostScales(), trust)


def _create(name: str, sort: type[Sort], scales: Scales, trust: Trust | None) -> Sort:
    kind = sort.plans
    if (in_file := InFile.of(name)) is not None:
        if trust is None or not trust.covers(in_file.path):
            raise NotTrusted(f"strategy {label(name)} is code in a file: add --trust if you trust it")
        source, strategy = f"strategy {label(name)}", _load_file(in_file, trust)
    else:
        source, strategy = _create_by_name(name, kind, scales)
    if lacking := _lacking(strategy, kind):
        raise ValueError(f"{source} is no {kind} strategy: it needs {' and '.join(lacking)}")
    return strategy if isinstance(strategy, sort) else _completed(strategy, sort)


def _completed(strategy: object, sort: type[Sort]) -> Sort:
    """A strategy with the members of this one, and with the defaults of its sort for those that it lacks."""
    completed = sort()
    for name in ("plan", "pre_empts", "refuses", "explain"):
        if hasattr(strategy, name):
            setattr(completed, name, getattr(strategy, name))
    return completed


def _create_by_name(name: str, kind: StepKind, scales: Scales) -> tuple[str, object]:
    """A strategy of ours or of a package, after the words that name its source."""
    entries = tuple(entry for entry in _entries() if entry.name == name)
    sources = ["musselbed itself"] * (name in _BUILT_IN or name in _SCALED) + [
        entry.brought_by for entry in entries
    ]
    if not sources:
        raise ValueError(
            f"unknown strategy {name!r}; known: {', '.join(_known_of(kind))}; one of your own is FILE.py:Class"
        )
    if len(sources) > 1:
        raise ValueError(f"strategy {name!r} is in each of {', '.join(sources)}: rename or remove one")
    return f"strategy {name!r} (from {sources[0]})", _built_in(name, scales) or _load(entries[0])


def _lacking(strategy: object, kind: StepKind) -> list[str]:
    """The members by which this object would be a strategy of the kind, and that it does not have."""
    lacking = [] if getattr(strategy, "plans", None) is kind else [f"`plans = StepKind.{kind.name}`"]
    arguments = ("situation", "batch") if kind is StepKind.COLLECT else ("situation",)
    try:
        inspect.signature(getattr(strategy, "plan", None)).bind(*arguments)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        lacking.append(f"a method `plan(self, {', '.join(arguments)})`")
    return lacking


def _load_file(in_file: InFile, _: Trust) -> object:
    path, name = Path(in_file.path), label(str(in_file))
    try:
        module = _module(path, path.read_bytes())
    except OSError as error:
        raise ValueError(f"strategy {name}: {path}: {error.strerror}") from error
    except A_USERS_ERROR as error:  # the file is a user's
        raise ValueError(f"strategy {name} cannot be loaded: {_where(error, path)}") from error
    factory = vars(module).get(in_file.factory)
    if not callable(factory):
        own = [
            it for it, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__
        ]
        near = get_close_matches(in_file.factory, own, n=1) or own[:1]
        meant = f"did you mean {path.name}:{near[0]}?" if near else "it defines no class"
        wrong = f"has no class {in_file.factory}" if in_file.factory else "names no class of its file"
        raise ValueError(f"strategy {name} {wrong}: {meant}")
    try:
        strategy: object = factory()
    except A_USERS_ERROR as error:
        raise ValueError(
            f"strategy {name} cannot be made without arguments: {_where(error, path)}"
        ) from error
    return strategy


@lru_cache(maxsize=8)
def _module(path: Path, source: bytes) -> ModuleType:
    """Executes a strategy's file with this content: once in a process, since studies ask for it in each mission."""
    module = ModuleType(f"musselbed_strategy_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(source, str(path), "exec"), vars(module))
    return module


def _where(error: BaseException, path: Path) -> str:
    """The error in one line, with the file's line that led to it."""
    if isinstance(error, SyntaxError) and error.lineno:
        return f"line {error.lineno}: {error.msg}"
    lines = [
        frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)
    ]
    where = f"line {lines[-1]}: " if lines else ""
    return f"{where}{in_one_line(error)}"


def _built_in(name: str, scales: Scales) -> object | None:
    if name in _SCALED:
        return _SCALED[name](scales)
    return _BUILT_IN[name]() if name in _BUILT_IN else None


def _entries() -> list[EntryPoint]:
    return _entries_on(tuple(sys.path))


@lru_cache(maxsize=8)
def _entries_on(path: tuple[str, ...]) -> list[EntryPoint]:
    """The entry points of the packages on this search path. A study asks for strategies in each of its missions, and
    reading the packages' metadata would take a tenth of such a mission."""
    return entry_points(GROUP)


def _load(entry: EntryPoint) -> object:
    try:
        return entry.load()()
    except A_USERS_ERROR as error:
        raise ValueError(
            f"strategy {entry.name!r} (from {entry.brought_by}, {entry.module}) cannot be loaded: {in_one_line(error)}"
        ) from error

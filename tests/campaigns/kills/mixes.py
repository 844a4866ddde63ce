"""Mixes of kills, drawn by a seed: the scenario, who gets which signal at which mission time, and when the power goes."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path
from signal import SIGINT, SIGKILL, SIGSTOP, SIGTERM, Signals
from typing import Any

import yaml

from kills.judge import Clock
from kills.machine import AGENT, NURSERY, PARENT

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"
STOPPED_S = (0.3, 3.5)
"""Wall seconds from SIGSTOP to SIGCONT: shorter than the patience of any process with another."""
FAULTS = 60
"""Faults of boards and aPad in a mix in virtual time. A mix over ROS is much shorter."""
SERVICES = ("console", "IMC gateway", "Foxglove server")
Victim = tuple[str, Signals]


@dataclass(frozen=True, slots=True)
class Act:
    """A signal for a process of this role, or for a random one of several; SIGSTOP ends after `for_s` wall seconds."""

    at_s: float
    role: str
    number: Signals
    for_s: float = 0.0

    def __str__(self) -> str:
        return f"{self.number.name} of the {self.role} at {self.at_s:.0f} s"


@dataclass(frozen=True, slots=True)
class Mix:
    scenario: dict[str, Any]
    acts: list[Act]
    crash_s: float | None
    """The mission time at which the power goes; None: never. Later acts are for the resumed run."""


@dataclass(frozen=True, slots=True)
class Row:
    like: str
    """The shipped scenario that `changes` changes."""
    changes: dict[str, Any]
    speed: float | None
    """None: virtual time, without ROS."""
    clock: Clock
    lives_on: tuple[Victim, ...]
    """Ends and stops that a run survives."""
    ends: tuple[Victim, ...]
    """Those that end it in order, or with one line."""
    resumes: bool = False
    """A person can resume it after a restart of the machine."""
    generations: tuple[str, ...] = ("a",)
    words: tuple[str, ...] = ()


def _each(*roles: str) -> tuple[Victim, ...]:
    return tuple((role, number) for role in roles for number in (SIGKILL, SIGTERM, SIGSTOP))


ALIVE = (
    *_each(AGENT, AGENT, NURSERY),
    *((it, SIGSTOP) for it in (PARENT, "supervisor", "master", "aPad")),
    ("supervisor", SIGKILL),
)
ENDS = (
    *((it, number) for it in ("master", "aPad") for number in (SIGKILL, SIGTERM)),
    *((it, number) for it in (PARENT,) for number in (SIGTERM, SIGINT)),
    ("supervisor", SIGTERM),
)
UNWATCHED = ((PARENT, SIGKILL), ("supervisor", SIGKILL))
POOL: dict[str, Any] = {
    "duration_s": 240,
    "theta": 600,
    "fleet": {"count": 8, "start": {"charge": [0.4, 0.75]}},
    "area": {"polygon_m": [[0, 0], [10, 0], [10, 6], [0, 6]]},
    "apad": {"start_m": [5, 3]},
    "mission": {"docking": {"dock_s": 3, "undock_s": 1}},
    "board": {"float_timeout_s": 432_000},
}
SOUND: dict[str, Any] = {
    "duration_s": 900,
    "fleet": {"count": 8, "start": {"charge": [0.4, 0.7]}},
    "area": {"polygon_m": [[0, 0], [14, 0], [14, 10], [0, 10]]},
    "apad": {"start_m": [7, 5]},
}
SEVERAL: dict[str, Any] = {
    "duration_s": 300,
    "theta": 120,
    "fleet": {"count": 9, "start": {"charge": [0.4, 0.8]}},
    "area": {"polygon_m": [[0, 0], [20, 0], [20, 40], [0, 40]]},
    "apad": {"start_m": [10, 6]},
    "apads": [{"name": "apad2", "start_m": [10, 20]}, {"name": "apad3", "start_m": [10, 34]}],
    "mission": {"docking": {"dock_s": 5, "undock_s": 2}},
}
VIRTUAL: tuple[Any, ...] = (
    None,
    "virtual",
    (*_each(AGENT, AGENT, NURSERY), (PARENT, SIGSTOP)),
    ((PARENT, SIGTERM), (PARENT, SIGINT)),
)
ROWS = {
    # Over ROS, with all that serves people beside it.
    "pool": Row(
        "pool-12",
        POOL,
        8.0,
        "own",
        (*ALIVE, (PARENT, SIGKILL), *_each(*SERVICES)),
        ENDS,
        resumes=True,
        generations=("a", "b"),
        words=("--console", "--imc", "--foxglove", "8765", "--on-supervisor-death", "resume"),
    ),
    # Over ROS, whole boards that speak through the water.
    "sound": Row(
        "sound-12",
        SOUND,
        30.0,
        "own",
        (*ALIVE, (PARENT, SIGKILL), *_each("console")),
        ENDS,
        resumes=True,
        generations=("a", "b"),
        words=("--console", "--on-supervisor-death", "resume"),
    ),
    # Three aPads that follow one clock, each with a share of the fleet.
    "several": Row(
        "bay-120",
        SEVERAL,
        10.0,
        "followed",
        (*ALIVE, ("clock", SIGSTOP), ("aPad", SIGKILL)),
        (*_each("clock")[:2], *_each("master")[:2], (PARENT, SIGTERM)),
    ),
    # The same with a sea that they share.
    "several by sound": Row(
        "sound-12",
        SEVERAL | {"theta": 30},
        10.0,
        "followed",
        (*ALIVE, *((it, SIGSTOP) for it in ("sea", "clock")), ("aPad", SIGKILL)),
        (*_each("sea")[:2], *_each("clock")[:2], *_each("master")[:2], (PARENT, SIGTERM)),
    ),
    # Without ROS, as fast as it goes, with faults of boards and aPad.
    "virtual": Row("pool-12", {"duration_s": 14_400, "apad": {"battery": {"capacity_wh": 10_000}}}, *VIRTUAL),
    "virtual by sound": Row("sound-12", {"duration_s": 14_400}, *VIRTUAL),
}


def drawn(name: str, generation: str, seed: str) -> Mix:
    """The mix of a try. A third of the runs is ended before its time.

    The power goes once in each run that can be resumed, and in a third of the others.
    """
    rng, row = random.Random(seed), ROWS[name]
    scenario = _scenario(row, generation, rng)
    whole_s = float(scenario["duration_s"])
    crash_s = rng.uniform(0.4, 0.65) * whole_s if row.resumes or rng.random() < 1 / 3 else None
    acts = _acts(rng, row.lives_on, 0.05 * whole_s, 0.95 * (crash_s or 0.85 * whole_s), rng.randint(3, 6))
    if crash_s is not None and row.resumes:
        # A resumed run has nothing beside it, and nobody starts another supervisor.
        left = tuple(it for it in row.lives_on if it[0] not in SERVICES and it not in UNWATCHED)
        acts += _acts(rng, left, crash_s + 0.05 * whole_s, 0.85 * whole_s, rng.randint(1, 4))
    if (crash_s is None or row.resumes) and rng.random() < 1 / 3:
        acts.append(Act(rng.uniform(0.86, 0.93) * whole_s, *rng.choice(row.ends)))
    return Mix(scenario, acts, crash_s)


def _scenario(row: Row, generation: str, rng: random.Random) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load((SCENARIOS / f"{row.like}.yaml").read_text())
    _merge(data, row.changes)
    data["seed"] = rng.randrange(1, 1 << 20)
    if row.speed is not None and not data.get("apads"):
        data["apad"]["generation"] = generation
    ids, kind = range(1, data["fleet"]["count"] + 1), rng.random()
    if row.speed is None or kind < 0.3:
        count = FAULTS if row.speed is None else FAULTS // 5
        data["faults"] = {"mix": {"seed": rng.randrange(1, 1 << 20), "count": count}}
    elif kind < 0.5:
        # A loss of charge is under way in each tick, whenever the supervisor is killed.
        leak = {"fault": "battery_ageing", "at_s": 5, "for_s": data["duration_s"]}
        data["faults"] = {"at": [leak | {"id": it} for it in ids]}
    if isinstance(data["fleet"]["start"], str):
        data["fleet"]["start"] = {"charge": [0.4, 0.9]}
    return data


def _merge(data: dict[str, Any], changes: dict[str, Any]) -> None:
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(data.get(key), dict):
            _merge(data[key], value)
        else:
            data[key] = value


def _acts(
    rng: random.Random, victims: tuple[Victim, ...], from_s: float, until_s: float, count: int
) -> list[Act]:
    """So many acts in the order of time. The parent's kill comes last: without it nobody starts another supervisor."""
    chosen = [rng.choice(victims) for _ in range(count)]
    chosen.sort(key=lambda it: it == (PARENT, SIGKILL))
    while chosen.count((PARENT, SIGKILL)) > 1:
        chosen.pop()
    times = sorted(rng.uniform(from_s, until_s) for _ in chosen)
    return [
        Act(at_s, role, number, rng.uniform(*STOPPED_S) if number is SIGSTOP else 0.0)
        for at_s, (role, number) in zip(times, chosen, strict=True)
    ]

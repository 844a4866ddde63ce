"""A small script of timed stimuli for one board, and the energy budget of its run."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import field, replace
from functools import partial
from math import fsum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Le
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from agents.water.bounds import NotNegative
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.quantities import Fraction, Positive
from apad_bridge.scenario.text.key_mistakes import abbreviated, explain
from apad_bridge.scenario.text.yaml_text import yaml_of
from firmware_model.actions import Dropped, LogSample
from firmware_model.bench import Bench
from firmware_model.bench.rigs import COMMANDS
from firmware_model.config import BoardConfig, LastResort
from firmware_model.packets import Beacon
from firmware_model.power.ageing import aged, capacity_left
from firmware_model.power.charge import fraction, grains
from firmware_model.power.rails import Rail, bits
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import CYCLES, METERING, board, power

_FACTS: dict[str, Callable[[Bench], object]] = {
    **{word: partial(Bench.command, kind=kind) for word, kind in COMMANDS.items()},
    "beacon": lambda bench: bench.hear(Beacon(bench.config.agent_id, bench.now_ms)),
    "charge_pin_rises": Bench.charge_pin_rises,
    "charge_pin_falls": Bench.charge_pin_falls,
    "brown_out": lambda bench: bench.reset(ResetCause.BROWN_OUT),
    "watchdog": lambda bench: bench.reset(ResetCause.WATCHDOG),
}
if TYPE_CHECKING:
    BoardFact = str
else:
    BoardFact = Literal[tuple(_FACTS)]
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class MuScript:
    """Hours are agent time from power-on; charges are the paper's scaled voltage."""

    hours: Annotated[float, Ge(1e-6), Le(1e6)]
    sleep: Literal["never", "hourly", "field"]
    """`never`; `hourly`: Table I's 10 s an hour; `field`: Fig. 4's wakes of several minutes."""
    primary: Fraction
    secondary: Fraction
    last_resort: Literal["wait", "call", "surface"] = "wait"
    kept_on: tuple[str, ...] = ()
    """Names of rails that are never switched off."""
    capacity_mwh: Positive | None = None
    """The capacity of each battery; without it energy is printed as a fraction of one battery."""
    metered: bool = False
    """The board takes levels from readings, which sag under load and rise with a charger, instead of from the charge."""
    low_level: Fraction = 0.0
    """The level at which a sleeping board wakes; 0 for no such level."""
    cycles: Annotated[int, Ge(0), Le(1_000_000)] = 0
    """The number of full charge cycles of the batteries so far."""
    years: NotNegative = 0.0
    """The age of the batteries."""
    secondary_use: Literal["backup", "in_use"] = "backup"
    """`in_use`: the board works on its secondary, too, when its primary is empty."""
    clock_drift_ppm: Annotated[float, Ge(-1000), Le(1000)] = 0.0
    """The gain of the board's clock; a beacon sets the clock."""
    tell: tuple[tuple[NotNegative, BoardFact], ...] = field(default=())
    """(hours, stimulus), in any order."""

    def __post_init__(self) -> None:
        capacity_left(self.cycles, self.years)
        if unknown := [name for name in self.kept_on if name.upper() not in Rail.__members__]:
            raise ValueError(
                f"kept_on: no rail is called {unknown[0]!r}; there are {', '.join(Rail.__members__).lower()}"
            )


@dataclass(frozen=True)
class Budget:
    """The energy budget of a run; energies are fractions of one battery."""

    hours: float
    capacity_mwh: float | None
    by_rail: dict[str, float]
    by_state: dict[str, float]
    state_hours: dict[str, float]
    state: str
    primary: float
    secondary: float
    samples: int
    dropped: int
    life_hours: float | None
    """The life of a full primary at the mean rate of this run; None when nothing was drawn."""
    life_samples: int | None
    """The number of samples in that life; None likewise."""
    lives: float
    """The lives of the board with both batteries full: 1 where the secondary is a backup, else up to 2."""


def read_script(path: Path) -> MuScript:
    """Reads a script from a YAML file; UserError, one line, names every fault and its key."""
    data = yaml_of(path)
    if not isinstance(data, dict):
        raise UserError(f"{path}: a script is a mapping of keys to values, not {abbreviated(data)}")
    try:
        # JSON on the way, as for a scenario: the strict mode takes no text for a number.
        return TypeAdapter(MuScript).validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        faults = dict.fromkeys(explain(MuScript, it, it["loc"]) for it in error.errors())
        raise UserError(f"{path}: " + "; ".join(faults)) from None


def config_of(script: MuScript) -> BoardConfig:
    kept_on = bits(*(Rail[name.upper()] for name in set(script.kept_on)))
    metering = METERING if script.metered else None
    power_config = power(
        LastResort[script.last_resort.upper()],
        kept_on,
        metering,
        grains(script.low_level),
        script.secondary_use == "in_use",
    )
    config = replace(
        board(CYCLES[script.sleep], power_config), drift_ppb=round(script.clock_drift_ppm * 1000)
    )
    return aged(config, capacity_left(script.cycles, script.years))


def play(script: MuScript) -> Bench:
    """Runs the script from power-on on the bottom. Stimuli after the end are left out."""
    bench = Bench(config_of(script), primary=script.primary, secondary=script.secondary)
    end_ms = round(script.hours * 3_600_000)
    for hours, fact in sorted(script.tell, key=lambda it: it[0]):
        if (at_ms := round(hours * 3_600_000)) <= end_ms:
            bench.run_until(at_ms)
            _FACTS[fact](bench)
    bench.run_until(end_ms)
    return bench


def budget_of(script: MuScript, bench: Bench) -> Budget:
    """The budget of a board after its script was played."""
    assert bench.ledger is not None
    bench.ledger.settle(bench.now_ms)
    by_rail = {rail.name: fraction(drawn) for rail, drawn in bench.ledger.by_rail().items()}
    drawn = fsum(by_rail.values())
    samples = len(bench.did(LogSample))
    return Budget(
        hours=script.hours,
        capacity_mwh=script.capacity_mwh,
        by_rail=by_rail,
        by_state={state.name: fraction(drawn) for state, drawn in bench.ledger.by_state().items()},
        state_hours={state.name: ms / 3_600_000 for state, ms in bench.ledger.state_ms().items() if ms},
        state=bench.state.name,
        primary=bench.primary_fraction,
        secondary=bench.secondary_fraction,
        samples=samples,
        dropped=len(bench.did(Dropped)),
        life_hours=script.hours / drawn if drawn else None,
        life_samples=int(samples / drawn) if drawn else None,
        lives=_lives(script, bench.config),
    )


def _lives(script: MuScript, config: BoardConfig) -> float:
    """A secondary in use is drawn down to the safe level of a last resort, or to its end without one."""
    if script.secondary_use == "backup":
        return 1.0
    assert config.whole is not None
    power_config = config.whole.power
    reserve = 0 if power_config.last_resort is LastResort.WAIT else power_config.safe_level
    return 2 - fraction(reserve)

"""The table of faults that a run can have for a time, and a scenario's list of them.

The scenario, the service /musselbed/inject_fault and the console take the same rows.
`apad_bridge/world/fault_injection.py` carries them out.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Le

from agents.mussel.board_parts import BoardPart
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    ClockShifted,
    CoilSlipped,
    ContactBounced,
    CrystalSkewed,
    PartFailed,
    WasReset,
)
from apad_bridge.scenario.quantities import (
    AgentId,
    NotNegativeSeconds,
    PositiveSeconds,
    Quantity,
    frozen,
)
from firmware_model.power.charge import grains
from firmware_model.stimuli import ResetCause

LONGEST_S = 1e6
_BURSTS = (1, 2, 3, 4, 5, 6)
_APART_S = (0, 1, 5)


class TimedFault(StrEnum):
    """A fault of a simulated aMussel, of its process or its link, or of a simulated aPad as the supervisor meets it."""

    BROWN_OUT = "brown_out"
    WATCHDOG = "watchdog"
    KILLED = "killed"
    STOPPED = "stopped"
    MEMORY_LIMIT = "memory_limit"
    LINK_CUT = "link_cut"
    LINK_DELAY = "link_delay"
    BIT_FLIP = "bit_flip"
    MODEM_DEAF = "modem_deaf"
    CLOCK_SKEW = "clock_skew"
    CLOCK_JUMP = "clock_jump"
    BATTERY_AGEING = "battery_ageing"
    BATTERY_LOSS = "battery_loss"
    BUOYANCY_STUCK = "buoyancy_stuck"
    COIL_SLIP = "coil_slip"
    EDGE_FALSE = "edge_false"
    EDGE_MISSED = "edge_missed"
    EDGE_CHATTER = "edge_chatter"
    BUS_SILENT = "bus_silent"
    READINGS_SCATTER = "readings_scatter"
    READINGS_STAND = "readings_stand"
    DEPTH_STANDS = "depth_stands"
    UART_OVERRUN = "uart_overrun"
    WRITE_TORN = "write_torn"
    FLASH_WORN = "flash_worn"
    FLASH_SILENT = "flash_silent"
    WRITE_BROWN_OUT = "write_brown_out"
    APAD_FROZEN = "apad_frozen"
    APAD_LIES = "apad_lies"
    DOCK_JAMMED = "dock_jammed"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fault's value: its name, its unit, the default, and the least and the greatest."""

    name: str
    unit: str
    default: float
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class FaultRow:
    """A row of the table. `healing` says how it ends; `span_s` 0 is a fault that is over at once."""

    does: str
    healing: str
    span_s: float = 0.0
    """The default, in seconds of mission time."""
    parameter: Parameter | None = None
    is_of_apad: bool = False
    needs_dock: bool = False
    """Only an aMussel in a dock can have it."""
    needs_process: bool = False
    """Only an aMussel with a process of its own can have it."""
    begins: Callable[[float], AgentStimulus] | None = None
    """The stimulus that begins it, by its value; None for a fault that is none of a body."""
    heals: AgentStimulus | None = None
    """The stimulus that ends it; None for a fault that heals by itself."""


def _of_part(
    part: BoardPart,
    does: str,
    healing: str,
    span_s: float = 60.0,
    parameter: Parameter | None = None,
    value: Callable[[float], int] = round,
) -> FaultRow:
    """A part of the board fails; without a parameter its value is 1."""
    return FaultRow(
        does,
        healing,
        span_s,
        parameter,
        begins=lambda given: PartFailed(part, 1 if parameter is None else value(given)),
        heals=PartFailed(part, 0),
    )


_F = TimedFault
TABLE: Mapping[TimedFault, FaultRow] = {
    _F.BROWN_OUT: FaultRow(
        "a brown-out resets the MU", "the board boots again", begins=lambda _: WasReset(ResetCause.BROWN_OUT)
    ),
    _F.WATCHDOG: FaultRow(
        "the watchdog resets the MU", "the board boots again", begins=lambda _: WasReset(ResetCause.WATCHDOG)
    ),
    _F.KILLED: FaultRow("kill -9 of the aMussel's process", "the nursery starts it again"),
    _F.STOPPED: FaultRow(
        "SIGSTOP of the process",
        "after 2 s without an answer it is ended and started again",
        needs_process=True,
    ),
    _F.MEMORY_LIMIT: FaultRow(
        "the process may have no more address space",
        "the limit is lifted; a process that ended is started again without it",
        60.0,
        Parameter("limit", "MB", 1.0, 1.0, 1e6),
        needs_process=True,
    ),
    _F.LINK_CUT: FaultRow("no packet passes, neither way", "packets pass again", 60.0),
    _F.LINK_DELAY: FaultRow(
        "each packet passes later, both ways",
        "late packets still arrive",
        60.0,
        Parameter("delay", "s", 5.0, 0.001, 3600.0),
    ),
    _F.BIT_FLIP: FaultRow(
        "bits of packets flip, both ways",
        "packets pass whole",
        60.0,
        Parameter("probability", "each bit", 0.01, 0.0, 1.0),
    ),
    _F.MODEM_DEAF: FaultRow("the acoustic modem receives nothing; it still sends", "it receives again", 60.0),
    _F.CLOCK_SKEW: FaultRow(
        "the MU's clock runs faster, or slower if negative",
        "the crystal runs as before; a beacon sets the clock",
        600.0,
        Parameter("skew", "ppm", 1000.0, -1e5, 1e5),
        begins=lambda ppm: CrystalSkewed(round(1000 * ppm)),
        heals=CrystalSkewed(0),
    ),
    _F.CLOCK_JUMP: FaultRow(
        "the MU's clock jumps",
        "a beacon sets the clock",
        parameter=Parameter("jump", "agent s", 60.0, -86400.0, 86400.0),
        begins=lambda shift_s: ClockShifted(round(1000 * shift_s)),
    ),
    _F.BATTERY_AGEING: FaultRow(
        "an old battery leaks",
        "the leak ends; the charge stays lost",
        600.0,
        Parameter("leak", "of the primary, a mission minute", 0.01, 0.0, 1.0),
    ),
    _F.BATTERY_LOSS: FaultRow(
        "the primary battery loses charge at once",
        "an aPad charges it",
        parameter=Parameter("loss", "of the primary", 0.2, 0.0, 1.0),
        begins=lambda charge: ChargeLost(grains(charge), 0),
    ),
    _F.BUOYANCY_STUCK: FaultRow(
        "motor runs do not move the buoyancy",
        "the last motor run is carried out",
        60.0,
        begins=lambda _: BuoyancyJammed(1),
        heals=BuoyancyJammed(0),
    ),
    _F.COIL_SLIP: FaultRow(
        "the coils slip apart", "they align again", needs_dock=True, begins=lambda _: CoilSlipped()
    ),
    _F.EDGE_FALSE: FaultRow(
        "the charger's pin shows the opposite level", "the pin shows the true level again", 1.0
    ),
    _F.EDGE_MISSED: FaultRow(
        "edges of the charger's pin cause no interrupt",
        "edges count again; the board samples the level",
        60.0,
    ),
    _F.EDGE_CHATTER: FaultRow(
        "the contact in the dock bounces",
        "the contact holds after the last edge, or the dock opens",
        parameter=Parameter("openings", "20 ms of agent time each", 50.0, 1.0, 10_000.0),
        needs_dock=True,
        begins=lambda times: ContactBounced(round(times)),
    ),
    _F.BUS_SILENT: _of_part(
        BoardPart.BUS,
        "the sensors do not answer on their bus (NACK)",
        "they answer again; samples meanwhile repeat the last counts",
    ),
    _F.READINGS_SCATTER: _of_part(
        BoardPart.CONVERTER,
        "the converter's readings of the batteries have noise",
        "they are exact again",
        60.0,
        Parameter("amplitude", "of a battery, either way", 0.05, 0.0, 1.0),
        value=grains,
    ),
    _F.READINGS_STAND: _of_part(
        BoardPart.HOLD,
        "the converter stands: its readings of the batteries stay as they are",
        "they follow the batteries again; a reset reads them once",
    ),
    _F.DEPTH_STANDS: _of_part(
        BoardPart.DEPTH,
        "the pressure sensor stands: the board notices neither the surface nor the bottom",
        "it shows where the aMussel is by then; a reset reads it once",
    ),
    _F.UART_OVERRUN: _of_part(
        BoardPart.UARTS,
        "the board's UARTs overrun: each packet to it loses its end",
        "packets arrive whole",
        60.0,
        Parameter("kept", "bytes", 4.0, 1.0, 1000.0),
    ),
    _F.WRITE_TORN: _of_part(
        BoardPart.WRITES,
        "each write to the flash ends in its middle",
        "writes are whole; the torn records stay unreadable",
        60.0,
        Parameter("written", "bytes", 10.0, 1.0, 4096.0),
    ),
    _F.FLASH_WORN: _of_part(
        BoardPart.CELLS,
        "worn cells of the flash stay erased",
        "writes are whole; the spoilt records stay unreadable",
        60.0,
        Parameter("bits", "mask of each byte", 16.0, 1.0, 255.0),
    ),
    _F.FLASH_SILENT: _of_part(
        BoardPart.FLASH,
        "the flash does not answer: it reads as erased, and nothing is written or erased",
        "it answers again; the records of the time between are missing",
    ),
    _F.WRITE_BROWN_OUT: _of_part(
        BoardPart.SUPPLY,
        "a brown-out resets the MU in the middle of its next write to the flash",
        "the board boots again, and counts the torn record; if it wrote nothing, nothing happens",
        600.0,
        Parameter("written", "bytes", 10.0, 1.0, 4096.0),
    ),
    _F.APAD_FROZEN: FaultRow(
        "the aPad's computer reports nothing and takes no order; it goes on with the last one",
        "its reports come, and it takes the orders",
        20.0,
        is_of_apad=True,
    ),
    _F.APAD_LIES: FaultRow(
        "the aPad reports a place north of the true one",
        "it reports the true place",
        30.0,
        Parameter("error", "m", 5.0, -1000.0, 1000.0),
        is_of_apad=True,
    ),
    _F.DOCK_JAMMED: FaultRow(
        "a dock neither closes nor opens: its orders fail",
        "it moves again",
        60.0,
        Parameter("dock", "index from 0", 0.0, 0.0, 15.0),
        is_of_apad=True,
    ),
}


@dataclass(frozen=True, slots=True)
class Injection:
    """A fault with everything that its row left to choose. `agent_id` is None for a fault of the aPad."""

    fault: TimedFault
    agent_id: int | None
    value: float
    span_ms: int

    @property
    def row(self) -> FaultRow:
        return TABLE[self.fault]


def injection(
    fault: TimedFault, agent_id: int | None, value: float | None = None, for_s: float | None = None
) -> Injection:
    """The row's defaults for what is None. ValueError, one line, for what its row does not allow."""
    row = TABLE[fault]
    if row.is_of_apad != (agent_id is None):
        raise ValueError(
            f"{fault} is a fault of the aPad: leave id out"
            if row.is_of_apad
            else f"{fault} needs the aMussel's id"
        )
    if row.parameter is None and value is not None:
        raise ValueError(f"{fault} has no value")
    if (
        row.parameter is not None
        and value is not None
        and not row.parameter.least <= value <= row.parameter.most
    ):
        it = row.parameter
        raise ValueError(f"{fault}: {it.name} is {it.least:g} to {it.most:g} ({it.unit}), not {value:g}")
    if row.span_s == 0 and for_s is not None:
        raise ValueError(f"{fault} is over at once: leave for_s out")
    if for_s is not None and not 0 < for_s <= LONGEST_S:
        raise ValueError(f"for_s is above 0 s and up to {LONGEST_S:g} s, not {for_s:g}")
    default = 0.0 if row.parameter is None else row.parameter.default
    return Injection(
        fault,
        agent_id,
        default if value is None else value,
        round(1000 * (row.span_s if for_s is None else for_s)),
    )


@frozen
class FaultAt:
    """A fault at a time of the mission; what is None has the table's default."""

    fault: TimedFault
    """A row of the table of faults: docs/reference/faults.md."""
    at_s: NotNegativeSeconds
    """Its begin."""
    id: AgentId | None = None
    """The aMussel; None for a fault of the aPad."""
    value: Quantity | None = None
    """In the unit of its row; None: that of its row."""
    for_s: PositiveSeconds | None = None
    """Its length; None: that of its row. A fault that is over at once has none."""

    def __post_init__(self) -> None:
        injection(self.fault, self.id, self.value, self.for_s)

    @property
    def injection(self) -> Injection:
        return injection(self.fault, self.id, self.value, self.for_s)


@frozen
class FaultMix:
    """A seeded mix of faults in bursts, over the whole mission."""

    seed: Annotated[int, Ge(0), Le(2**63 - 1)]
    """Decides which faults come when; the same ones for the same seed."""
    count: Annotated[int, Ge(1), Le(10_000)]
    """The number of faults."""
    of: tuple[TimedFault, ...] = ()
    """The faults to choose from; empty for all."""


@frozen
class Faults:
    """The faults of a run, beside those that somebody causes in it."""

    at: tuple[FaultAt, ...] = ()
    """The faults, each with its time."""
    mix: FaultMix | None = None
    """A seeded mix of faults over the whole mission."""


def planned(
    faults: Faults, ids: Sequence[int], duration_s: float, *, processes: bool
) -> list[tuple[int, Injection]]:
    """The faults by their time (mission ms). Without `processes`, the mix has none that needs an aMussel's own process."""
    found = [(round(1000 * it.at_s), it.injection) for it in faults.at]
    if faults.mix is not None:
        of = [it for it in faults.mix.of or tuple(TimedFault) if processes or not TABLE[it].needs_process]
        found += mixed(faults.mix.seed, faults.mix.count, of, ids, duration_s)
    return sorted(found, key=lambda it: it[0])


def mixed(
    seed: int, count: int, of: Collection[TimedFault], ids: Sequence[int], duration_s: float
) -> Iterator[tuple[int, Injection]]:
    """`count` faults in bursts: several of one aMussel in a row, or of several within a tick; their defaults else."""
    kinds = sorted(it for it in of if ids or TABLE[it].is_of_apad)
    rng, last_s, done = random.Random(f"faults {seed}"), max(0, int(duration_s) - 1), 0
    while kinds and done < count:
        at_s, agent_id = rng.randint(0, last_s), rng.choice(ids or [0])
        for _ in range(min(rng.choice(_BURSTS), count - done)):
            fault = rng.choice(kinds)
            yield 1000 * min(at_s, last_s), injection(fault, None if TABLE[fault].is_of_apad else agent_id)
            done += 1
            at_s += rng.choice(_APART_S)
            agent_id = rng.choice((agent_id, *ids) if ids else (0,))

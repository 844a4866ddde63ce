"""A fleet's configuration, which its agents share, and an agent's initial state. Plain values that cross a link."""

from __future__ import annotations

from _blake2 import blake2b
from dataclasses import asdict, dataclass
from struct import Struct
from typing import Any

from agents.mussel.agent import AgentConfig
from agents.mussel.body import WaterConfig
from agents.mussel.physical import Physical
from agents.mussel.reporter import Modem
from agents.water.fields import Fields
from agents.water.patches import OXYGEN, TEMPERATURE, TURBIDITY, Waters
from agents.water.stream import STILL, Stream, Tide, parse_stream
from firmware_model.actions import Buoyancy
from firmware_model.config import (
    BoardConfig,
    Cycle,
    FullFirmware,
    LastResort,
    Metering,
    Power,
    Timekeeping,
    Timeslots,
)
from firmware_model.power.charge import Battery, ChargeModel, Flow, grains
from firmware_model.power.rails import Loads
from firmware_model.sampling.flash import PAGES

_KEY = Struct("<QQ").pack


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """Shared by all agents. Durations `_ms` are agent time."""

    theta: int
    seed: int
    codec: str
    charge: ChargeModel
    pin_debounce_ms: int
    boot_ms: int
    float_timeout_ms: int
    release_wait_ms: int
    report_period_ms: int
    heard_always: bool
    bottom_um: int
    surfacing_ms: int
    sinking_ms: int
    drifts_always: bool
    drift_amplitude_um: int
    current_csv: str | None
    """The text of the current vector field's file; None for still water."""
    whole: FullFirmware | None = None
    """The full firmware with sleep, rails and two batteries; None is the paper's worst case."""
    first_id: int = 1
    """The aMussel with the first acoustic timeslot; the others follow by their ids."""
    coil_alignment_ms: int = 0
    """The time from a contact until the charger starts."""
    clock_drift_ppb: int = 0
    """The largest drift of a whole board's clock, either way, in parts of 10^9; each clock has a drift of its own."""
    tides: tuple[tuple[int, int, int, int, int], ...] = ()
    """The fields of a `Tide`, in their order, for each constituent."""
    current_profile: tuple[tuple[int, int], ...] = ()
    """(depth in um, the share of the current that is left there, in millionths)."""
    pin_chatter_ms: int = 2000
    pin_check_ms: int = 60_000
    oxygen_mg_l: Waters = OXYGEN
    temperature_c: Waters = TEMPERATURE
    turbidity_ntu: Waters = TURBIDITY
    """The water's true values."""
    modem: Modem = Modem.V3
    flash_pages: int = PAGES
    """Flash pages of `firmware_model.sampling.flash.PAGE_BYTES` each, for the log of one aMussel."""

    def to_wire(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_wire(cls, wire: dict[str, Any]) -> FleetConfig:
        """The inverse of `to_wire`; KeyError, TypeError or ValueError for anything else."""
        whole = wire["whole"]
        return cls(
            **{
                **wire,
                "charge": _charge_of(wire["charge"]),
                "modem": Modem(wire["modem"]),
                "whole": None if whole is None else _whole_of(whole),
                **{
                    name: _waters_of(wire[name]) for name in ("oxygen_mg_l", "temperature_c", "turbidity_ntu")
                },
                "tides": tuple([tuple(it) for it in wire["tides"]]),
                "current_profile": tuple([tuple(it) for it in wire["current_profile"]]),
            }
        )

    def maker(self) -> AgentConfigs:
        return AgentConfigs(self)


def _charge_of(wire: dict[str, Any]) -> ChargeModel:
    one, two = (tuple((end, rate) for end, rate in wire[key]) for key in ("segments", "segments_by_two"))
    return ChargeModel(**{**wire, "segments": one, "segments_by_two": two})


def _whole_of(wire: dict[str, Any]) -> FullFirmware:
    cycle, timekeeping = wire["cycle"], wire["timekeeping"]
    return FullFirmware(
        **{
            **wire,
            "power": _power_of(wire["power"]),
            "cycle": None if cycle is None else _cycle_of(cycle),
            "timekeeping": None if timekeeping is None else Timekeeping(**timekeeping),
        }
    )


def _power_of(wire: dict[str, Any]) -> Power:
    metering = wire["metering"]
    return Power(
        **{
            **wire,
            "loads": Loads(tuple(wire["loads"]["of"])),
            "last_resort": LastResort(wire["last_resort"]),
            "metering": None if metering is None else Metering(**metering),
        }
    )


def _cycle_of(wire: dict[str, Any]) -> Cycle:
    slots = wire["slots"]
    return Cycle(**{**wire, "slots": None if slots is None else Timeslots(**slots)})


def _waters_of(wire: dict[str, Any]) -> Waters:
    layers, patches = (tuple([tuple(it) for it in wire[key]]) for key in ("layers", "patches"))
    return Waters(layers, patches)


def _stream(fleet: FleetConfig) -> Stream:
    stream = STILL if fleet.current_csv is None else parse_stream(fleet.current_csv)
    tides = tuple([Tide(*it) for it in fleet.tides])
    return Stream.of(stream.seconds, stream.depths_um, stream.fields, tides, fleet.current_profile)


class AgentConfigs:
    """Makes agents' configurations, which share their equal parts, so that forked agents share the memory too."""

    def __init__(self, fleet: FleetConfig) -> None:
        self._fleet = fleet
        cycle = None if fleet.whole is None else fleet.whole.cycle
        self._has_slots = cycle is not None and cycle.slots is not None
        self._water = WaterConfig(
            seed=fleet.seed,
            step_ms=1000 * fleet.theta,
            bottom_um=fleet.bottom_um,
            surfacing_ms=fleet.surfacing_ms,
            sinking_ms=fleet.sinking_ms,
            drifts_always=fleet.drifts_always,
            amplitude_um=fleet.drift_amplitude_um,
            current=_stream(fleet),
            coil_alignment_ms=fleet.coil_alignment_ms,
            fields=Fields(
                fleet.oxygen_mg_l.field(), fleet.temperature_c.field(), fleet.turbidity_ntu.field()
            ),
        )

    def config(self, agent_id: int) -> AgentConfig:
        fleet = self._fleet
        board = BoardConfig(
            agent_id,
            fleet.charge,
            fleet.pin_debounce_ms,
            fleet.boot_ms,
            fleet.float_timeout_ms,
            fleet.release_wait_ms,
            fleet.whole,
            agent_id - fleet.first_id if self._has_slots else 0,
            fleet.pin_chatter_ms,
            fleet.pin_check_ms,
            drift_ppb=drift_of(fleet.seed, agent_id, fleet.clock_drift_ppb),
        )
        return AgentConfig(board, self._water, fleet.report_period_ms, fleet.heard_always, fleet.modem)


def drift_of(seed: int, agent_id: int, bound_ppb: int) -> int:
    """The drift of one aMussel's clock, since no two crystals are alike: a keyed hash of (seed, agent id).

    Uniform on the integers of [-bound_ppb, +bound_ppb].
    """
    word = int.from_bytes(blake2b(_KEY(seed, agent_id), digest_size=8, person=b"crystal").digest(), "little")
    return (word * (2 * bound_ppb + 1) >> 64) - bound_ppb


def resting_on_bottom(
    north_m: float, east_m: float, depth_m: float, primary: float, secondary: float
) -> Physical:
    """A new aMussel at agent time 0, its primary battery in use."""
    return Physical(
        primary=Battery(0, grains(primary), Flow.DISCHARGING),
        secondary=Battery(0, grains(secondary), Flow.RESTING),
        north_um=round(north_m * 1e6),
        east_um=round(east_m * 1e6),
        depth_anchor_ms=0,
        depth_um=round(depth_m * 1e6),
        buoyancy=Buoyancy.SINK,
        docked=False,
    )

"""A fleet's configuration, which its agents share, and an agent's initial state. Plain values that cross a link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from struct import Struct

from agents.mussel.agent import AgentConfig
from agents.mussel.body import BodyConfig, WaterConfig
from agents.mussel.physical import Physical
from agents.mussel.reporter import ReportConfig
from agents.time_scale import TICK_MS, TimeScale
from agents.water.fields import WaterFields
from agents.water.packet_draws import fates
from agents.water.patches import CALM, QuantityWater
from agents.water.water_current import STILL_CURRENT, CurrentConfig
from firmware_model.actions import Buoyancy
from firmware_model.config import BoardConfig, timeslots_of
from firmware_model.keyed_hash import blake2b
from firmware_model.power.ageing import AS_NEW, rescaled
from firmware_model.power.charge import Battery, ChargeModel, Flow, grains
from firmware_model.sampling.flash import PAGES

_KEY = Struct("<QQ").pack
_MOST_DEVIATIONS = 3.0
"""A draw from a spread lies no farther off, so that no battery is left without a capacity."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Spread of boards' drains and battery capacities about the nominal: standard deviations in 1/10000.

    All boards alike drain by `drain_bias` / 10000 more than the nominal.

    The draws are a keyed hash of (seed, agent id): normal, and cut at three deviations.
    """

    drain: int = 0
    capacity: int = 0
    drain_bias: int = 0

    def applied(self, board: BoardConfig, seed: int) -> BoardConfig:
        """This board's own configuration; the very same object without a spread."""
        if not (self.drain or self.capacity or self.drain_bias):
            return board
        drain = AS_NEW + round(self.drain * deviations_of(seed, board.agent_id, b"drain"))
        drain = drain * (AS_NEW + self.drain_bias) // AS_NEW
        capacity = AS_NEW + round(self.capacity * deviations_of(seed, board.agent_id, b"capacity"))
        return rescaled(board, drain, capacity)

    def charge_model(self, nominal: ChargeModel, seed: int, agent_id: int) -> ChargeModel:
        """The charge model of this aMussel's batteries."""
        return self.applied(BoardConfig(agent_id, nominal, 0, 0, 0, 0), seed).charge


def deviations_of(seed: int, agent_id: int, of: bytes) -> float:
    """Deviation of an aMussel from the nominal in the quantity named `of` (16 bytes at most), in standard deviations."""
    return max(-_MOST_DEVIATIONS, min(_MOST_DEVIATIONS, fates(seed, agent_id, 0, 0, of)[2]))


@dataclass(frozen=True, slots=True)
class FirmwareConfig:
    """Somebody's firmware on the boards of these ids."""

    command: tuple[str, ...]
    """An executable and its arguments, or `serial:DEVICE`."""
    agent_ids: tuple[int, ...] = ()
    """Empty for all aMussels that no other firmware names."""


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """Shared by all agents. Durations `_ms` are agent time."""

    theta: int
    seed: int
    codec: str
    board: BoardConfig
    """The board of every aMussel; its id, timeslot and clock's drift are 0 here, and each aMussel has its own."""
    body: BodyConfig
    reports: ReportConfig
    current: CurrentConfig = STILL_CURRENT
    first_id: int = 1
    """The aMussel with the first acoustic timeslot; the others follow by their ids."""
    agent_ids: tuple[int, ...] = ()
    """All aMussels' ids, rising, where they have gaps. Empty for none."""
    clock_drift_ppb: int = 0
    """The largest drift of a whole board's clock, either way, in parts of 10^9; each clock has a drift of its own."""
    waters: Mapping[str, QuantityWater] = field(default_factory=lambda: CALM)
    """The water's true values, by the sensors' keys: each quantity that does not follow from the depth."""
    flash_pages: int = PAGES
    """Flash pages of `firmware_model.sampling.flash.PAGE_BYTES` each, for the log of one aMussel."""
    spread: Spread = Spread()
    firmware: tuple[FirmwareConfig, ...] = ()
    """Somebody's firmware; the boards that none of them has have ours."""

    @property
    def time_scale(self) -> TimeScale:
        return TimeScale(self.theta)

    def maker(self) -> AgentConfigs:
        return AgentConfigs(self)


class AgentConfigs:
    """Makes agents' configurations, which share their equal parts, so that forked agents share the memory too."""

    def __init__(self, fleet: FleetConfig) -> None:
        self._fleet = fleet
        cycle = None if fleet.board.whole is None else fleet.board.whole.cycle
        self._has_slots = cycle is not None and cycle.slots is not None
        self._slots = timeslots_of(fleet.agent_ids)
        self._water = WaterConfig(
            fleet.seed,
            fleet.time_scale.agent_span(TICK_MS),
            fleet.body,
            fleet.current.water_current(),
            WaterFields.by_key({key: waters.field() for key, waters in fleet.waters.items()}),
        )

    def config(self, agent_id: int) -> AgentConfig:
        fleet = self._fleet
        board = replace(
            fleet.board,
            agent_id=agent_id,
            slot=self._slot(agent_id) if self._has_slots else 0,
            drift_ppb=drift_of(fleet.seed, agent_id, fleet.clock_drift_ppb),
        )
        applied = fleet.spread.applied(board, fleet.seed)
        return AgentConfig(applied, self._water, fleet.reports, self._firmware(agent_id))

    def _firmware(self, agent_id: int) -> tuple[str, ...]:
        # One that names the aMussel goes before one for all that are left.
        for firmware in sorted(self._fleet.firmware, key=lambda it: not it.agent_ids):
            if not firmware.agent_ids or agent_id in firmware.agent_ids:
                return firmware.command
        return ()

    def _slot(self, agent_id: int) -> int:
        return self._slots[agent_id] if self._slots else agent_id - self._fleet.first_id


def drift_of(seed: int, agent_id: int, bound_ppb: int) -> int:
    """The drift of one aMussel's clock, since no two crystals are alike: a keyed hash of (seed, agent id).

    Uniform on the integers of [-bound_ppb, +bound_ppb].
    """
    word = int.from_bytes(blake2b(_KEY(seed, agent_id), digest_size=8, person=b"crystal").digest(), "little")
    return (word * (2 * bound_ppb + 1) >> 64) - bound_ppb


def resting_on_bottom(
    north_m: float, east_m: float, depth_m: float, primary: float, secondary: float
) -> Physical:
    """A new aMussel at agent time 0, its primary battery in use; its GPS had an exact fix when it was put there."""
    place_um = round(north_m * 1e6), round(east_m * 1e6)
    return Physical(
        primary=Battery(0, grains(primary), Flow.DISCHARGING),
        secondary=Battery(0, grains(secondary), Flow.RESTING),
        north_um=place_um[0],
        east_um=place_um[1],
        depth_anchor_ms=0,
        depth_um=round(depth_m * 1e6),
        buoyancy=Buoyancy.SINK,
        docked=False,
        fix_um=place_um,
    )

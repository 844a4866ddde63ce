"""What a fleet is made of: the numbers that its agents share, and what each is born with. Plain values, to cross a link."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from agents.agent import AgentConfig
from agents.body import WaterConfig
from agents.physical import Physical
from agents.water.current import STILL_WATER, CurrentField
from firmware_model.actions import Buoyancy
from firmware_model.charge import Battery, ChargeModel, Flow, grains
from firmware_model.plan import BoardConfig


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """Shared by all agents. Durations `_ms` are agent time; rates are a minute of agent time, as the paper prints them."""

    theta: int
    seed: int
    codec: str
    discharge_per_min: float
    charge_segments: tuple[tuple[float, float], ...]
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
    coil_alignment_ms: int = 0

    def to_wire(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_wire(cls, wire: dict[str, Any]) -> FleetConfig:
        segments = tuple((end, rate) for end, rate in wire["charge_segments"])
        return cls(**{**wire, "charge_segments": segments})

    def maker(self) -> AgentConfigs:
        return AgentConfigs(self)


class AgentConfigs:
    """Makes agents' configurations that share what they can: a forked agent then shares the memory too."""

    def __init__(self, fleet: FleetConfig) -> None:
        self._fleet = fleet
        self._charge = ChargeModel.from_minutes(fleet.discharge_per_min, fleet.charge_segments)
        self._water = WaterConfig(
            seed=fleet.seed,
            step_ms=1000 * fleet.theta,
            bottom_um=fleet.bottom_um,
            surfacing_ms=fleet.surfacing_ms,
            sinking_ms=fleet.sinking_ms,
            drifts_always=fleet.drifts_always,
            amplitude_um=fleet.drift_amplitude_um,
            current=STILL_WATER if fleet.current_csv is None else CurrentField.parse(fleet.current_csv),
            coil_alignment_ms=fleet.coil_alignment_ms,
        )

    def config(self, agent_id: int) -> AgentConfig:
        fleet = self._fleet
        board = BoardConfig(
            agent_id,
            self._charge,
            fleet.pin_debounce_ms,
            fleet.boot_ms,
            fleet.float_timeout_ms,
            fleet.release_wait_ms,
        )
        return AgentConfig(board, self._water, fleet.report_period_ms, fleet.heard_always)


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

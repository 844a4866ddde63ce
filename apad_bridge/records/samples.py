"""Samples of one instant for the bag, as plain rows in the order of our messages' fields."""

from __future__ import annotations

from itertools import chain
from math import nan, sqrt
from typing import NamedTuple

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import NUMBERS, Belief, Source
from apad_bridge.scenario.firmware_config import charge_models, sinking_of
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.power.charge import fraction

_MOST_TIMESLOTS = 0xFFFF
"""The largest count of silent timeslots in a bag."""


class TruthSample(NamedTuple):
    agent_id: int
    state: int
    primary: float
    secondary: float
    north_m: float
    east_m: float
    depth_m: float
    docked: bool
    agent_time_ms: int


class BeliefSample(NamedTuple):
    """A belief; NaN, and no modes, where an estimator gives no uncertainty. Units are those of AgentBelief.msg."""

    agent_id: int
    state: int
    charge: float
    secondary: float
    north_m: float
    east_m: float
    age_s: float
    charge_deviation: float = nan
    secondary_deviation: float = nan
    charges_covariance: float = nan
    charge_low: float = nan
    charge_high: float = nan
    north_deviation_m: float = nan
    east_deviation_m: float = nan
    place_covariance_m2: float = nan
    mode_probabilities: tuple[float, ...] = ()
    clock_offset_ms: float = nan
    clock_deviation_ms: float = nan
    silent_timeslots: int = 0
    learned_from: int = int(Source.PACKET)
    reported: tuple[float, ...] = ()
    """The numbers of `NUMBERS`, in their order."""
    charge_parts: tuple[float, ...] = ()
    """Weight, mean and deviation of each Gaussian of the primary charge, one after the other."""


class APadSample(NamedTuple):
    north_m: float
    east_m: float
    heading_rad: float
    voltage_v: float
    battery_fraction: float
    primitive: str
    docks: tuple[int, ...]
    """The aMussel in each dock; -1 for a free dock."""


class TruthExtrapolator:
    """Extrapolates a Truth until the next one: batteries and depth are linear from their anchors."""

    def __init__(self, scenario: Scenario) -> None:
        self.charge_of = charge_models(scenario)
        self._sinking = sinking_of(scenario)

    def sample(self, truth: Truth, agent_ms: int) -> TruthSample:
        """The aMussel at agent time `agent_ms`, at or after the truth's."""
        physical, charge_at = truth.physical, self.charge_of(truth.agent_id).charge_at
        return TruthSample(
            agent_id=truth.agent_id,
            state=int(truth.state),
            primary=fraction(charge_at(physical.primary, agent_ms)),
            secondary=fraction(charge_at(physical.secondary, agent_ms)),
            north_m=physical.north_um / 1e6,
            east_m=physical.east_um / 1e6,
            depth_m=self.depth_um(physical, agent_ms) / 1e6,
            docked=physical.docked,
            agent_time_ms=agent_ms,
        )

    def depth_um(self, physical: Physical, agent_ms: int) -> int:
        if physical.docked:
            return 0
        elapsed_ms = agent_ms - physical.depth_anchor_ms
        return self._sinking.depth_um(physical.depth_um, physical.buoyancy, physical.hover_um, elapsed_ms)


def belief_sample(belief: Belief, now_ms: MissionMs) -> BeliefSample:
    """The belief at mission time `now_ms`, as the bag and /musselbed/beliefs publish it."""
    newest = (
        belief.agent_id,
        int(belief.state),
        belief.primary,
        belief.secondary,
        belief.north_m,
        belief.east_m,
        belief.age_s(now_ms),
    )
    reported = tuple([nan if (value := it.of(belief)) is None else value for it in NUMBERS.values()])
    silent, learned_from = min(belief.silent_timeslots, _MOST_TIMESLOTS), int(belief.learned_from)
    if not belief.is_predicted:
        return BeliefSample(*newest, silent_timeslots=silent, learned_from=learned_from, reported=reported)
    primary, both, secondary = belief.charge_cov
    north, across, east = belief.place_cov
    return BeliefSample(
        *newest,
        *(sqrt(primary), sqrt(secondary), both),
        *belief.charge_interval(),
        *(sqrt(north), sqrt(east), across),
        mode_probabilities=belief.mode_probabilities,
        clock_offset_ms=belief.clock.offset_ms,
        clock_deviation_ms=sqrt(belief.clock.offset_var),
        silent_timeslots=silent,
        learned_from=learned_from,
        reported=reported,
        charge_parts=tuple(chain.from_iterable(belief.parts)),
    )


def apad_sample(
    pose: PoseReported, battery: BatteryReported | None, primitive: str, docks: tuple[int | None, ...]
) -> APadSample:
    """The aPad's sample; NaN for a battery that was never reported."""
    voltage_v, left = (float("nan"),) * 2 if battery is None else (battery.voltage_v, battery.fraction)
    held = tuple(-1 if agent_id is None else agent_id for agent_id in docks)
    return APadSample(
        north_m=pose.north_m,
        east_m=pose.east_m,
        heading_rad=pose.heading_rad,
        voltage_v=voltage_v,
        battery_fraction=left,
        primitive=primitive,
        docks=held,
    )

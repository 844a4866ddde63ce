"""The supervisor's estimate of one aMussel. The mission and the planner are built from beliefs alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntFlag
from operator import attrgetter
from typing import NamedTuple

from agents.time_scale import MissionMs
from apad_bridge.beliefs.mixture import Gaussian, below, interval
from apad_bridge.beliefs.modes import Mode, mode_of
from firmware_model.packets import NOTHING_REPORTED, QUANTITIES, Reported, ShownQuantity
from firmware_model.states import State
from firmware_model.value import value

EXACT = (0.0, 0.0, 0.0)


class Source(IntFlag):
    """Information that a belief contains since the newest packet, that packet included."""

    PACKET = 1
    SILENCE = 2
    """Timeslots passed in which a packet was due."""
    DOCKING = 4
    RELEASE = 8
    RANGE = 16
    SCHEDULE = 32
    """The activity follows from the schedule that was commanded last."""
    HAND_OVER = 64
    """The id is that of another board now, which has not been heard: its place and charge are not known."""


@dataclass(frozen=True, slots=True)
class ClockBelief:
    """An aMussel's clock against its nominal agent time: ahead by `offset_ms`, gaining `drift_ppm`; their covariance."""

    offset_ms: float = 0.0
    drift_ppm: float = 0.0
    offset_var: float = 0.0
    covariance: float = 0.0
    drift_var: float = 0.0


class Suspicion(NamedTuple):
    """Packets of this aMussel contradicted physics: what it states is no measurement of its charge, as far as known."""

    reason: str
    was_docked: bool
    """A dock has held it since, so that a person could look at it."""
    stands: float | None = None
    """The reading that stands, until it moves; None for another reason, which lasts until the run's end."""


class CapacityLeft(NamedTuple):
    """The share of its capacity that an aged battery still has: the interval that holds it with 95 %, in [0, 1]."""

    low: float
    high: float


EXACT_CLOCK = ClockBelief()


@value
class Belief:
    """An estimate for the mission time `at_ms`; charges are the paper's scaled voltage in [0, 1].

    `heard_ms` is the mission time of the newest packet, and `state` is the state in that packet. An estimator that claims
    to be certain leaves every field after `east_m` at its default.
    """

    agent_id: int
    heard_ms: MissionMs
    state: State
    primary: float
    secondary: float
    north_m: float
    east_m: float
    predicted_ms: int = 0
    """The time past `heard_ms` over which the estimate was predicted."""
    charge_cov: tuple[float, float, float] = EXACT
    """Variance of the primary, covariance, variance of the secondary."""
    place_cov: tuple[float, float, float] = EXACT
    """Variance north, covariance, variance east; square metres."""
    mode_probabilities: tuple[float, ...] = ()
    """One probability for each `Mode`, in its order; empty when the estimator takes `state` as certain."""
    clock: ClockBelief = EXACT_CLOCK
    learned_from: Source = Source.PACKET
    silent_timeslots: int = 0
    """Timeslots since the newest packet in which a packet was due and none was received.

    Silence makes no aMussel suspect. `mission/policy/pool.py` decides if a silent one is fetched.
    """
    suspicion: Suspicion | None = None
    """None for an aMussel whose packets can all be true."""
    parts: tuple[Gaussian, ...] = ()
    """The primary charge as a mixture, not yet clamped to 0 and 1; empty for one Gaussian."""
    capacity_left: CapacityLeft | None = None
    """Both batteries age alike. None for an estimator that learns no ageing."""
    reported: Reported = NOTHING_REPORTED
    estimator_state: object = field(default=None, compare=False, repr=False)
    """Private to the estimator."""

    @property
    def at_ms(self) -> int:
        """The mission time for which it is an estimate."""
        return self.heard_ms + self.predicted_ms

    def counting_silence(self, timeslots: int) -> Belief:
        """The same after so many silent timeslots; `replace` takes five times as long for so many fields."""
        return Belief(
            agent_id=self.agent_id,
            heard_ms=self.heard_ms,
            state=self.state,
            primary=self.primary,
            secondary=self.secondary,
            north_m=self.north_m,
            east_m=self.east_m,
            predicted_ms=self.predicted_ms,
            charge_cov=self.charge_cov,
            place_cov=self.place_cov,
            mode_probabilities=self.mode_probabilities,
            clock=self.clock,
            learned_from=self.learned_from | Source.SILENCE,
            silent_timeslots=timeslots,
            suspicion=self.suspicion,
            parts=self.parts,
            capacity_left=self.capacity_left,
            reported=self.reported,
            estimator_state=self.estimator_state,
        )

    def age_s(self, now_ms: MissionMs) -> float:
        """Mission seconds since the newest packet."""
        return (now_ms - self.heard_ms) / 1000

    @property
    def is_predicted(self) -> bool:
        """True if the estimator predicts between packets; otherwise the belief is only as good as its newest packet."""
        return bool(self.mode_probabilities)

    @property
    def is_of_another_board(self) -> bool:
        """True after a hand-over until the new board is heard: nothing tells its place."""
        return Source.HAND_OVER in self.learned_from

    @property
    def mode(self) -> Mode:
        """The most probable mode; the first of several equally probable ones."""
        if not self.mode_probabilities:
            return mode_of(self.state, self.primary, self.secondary)
        return Mode(max(range(len(Mode)), key=self.mode_probabilities.__getitem__))

    def probability_of(self, *modes: Mode) -> float:
        """The probability that the aMussel is in one of `modes`."""
        if not self.mode_probabilities:
            return float(self.mode in modes)
        return math.fsum(self.mode_probabilities[mode] for mode in modes)

    def probability_at_most(self, charge: float) -> float:
        """The probability that the primary battery holds `charge` or less."""
        return below(self._mixture, charge)

    def charge_interval(self, share: float = 0.95) -> tuple[float, float]:
        """The central interval that holds the primary charge with probability `share`."""
        return interval(self._mixture, share)

    @property
    def _mixture(self) -> tuple[Gaussian, ...]:
        return self.parts or (Gaussian(1.0, self.primary, math.sqrt(self.charge_cov[0])),)


class BelievedNumber(NamedTuple):
    """A number of a belief that has a name of its own, and how it is read."""

    quantity: ShownQuantity
    of: Callable[[Belief], float | None]
    """None where no packet stated it, or the estimator does not know it."""


NUMBERS: dict[str, BelievedNumber] = {
    name: BelievedNumber(it, attrgetter(f"reported.{name}")) for name, it in QUANTITIES.items()
}
"""By name, the numbers that bags, topics, exported tables, the journal and pages carry as `reported`.

All that packets state are rows. A number that an estimator believes is one more, after these, and a field of `Belief` that
is None where the estimator has none. A checkpoint keeps what it is computed from, not the number.
"""

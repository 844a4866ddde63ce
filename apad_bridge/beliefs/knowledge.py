"""What a twin is told before it hears anything: how the firmware spends, what was commanded, how far to trust both.

Charges are the paper's scaled voltage; rates are a minute of agent time; milliseconds are agent time unless said
otherwise. Nothing here is learned in flight: what differs between aMussels is in the twin's state.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from apad_bridge.beliefs.modes import SUBMERGED, Mode
from firmware_model.states import State

_MS_PER_MIN = 60_000
_SHARE_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Drain:
    """What an aMussel of the nominal kind draws."""

    per_min: tuple[float, ...]
    """By `Mode`, of the battery that feeds the board."""
    motor_run: float
    """One run of the buoyancy motors, to surface or to sink."""
    motor_deviation: float
    """Of a way up or down, the run and all that goes with it."""
    in_dock: float
    """Of the load, the share that reaches a battery which is being charged."""

    def __post_init__(self) -> None:
        if len(self.per_min) != len(Mode):
            raise ValueError(f"a drain is given for {len(self.per_min)} of {len(Mode)} modes")


@dataclass(frozen=True, slots=True)
class Cycle:
    """What one that sleeps draws in the course of its own cycle, from whole multiples of a period of its clock."""

    steps: tuple[tuple[int, float, float], ...]
    """(ms into the period, spent by then, rate a minute from then on), rising from 0."""
    period_ms: int
    in_all: float
    """What a period takes."""

    @classmethod
    def of(cls, lasting: Sequence[tuple[int, float]], period_ms: int) -> Cycle:
        """From (how many ms, rate a minute), one after the other; the last one lasts until the period is over."""
        steps, at_ms, spent = [], 0, 0.0
        for lasts_ms, per_min in lasting:
            steps.append((at_ms, spent, per_min))
            lasts_ms = min(lasts_ms, period_ms - at_ms)
            at_ms, spent = at_ms + lasts_ms, spent + per_min * lasts_ms / _MS_PER_MIN
        return cls(tuple(steps), period_ms, spent + steps[-1][2] * (period_ms - at_ms) / _MS_PER_MIN)

    def spent(self, from_ms: int, to_ms: int) -> float:
        return self._spent_by(to_ms) - self._spent_by(from_ms)

    def _spent_by(self, at_ms: int) -> float:
        """Since time 0."""
        periods, phase_ms = divmod(at_ms, self.period_ms)
        began_ms, before, per_min = self.steps[bisect_right(self.steps, phase_ms, key=_start_ms) - 1]
        return periods * self.in_all + before + per_min * (phase_ms - began_ms) / _MS_PER_MIN


def _start_ms(step: tuple[int, float, float]) -> int:
    return step[0]


@dataclass(frozen=True, slots=True)
class Charger:
    segments: tuple[tuple[float, float], ...]
    """(upper end on [0, 1], rate a minute) of one coil, rising; the last ends at 1 (equation (2))."""
    primary: float
    """What the primary's coils give, in coils."""
    deviation: float
    """Relative deviation of a docking's rate: how well the coils came to lie."""


@dataclass(frozen=True, slots=True)
class Sensor:
    noise: float
    """Deviation of one measured charge."""
    bias: tuple[float, float, float, float]
    """Expected asleep, awake, under high load, charging: voltage sags under a load and is lifted by a charger."""
    bias_deviation: tuple[float, float, float, float]
    apart_ms: int
    """Of the readings within this time, in one mode, one is used: they share their error."""
    offsets: Mapping[State, tuple[float, float]] = field(default_factory=dict)
    """By what the readings of the primary and of the secondary differ from the charge on a board of the nominal kind, in
    the state that a packet states; 0 where none is given. Biases come on top."""
    saturates: bool = False
    """A charger lifts no voltage above the full one, and noise comes on top of that: a reading near the full one, on a
    charger, says only that the charge is at least so much."""


@dataclass(frozen=True, slots=True)
class Habits:
    """Which of `SUBMERGED` an aMussel takes up by itself, decided at whole multiples of `every_ms`."""

    every_ms: int
    unscheduled: float
    """The share of times that differ from what the schedule says."""
    stays: float
    """Without a schedule: the probability of staying in the mode."""
    shares: tuple[float, float, float]
    """Without a schedule: which mode is changed to."""
    daily: float
    """Without a schedule, but one and the same plan: the probability that it does as at this time of another day."""
    plan_lasts_ms: int
    plan_deviation: float
    """Without a schedule: of the mean drain, a minute, between one plan of days and another."""
    seen_before: float
    """How many decisions `shares` is worth beside those that are heard of one aMussel."""

    def __post_init__(self) -> None:
        if abs(sum(self.shares) - 1) > _SHARE_TOLERANCE or min(self.shares) < 0:
            raise ValueError("the shares of the modes must add up to 1")
        if not (0 <= self.unscheduled < 1 and 0 <= self.stays <= 1):
            raise ValueError("unscheduled and stays are probabilities")


@dataclass(frozen=True, slots=True)
class Water:
    """How a place is lost; mission time, for the water knows no theta."""

    step_variance_m2: float
    """Of the random drift, along one axis, a mission second."""
    current_deviation_m_s: float
    """Of a steady current along one axis."""
    current_lasts_s: float
    fix_deviation_m: float
    """Of a place that a packet states, along one axis."""


@dataclass(frozen=True, slots=True)
class ClockKnowledge:
    """Deviations: of an unheard clock's offset, of its drift, and of one reading with the sound's way in it."""

    offset_ms: float
    drift_ppm: float
    reading_ms: float


@dataclass(frozen=True, slots=True)
class Calls:
    """What an aMussel that has come up says, unasked: so its silence says that it has not."""

    every_ms: int
    """Agent time; the first as soon as it is up."""
    missed: float
    """The share of these times in which nothing is heard of it."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    theta: int
    drain: Drain
    charger: Charger
    sensor: Sensor
    habits: Habits
    water: Water
    drain_deviation: float
    """Relative, between aMussels."""
    ageing_per_day: float
    """Deviation by which the relative drain wanders in a day."""
    clock: ClockKnowledge
    surfacing_ms: int
    sinking_ms: int
    float_timeout_ms: int
    """Floating unserved for so long, it sinks again."""
    calls: Calls | None = None
    """From the surface; None: nobody knows when one that is up should be heard."""


@dataclass(frozen=True, slots=True)
class Schedule:
    """Modes as last commanded: (agent ms from which, mode), rising; nothing is known before the first."""

    starts_ms: tuple[int, ...]
    modes: tuple[Mode, ...]
    cycle: Cycle | None = None
    """Of one that sleeps; None: it draws its mean all the time."""

    def __post_init__(self) -> None:
        if len(self.starts_ms) != len(self.modes) or list(self.starts_ms) != sorted(set(self.starts_ms)):
            raise ValueError("a schedule's times must rise, with a mode for each")
        if not set(self.modes) <= set(SUBMERGED):
            raise ValueError("a schedule commands what an aMussel does by itself: asleep, idle or high load")

    def at(self, agent_ms: int) -> Mode | None:
        n = bisect_right(self.starts_ms, agent_ms)
        return self.modes[n - 1] if n else None


UNKNOWN = Schedule((), ())

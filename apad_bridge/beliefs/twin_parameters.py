"""The fixed parameters of a twin: how the firmware spends charge, what was commanded, and how far to trust both.

Charges are the paper's scaled voltage; rates are a minute of agent time; milliseconds are agent time unless stated
otherwise. Nothing here is learned in flight: the differences between aMussels are in the twin's state.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import fsum, log

from agents.time_scale import TimeScale
from apad_bridge.beliefs.modes import SUBMERGED, Mode
from firmware_model.config import BoardConfig
from firmware_model.power.charge import FULL, MS_PER_MIN
from firmware_model.power.voltage_curve import STRAIGHT, VoltageCurve
from firmware_model.sinking import Sinking
from firmware_model.states import State

_SHARE_TOLERANCE = 1e-9
NO_OFFSETS = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Drain:
    """The charge that an aMussel of the nominal kind draws."""

    per_min: tuple[float, ...]
    """Charge by `Mode`, drawn from the battery that feeds the board."""
    motor_run: float
    """One run of the buoyancy motors, to surface or to sink."""
    motor_deviation: float
    """Deviation of what the motors take for a whole way up or down."""
    in_dock: float
    """The share of the load that reaches a battery which is being charged."""
    listening: float = 0.0
    """Beyond what the schedule says: what a board takes that listens on the bottom, from rest until it sleeps."""
    release_wait: float = 0.0
    """The most that an aMussel takes, beyond the schedule, that was released and waits until it is clear to sink."""

    def __post_init__(self) -> None:
        if len(self.per_min) != len(Mode):
            raise ValueError(f"a drain is given for {len(self.per_min)} of {len(Mode)} modes")


@dataclass(frozen=True, slots=True)
class CycleParameters:
    """The charge that a sleeping aMussel draws over its wake cycle, which starts at whole multiples of a period."""

    steps: tuple[tuple[int, float, float], ...]
    """(ms into the period, spent by then, rate a minute from then on), rising from 0."""
    period_ms: int
    in_all: float
    """The charge that a whole period takes."""

    @classmethod
    def of(cls, lasting: Sequence[tuple[int, float]], period_ms: int) -> CycleParameters:
        """Makes a cycle of consecutive (duration in ms, rate a minute); the last rate lasts until the period's end."""
        steps, at_ms, spent = [], 0, 0.0
        for lasts_ms, per_min in lasting:
            steps.append((at_ms, spent, per_min))
            lasts_ms = min(lasts_ms, period_ms - at_ms)
            at_ms, spent = at_ms + lasts_ms, spent + per_min * lasts_ms / MS_PER_MIN
        return cls(tuple(steps), period_ms, spent + steps[-1][2] * (period_ms - at_ms) / MS_PER_MIN)

    def spent(self, from_ms: int, to_ms: int) -> float:
        return self._spent_by(to_ms) - self._spent_by(from_ms)

    def awake(self, from_ms: int, to_ms: int) -> float:
        """The part of `spent` that is for wakes, beyond what sleep takes."""
        return self.spent(from_ms, to_ms) - self.steps[-1][2] * (to_ms - from_ms) / MS_PER_MIN

    def _spent_by(self, at_ms: int) -> float:
        """The charge spent since time 0."""
        periods, phase_ms = divmod(at_ms, self.period_ms)
        began_ms, before, per_min = self.steps[bisect_right(self.steps, phase_ms, key=_start_ms) - 1]
        return periods * self.in_all + before + per_min * (phase_ms - began_ms) / MS_PER_MIN


def _start_ms(step: tuple[int, float, float]) -> int:
    return step[0]


@dataclass(frozen=True, slots=True)
class ChargerParameters:
    segments: tuple[tuple[float, float], ...]
    """(upper end on [0, 1], rate a minute) of one coil, rising; the last ends at 1 (equation (2))."""
    primary: float
    """The output of the primary's coils, in coils."""
    deviation: float
    """Relative deviation of a docking's charging rate, from the alignment of the coils."""
    rate_deviation: float = 0.0
    """Relative deviation of the charging rate between aMussels, from the capacity of their batteries."""


@dataclass(frozen=True, slots=True)
class SensorParameters:
    noise: float
    """Deviation of one measured charge."""
    bias: tuple[float, float, float, float]
    """Expected asleep, awake, under high load, charging: a load lowers the voltage, and a charger lifts it."""
    bias_deviation: tuple[float, float, float, float]
    apart_ms: int
    """The filter uses one of the readings within this time in one mode, because they share their error."""
    offsets: Mapping[State, tuple[float, float]] = field(default_factory=dict)
    """Reading minus charge, for the primary and the secondary of a nominal board, by the state in the packet; 0 if not
    given. Biases come on top."""
    curve: VoltageCurve = STRAIGHT
    """Stated readings, less their offset, are voltages along it."""
    saturates: bool = False
    """A charger lifts no voltage above the full one, and noise comes on top. So a reading near the full voltage, on a
    charger, gives only a lower bound of the charge."""

    def charge_of(self, reading: float, offset: float) -> float:
        """The charge that a reading stands for; beyond [0, 1] the curve goes on."""
        voltage = reading - offset
        return voltage if self.curve.is_straight else self.curve.charge(round(voltage * FULL)) / FULL

    def stretch_at(self, reading: float, offset: float) -> float:
        """The change of that charge for a change of the reading."""
        return 1.0 if self.curve.is_straight else self.curve.stretch_at(round((reading - offset) * FULL))

    def primary_of(self, state: State, reading: float) -> float:
        """The charge that a packet's primary stands for."""
        return self.charge_of(reading, self.offsets.get(state, NO_OFFSETS)[0])


@dataclass(frozen=True, slots=True)
class UntoldParameters:
    """The most by which a board differs from the catalogue's in what nobody told its twin, which learns it.

    A twin begins with uniform distributions over these ranges.
    """

    ageing: float
    """The share of the capacity that is lost, from 0 on; both batteries of an aMussel age alike."""
    drain: float
    """Relative, either way."""
    bias: float
    """A sensor's, either way, in every state alike; each battery's sensor has its own."""
    drain_swing: float = 0.0
    """The deviation of the loads within a day, relative to their mean; 0 for steady loads."""

    def __post_init__(self) -> None:
        if not (0 <= self.ageing < 1 and min(self.drain, self.bias, self.drain_swing) >= 0):
            raise ValueError("an ageing lies in [0, 1), and a drain, its swing and a bias are not negative")

    @property
    def rate(self) -> tuple[float, float]:
        """Mean and variance of 1 / capacity: how much faster an aged battery charges and discharges."""
        if self.ageing == 0:
            return 1.0, 0.0
        left = 1 - self.ageing
        mean = -log(left) / self.ageing
        return mean, 1 / left - mean**2


@dataclass(frozen=True, slots=True)
class Habits:
    """The modes of `SUBMERGED` that an aMussel takes up by itself; it decides at whole multiples of `every_ms`."""

    every_ms: int
    unscheduled: float
    """The share of decisions that differ from the schedule."""
    stays: float
    """Without a schedule: the probability of staying in the mode."""
    shares: tuple[float, float, float]
    """Without a schedule: the probabilities of the mode that it changes to."""
    daily: float
    """Without a schedule, under an unchanged plan: the probability of the same mode as at this time of another day."""
    plan_lasts_ms: int
    plan_deviation: float
    """Without a schedule: deviation of the mean drain, a minute, between plans that last for days."""
    seen_before: float
    """The weight of `shares` as a prior, in decisions, against the decisions observed of one aMussel."""

    def __post_init__(self) -> None:
        if abs(fsum(self.shares) - 1) > _SHARE_TOLERANCE or min(self.shares) < 0:
            raise ValueError("the shares of the modes must add up to 1")
        if not (0 <= self.unscheduled < 1 and 0 <= self.stays <= 1):
            raise ValueError("unscheduled and stays are probabilities")


@dataclass(frozen=True, slots=True)
class WaterParameters:
    """The uncertainty of a place in the water. Mission time, because theta does not apply to the water."""

    step_variance_m2: float
    """Variance of the random drift along one axis, a mission second."""
    current_deviation_m_s: float
    """Deviation of a steady current along one axis."""
    current_lasts_s: float
    fix_deviation_m: float
    """Deviation of a place that a packet states, along one axis."""
    is_ground_truth: bool = True
    """Packets from below state the present place; otherwise the last one from the surface."""
    way_down_s: float = 0.0
    """Duration of the way between the surface and the bottom."""

    @property
    def way_down_variance_m2(self) -> float:
        """Variance along one axis of how far a current carries an aMussel on its way down."""
        return (self.current_deviation_m_s * self.way_down_s) ** 2


@dataclass(frozen=True, slots=True)
class ClockParameters:
    """Deviations of an unread clock's offset, of its drift, and of one reading, which includes the travel time of sound."""

    offset_ms: float
    drift_ppm: float
    reading_ms: float


@dataclass(frozen=True, slots=True)
class CallParameters:
    """The packets that a surfaced aMussel sends unasked: so silence is evidence that it has not surfaced."""

    every_ms: int
    """Agent time; the first packet is due as soon as it is up."""
    missed: float
    """The share of these packets that are not received."""


@dataclass(frozen=True, slots=True)
class TwinParameters:
    scale: TimeScale
    drain: Drain
    charger: ChargerParameters
    sensor: SensorParameters
    habits: Habits
    water: WaterParameters
    drain_deviation: float
    """Relative, between aMussels."""
    ageing_per_day: float
    """Deviation by which the relative drain wanders in a day."""
    clock: ClockParameters
    board: BoardConfig
    """The nominal board: how long it floats, waits, listens and runs its motors."""
    sinking: Sinking
    calls: CallParameters | None = None
    """Packets from the surface; None if it is unknown when a surfaced aMussel should be received."""
    untold: UntoldParameters | None = None
    """None for a twin whose board is told but for `drain_deviation` and the charger's deviations."""
    permission_arrives: float = 0.9
    """The probability that an aMussel received the permission to surface, before any packet from it. Where half of the
    packets are lost, an aPad that assumed 0.97 searched in vain and served fewer."""

    @property
    def motor_run_ms(self) -> int:
        """One run of the motors; 0 for the paper's worst case, whose motors are in its one load."""
        return 0 if self.board.whole is None else self.board.whole.power.motor_run_ms

    @property
    def listening_ms(self) -> int:
        """A board stays awake for so long after it has come to rest on the bottom; 0 for one that never sleeps."""
        whole = self.board.whole
        return 0 if whole is None or whole.cycle is None else whole.cycle.listen_ms


@dataclass(frozen=True, slots=True)
class Schedule:
    """Modes as last commanded, each from an agent time in ms, rising; nothing is known before the first."""

    starts_ms: tuple[int, ...]
    modes: tuple[Mode, ...]
    cycle: CycleParameters | None = None
    """The cycle of a sleeping aMussel; None if it draws its mean all the time."""

    def __post_init__(self) -> None:
        if len(self.starts_ms) != len(self.modes) or list(self.starts_ms) != sorted(set(self.starts_ms)):
            raise ValueError("a schedule's times must rise, with a mode for each")
        if not set(self.modes) <= set(SUBMERGED):
            raise ValueError("a schedule commands what an aMussel does by itself: asleep, idle or high load")

    def at(self, agent_ms: int) -> Mode | None:
        n = bisect_right(self.starts_ms, agent_ms)
        return self.modes[n - 1] if n else None


UNKNOWN = Schedule((), ())

"""Checks the charges that packets state against physics: no board of the kind, however aged, explains some of them.

The bounds hold for every board within the ranges of `Untold`, and every charge that the reading can stand for. So a board
that is merely old, thirsty or badly calibrated contradicts nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from apad_bridge.beliefs import charging
from apad_bridge.beliefs.modes import DOCKED, Mode
from apad_bridge.beliefs.twin_parameters import TwinParameters, UntoldParameters
from firmware_model.power.charge import MS_PER_MIN
from firmware_model.states import State

_NOISE_DEVIATIONS = 6.0
"""Two readings differ by their noise alone by less than this times its deviation, once in five hundred million."""
_BIAS_DEVIATIONS = 3.0
_COIL_DEVIATIONS = 3.0
_LOAD_DEVIATIONS = 2.0
_STEPS = 3.0
"""A reading that stands was due to move by so many steps; a step is the noise's deviation."""
_CHANCE = 1e-6
"""The greatest probability that the noise of a sensor that works makes such readings agree."""
NOT_ON_THE_PRIMARY = (State.OFF, State.EMPTY, State.CALLING, State.LOST)


class Stated(NamedTuple):
    """A charge that a packet stated, without the shift that the board's kind has in that state."""

    at_ms: int
    """Agent time."""
    charge: float
    docked: bool


class StandingReading(NamedTuple):
    """Readings in a row that agree with the first one to half a step, and the steps by which they were due to differ."""

    reading: float
    """The first, as the packet stated it."""
    from_ms: int
    """Its agent time."""
    since: Stated | None
    """The first one of this stay in a dock or in the water; None before it."""
    drain: float
    """The least that the board can draw, relative to its kind's drain."""
    further: int = 0
    steps: float = 0.0
    """The sum over the further readings; each was due to differ from the first by so many steps at least."""
    squares: float = 0.0
    """The sum of their squares."""
    most: float = 0.0

    @property
    def log_chance(self) -> float:
        """The logarithm of the probability that a sensor's noise of one step, on top of what was due, makes them agree.

        The differences of n readings to one more have the covariance 1 + (n = m), whose determinant is n + 1.
        """
        count = self.further + 1
        scatter = self.squares - self.steps**2 / count
        return -0.5 * (scatter + self.further * math.log(2 * math.pi) + math.log(count))


class ReadingTrack(NamedTuple):
    """The readings of one stay in a dock or in the water, as far as they are compared."""

    first: Stated
    newest: Stated


def extended(track: ReadingTrack | None, stated: Stated) -> ReadingTrack:
    """The track with this reading, which begins a new one where the stay is another."""
    if track is None or track.newest.docked is not stated.docked:
        return ReadingTrack(stated, stated)
    return track._replace(newest=stated)


class ChargeChecker:
    """Judges each reading by the first and by the newest one of the same stay, of a board that may be any of its kind."""

    def __init__(
        self, parameters: TwinParameters, untold: UntoldParameters, bias: float | None = None
    ) -> None:
        """`bias` is the greatest of the primary's sensor, either way; None for that of `untold`."""
        self._parameters = parameters
        self._bias = untold.bias if bias is None else bias
        sensor, drain = parameters.sensor, parameters.drain
        stretch = sensor.curve.stretch
        self._bias *= stretch
        self._step = sensor.noise * stretch
        self.margin = _NOISE_DEVIATIONS * math.sqrt(2) * self._step
        self.margin += _BIAS_DEVIATIONS * max(sensor.bias_deviation) * stretch
        load = untold.drain + _LOAD_DEVIATIONS * (parameters.drain_deviation + untold.drain_swing)
        self._least, most, self._aged = max(0.0, 1 - load), 1 + load, 1 / (1 - untold.ageing)
        in_water = [drain.per_min[mode] for mode in Mode if mode not in DOCKED and mode is not Mode.LOST]
        self._asleep, self._steady = min(in_water), 1 - _LOAD_DEVIATIONS * untold.drain_swing
        self._falls_least = self._asleep * self._least
        self._falls_most = max(in_water) * most * self._aged
        self._motors = 2 * drain.motor_run * most * self._aged
        self._in_dock = drain.in_dock * drain.per_min[Mode.CHARGING_PRIMARY]
        self._load = most
        whole = parameters.board.whole
        self._may_work_on_secondary = whole is not None and whole.power.secondary_in_use

    def agree(self, one: float, other: float) -> bool:
        """True for two readings nearer than half a step: packets of several kinds round alike to within that."""
        return abs(one - other) <= self._parameters.sensor.noise / 2

    def standing(
        self, before: StandingReading | None, stated: Stated, reading: float, state: State, drain: float
    ) -> StandingReading:
        """The readings that agree, up to this one; `drain` is the least mean drain that the twin has learned."""
        if before is None or not self.agree(reading, before.reading):
            return StandingReading(reading, stated.at_ms, stated, max(self._least, drain * self._steady))
        since = before.since
        if since is None or since.docked is not stated.docked:
            return StandingReading(before.reading, before.from_ms, stated, before.drain)
        charge, minutes = since.charge, (stated.at_ms - since.at_ms) / MS_PER_MIN
        if stated.docked:
            due = self._in_a_dock(charge, minutes, state)[0] - charge
            due = min(
                due, 1 - self._bias - max(reading, stated.charge)
            )  # a charger holds the voltage of a full battery
        else:
            falls = 0.0 if state in NOT_ON_THE_PRIMARY else self._asleep * before.drain * minutes
            # A reading at the end of its scale may be beyond it, and an empty battery falls no further.
            due = min(falls - (self._beyond_the_ends(charge)[1] - charge), charge - self._bias)
        steps = max(0.0, due / self._step)
        return before._replace(
            further=before.further + 1,
            steps=before.steps + steps,
            squares=before.squares + steps**2,
            most=max(before.most, steps),
        )

    @staticmethod
    def stands(standing: StandingReading) -> bool:
        """True for readings that are of a sensor that stands.

        Noise counts beside the movement: a sensor that works states the same twice, and hardly ever five times.
        """
        return standing.most >= _STEPS and standing.log_chance <= math.log(_CHANCE)

    def judge(self, track: ReadingTrack | None, stated: Stated, state: State) -> str | None:
        """The reason why no board of the kind states this charge after those of `track`; None without one."""
        if track is None or track.newest.docked is not stated.docked:
            return None
        for before in (track.newest, track.first):
            if (reason := self._judge_pair(before, stated, state)) is not None:
                minutes = (stated.at_ms - before.at_ms) / MS_PER_MIN
                return f"{reason}: {before.charge:.2f}, and {stated.charge:.2f} after {minutes:.0f} min of its time"
        return None

    def _judge_pair(self, before: Stated, after: Stated, state: State) -> str | None:
        minutes = max(0.0, (after.at_ms - before.at_ms) / MS_PER_MIN)
        bounds = self._in_a_dock if before.docked else self._in_the_water
        least, most = bounds(before.charge, minutes, state)
        low, high = self._beyond_the_ends(after.charge)
        rises = after.charge - before.charge
        if low > most + self.margin:
            if before.docked:
                return "its charge rises faster than a charger can"
            return "its charge rises without a charger" if rises > self.margin else "its charge does not fall"
        if high < least - self.margin:
            if not before.docked:
                return "its charge falls faster than its loads can"
            return (
                "its charge falls on a charger"
                if rises < -self.margin
                else "its charge does not rise on a charger"
            )
        return None

    def _beyond_the_ends(self, charge: float) -> tuple[float, float]:
        """A packet cannot state less than 0 or more than 1, so a biased reading there stands for a span."""
        return charge - self._bias * (charge <= 0), charge + self._bias * (charge >= 1)

    def _in_the_water(self, charge: float, minutes: float, state: State) -> tuple[float, float]:
        """The least and the greatest reading after so many minutes."""
        low, high = self._beyond_the_ends(charge)
        falls = 0.0 if state in NOT_ON_THE_PRIMARY else self._falls_least * minutes
        if self._may_work_on_secondary:
            falls = min(
                falls, max(0.0, charge)
            )  # an empty primary falls no further, while the other feeds the board
        return low - self._falls_most * minutes - self._motors, high - falls

    def _in_a_dock(self, charge: float, minutes: float, state: State) -> tuple[float, float]:
        """The same; a full battery rises no further, and reads what its bias makes of 1."""
        low, high = self._beyond_the_ends(charge)
        charger = self._parameters.charger
        deviation = _COIL_DEVIATIONS * charger.deviation + _LOAD_DEVIATIONS * charger.rate_deviation

        def rise(coils: float, load: float, begin: float) -> float:
            begin = min(1.0, max(0.0, begin))
            return charging.charged(charger, charger.primary * coils, load, begin, minutes) - begin

        # An aged battery charges faster, so the slowest is as new.
        slowest = rise(1 - deviation, self._in_dock * self._load, low - self._bias)
        fastest = rise((1 + deviation) * self._aged, 0.0, high + self._bias)
        return min(low + slowest, max(low, 1 - self._bias)), high + fastest

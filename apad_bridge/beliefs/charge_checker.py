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
from firmware_model.states import State

_MS_PER_MIN = 60_000
_NOISE_DEVIATIONS = 6.0
"""Two readings differ by their noise alone by less than this times its deviation, once in five hundred million."""
_BIAS_DEVIATIONS = 3.0
_COIL_DEVIATIONS = 3.0
_LOAD_DEVIATIONS = 2.0
_NOT_ON_THE_PRIMARY = (State.OFF, State.EMPTY, State.CALLING, State.LOST)


class Stated(NamedTuple):
    """A charge that a packet stated, without the shift that the board's kind has in that state."""

    at_ms: int
    """Agent time."""
    charge: float
    docked: bool


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
        self.margin = _NOISE_DEVIATIONS * math.sqrt(2) * sensor.noise
        self.margin += _BIAS_DEVIATIONS * max(sensor.bias_deviation)
        load = untold.drain + _LOAD_DEVIATIONS * (parameters.drain_deviation + untold.drain_swing)
        self._least, most, self._aged = max(0.0, 1 - load), 1 + load, 1 / (1 - untold.ageing)
        in_water = [drain.per_min[mode] for mode in Mode if mode not in DOCKED and mode is not Mode.LOST]
        self._falls_least = min(in_water) * self._least
        self._falls_most = max(in_water) * most * self._aged
        self._motors = 2 * drain.motor_run * most * self._aged
        self._in_dock = drain.in_dock * drain.per_min[Mode.CHARGING_PRIMARY]
        self._load = most
        whole = parameters.board.whole
        self._may_work_on_secondary = whole is not None and whole.power.secondary_in_use

    def judge(self, track: ReadingTrack | None, stated: Stated, state: State) -> str | None:
        """The reason why no board of the kind states this charge after those of `track`; None without one."""
        if track is None or track.newest.docked is not stated.docked:
            return None
        for before in (track.newest, track.first):
            if (reason := self._judge_pair(before, stated, state)) is not None:
                minutes = (stated.at_ms - before.at_ms) / _MS_PER_MIN
                return f"{reason}: {before.charge:.2f}, and {stated.charge:.2f} after {minutes:.0f} min of its time"
        return None

    def _judge_pair(self, before: Stated, after: Stated, state: State) -> str | None:
        minutes = max(0.0, (after.at_ms - before.at_ms) / _MS_PER_MIN)
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
        falls = 0.0 if state in _NOT_ON_THE_PRIMARY else self._falls_least * minutes
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

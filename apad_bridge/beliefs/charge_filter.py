"""The state vector of a twin's power filter, with its prediction and its update: ten or eleven numbers together.

The numbers are both charges at the anchor; the drain, relative to the nominal kind's; four voltage biases, because a
sensor reads low under a load and high on a charger; the charging rate, relative to the nominal kind's; and a constant
bias of each battery's sensor. Where loads swing within a day, the eleventh is the drain's present deviation, relative
to itself: an Ornstein-Uhlenbeck process. Drain, biases and charging rate differ between aMussels; the filter learns
them from packets. On the scale of voltage an aged battery discharges and charges faster alike, by 1 / capacity: so the
charging rate tells the capacity, and the drain over the rate tells the load.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from filterpy.kalman import predict, update
from numpy.typing import NDArray

from apad_bridge.beliefs.mixture import clamped, inside, normal_cdf, normal_pdf, truncated
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.spent_charge import Spent
from apad_bridge.beliefs.twin_parameters import SensorParameters, TwinParameters

Array = NDArray[np.float64]
PRIMARY, SECONDARY, DRAIN, ASLEEP, AWAKE, HIGH, CHARGING, RATE, SENSOR, SECONDARY_SENSOR, SWING = range(11)
SIZE = 10
"""Without the swing, which the states of twins have that are told of one."""
_UNKNOWN_SD = 0.6
"""Deviation of an unknown charge: wider than [0, 1], so that the first packet alone decides."""
_UNINFORMATIVE = 1e4
"""Variance of an uninformative reading at the end of its scale: the expected value lies far beyond that end."""
_NEAR_FULL = 2.5
"""A reading within so many noise deviations of the full voltage may come from a voltage that the charger holds there."""
_SURELY_FREE = 20.0
"""A lower reading may come from it too, unless a voltage that still rises is so much likelier. The filter would take the
noise of a held voltage for a bias."""
_CERTAIN = 1e-16
"""A smaller variance is only rounding."""
_BIAS_WANDERS = 0.15
"""The share of its deviation between aMussels by which a bias wanders in a day."""
_CURVED_WANDERS = 1.0
"""The same where the voltage is a curve, along which temperature and the curve's own error change the bias."""
_SENSOR_WANDERS = 0.02
"""The same for the constant bias of a sensor."""
_SWING_LASTS_MS = 21_600_000
"""The correlation time of the drain's swing: a quarter of a day, after which a daily sine has no correlation."""
ANY_BIAS = 1.0
"""A bias of a sensor that may state anything: uniform, either way."""
_IMPROBABLE = 1e-3
_MAX_ANCHORS = 4
_ALIKE_TOLERANCE = 0.01
_BIAS_OF = {
    Mode.ASLEEP: ASLEEP,
    Mode.IDLE: AWAKE,
    Mode.HIGH_LOAD: HIGH,
    Mode.SURFACING: AWAKE,
    Mode.FLOATING: HIGH,
    Mode.CHARGING_PRIMARY: CHARGING,
    Mode.CHARGING_SECONDARY: CHARGING,
    Mode.FULL: CHARGING,
    Mode.LOST: ASLEEP,
}


class Anchor(NamedTuple):
    """The state at the time of the last measurement or docking event, as one of several Gaussians."""

    weight: float
    mean: Array
    cov: Array


class Swing(NamedTuple):
    """The drain's swing over an interval, given its deviation x at the begin: the mean over the interval, and the end."""

    share: float
    """The expected mean is `share` x."""
    decay: float
    """The expected deviation at the end is `decay` x."""
    mean_variance: float
    covariance: float
    """The covariance of the mean with the deviation at the end."""
    variance: float


def swing_over(parameters: TwinParameters, elapsed_ms: int) -> Swing | None:
    """The swing over `elapsed_ms`; None for steady loads."""
    untold = parameters.untold
    if untold is None or not untold.drain_swing:
        return None
    if elapsed_ms <= 0:
        return Swing(1.0, 1.0, 0.0, 0.0, 0.0)
    # Uhlenbeck and Ornstein 1930: the moments of the position and the velocity of a Brownian particle.
    times, square = elapsed_ms / _SWING_LASTS_MS, untold.drain_swing**2
    decay, gone = math.exp(-times), -math.expm1(-times)
    share = gone / times
    return Swing(
        share,
        decay,
        square * max(0.0, 2 * (times - gone) / times**2 - share**2),
        square * share * gone,
        square * gone * (1 + decay),
    )


def drain_over(mean: Array, cov: Array, swing: Swing | None) -> tuple[float, float, float]:
    """Mean and variance of the drain over an interval that begins in this state, and its covariance with the primary."""
    drain, variance, both = mean.item(DRAIN), cov.item(DRAIN, DRAIN), cov.item(PRIMARY, DRAIN)
    if swing is None:
        return drain, variance, both
    by_drain, by_swing = 1 + swing.share * mean.item(SWING), swing.share * drain
    variance = by_drain**2 * variance + by_swing**2 * cov.item(SWING, SWING)
    variance += 2 * by_drain * by_swing * cov.item(DRAIN, SWING) + drain**2 * swing.mean_variance
    return drain * by_drain, variance, by_drain * both + by_swing * cov.item(PRIMARY, SWING)


def _measurement_matrix(mode: Mode, size: int) -> Array:
    """The 2 x `size` matrix from the state to the two measured charges: a load biases the primary alone, a charger both."""
    bias = _BIAS_OF[mode]
    reading = np.zeros((2, size))
    reading[0, PRIMARY] = reading[1, SECONDARY] = reading[0, bias] = 1.0
    reading[0, SENSOR] = reading[1, SECONDARY_SENSOR] = 1.0
    if bias == CHARGING:
        reading[1, CHARGING] = 1.0
    return reading


SIZES = (SIZE, SIZE + 1)
_MEASUREMENT_MATRICES = {(mode, size): _measurement_matrix(mode, size) for mode in Mode for size in SIZES}
_IDENTITY = {size: np.eye(size) for size in SIZES}


def prior_state(parameters: TwinParameters) -> tuple[Array, Array]:
    sensor = parameters.sensor
    mean = np.array([0.5, 0.5, 1.0, *sensor.bias, 1.0, 0.0, 0.0])
    rate = parameters.charger.rate_deviation
    sds = (_UNKNOWN_SD, _UNKNOWN_SD, parameters.drain_deviation, *sensor.bias_deviation, rate, 0.0, 0.0)
    cov = np.diag(np.square(sds))
    if (untold := parameters.untold) is not None:
        # The drain on the scale of voltage is the load times 1 / capacity, and the charging rate is 1 / capacity.
        faster, variance = untold.rate
        load_var = parameters.drain_deviation**2 + untold.drain**2 / 3
        mean[DRAIN] = mean[RATE] = faster
        cov[RATE, RATE] += variance
        cov[DRAIN, RATE] = cov[RATE, DRAIN] = cov[RATE, RATE]
        cov[DRAIN, DRAIN] = cov[RATE, RATE] + load_var * (faster**2 + cov[RATE, RATE])
        cov[SENSOR, SENSOR] = cov[SECONDARY_SENSOR, SECONDARY_SENSOR] = untold.bias**2 / 3
        if untold.drain_swing:
            mean, cov = np.append(mean, 0.0), np.pad(cov, (0, 1))
            cov[SWING, SWING] = untold.drain_swing**2
    return mean, cov


def doubted_state(parameters: TwinParameters, before: Anchor, any_bias: bool) -> Anchor:
    """The state of an aMussel whose packets contradicted physics: with `any_bias` its primary's sensor may be off by any
    amount, else it is as any board's.

    Drain and charging rate begin anew, because they were learned from those packets. The secondary stays as it was.
    """
    mean, cov = prior_state(parameters)
    if any_bias:
        cov[SENSOR, SENSOR] = ANY_BIAS**2 / 3
    kept = [SECONDARY, SECONDARY_SENSOR]
    mean[kept] = before.mean[kept]
    cov[np.ix_(kept, kept)] = before.cov[np.ix_(kept, kept)]
    return Anchor(1.0, mean, cov)


def process_noise(parameters: TwinParameters, elapsed_ms: int) -> Array:
    """The square process noise: the drain of an ageing battery does a random walk, and so do the biases.

    Without theirs the filter would grow ever surer of a bias by what its model of the loads leaves out alike each time.
    """
    swing, days = swing_over(parameters, elapsed_ms), elapsed_ms / 86_400_000
    noise = np.zeros((SIZE, SIZE) if swing is None else (SIZE + 1, SIZE + 1))
    noise[DRAIN, DRAIN] = parameters.ageing_per_day**2 * days
    wanders = _BIAS_WANDERS if parameters.sensor.curve.is_straight else _CURVED_WANDERS
    for row, deviation in zip((ASLEEP, AWAKE, HIGH, CHARGING), parameters.sensor.bias_deviation, strict=True):
        noise[row, row] = (wanders * deviation) ** 2 * days
    if parameters.untold is not None:
        variance = (_SENSOR_WANDERS * parameters.untold.bias) ** 2 * days
        noise[SENSOR, SENSOR] = noise[SECONDARY_SENSOR, SECONDARY_SENSOR] = variance
    if swing is not None:
        noise[SWING, SWING] = swing.variance
    return noise


def discharged(
    mean: Array,
    cov: Array,
    spent: Spent,
    from_secondary: tuple[float, float],
    noise: Array,
    swing: Swing | None = None,
) -> tuple[Array, Array]:
    """The state after the primary gave `spent` times its drain, and the secondary gave (mean, variance).

    The charges are not yet clamped at 0. Nothing is raised: a charge below 0 means that the battery would have run out.
    """
    transition = _IDENTITY[len(mean)].copy()
    transition[PRIMARY, DRAIN] = -spent[1]
    swung = 0.0
    if swing is not None:
        taken = spent[1] * mean[DRAIN]
        swung = taken * swing.share * mean[SWING]
        transition[PRIMARY, DRAIN] *= 1 + swing.share * mean[SWING]
        transition[PRIMARY, SWING], transition[SWING, SWING] = -taken * swing.share, swing.decay
        noise = noise.copy()
        noise[PRIMARY, PRIMARY] += taken**2 * swing.mean_variance
        noise[PRIMARY, SWING] = noise[SWING, PRIMARY] = -taken * swing.covariance
    new_mean, new_cov = predict(mean, cov, transition, noise)
    new_mean[PRIMARY] += swung  # the slopes of a product count it twice
    new_mean[SECONDARY] -= from_secondary[0]
    new_cov[PRIMARY, PRIMARY] += (mean[DRAIN] ** 2 + cov[DRAIN, DRAIN]) * spent[2]
    new_cov[SECONDARY, SECONDARY] += from_secondary[1]
    return new_mean, new_cov


def charged(
    mean: Array,
    cov: Array,
    rows: Sequence[tuple[float, float, float, float]],
    noise: Array,
    swing: Swing | None = None,
) -> tuple[Array, Array]:
    """The state after a time in a dock; `rows` are (mean, variance, slope, slope by the charging rate) of both charges.

    The variances are those of the nonlinear curve; the slopes give every covariance.
    """
    transition = _IDENTITY[len(mean)].copy()
    new_mean = mean.copy()
    if swing is not None:
        transition[SWING, SWING] = swing.decay
        new_mean[SWING] *= swing.decay
    for row, (_, _, slope, by_rate) in zip((PRIMARY, SECONDARY), rows, strict=True):
        transition[row, row], transition[row, RATE] = slope, by_rate
    new_cov = transition @ cov @ transition.T + noise
    for row, (its_mean, variance, _, _) in zip((PRIMARY, SECONDARY), rows, strict=True):
        new_mean[row] = its_mean
        new_cov[row, row] = max(new_cov[row, row], variance)
    return new_mean, new_cov


def with_moments(
    mean: Array, cov: Array, row: int, to: tuple[float, float], slope: float
) -> tuple[Array, Array]:
    """Sets one number of the state to mean and variance `to`; its covariances scale with `slope`."""
    mean, cov = mean.copy(), cov.copy()
    cov[row, :] *= slope
    cov[:, row] *= slope
    mean[row], cov[row, row] = to
    return mean, cov


def bounded(mean: Array, cov: Array, after_measuring: bool) -> tuple[Array, Array]:
    """Both charges clamped to [0, 1]; after a measurement truncated to [0, 1]."""
    for row in (PRIMARY, SECONDARY):
        before = float(mean[row]), float(cov[row, row])
        after = truncated(*before) if after_measuring else clamped(*before)
        if after == before:
            continue
        if before[1] < _CERTAIN or after[1] < _CERTAIN:
            mean, cov = with_moments(mean, cov, row, (after[0], 0.0), 0.0)
        elif after_measuring:
            mean, cov = _conditioned(mean, cov, row, after)
        else:
            # Covariances scale with the probability that the charge is not clamped (Stein's lemma); clamping teaches
            # nothing about the other numbers.
            mean, cov = with_moments(
                mean, cov, row, after, min(inside(*before), math.sqrt(after[1] / before[1]))
            )
    return mean, cov


def split_at_ends(row: Anchor) -> list[Anchor]:
    """The state as hypotheses: each battery has reached an end of the scale and rests there, or it has not.

    At an end the charge is known, so a reading there tells the sensor's bias; and a charge that no longer rises, or
    falls, tells that the end is reached. One Gaussian can say neither.
    """
    rows = [row]
    for battery in (PRIMARY, SECONDARY):
        rows = [part for one in rows for part in _split(one, battery)]
    return rows


def _split(row: Anchor, battery: int) -> list[Anchor]:
    mean, variance = float(row.mean[battery]), float(row.cov[battery, battery])
    if variance < _CERTAIN:
        at = min(1.0, max(0.0, mean))
        return [
            row
            if at == mean
            else Anchor(row.weight, *with_moments(row.mean, row.cov, battery, (at, 0.0), 0.0))
        ]
    sd = math.sqrt(variance)
    below_0, above_1 = normal_cdf(-mean / sd), normal_cdf((mean - 1) / sd)
    within = max(0.0, 1 - below_0 - above_1)
    parts = []
    if within > _IMPROBABLE:
        state = row.mean, row.cov
        if max(below_0, above_1) > _IMPROBABLE:
            state = _conditioned(*state, battery, truncated(mean, variance))
        parts.append(Anchor(row.weight * within, *state))
    for probability, end, side in ((below_0, 0.0, -1.0), (above_1, 1.0, 1.0)):
        if probability > _IMPROBABLE:
            bound = side * (end - mean) / sd
            rise = normal_pdf(bound) / probability
            beyond = mean + side * sd * rise, variance * max(1e-9, 1 - rise * (rise - bound))
            state = _conditioned(row.mean, row.cov, battery, beyond)
            parts.append(Anchor(row.weight * probability, *with_moments(*state, battery, (end, 0.0), 0.0)))
    return parts


def _conditioned(mean: Array, cov: Array, row: int, to: tuple[float, float]) -> tuple[Array, Array]:
    """Conditions the state on one number with the new mean and variance `to`; given that number, the others keep their
    distribution.

    Correlated numbers learn too: a battery that reads 0.98 twice and holds no more than 1 is evidence about a bias.
    """
    gain = cov[:, row] / cov[row, row]
    known = cov + np.outer(gain, gain) * (to[1] - cov[row, row])
    # Rounding may make a variance that was nearly zero negative.
    np.fill_diagonal(known, np.maximum(known.diagonal(), 0.0))
    return mean + gain * (to[0] - mean[row]), known


def measured(
    mean: Array,
    cov: Array,
    sensor: SensorParameters,
    mode: Mode,
    charges: tuple[float, float],
    offsets: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, Array, float, float]:
    """Updates the state with a packet's two charges, which read `offsets` too high.

    Returns mean, covariance, the log density of both readings, and the surprise of the primary's in deviations.
    """
    bias = _BIAS_OF[mode]
    reading = _MEASUREMENT_MATRICES[mode, len(mean)]
    z = np.array([sensor.charge_of(*it) for it in zip(charges, offsets, strict=True)])
    stretches = [sensor.stretch_at(*it) for it in zip(charges, offsets, strict=True)]
    if stretches != [1.0, 1.0]:
        reading = reading.copy()
        reading[:, DRAIN:] *= np.array([stretches]).T  # a bias is one of the voltage
    expected = reading @ mean
    deviations = [sensor.noise * it for it in stretches]
    noise = np.diag(np.square(deviations))
    # filterpy's own log likelihood is not used: its function gives the posterior's, which no packet ever contradicts.
    variances = [float(reading[row] @ cov @ reading[row] + noise[row, row]) for row in (0, 1)]
    surprises = [abs(float(z[row] - expected[row])) / math.sqrt(variances[row]) for row in (0, 1)]
    tops = [sensor.charge_of(1.0, it) for it in offsets]
    below = [(float(tops[row] - z[row]), float(tops[row] - expected[row])) for row in (0, 1)]
    clamped = [
        row
        for row in (0, 1)
        if bias == CHARGING
        and (
            charges[row] >= 1
            or (sensor.saturates and _may_be_held(*below[row], variances[row], deviations[row]))
        )
    ]
    for row in (0, 1):
        if not 0 < charges[row] < 1 or row in clamped:
            if bool(expected[row] > z[row]) is bool(charges[row] > 0):
                # The expected value lies beyond the end, so only the noise below a held voltage surprises.
                surprises[row] = max(0.0, below[row][0] / deviations[row]) if row in clamped else 0.0
            if row not in clamped:
                spread = float(reading[row] @ cov @ reading[row])
                side = 1.0 if charges[row] > 0 else -1.0
                z[row], noise[row, row] = _censored(
                    float(expected[row]), spread, float(z[row]), deviations[row] ** 2, side
                )
    if free := [row for row in (0, 1) if row not in clamped]:
        mean, cov = update(mean, cov, z[free], noise[np.ix_(free, free)], reading[free])
    for row in clamped:
        mean, cov = _considered_update(mean, cov, reading[row], row, float(z[row]), deviations[row] ** 2)
    density = -0.5 * math.fsum(
        surprise**2 + math.log(variance) for surprise, variance in zip(surprises, variances, strict=True)
    )
    return mean, cov, density, surprises[0]


def _may_be_held(below: float, expected_below: float, variance: float, noise: float) -> bool:
    """True if a charger may hold the voltage at the full one, under a noise of deviation `noise`.

    `below` and `expected_below` are how far the reading and the expected one lie below it; `variance` is of their
    difference.
    """
    if below <= _NEAR_FULL * noise:
        return True
    spread, sd = math.sqrt(max(variance - noise**2, _CERTAIN)), math.sqrt(variance)
    held = normal_cdf(-expected_below / spread) * normal_pdf(below / noise) / noise
    return _SURELY_FREE * held > normal_pdf((below - expected_below) / sd) / sd


def _considered_update(
    mean: Array, cov: Array, reading: Array, charge: int, end: float, noise: float
) -> tuple[Array, Array]:
    """Updates one charge from a charger's voltage at the end of its scale: the battery holds at least so much.

    The reading carries no information about the lift, because a charger holds a full battery's voltage there however much
    it lifts. A filter that learned the lift from such readings would make it grow without any evidence. So the lift is
    considered and not estimated (Schmidt-Kalman).
    """
    expected, spread = float(reading @ mean), float(reading @ cov @ reading)
    z, its_noise = _censored(expected, spread, end, noise)
    gain = np.zeros_like(mean)
    gain[charge] = float(cov[charge] @ reading) / (spread + its_noise)
    # Joseph's form is valid for any gain.
    rest = _IDENTITY[len(mean)] - np.outer(gain, reading)
    return mean + gain * (z - expected), rest @ cov @ rest.T + its_noise * np.outer(gain, gain)


def _censored(
    expected: float, spread: float, end: float, noise: float, side: float = 1.0
) -> tuple[float, float]:
    """An equivalent (reading, variance) for a reading that is censored at the upper `end`; with `side` -1, the lower one.

    A Kalman filter that takes the pair ends up as if it knew that the uncensored reading lay beyond the end. Ignoring such
    readings would leave only the low readings of a full battery, and the filter would learn its bias from them. The moments
    are those of a Gaussian beyond a bound (Tobin's censored regression).
    """
    total = spread + noise
    sd = math.sqrt(total)
    bound = side * (end - expected) / sd
    beyond = normal_cdf(-bound)
    if beyond < 1e-9:
        return end, noise  # a very unlikely reading: a plain update is good enough
    rise = normal_pdf(bound) / beyond
    narrowing = rise * (rise - bound)
    if narrowing < total / _UNINFORMATIVE:
        return expected, _UNINFORMATIVE
    return expected + side * sd * rise / narrowing, total / narrowing - spread


def moment_matched(rows: Sequence[Anchor]) -> Anchor:
    """One Gaussian with the total weight and the first two moments of all `rows`."""
    if len(rows) == 1:
        return rows[0]
    total = math.fsum(row.weight for row in rows)
    mean = sum((row.weight / total * row.mean for row in rows), start=np.zeros_like(rows[0].mean))
    cov = np.zeros_like(rows[0].cov)
    for row in rows:
        away = row.mean - mean
        cov += row.weight / total * (row.cov + np.outer(away, away))
    return Anchor(total, mean, cov)


def reduced(rows: Sequence[Anchor]) -> tuple[Anchor, ...]:
    """Reduces the mixture: merges anchors that are nearly alike, and the least probable ones beyond `_MAX_ANCHORS`.

    The weights of the result add up to 1.
    """
    kept: list[Anchor] = []
    for row in sorted(rows, key=lambda row: -row.weight):
        if (like := next((n for n, one in enumerate(kept) if _alike(one, row)), None)) is None:
            kept.append(row)
        else:
            kept[like] = moment_matched((kept[like], row))
    if len(kept) > _MAX_ANCHORS:
        kept[_MAX_ANCHORS - 1 :] = [moment_matched(kept[_MAX_ANCHORS - 1 :])]
    total = math.fsum(row.weight for row in kept)
    return tuple(Anchor(weight / total, mean, cov) for weight, mean, cov in kept)


def _alike(one: Anchor, other: Anchor) -> bool:
    sds = math.sqrt(one.cov[PRIMARY, PRIMARY]), math.sqrt(other.cov[PRIMARY, PRIMARY])
    return (
        abs(float(one.mean[PRIMARY] - other.mean[PRIMARY])) < _ALIKE_TOLERANCE
        and abs(sds[0] - sds[1]) < _ALIKE_TOLERANCE
    )

"""A filter of an aMussel's clock against its nominal agent time: an offset that grows at a constant, unknown rate."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import predict, update
from numpy.typing import NDArray

from apad_bridge.beliefs.belief import ClockBelief

_MEASUREMENT_MATRIX = np.array([[1.0, 0.0]])
_NO_NOISE = np.zeros((2, 2))
_PPM = 1e-6


def prior_clock(offset_deviation_ms: float, drift_deviation_ppm: float) -> ClockBelief:
    return ClockBelief(0.0, 0.0, offset_deviation_ms**2, 0.0, drift_deviation_ppm**2)


def set_to(ahead_ms: float, noise_ms: float, drift_deviation_ppm: float) -> ClockBelief:
    """A clock that is known from a single packet alone, without any earlier belief."""
    return ClockBelief(ahead_ms, 0.0, noise_ms**2, 0.0, drift_deviation_ppm**2)


def propagated(clock: ClockBelief, elapsed_ms: int) -> ClockBelief:
    """The clock after `elapsed_ms` of agent time."""
    if elapsed_ms <= 0:
        return clock
    mean, cov = predict(*_arrays(clock), np.array([[1.0, elapsed_ms * _PPM], [0.0, 1.0]]), _NO_NOISE)
    return _clock(mean, cov)


def corrected(clock: ClockBelief, ahead_ms: float, noise_ms: float) -> ClockBelief:
    """The clock after a packet that states a time `ahead_ms` ahead of the nominal one."""
    mean, cov = update(*_arrays(clock), np.array([ahead_ms]), np.array([[noise_ms**2]]), _MEASUREMENT_MATRIX)
    return _clock(mean, cov)


def _arrays(clock: ClockBelief) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    cov = [[clock.offset_var, clock.covariance], [clock.covariance, clock.drift_var]]
    return np.array([clock.offset_ms, clock.drift_ppm]), np.array(cov)


def _clock(mean: NDArray[np.float64], cov: NDArray[np.float64]) -> ClockBelief:
    return ClockBelief(float(mean[0]), float(mean[1]), float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]))

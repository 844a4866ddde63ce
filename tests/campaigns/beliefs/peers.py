"""The peers: a plain Kalman filter and a plain interacting-multiple-model filter, over all aMussels at once.

They know neither schedule nor dockings, only packets, with the mode that each states. Both are filterpy's, written over
arrays of aMussels for speed: `like_filterpy` runs filterpy's own classes on the same packets, and the run reports the
difference. Their numbers are tuned in the run, on a seed that is not reported.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from filterpy.kalman import IMMEstimator, KalmanFilter

from beliefs.truth import NOISE, Array, Doing, Life

RATES = np.array([-0.004, -0.063, -0.108, 0.16])
"""An hour asleep, idle, under high load, docked."""
_SEEN_AS = np.array([0, 1, 2, 2, 2, 3, 1, 0])
_START = 0.3


@dataclass(frozen=True)
class Peer:
    """Linear models of the same state; with one of them it is a Kalman filter."""

    transitions: Array
    """(models, 2, 2): of (charge, drift an hour) or (charge, 1)."""
    noise: Array
    """(models, 2, 2)."""
    reading: float
    """Variance of a measured charge."""
    chain: Array
    """(models, models), [from, to]."""
    start: Array
    start_variance: Array


def kalman(wander: float, keeps: float) -> Peer:
    transition = np.array([[[1.0, 1.0], [0.0, keeps]]])
    noise = np.array([[[1e-6, 0.0], [0.0, wander**2]]])
    return Peer(
        transition, noise, NOISE**2, np.ones((1, 1)), np.array([0.5, -0.02]), np.diag([0.36, 0.05**2])
    )


def imm(spread: float, stays: float, rare: float) -> Peer:
    transition = np.array([[[1.0, rate], [0.0, 1.0]] for rate in RATES])
    noise = np.array([[[spread**2, 0.0], [0.0, 0.0]]] * len(RATES))
    usual = np.array([0.72, 0.14, 0.04, 0.10])
    chain = stays * np.eye(4) + (1 - stays) * (usual * (1 - rare) + rare / 4)
    return Peer(transition, noise, NOISE**2, chain, np.array([0.5, 1.0]), np.diag([0.36, 0.0]))


def tuned(make: Callable[..., Peer], grid: Sequence[tuple[float, ...]], life: Life, heard: Array) -> Peer:
    """The peer of the grid with the least error on a life that is not reported."""

    def error(numbers: tuple[float, ...]) -> float:
        mean, _, _ = run(make(*numbers), life, heard)
        return float(np.nanmean((np.clip(mean, 0, 1) - life.primary) ** 2))

    return make(*min(grid, key=error))


KALMAN_GRID = list(itertools.product((0.003, 0.01, 0.03), (0.0, 0.5, 0.8, 0.95)))
IMM_GRID = list(itertools.product((0.003, 0.01, 0.03), (0.5, 0.7, 0.85), (0.0, 0.2)))


def run(peer: Peer, life: Life, heard: Array) -> tuple[Array, Array, Array]:
    """(mean, variance, most probable model) of every aMussel and hour; NaN before its first packet."""
    agents, hours = life.primary.shape
    count = len(peer.transitions)
    x = np.tile(peer.start, (agents, count, 1))
    cov = np.tile(peer.start_variance, (agents, count, 1, 1))
    modes: Array = np.full((agents, count), 1 / count)
    known = np.zeros(agents, bool)
    means, variances, models = (np.full((agents, hours), np.nan) for _ in range(3))
    for hour in range(hours):
        x, cov, arriving = _mixed(peer, x, cov, modes)
        x = np.einsum("mij,amj->ami", peer.transitions, x)
        cov = peer.transitions @ cov @ peer.transitions.transpose(0, 2, 1) + peer.noise
        modes = arriving
        here = heard[:, hour]
        known |= here
        if here.any():
            z, stated = life.measured[here, hour, 0], _SEEN_AS[life.doing[here, hour]]
            x[here], cov[here], modes[here] = _corrected(peer, x[here], cov[here], modes[here], z, stated)
        mean = np.einsum("am,am->a", modes, x[:, :, 0])
        spread = cov[:, :, 0, 0] + (x[:, :, 0] - mean[:, None]) ** 2
        means[known, hour] = mean[known]
        variances[known, hour] = np.einsum("am,am->a", modes, spread)[known]
        models[known, hour] = modes.argmax(axis=1)[known]
    return means, variances, models


def _mixed(peer: Peer, x: Array, cov: Array, modes: Array) -> tuple[Array, Array, Array]:
    arriving = modes @ peer.chain
    share = peer.chain * modes[:, :, None] / arriving[:, None, :]
    mixed = np.einsum("aij,aik->ajk", share, x)
    away = x[:, :, None, :] - mixed[:, None, :, :]
    spread = np.einsum("aij,aijk,aijl->ajkl", share, away, away)
    return mixed, np.einsum("aij,aikl->ajkl", share, cov) + spread, arriving


def _corrected(
    peer: Peer,
    x: Array,
    cov: Array,
    modes: Array,
    z: Array,
    stated: Array,
) -> tuple[Array, Array, Array]:
    total = cov[:, :, 0, 0] + peer.reading
    gain = cov[:, :, :, 0] / total[:, :, None]
    away = z[:, None] - x[:, :, 0]
    likelihood = np.exp(-0.5 * away**2 / total) / np.sqrt(total) + 1e-300
    modes = modes * likelihood
    if modes.shape[1] > 1:
        stated_likelihood = np.full(modes.shape, 0.01)
        stated_likelihood[np.arange(len(z)), stated] = 0.97
        modes = modes * stated_likelihood
    modes /= modes.sum(axis=1, keepdims=True)
    return x + gain * away[:, :, None], cov - gain[..., None] * cov[:, :, None, 0, :], modes


def like_filterpy(peer: Peer, life: Life, heard: Array, agent: int) -> float:
    """The largest difference of the means between `run` and filterpy's own classes on one aMussel."""
    mean, _, _ = run(peer, life, heard)
    filters = []
    for transition, noise in zip(peer.transitions, peer.noise, strict=True):
        one = KalmanFilter(dim_x=2, dim_z=1)
        one.x, one.P = peer.start.copy(), peer.start_variance.copy()
        one.F, one.Q, one.H = transition, noise, np.array([[1.0, 0.0]])
        one.R = np.array([[peer.reading]])
        filters.append(one)
    theirs = filters[0]
    if len(filters) > 1:
        theirs = IMMEstimator(filters, np.full(len(filters), 1 / len(filters)), peer.chain)
    worst, known = 0.0, False
    for hour in range(life.primary.shape[1]):
        theirs.predict()
        if heard[agent, hour]:
            known = True
            theirs.update(np.array([life.measured[agent, hour, 0]]))
            if len(filters) > 1:
                _state(theirs, int(_SEEN_AS[life.doing[agent, hour]]))
        elif len(filters) > 1:
            # filterpy's predict() does not update the mode probabilities: do that step here.
            theirs.mu = theirs.cbar.copy()
            theirs._compute_mixing_probabilities()
            theirs._compute_state_estimate()
        if known:
            worst = max(worst, abs(float(theirs.x[0]) - mean[agent, hour]))
    return worst


def _state(theirs: IMMEstimator, stated: int) -> None:
    """Updates filterpy's estimator with a packet that states its mode."""
    likelihood = np.full(theirs.N, 0.01)
    likelihood[stated] = 0.97
    theirs.mu = theirs.mu * likelihood / (theirs.mu * likelihood).sum()
    theirs._compute_mixing_probabilities()
    theirs._compute_state_estimate()


def modes_right(models: Array, life: Life) -> Array:
    """True where the most probable model is the aMussel's mode; on the way up or down no mode is claimed."""
    right: npt.NDArray[np.bool_] = (
        (models == _SEEN_AS[life.doing]) & (life.doing != Doing.SURFACING) & (life.doing != Doing.FLOATING)
    )
    return right

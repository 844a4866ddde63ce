"""The queue of a mobile charger that serves the nearest request, solved by its Markov chain: the judge of `njnp`.

The model is that of L. He, Y. Gu, J. Pan, T. Zhu, "On-Demand Charging in Wireless Sensor Networks: Theories and
Applications", MASS 2013, as far as we know it: we could read the abstract, and no formula or figure, so the derivation
below is ours. Requests come as a Poisson process from uniformly random places of a square. One charger with a constant
speed goes to the nearest of them and charges it there for a constant time.

The chain counts the requests that wait when a service ends. A service with k waiting lasts for the way to the nearest of k,
and the charging. The approximation is in the law of that way: each decision finds the charger and all requests at new
random places. The mean number of requests at the ends of services is that at any time, because they come and go one by one
and at random times (PASTA). The latency follows by Little's law. It lasts from the request until the charging ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache
from math import asinh, lgamma, pi, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEAN_WAY = (2 + sqrt(2) + 5 * asinh(1)) / 15
"""The mean distance between two random points of the unit square."""

_CELLS, _FINE = 800, 20
"""Cells of distance between 0 and the diagonal, and the steps of the integration in each."""
_MOST = 150
"""Requests that the chain counts."""
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, slots=True)
class RequestQueue:
    """A charger in a square of `side_m`, and its requests: `rate_per_s` of them in a second, in the long run."""

    side_m: float
    speed_m_s: float
    charge_s: float
    rate_per_s: float


class Law(Enum):
    """The law of the way to the nearest of k requests. F is that of the distance between two random points."""

    INDEPENDENT = "independent"
    """P(way > r) = (1 - F(r))^k, as if each request had a charger of its own."""
    BY_PLACE = "by place"
    """The same for each place of the charger, and then the mean over its places: they share one charger."""


def density(distance: Array) -> Array:
    """The density of the distance between two random points of the unit square (B. Ghosh, 1951)."""
    beyond = np.sqrt(np.maximum(distance**2 - 1, 0.0))
    near = pi - 4 * distance + distance**2
    far = 4 * beyond - (distance**2 + 2 - pi) - 4 * np.arctan(beyond)
    return np.asarray(2 * distance * np.where(distance <= 1, near, far), np.float64)


def edges() -> Array:
    """The borders of the cells of distance in the unit square."""
    return np.linspace(0.0, sqrt(2), _CELLS + 1, dtype=np.float64)


@cache
def distribution() -> Array:
    """F at each border, by the trapezoidal rule."""
    fine = np.linspace(0.0, sqrt(2), _CELLS * _FINE + 1, dtype=np.float64)
    height = density(fine)
    steps = (height[1:] + height[:-1]) / 2 * np.diff(fine)
    summed: Array = np.concatenate([[0.0], np.cumsum(steps)])[::_FINE]
    return np.asarray(summed / summed[-1], np.float64)


@cache
def _share_within() -> tuple[Array, Array]:
    """The share of the unit square that is no farther than each border, from many places; and the places' weights."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    along, along_weights = np.polynomial.legendre.leggauss(60)
    quarter = (nodes + 1) / 4  # the four quarters are alike
    shares = []
    for north in quarter:
        for east in quarter:
            low, high = np.maximum(0, north - edges()), np.minimum(1, north + edges())
            cut = low[:, None] + (along + 1) / 2 * (high - low)[:, None]
            half = np.sqrt(np.maximum(edges()[:, None] ** 2 - (cut - north) ** 2, 0.0))
            chord = np.minimum(1, east + half) - np.maximum(0, east - half)
            shares.append(np.minimum(chord @ along_weights / 2 * (high - low), 1.0))
    return np.array(shares), np.outer(weights, weights).ravel() / 4


def nearest(waiting: int, law: Law) -> Array:
    """The probability that the nearest of `waiting` requests lies in each cell of distance."""
    if law is Law.INDEPENDENT:
        farther = (1 - distribution()) ** waiting
    else:
        shares, weights = _share_within()
        farther = weights @ (1 - shares) ** waiting
    result: Array = -np.diff(farther)
    return result


def _middle_m(queue: RequestQueue) -> Array:
    result: Array = queue.side_m * (edges()[1:] + edges()[:-1]) / 2
    return result


def busy_rate_per_s(queue: RequestQueue, waiting: int, law: Law = Law.INDEPENDENT) -> float:
    """The throughput of a charger for which so many requests wait at each decision."""
    way_m = float(nearest(waiting, law) @ _middle_m(queue))
    return 1 / (way_m / queue.speed_m_s + queue.charge_s)


def latency_s(queue: RequestQueue, law: Law = Law.INDEPENDENT, *, turns: bool = False) -> float:
    """The mean time from a request until its charging ends. With `turns` a nearer request turns the charger round.

    Raises ValueError where more than a millionth of the services ends with 150 waiting: there is no steady state, or the
    chain is too short for it.
    """
    ways = _came_by_way(queue, turns)
    came = np.array([ways @ nearest(waiting, law) for waiting in range(1, _MOST)])
    chain = np.zeros((_MOST, _MOST))
    for left in range(_MOST):
        waiting = max(left, 1)  # an idle charger begins with the next request
        chain[left, waiting - 1 :] = came[waiting - 1, : _MOST - waiting + 1]
        chain[left, -1] += 1 - chain[left].sum()
    balance = (chain - np.eye(_MOST)).T
    balance[-1] = 1.0
    share = np.linalg.solve(balance, np.eye(_MOST)[-1])
    if share[-1] > _NEGLIGIBLE:
        raise ValueError(f"{queue} has more than {_MOST} requests too often")
    return float(share @ np.arange(_MOST)) / queue.rate_per_s


def _came_by_way(queue: RequestQueue, turns: bool) -> Array:
    """The probability that n requests come in a service (a row for each n) whose way begins in a cell (a column)."""
    on_way = queue.rate_per_s * _middle_m(queue) / queue.speed_m_s
    charging = queue.rate_per_s * queue.charge_s
    if not turns:
        return _poisson(on_way + charging)
    while_charging = _poisson(np.array([charging]))[:, 0]
    travelled = _came_while_turning(queue)
    return np.array([while_charging[: n + 1][::-1] @ travelled[: n + 1] for n in range(_MOST)])


def _poisson(mean: Array) -> Array:
    count = np.arange(_MOST)[:, None]
    of_factorial = np.array([lgamma(n + 1) for n in range(_MOST)])[:, None]
    result: Array = np.exp(count * np.log(np.maximum(mean, 1e-300)) - mean - of_factorial)
    return result


def _came_while_turning(queue: RequestQueue) -> Array:
    """The probability that n requests come on a way that each nearer one shortens, for a way that begins in each cell.

    With p_n(y) for a way y and a = rate / speed: p_n' = a (-p_n + (1 - F(y)) p_(n-1)(y) + integral of p_(n-1) dF up to y).
    Heun's method, from p_0(0) = 1 on.
    """
    per_cell = queue.rate_per_s / queue.speed_m_s * queue.side_m * sqrt(2) / _CELLS
    below = distribution()
    came, nearer = np.eye(_MOST)[0], np.zeros(_MOST)
    at_borders = [came]

    def before(one: Array) -> Array:
        return np.concatenate([[0.0], one[:-1]])

    def slope(came: Array, nearer: Array, cell: int) -> Array:
        result: Array = -came + (1 - below[cell]) * before(came) + before(nearer)
        return result

    for cell in range(_CELLS):
        risen, more = slope(came, nearer, cell), below[cell + 1] - below[cell]
        tried = came + per_cell * risen
        tried_nearer = nearer + more * (came + tried) / 2
        following = came + per_cell / 2 * (risen + slope(tried, tried_nearer, cell + 1))
        nearer = nearer + more * (came + following) / 2
        came = following
        at_borders.append(came)
    borders = np.array(at_borders)
    result: Array = ((borders[1:] + borders[:-1]) / 2).T
    return result

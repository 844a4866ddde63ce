"""Behaviour of filterpy that our code must not rely on. If a test fails, filterpy has changed: review our code."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter, update


def two_models(chain: np.ndarray) -> IMMEstimator:
    filters = []
    for drift in (0.0, -0.1):
        one = KalmanFilter(dim_x=2, dim_z=1)
        one.x = np.array([0.9, drift])
        one.F, one.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
        one.P, one.Q, one.R = np.diag([1e-4, 0.0]), np.diag([drift**2 / 4, 0.0]), np.array([[2e-4]])
        filters.append(one)
    return IMMEstimator(filters, np.array([1.0, 0.0]), chain)


CHAIN = np.array([[0.7, 0.3], [0.1, 0.9]])


def test_predict_alone_never_moves_the_modes_probabilities() -> None:
    theirs = two_models(CHAIN)
    for _ in range(20):
        theirs.predict()
    assert list(theirs.mu) == [1.0, 0.0]


def test_update_without_a_reading_scores_it_as_a_reading() -> None:
    theirs = two_models(CHAIN)
    theirs.predict()
    theirs.update(np.array([0.8]))
    by_chain = theirs.mu @ CHAIN
    theirs.predict()
    theirs.update(None)
    assert not np.allclose(theirs.mu, by_chain)


def test_the_chain_is_indexed_from_to() -> None:
    assert list(two_models(CHAIN).cbar) == list(CHAIN[0])


def test_a_gross_outlier_makes_all_likelihoods_alike() -> None:
    theirs = two_models(CHAIN)
    theirs.predict()
    before = theirs.cbar.copy()
    theirs.update(np.array([-300.0]))
    assert np.allclose(
        theirs.mu, before
    )  # both likelihoods are at the floor: the information about the modes is lost


def test_nothing_holds_a_charge_in_its_range() -> None:
    one = KalmanFilter(dim_x=1, dim_z=1)
    one.x, one.F = np.array([0.05]), np.array([[1.0]])
    one.B = np.array([[1.0]])
    one.predict(u=np.array([-0.2]))
    assert one.x[0] < 0


def test_its_log_likelihood_is_that_of_the_posterior() -> None:
    arguments = (np.array([0.0]), np.array([[1.0]]), np.array([3.0]), np.array([[1.0]]), np.array([[1.0]]))
    *_, likelihood = update(*arguments, return_all=True)
    prior, posterior = (-0.5 * (away**2 / 2 + np.log(2 * np.pi * 2)) for away in (3.0, 1.5))
    assert np.isclose(likelihood, posterior) and not np.isclose(likelihood, prior)


def test_it_is_imported_only_by_those_who_filter() -> None:
    """filterpy takes half a second to import, and imports scipy and matplotlib."""
    code = (
        "import sys, apad_bridge.commands.main, apad_bridge.supervisor.supervisor, apad_bridge.assembly.flight_parts; "
        "sys.exit(bool({'filterpy', 'scipy', 'matplotlib'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_it_is_imported_without_a_warning() -> None:
    code = "import filterpy.kalman"
    subprocess.run([sys.executable, "-W", "error", "-c", code], timeout=60, check=True)

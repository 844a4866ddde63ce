"""Behaviour of filterpy that our code must not rely on. If a test fails, filterpy has changed: review our code."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from filterpy.kalman import update


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

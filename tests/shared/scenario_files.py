"""Scenarios of the tests' own, so that tuning a shipped scenario changes only the tests that are about it."""

from __future__ import annotations

from pathlib import Path

SCENARIO_FILES = Path(__file__).with_name("scenarios")
POOL_FILE = SCENARIO_FILES / "pool.yaml"
"""12 aMussels of the worst case in a pool of 28 x 21 m."""
WHOLE_FILE = SCENARIO_FILES / "whole.yaml"
"""The same with whole boards, which sleep."""
SOUND_FILE = SCENARIO_FILES / "sound.yaml"
"""The same by sound, on twins."""

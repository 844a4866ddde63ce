"""Scenarios of the tests' own, so that tuning a shipped scenario changes only the tests that are about it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from apad_bridge.scenario.schema import Scenario

SCENARIO_FILES = Path(__file__).with_name("scenarios")
POOL_FILE = SCENARIO_FILES / "pool.yaml"
"""12 aMussels of the worst case in a pool of 28 x 21 m."""
WHOLE_FILE = SCENARIO_FILES / "whole.yaml"
"""The same with whole boards, which sleep."""
SOUND_FILE = SCENARIO_FILES / "sound.yaml"
"""The same by sound, on twins."""

_TWIN = {
    "drain_deviation": 0.05,
    "sensor_noise": 0.01,
    "bias_deviation": 0.01,
    "unscheduled": 0.01,
    "fix_deviation_m": 1.0,
}


def write_scenario(path: Path, base: Path = POOL_FILE, /, **changes: Any) -> Path:
    """Writes the base by the file's name, with other values: a block keeps what its change does not name."""
    data = changed({**resolve(load(base)), "name": path.stem}, changes)
    write_resolved(path, from_data(data, path.stem))
    return path


def changed(block: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    def value(old: Any, new: Any) -> Any:
        return changed(old, new) if isinstance(old, dict) and isinstance(new, dict) else new

    return block | {key: value(block.get(key), new) for key, new in changes.items()}


def silent_in_its_dock(generation: str = "a") -> Scenario:
    """One aMussel whose packets are lost from its docking on. Its twin believes that it charges, and it is released."""
    data = resolve(load(POOL_FILE))
    data |= {"theta": 30, "duration_s": 150, "beliefs": {"estimator": "twin", "twin": _TWIN}}
    data["fleet"] |= {"count": 1, "start": {"charge": [0.75, 0.75]}, "hosting": "one_process"}
    data["apad"] |= {"dock_miss_probability": 0.0, "generation": generation}
    data["mission"] |= {"batch": 1, "pool_threshold": 0.8, "full_threshold": 0.85, "silence_timeout_s": 900}
    data["faults"] = {"at": [{"fault": "link_cut", "at_s": 30, "id": 1, "for_s": 120}]}
    return from_data(data, "silent")

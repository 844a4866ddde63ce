"""The vehicle's watchdog as a module: a script without an ending, which nothing else can import."""

from __future__ import annotations

import importlib.util
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parents[2] / "launch_scripts" / "vehicle_watchdog"


def loaded() -> Any:
    loader = SourceFileLoader("vehicle_watchdog", str(SCRIPT))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


WATCHDOG = loaded()

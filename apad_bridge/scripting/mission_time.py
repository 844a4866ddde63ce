"""The `time` that a script is given: its sleep follows mission time, its clocks show mission time, the rest is Python's."""

from __future__ import annotations

import time
import types
from typing import Any

from apad_bridge.scripting.api import Api


class MissionTime(types.ModuleType):
    """Stands where a script says `time` or `import time`: seconds since the flight began."""

    def __init__(self, api: Api) -> None:
        super().__init__("time", "Mission time, for a script of an aPad.")
        self.sleep = api.sleep
        self.time = self.monotonic = self.perf_counter = api.now
        self.time_ns = self.monotonic_ns = self.perf_counter_ns = lambda: round(api.now() * 1e9)

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)

"""The simulated aPad as a hull whose position and battery leave it on topics of their own, for a relay in between.

    python -m safety.nodes.hull --scenario RESOLVED.yaml [--tether METRES]

The place that it publishes on /hull/position is the truth, whatever a relay makes of it on /apad1/position. SIGUSR1 ties it
to where it is: from then on nothing takes it further from there than METRES.
"""

from __future__ import annotations

import math
import runpy
import signal
import sys
from dataclasses import replace
from typing import Any

import rosgraph.names

from apad_bridge.vehicle.simulated import motion

REMAPPED = {f"/apad1/{leaf}": f"/hull/{leaf}" for leaf in ("position", "battery_level")}


def remap() -> None:
    """Does what `FROM:=TO` does on the command line of any other node."""
    known = rosgraph.names.load_mappings
    rosgraph.names.load_mappings = lambda argv: known(argv) | REMAPPED


def tie_on_signal(length_m: float) -> None:
    free = motion.Motion.end_step
    tied: list[tuple[float, float]] = []
    is_asked: list[bool] = []
    signal.signal(signal.SIGUSR1, lambda *_: is_asked.append(True))

    def end_step(self: Any) -> None:
        before = self.pose
        free(self)
        if is_asked and not tied:
            tied.append((before.north_m, before.east_m))
        if tied and math.dist(tied[0], (self.pose.north_m, self.pose.east_m)) > length_m:
            self.pose = replace(before, north_m_s=0.0, east_m_s=0.0)

    motion.Motion.end_step = end_step  # type: ignore[method-assign]


if __name__ == "__main__":
    remap()
    if "--tether" in sys.argv:
        at = sys.argv.index("--tether")
        tie_on_signal(float(sys.argv[at + 1]))
        del sys.argv[at : at + 2]
    runpy.run_module("apad_bridge.ros.simulated_node.apad_node", run_name="__main__", alter_sys=True)

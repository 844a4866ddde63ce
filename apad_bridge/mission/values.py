"""What a script is given and told: places, aMussels as they are believed to be, events, statuses. Docks count from 1 here.

The one place where a dock's number becomes the wire's slot, and back, is in this file too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from apad_bridge.mission.pool import DOCK_COUNT
from apad_bridge.vehicle.commands import Manoeuvre

DOCKS = tuple(range(1, DOCK_COUNT + 1))
"""As people count them, and the paper's API."""


KINDS = ("goto", "docking", "docked", "undocked", "heard", "state", "low")
"""Of events: see `Event`."""


class Refused(ValueError):
    """The API cannot do what it was asked: one line, with the mend. Nothing has changed."""


class Status(IntEnum):
    """Of a primitive. 0 to 3 are the numbers of the field's aPads (`goto_status`, `docking_status`); 4 is ours."""

    IDLE = 0
    RUNNING = 1
    PREEMPTED = 2
    DONE = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Location:
    """Degrees, and metres north and east of the scenario's origin."""

    lat: float
    lon: float
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Agent:
    """An aMussel as it is believed to be. Charges are the paper's scaled voltage; `age_s` is since it was last heard."""

    id: int
    state: str
    battery: float
    secondary: float
    location: Location
    age_s: float
    dock: int | None
    """1 to 4, or None for one in the water."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at mission time `at_s`.

    `kind` is "goto" or "docking" (a primitive's status changed: see `status`, and `reason` when it failed), "docked",
    "undocked" (a mechanism closed or opened, asked for or not), "heard" (for the first time), "state" (it is believed in
    another state, `reason`), "low" (its charge fell to the pool's threshold).
    """

    at_s: float
    kind: str
    agent: int | None = None
    dock: int | None = None
    status: Status | None = None
    reason: str | None = None


def manoeuvre_of(yaw_rate_rad_s: float | None, surge_m_s: float | None) -> Manoeuvre:
    """Refused for what is not above 0; None is what the scenario says."""
    for what, value in (("yaw rate", yaw_rate_rad_s), ("surge speed", surge_m_s)):
        if value is not None and not 0 < value < math.inf:
            raise Refused(f"a {what} of {value}: it must be above 0, or left out")
    return Manoeuvre(yaw_rate_rad_s, surge_m_s)


def dock_index_of(dock: int) -> int:
    """The wire's slot (0-3) of a dock's number (1-4). Refused for anything else."""
    if dock not in DOCKS or isinstance(dock, bool):
        raise Refused(f"there is no dock {dock!r}: the docks are {DOCKS[0]} to {DOCKS[-1]}")
    return dock - 1


def dock_of(dock_index: int) -> int:
    """The number of a slot."""
    return dock_index + 1

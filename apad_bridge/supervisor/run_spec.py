"""The task of a flight in one value: its start, the sources of its commands, and its end."""

from __future__ import annotations

from dataclasses import dataclass

from agents.time_scale import TICK_MS, MissionMs
from apad_bridge.events.mission_events import MissionState
from apad_bridge.events.person_events import Steering
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.manual import CommandSource
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.guards.stops import NO_STOPS, StopsState
from apad_bridge.vehicle.outcomes import PrimitiveFailed

_COMMAND_IDS_PER_EPOCH = 1_000_000


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """The point at which a resumed flight continues, from the newest lines of the journal."""

    now_ms: MissionMs
    state: MissionState
    epoch: int
    apad_fraction_at_start: float | None
    first_failure: PrimitiveFailed | None = None
    """The failure that the docking port had latched."""
    stops: StopsState = NO_STOPS
    steering: Steering = Steering.PERSON
    """The party that had taken the aPad from the mission, where the flight is by hand."""


@dataclass(frozen=True, slots=True)
class RunSpec:
    """The start, the sources of commands and the end of a flight."""

    resume_point: ResumePoint | None = None
    """None: the flight starts at the mission's beginning."""
    learned: LearnedState | None = None
    """State that a former supervisor learned; None for none."""
    command_sources: tuple[CommandSource, ...] | None = None
    """If there are any, they command the aPad, and no mission of our own runs."""
    calls: CallQueue | None = None
    """The queue of calls that can take the mission over."""
    until_first_plan: bool = False
    """The flight ends with the first plan instead of the mission."""

    @property
    def start_ms(self) -> MissionMs:
        """The mission time of the flight's first tick."""
        return MissionMs(0 if self.resume_point is None else self.resume_point.now_ms + TICK_MS)

    @property
    def first_command_id(self) -> int:
        """The id of the first command to the vehicle, beyond those of every former supervisor."""
        return 1 + (0 if self.resume_point is None else self.resume_point.epoch * _COMMAND_IDS_PER_EPOCH)


FROM_START = RunSpec()
"""The scenario's own mission, from its beginning to its end."""

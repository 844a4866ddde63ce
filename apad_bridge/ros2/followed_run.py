"""Follows a run by its journal, as a console does, and gives its state. The flight does nothing for it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.events.fleet_events import BeliefChanged
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.records.journal import Entry, JournalTail
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.run_state import RunState
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.ros_names.shown_fleet import APadTrack, PlaceM, ShownAMussel
from apad_bridge.scenario.run_options import RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario

_NEWEST_MS = 5000
"""The aPad's velocity comes from two places that are at most so much mission time apart, and old."""
_JUMP_MS = 2000
"""Wall time against mission time: a supervisor that was away for longer has shifted them."""


@dataclass(frozen=True, slots=True)
class MovingAPad:
    event: APadMoved
    forward_m_s: float
    left_m_s: float
    turn_rad_s: float
    """Anticlockwise, as ROS has it."""


class FollowedRun:
    """`poll` takes what is new in the journal; all else is as of `now_ms`."""

    def __init__(self, directory: RunDirectory, scenario: Scenario) -> None:
        """OSError for a directory without a journal; ValueError for options that cannot be read."""
        options = RunOptions.load(directory.path)
        self.namespace = options.namespace
        self.has_wall_time = options.time is TimeSource.WALL and options.speed == 1
        """Mission time runs as the wall clock does; else stamps are mission time, and readers need /clock."""
        self._path = directory.journal
        self._journal = JournalTail(self._path)
        self._water = TruthExtrapolator(scenario)
        self._scale = scenario.time_scale
        self.state = RunState(scenario)
        self._offset_ms: int | None = None
        self._ended_s: float | None = None
        self._believed_ms: dict[int, int] = {}
        self._newest: tuple[tuple[int, APadMoved], ...] = ()
        """The newest two places of the aPad, with their mission times."""
        self.track = APadTrack()

    def close(self) -> None:
        self._journal.close()

    def poll(self) -> list[Entry]:
        """Takes the new events and returns them: at the first call all since the begin. JournalDamaged."""
        written_ns = self._path.stat().st_mtime_ns
        new = self._journal.read_new()
        for at_ms, event in new.entries:
            self.state.apply(at_ms, event)
            if isinstance(event, BeliefChanged):
                self._believed_ms[event.id] = event.heard if event.mode is None else at_ms
            elif isinstance(event, APadMoved):
                self._newest = (*self._newest[-1:], (at_ms, event))
                self.track.extend((event.north_m, event.east_m))
        if self.state.ended_by is not None and self._ended_s is None:
            self._ended_s = time.monotonic()
        if new.entries and (self._offset_ms is None or written_ns == self._path.stat().st_mtime_ns):
            self._set_clock(written_ns // 1_000_000)
        return new.entries

    @property
    def now_ms(self) -> MissionMs:
        """The newest mission time. After the end it goes on by the wall clock, for readers who come then."""
        after_s = 0.0 if self._ended_s is None else time.monotonic() - self._ended_s
        return MissionMs(self.state.last_ms + int(1000 * after_s))

    def stamp_ms(self, at_ms: int) -> int:
        """The stamp of a message about a mission time: Unix time, or the mission time itself."""
        return max(0, at_ms + (self._offset_ms or 0))

    @property
    def apad(self) -> MovingAPad | None:
        event = self.state.apad
        return None if event is None else MovingAPad(event, *self._velocity(event))

    @property
    def plan_m(self) -> list[PlaceM]:
        """The places of the plan's unfinished steps, in order; those that are not known are left out."""
        plan, beliefs = self.state.plan, self.state.beliefs
        if plan is None:
            return []
        places = plan.places_m or tuple(
            (beliefs[it].north_m, beliefs[it].east_m) if it in beliefs else None for it, _ in plan.steps
        )
        return [it for it in places[len(places) - plan.left :] if it is not None]

    @property
    def beliefs(self) -> list[ShownAMussel]:
        """The aMussels that were heard, by id."""
        return [self._believed(event) for _, event in sorted(self.state.beliefs.items())]

    @property
    def truths(self) -> list[tuple[int, PlaceM, float]]:
        """The id, the place and the depth in metres of each simulated aMussel, by id."""
        agent_ms = self._scale.agent_ms(self.now_ms)
        found = []
        for agent_id, truth in sorted(self.state.truths.items()):
            it = self._water.sample(truth, max(agent_ms, truth.at_ms))
            place_m = self._place_of_docked(it.docked) or (it.north_m, it.east_m)
            found.append((agent_id, place_m, it.depth_m))
        return found

    def _believed(self, event: BeliefChanged) -> ShownAMussel:
        """A docked aMussel is where the aPad is."""
        is_docked = event.id in self.state.docks
        return ShownAMussel(
            agent_id=event.id,
            state=event.state,
            mode=event.likely_mode,
            charge=event.charge,
            secondary=event.secondary,
            place_m=self._place_of_docked(is_docked) or (event.north_m, event.east_m),
            depth_m=0.0 if is_docked else (event.reported or {}).get("depth_m", 0.0),
            place_cov=event.place_cov,
            heard_ms=event.heard,
            at_ms=self._believed_ms[event.id],
            is_docked=is_docked,
        )

    def _place_of_docked(self, is_docked: bool) -> PlaceM | None:
        apad = self.state.apad
        return (apad.north_m, apad.east_m) if is_docked and apad is not None else None

    def _velocity(self, now: APadMoved) -> tuple[float, float, float]:
        if len(self._newest) < 2:
            return 0.0, 0.0, 0.0
        (before_ms, before), (at_ms, _) = self._newest
        span_ms = at_ms - before_ms
        if not 0 < span_ms <= _NEWEST_MS or self.now_ms - at_ms > _NEWEST_MS:
            return 0.0, 0.0, 0.0
        north = 1000 * (now.north_m - before.north_m) / span_ms
        east = 1000 * (now.east_m - before.east_m) / span_ms
        cos, sin = math.cos(now.heading_rad), math.sin(now.heading_rad)
        turned = math.remainder(before.heading_rad - now.heading_rad, math.tau)
        return north * cos + east * sin, north * sin - east * cos, 1000 * turned / span_ms

    def _set_clock(self, written_ms: int) -> None:
        """The journal's newest line was written at its tick. Once set, the offset stays, so that stamps do not sway."""
        offset_ms = written_ms - self.state.last_ms if self.has_wall_time else 0
        if self._offset_ms is None or abs(offset_ms - self._offset_ms) > _JUMP_MS:
            self._offset_ms = offset_ms

"""Docking and undocking for a commanded mission: one at a time, from the order to its end.

A docking follows the paper's mission: permit the aMussel to surface, wait until it floats, then close the
mechanism.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.charging_watch import ChargingWatch
from apad_bridge.mission.event_log import EventLog
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import PermitSurfacing, TellClear
from apad_bridge.mission.pool import floats, is_surfacing_or_floating
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.mission.values import Refused, Status, dock_of
from apad_bridge.scenario.schema import Mission
from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, Manoeuvre
from apad_bridge.vehicle.docking import PRE_EMPTED
from apad_bridge.vehicle.primitives import DockMussel, UndockMussel
from firmware_model.state_groups import BEYOND_HELP


class SurfacingStep(Enum):
    WAIT = auto()
    PERMIT = auto()
    """Send the permission to surface (again)."""
    CLOSE = auto()
    """The aMussel floats: the mechanism may close."""


class GivenUp(Exception):
    """Ends the routine; the text is the reason."""


@dataclass(slots=True)
class SurfacingWait:
    """Decides the next step at every tick, until the aMussel floats or the scenario's times (`Mission`) are over."""

    dock_index: int
    agent_id: int
    since_ms: int
    permissions: int = 0

    def next_step(self, belief: Belief | None, config: Mission, now_ms: int) -> SurfacingStep:
        """The step at `now_ms`; raises GivenUp."""
        if belief is not None and floats(belief):
            return SurfacingStep.CLOSE
        waited_ms = now_ms - self.since_ms
        if belief is not None and is_surfacing_or_floating(belief):
            if waited_ms > config.silence_timeout_s * 1000:
                raise GivenUp("it does not come up")
            return SurfacingStep.WAIT
        if waited_ms < config.permission_repeat_s * 1000 * self.permissions:
            return SurfacingStep.WAIT
        if self.permissions >= config.surfacing_attempts:
            raise GivenUp("it does not answer the permission to surface")
        self.permissions += 1
        return SurfacingStep.PERMIT


REACH_M = 3.0
"""An aMussel believed beyond this (or twice the victory radius) is out of a mechanism's reach."""


class DockingRoutine:
    """Writes orders and notes into the mission's book. Dock indices count from 0; places are NED metres."""

    def __init__(self, config: Mission, beliefs: BeliefSource, book: OrderBook, events: EventLog) -> None:
        self.status = Status.IDLE
        self.order_count = 0
        """Number of accepted orders to dock or undock."""
        self._config = config
        self._beliefs = beliefs
        self._book = book
        self._events = events
        self._charging_watch = ChargingWatch(config.full_threshold, config.full_when, 0)
        self._surfacing: SurfacingWait | None = None
        self._permitted: int | None = None
        """The aMussel that was permitted to surface last, on the way to it."""
        self._mechanism: DockMussel | UndockMussel | None = None
        self._manoeuvre = DEFAULT_MANOEUVRE

    def belief_of(self, agent_id: int) -> Belief:
        """The belief about an aMussel. Refused when the aMussel was never heard."""
        belief = self._beliefs.get(agent_id)
        if belief is None:
            # In ROS 1 a field that is left out of a call is 0.
            hint = "" if agent_id else ": say the aMussel's id, which is 0 where it is left out"
            raise Refused(f"aMussel {agent_id} was never heard{hint}")
        return belief

    def is_full(self, agent_id: int) -> bool:
        """The aMussel is believed full, by the scenario's definition."""
        return self._charging_watch.is_full(self._beliefs.get(agent_id))

    def refuse_dock(self, dock_index: int, agent_id: int, here: tuple[float, float]) -> None:
        """Refused for an aMussel that cannot be docked from here."""
        belief, docks = self.belief_of(agent_id), self._book.docks
        if docks[dock_index] is not None:
            raise Refused(f"dock {dock_of(dock_index)} holds aMussel {docks[dock_index]}")
        if agent_id in docks:
            raise Refused(f"aMussel {agent_id} is in dock {dock_of(docks.index(agent_id))} already")
        if belief.state in BEYOND_HELP:
            raise Refused(f"aMussel {agent_id} is lost: it can no longer surface")
        self._refuse_beyond_reach(belief, here)

    def dock(
        self, dock_index: int, agent_id: int, manoeuvre: Manoeuvre, here: tuple[float, float], now_ms: int
    ) -> None:
        """Begins a docking, with the permission to surface unless that was sent already; `advance` continues it."""
        self._begin()
        self._manoeuvre = manoeuvre
        self._surfacing = SurfacingWait(dock_index, agent_id, now_ms, int(agent_id == self._permitted))
        self._permitted = None
        self.advance(here, now_ms)

    def permit_surfacing(self, agent_id: int) -> None:
        """Sends the permission ahead of a docking, which then repeats it in the scenario's time and not at once."""
        self._permitted = agent_id
        self._book.order(PermitSurfacing(agent_id))

    def undock(self, dock_index: int, manoeuvre: Manoeuvre, now_ms: int) -> None:
        agent_id = self._book.docks[dock_index]
        if agent_id is None:
            raise Refused(f"dock {dock_of(dock_index)} is empty")
        self.pre_empt(now_ms)
        self._begin()
        # A service counts by the belief at the order: on the way down the aMussel draws from its battery again.
        self._book.set(leaves_full=self.is_full(agent_id))
        self._mechanism = UndockMussel(self._book.next_id(), dock_index, agent_id, manoeuvre)
        self._book.order(self._mechanism)

    def advance(self, here: tuple[float, float], now_ms: int) -> None:
        """Checks whether the aMussel has surfaced, and takes the next step."""
        waiting = self._surfacing
        if waiting is None:
            return
        belief = self._beliefs.get(waiting.agent_id)
        try:
            step = waiting.next_step(belief, self._config, now_ms)
            if step is SurfacingStep.CLOSE and belief is not None:
                self._refuse_beyond_reach(belief, here)
        except (GivenUp, Refused) as given_up:
            self._book.note("given_up", agent=waiting.agent_id, what="dock", reason=str(given_up))
            self._end_surfacing(Status.FAILED, str(given_up), now_ms)
            return
        if step is SurfacingStep.PERMIT:
            self._book.order(PermitSurfacing(waiting.agent_id))
        elif step is SurfacingStep.CLOSE:
            self._surfacing = None
            self._mechanism = DockMussel(
                self._book.next_id(), waiting.dock_index, waiting.agent_id, self._manoeuvre
            )
            self._book.order(self._mechanism)

    def pre_empt(self, now_ms: int) -> None:
        """Ends the wait for another primitive. Once the mechanism is ordered, the port decides instead."""
        self._end_surfacing(Status.PREEMPTED, PRE_EMPTED, now_ms)

    def paused_for(self, pause_ms: int) -> None:
        """Prolongs the wait for an aMussel by a pause, in which the mission sends no permissions."""
        if self._surfacing is not None:
            self._surfacing.since_ms += pause_ms

    def ended(self, primitive_id: int, status: Status, reason: str | None, now_ms: int) -> None:
        """Takes the port's outcome; an outcome of another primitive changes nothing."""
        if self._mechanism is None or primitive_id != self._mechanism.primitive_id:
            return
        ended, self._mechanism = self._mechanism, None
        if isinstance(ended, UndockMussel) and status is Status.DONE:
            self._released(ended.agent_id)
        self._end(status, ended.agent_id, ended.dock_index, reason, now_ms)

    def _begin(self) -> None:
        self.status = Status.RUNNING
        self.order_count += 1

    def _refuse_beyond_reach(self, belief: Belief, here: tuple[float, float]) -> None:
        away_m = math.dist(here, (belief.north_m, belief.east_m))
        if away_m > max(REACH_M, 2 * self._config.victory_radius_m):
            raise Refused(f"aMussel {belief.agent_id} is believed {away_m:.1f} m away: go there first")

    def _end_surfacing(self, status: Status, reason: str, now_ms: int) -> None:
        if self._surfacing is not None:
            dock_index, agent_id = self._surfacing.dock_index, self._surfacing.agent_id
            self._surfacing = None
            self._end(status, agent_id, dock_index, reason, now_ms)

    def _end(self, status: Status, agent_id: int, dock_index: int, reason: str | None, now_ms: int) -> None:
        self.status = status
        self._events.record(now_ms, "docking", agent_id, dock_of(dock_index), status, reason)

    def _released(self, agent_id: int) -> None:
        full = self._book.state.leaves_full
        self._book.order(TellClear(agent_id))
        self._book.note("released", agent=agent_id, full=full)
        self._book.set(services=self._book.state.services + full)

"""Docking and undocking, one at a time: for the paper's mission, for scripts, for calls by hand, and after a takeover.

A docking follows the paper: permit the aMussel to surface, wait until it floats, close the mechanism around it. An
undocking opens the mechanism, tells the aMussel that it is clear to sink, and counts a service.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.charging_watch import is_full
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import PermitSurfacing, TellClear
from apad_bridge.mission.pool import floats, is_surfacing_or_floating
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.scenario.schema import Mission
from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, Manoeuvre
from apad_bridge.vehicle.primitives import (
    DockMussel,
    PrimitiveFailed,
    PrimitiveSucceeded,
    UndockMussel,
)


class DockingStep(Enum):
    """The routine's act at a tick."""

    WAIT = auto()
    PERMIT = auto()
    """It sent the permission to surface (again)."""
    CLOSE = auto()
    """The aMussel floats: it ordered the mechanism to close."""


class GivenUp(Exception):
    """The aMussel is not docked: the routine has ended, and the text is the reason."""


class OutOfReach(GivenUp):
    """The aMussel floats, but not where the aPad is."""


@dataclass(slots=True)
class SurfacingWait:
    """Decides the next step at every tick, until the aMussel floats or the scenario's times (`Mission`) are over."""

    agent_id: int
    since_ms: int
    permissions: int = 0
    """Number of permissions sent since `since_ms`, and the one before the aPad set out."""

    def next_step(self, belief: Belief | None, config: Mission, now_ms: int) -> DockingStep:
        """The step at `now_ms`; raises GivenUp."""
        if belief is not None and floats(belief):
            return DockingStep.CLOSE
        waited_ms = now_ms - self.since_ms
        if belief is not None and is_surfacing_or_floating(belief):
            if waited_ms > config.silence_timeout_s * 1000:
                raise GivenUp("it does not come up")
            return DockingStep.WAIT
        if waited_ms < config.permission_repeat_s * 1000 * self.permissions:
            return DockingStep.WAIT
        if self.permissions >= config.surfacing_attempts:
            raise GivenUp("it does not answer the permission to surface")
        self.permissions += 1
        return DockingStep.PERMIT


class DockingRoutine:
    """Writes orders, notes and the count of services into the mission's book.

    Dock indices count from 0; places are (north, east) in metres; times are mission milliseconds. It keeps nothing over a
    resume: the mission begins the step under way anew.
    """

    def __init__(self, config: Mission, beliefs: BeliefSource, book: OrderBook, reach_m: float) -> None:
        """An aMussel believed farther away than `reach_m` is out of a mechanism's reach."""
        self._config = config
        self._beliefs = beliefs
        self._book = book
        self._reach_m = reach_m
        self._permitted: int | None = None
        """The aMussel that was permitted to surface last, on the way to it."""
        self._wait: SurfacingWait | None = None
        self._next: DockMussel | None = None
        """The order to give when the aMussel of `_wait` floats; None while the aPad is on its way to it."""
        self.mechanism: DockMussel | UndockMussel | None = None
        """The order that the port carries out; another mission's routine goes on with it after a takeover."""

    def permit_surfacing(self, agent_id: int) -> None:
        """Sends the permission ahead of a docking, which then repeats it in the scenario's time and not at once."""
        self._permitted = agent_id
        self._book.order(PermitSurfacing(agent_id))

    def call_up(self, agent_id: int, now_ms: int) -> None:
        """Permits the aMussel to surface, and has `advance` repeat it while the aPad is on its way to it."""
        self._next = None
        self._wait = SurfacingWait(agent_id, now_ms, permissions=1)
        self.permit_surfacing(agent_id)

    def dock(
        self, dock_index: int, agent_id: int, now_ms: int, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE
    ) -> None:
        """Begins a docking where the aPad is; `advance` permits the aMussel to surface, waits, and closes the mechanism."""
        self._wait = SurfacingWait(agent_id, now_ms, int(agent_id == self._permitted))
        self._next = DockMussel(0, dock_index, agent_id, manoeuvre)
        self._permitted = None

    def undock(self, dock_index: int, agent_id: int, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE) -> None:
        """Opens the mechanism that holds the aMussel.

        A service counts by the belief at this order: on the way down the aMussel draws from its battery again.
        """
        self._wait = self._next = None
        self._book.set(leaves_full=is_full(self._beliefs.get(agent_id), self._config))
        self.mechanism = UndockMussel(self._book.next_id(), dock_index, agent_id, manoeuvre)
        self._book.order(self.mechanism)

    def advance(self, here: tuple[float, float], now_ms: int) -> DockingStep:
        """Takes the next step. GivenUp, and the routine has ended, when the aMussel cannot be docked from `here`.

        On the way to the aMussel it only repeats the permission.
        """
        wait, order = self._wait, self._next
        if wait is None:
            return DockingStep.WAIT
        belief = self._beliefs.get(wait.agent_id)
        try:
            step = wait.next_step(belief, self._config, now_ms)
            if step is DockingStep.CLOSE and belief is not None and order is not None:
                self.check_reach(belief, here)
        except GivenUp:
            if order is None:
                return DockingStep.WAIT  # the aPad finds out when it is there
            self._wait = self._next = None
            raise
        if step is DockingStep.PERMIT:
            self._book.order(PermitSurfacing(wait.agent_id))
        elif step is DockingStep.CLOSE:
            if order is None:
                return DockingStep.WAIT
            self._close(order)
        return step

    def check_reach(self, belief: Belief, here: tuple[float, float]) -> None:
        """Raises OutOfReach for an aMussel that is believed too far from `here`."""
        away_m = math.dist(here, (belief.north_m, belief.east_m))
        if away_m > self._reach_m:
            raise OutOfReach(f"aMussel {belief.agent_id} is believed {away_m:.1f} m away: go there first")

    def pre_empt(self) -> bool:
        """Ends the wait for an aMussel. True if a docking waited; an ordered mechanism is the port's to end."""
        waited = self._next is not None
        self._wait = self._next = None
        return waited

    def paused_for(self, pause_ms: int) -> None:
        """Prolongs the wait for an aMussel by a pause, in which the mission sends no permissions."""
        if self._wait is not None:
            self._wait.since_ms += pause_ms

    def receive(self, outcome: PrimitiveSucceeded | PrimitiveFailed) -> bool:
        """Takes the outcome of a primitive; False, and nothing happens, if it is not the mechanism's."""
        if self.mechanism is None or outcome.primitive_id != self.mechanism.primitive_id:
            return False
        ended, self.mechanism = self.mechanism, None
        if isinstance(ended, UndockMussel) and isinstance(outcome, PrimitiveSucceeded):
            self.released(ended.agent_id)
        return True

    def released(self, agent_id: int) -> None:
        """Ends an undocking: the aMussel is free."""
        full = self._book.state.leaves_full
        self._book.order(TellClear(agent_id))
        self._book.note("released", agent=agent_id, full=full)
        self._book.set(services=self._book.state.services + full)

    def _close(self, order: DockMussel) -> None:
        self._wait = self._next = None
        self.mechanism = replace(order, primitive_id=self._book.next_id())
        self._book.order(self.mechanism)

"""Docking and undocking, one at a time: for the paper's mission, for scripts, for calls by hand, and after a takeover.

A docking follows the paper: permit the aMussel to surface, wait until it floats, close the mechanism around it. An
undocking opens the mechanism, tells the aMussel that it is clear to sink, and counts a service.

Where the aMussel does not float within the catch radius, the aPad searches for it (`docking_search.py`), and tries the
docking at each point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import AMusselReleased
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.mission.docking.dock_witnesses import doubt
from apad_bridge.mission.docking.docking_search import SEARCH_S, DockingSearch
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import PermitSurfacing, SendCommand
from apad_bridge.mission.policy.charged_enough import is_charged
from apad_bridge.mission.policy.pool import floats, is_surfacing_or_floating
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, CloseDock, GoTo, Manoeuvre, OpenDock
from apad_bridge.vehicle.outcomes import NothingCaught, PrimitiveEnded, PrimitiveFailed, PrimitiveSucceeded
from firmware_model.packets import Kind


class DockingStep(Enum):
    """The routine's act at a tick."""

    WAIT = auto()
    PERMIT = auto()
    """It sent the permission to surface (again)."""
    CLOSE = auto()
    """The aMussel floats: it ordered the mechanism to close."""


class Progress(Enum):
    """The meaning of an outcome for the routine."""

    NOT_OURS = auto()
    """The outcome is that of somebody else's primitive."""
    GOES_ON = auto()
    """The docking goes on with another primitive."""
    ENDED = auto()
    """The docking or undocking ended with this outcome."""
    NOT_FOUND = auto()
    """The search is over without the aMussel."""


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

    def next_step(self, belief: Belief | None, config: Mission, now_ms: MissionMs) -> DockingStep:
        """The step at `now_ms`; raises GivenUp. The caller counts a permission when it sends it."""
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
        return DockingStep.PERMIT


class DockingRoutine:
    """Writes orders, notes and the count of services into the mission's book.

    Dock indices count from 0; places are (north, east) in metres; times are mission milliseconds. It keeps nothing over a
    resume: the mission begins the step under way anew.
    """

    def __init__(self, config: Mission, beliefs: BeliefSource, book: OrderBook, reach_m: float) -> None:
        """An aMussel believed farther away than `reach_m` is out of a mechanism's reach."""
        self.config = config
        self._beliefs = beliefs
        self._book = book
        self._reach_m = reach_m
        self._permitted: int | None = None
        """The aMussel that was permitted to surface last, on the way to it."""
        self._wait: SurfacingWait | None = None
        self._next: CloseDock | None = None
        """The order to give when the aMussel of `_wait` floats; None while the aPad is on its way to it."""
        self._search: DockingSearch | None = None
        self.mechanism: CloseDock | OpenDock | None = None
        """The order that the port carries out; another mission's routine goes on with it after a takeover."""

    def permit_surfacing(self, agent_id: int) -> None:
        """Sends the permission ahead of a docking, which then repeats it in the scenario's time and not at once."""
        self._permitted = agent_id
        self._book.order(PermitSurfacing(agent_id))

    def call_up(self, agent_id: int, now_ms: MissionMs) -> None:
        """Permits the aMussel to surface, and has `advance` repeat it while the aPad is on its way to it."""
        self._next = self._search = None
        self._wait = SurfacingWait(agent_id, now_ms, permissions=1)
        self.permit_surfacing(agent_id)

    def dock(
        self, dock_index: int, agent_id: int, now_ms: MissionMs, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE
    ) -> None:
        """Begins a docking where the aPad is; `advance` permits the aMussel to surface, waits, and closes the mechanism."""
        self._wait = SurfacingWait(agent_id, now_ms, int(agent_id == self._permitted))
        self._next = CloseDock(0, dock_index, agent_id, manoeuvre)
        self._permitted = self._search = None

    def undock(self, dock_index: int, agent_id: int, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE) -> None:
        """Opens the mechanism that holds the aMussel.

        A service counts by the belief at this order: on the way down the aMussel draws from its battery again. It counts
        where the docking has more witnesses than the vehicle.
        """
        self._wait = self._next = self._search = None
        belief = self._beliefs.get(agent_id)
        leaves_full = is_charged(belief, self.config)
        if leaves_full and (reason := doubt(belief, self._book.named.get(agent_id))) is not None:
            self._book.emit(DocksDisagree(agent_id, reason))
            leaves_full = False
        self._book.set(leaves_full=leaves_full)
        self.mechanism = OpenDock(self._book.next_id(), dock_index, agent_id, manoeuvre)
        self._book.order(self.mechanism)

    def advance(self, here: tuple[float, float], now_ms: MissionMs) -> DockingStep:
        """Takes the next step. GivenUp, and the routine has ended, when the aMussel cannot be docked from `here`.

        On the way to the aMussel it only repeats the permission.
        """
        wait, order = self._wait, self._next
        if wait is None:
            return DockingStep.WAIT
        belief = self._beliefs.get(wait.agent_id)
        try:
            step = wait.next_step(belief, self.config, now_ms)
            if step is DockingStep.CLOSE and belief is not None and order is not None:
                self.check_reach(belief, here)
        except GivenUp:
            if order is None:
                return DockingStep.WAIT  # the aPad finds out when it is there
            self._wait = self._next = None
            raise
        if step is DockingStep.PERMIT:
            wait.permissions += 1
            self._book.order(PermitSurfacing(wait.agent_id))
        elif step is DockingStep.CLOSE:
            if order is None:
                return DockingStep.WAIT
            self._close(order)
        return step

    def is_due(self, now_ms: MissionMs) -> bool:
        """Tells whether `advance` does something at `now_ms`, by the belief of that time. The question changes nothing."""
        wait, is_on_the_way = self._wait, self._next is None
        if wait is None:
            return False
        try:
            step = wait.next_step(self._beliefs.get(wait.agent_id), self.config, now_ms)
        except GivenUp:
            return not is_on_the_way
        return step is DockingStep.PERMIT or (step is DockingStep.CLOSE and not is_on_the_way)

    def check_reach(self, belief: Belief, here: tuple[float, float]) -> None:
        """Raises OutOfReach for an aMussel that is believed too far from `here`."""
        if (away_m := math.dist(here, (belief.north_m, belief.east_m))) > self._reach_m:
            raise OutOfReach(f"aMussel {belief.agent_id} is believed {away_m:.1f} m away: go there first")

    @property
    def is_on_search(self) -> bool:
        """A go-to of a search is under way."""
        return self._search is not None and self._search.go_to_id is not None

    def pre_empt(self) -> bool:
        """Ends the wait or the search for an aMussel. True if there was one; an ordered mechanism is the port's to end."""
        waited = self._next is not None or self.is_on_search
        self._wait = self._next = self._search = None
        return waited

    def paused_for(self, pause_ms: int) -> None:
        """Prolongs the wait for an aMussel by a pause, in which the mission sends no permissions."""
        if self._wait is not None:
            self._wait.since_ms += pause_ms

    def receive(self, outcome: PrimitiveEnded, now_ms: MissionMs) -> Progress:
        """Takes the outcome of a primitive; nothing happens if it is not the routine's."""
        search, mechanism = self._search, self.mechanism
        if search is not None and outcome.primitive_id == search.go_to_id:
            search.go_to_id = None
            if isinstance(outcome, PrimitiveFailed):
                self._search = None
                return Progress.ENDED
            self._close(search.order)
            return Progress.GOES_ON
        if mechanism is None or outcome.primitive_id != mechanism.command_id:
            return Progress.NOT_OURS
        self.mechanism = None
        if isinstance(outcome, NothingCaught) and isinstance(mechanism, CloseDock):
            return self._search_on(mechanism, now_ms)
        self._search = None
        if isinstance(mechanism, OpenDock) and isinstance(outcome, PrimitiveSucceeded):
            self.released(mechanism.agent_id)
        return Progress.ENDED

    def _search_on(self, order: CloseDock, now_ms: MissionMs) -> Progress:
        """Goes to the next point of the search, and begins a search if there is none."""
        here, belief = self._book.here, self._beliefs.get(order.agent_id)
        if self._search is None:
            self._search = DockingSearch(order, now_ms + round(SEARCH_S * 1000), self.config)
        if now_ms >= self._search.until_ms or belief is None or not floats(belief):
            self._search = None
            return Progress.NOT_FOUND
        point_m = self._search.next_point(belief, here, now_ms)
        # The victory radius is less than half of the pitch, or the aPad would cut the spiral's corners.
        radius_m = min(self.config.victory_radius_m, self._search.pitch_m / 2)
        go_to = GoTo(self._book.next_id(), *point_m, self.config.speed_m_s, radius_m)
        self._search.go_to_id = go_to.command_id
        self._book.order(go_to)
        return Progress.GOES_ON

    def released(self, agent_id: int) -> None:
        """Ends an undocking: the aMussel is free."""
        full = self._book.state.leaves_full
        self._book.order(SendCommand(Kind.RELEASE, agent_id))
        self._book.emit(AMusselReleased(agent_id, full))
        self._book.set(services=self._book.state.services + full)

    def _close(self, order: CloseDock) -> None:
        self._wait = self._next = None
        self.mechanism = replace(order, command_id=self._book.next_id())
        self._book.order(self.mechanism)

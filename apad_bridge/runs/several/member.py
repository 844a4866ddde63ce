"""The link of one of several aPads' supervisors to their parent, over ROS: applies its orders, reports to it.

The orders name the aMussels to serve; the reports are messages of `parent_protocol`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import HandedOn, TookOn
from apad_bridge.mission.facts import StandDownRequested
from apad_bridge.mission.stand_down_rule import Breakdown
from apad_bridge.runs.parent_protocol import (
    ORDERS_FILE,
    APadView,
    Gave,
    Kept,
    MemberReport,
    Orders,
    TransferredBelief,
)
from apad_bridge.runs.several.assignment import view_of
from apad_bridge.runs.several.lockstep import ASSIGNMENT_PERIOD_MS
from apad_bridge.scenario.blocks.mission_options import DockingProfile
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.supervisor import Supervisor


class MemberLink:
    """Runs in the flight's thread, as a watcher of its ticks."""

    def __init__(
        self,
        run_dir: Path,
        name: str,
        start_m: tuple[float, float],
        report: Callable[[MemberReport], None],
        cannot_move: frozenset[int] = frozenset(),
    ) -> None:
        """`cannot_move` are the aMussels that no other aPad can serve."""
        self._cannot_move = cannot_move
        self._run_dir = run_dir
        self._name = name
        self._start_m = start_m
        self._report = report
        self._stamp: tuple[int, int] | None = None
        self._pending: dict[int, TransferredBelief] = {}
        """aMussels to take on when this mission's time reaches the time of the transferred belief."""
        self._stood_down = False
        self._events: list[Event] = []

    def watcher(self, supervisor: Supervisor) -> Watcher:
        def watch(now_ms: MissionMs) -> None:
            orders = self._new_orders()
            if orders is not None:
                self._apply_orders(orders, supervisor, now_ms)
            self._take_pending(supervisor, now_ms)
            if orders is not None or now_ms % ASSIGNMENT_PERIOD_MS == 0:
                self._report(self._view(supervisor))

        return watch

    def take_events(self, now_ms: int) -> list[Event]:
        """Returns the events since the last call, for the journal."""
        events, self._events = self._events, []
        return events

    def _new_orders(self) -> Orders | None:
        """The orders, when they are new. The parent replaces the file as a whole, so it can be read at any time."""
        try:
            status = (self._run_dir / ORDERS_FILE).stat()
        except FileNotFoundError:
            return None
        stamp = (status.st_mtime_ns, status.st_ino)
        if stamp == self._stamp:
            return None
        self._stamp = stamp
        return Orders.load(self._run_dir)

    def _apply_orders(self, orders: Orders, supervisor: Supervisor, now_ms: MissionMs) -> None:
        if orders.stands_down is not None and not self._stood_down:
            self._stood_down = True
            supervisor.receive(StandDownRequested(now_ms, orders.stands_down))
        allocation = supervisor.allocation
        movable = self._view(supervisor).movable
        gave: dict[int, TransferredBelief] = {}
        kept = []
        for agent_id in sorted(allocation.served - orders.serves.keys()):
            if agent_id not in movable:
                kept.append(agent_id)
                continue
            belief = supervisor.beliefs.get(agent_id)
            estimate = None if belief is None else supervisor.beliefs.estimator.kept(belief)
            gave[agent_id] = TransferredBelief(now_ms, estimate)
            supervisor.stop_serving(agent_id)
            self._events.append(HandedOn(agent_id))
        self._pending = {
            it: transfer for it, transfer in orders.serves.items() if it not in allocation.served
        }
        if gave:
            self._report(Gave(gave))
        if kept:
            self._report(Kept(tuple(kept)))

    def _take_pending(self, supervisor: Supervisor, now_ms: int) -> None:
        """Takes on the aMussels whose transferred belief is not in the future.

        Missions of several aPads begin within some seconds of each other, so another aPad's time may be ahead.
        """
        for agent_id, transfer in list(self._pending.items()):
            if now_ms < transfer.at_ms:
                continue
            del self._pending[agent_id]
            estimator = supervisor.beliefs.estimator
            supervisor.start_serving(
                agent_id,
                None if transfer.estimate is None else estimator.restored(agent_id, transfer.estimate),
            )
            self._events.append(TookOn(agent_id))

    def _view(self, supervisor: Supervisor) -> APadView:
        view = view_of(self._name, self._start_m, supervisor)
        return replace(view, movable=view.movable - self._cannot_move)


def join_others(
    context: FlightContext,
    scenario: Scenario,
    options: RunOptions,
    run_dir: Path,
    report: Callable[[MemberReport], None],
) -> FlightContext:
    """The same context, with the link to the parent for one of several aPads that take over from each other."""
    if not options.is_one_of_several:
        return context
    apad, profile_of = scenario.apad, scenario.mission.docking.profile_of
    # Only the run that simulates an aMussel knows what a camera would see of it.
    cannot_move = frozenset(it for it in scenario.fleet.ids if profile_of(it) is DockingProfile.CAMERA)
    link = MemberLink(run_dir, apad.name, apad.start_m, report, cannot_move)
    watchers, take_events = context.watchers, context.take_events
    return replace(
        context,
        watchers=lambda supervisor: (link.watcher(supervisor), *watchers(supervisor)),
        take_events=lambda now_ms: [*link.take_events(now_ms), *take_events(now_ms)],
        stands_down=Breakdown(scenario.sharing.failed_go_tos),
    )

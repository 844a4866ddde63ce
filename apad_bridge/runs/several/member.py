"""One of several aPads over ROS: does what the parent of all orders about whom it serves, and says whom it could spare.

A line of JSON, `{"squad": ...}`, is what it says: `seen` for the planner, `gave` with what is believed of those that it has
handed on, `kept` for those that it cannot hand on at the moment. Its thread is the flight's.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.mission.events import StandDownAsked
from apad_bridge.records.journal import JournalContents
from apad_bridge.runs.resuming import StartState
from apad_bridge.runs.several.assignment import Seen, seen_of
from apad_bridge.runs.several.lockstep import LOOK_MS
from apad_bridge.runs.several.protocol import NAME, Handed, Orders, seen_data
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.schema import DockingProfile, Scenario
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.core import Supervisor

Event = tuple[str, dict[str, Any]]


class MemberLink:
    def __init__(
        self,
        run_dir: Path,
        name: str,
        start_m: tuple[float, float],
        say: Callable[[str], None],
        stays: frozenset[int] = frozenset(),
    ) -> None:
        """`stays` are those that cannot be served elsewhere."""
        self._stays = stays
        self._run_dir = run_dir
        self._name = name
        self._start_m = start_m
        self._say = say
        self._stamp: tuple[int, int] | None = None
        self._awaited: dict[int, Handed] = {}
        """To be taken on when this mission's time has come as far as what is believed of them."""
        self._stood_down = False
        self._events: list[Event] = []

    def watcher(self, supervisor: Supervisor) -> Watcher:
        def watch(now_ms: int) -> None:
            orders = self._look()
            if orders is not None:
                self._obey(orders, supervisor, now_ms)
            self._take_awaited(supervisor, now_ms)
            if orders is not None or now_ms % LOOK_MS == 0:
                self._tell("seen", seen_data(self._seen(supervisor), supervisor.allocation))

        return watch

    def noticed(self, now_ms: int) -> list[Event]:
        """What was done since it was last asked, for the journal."""
        events, self._events = self._events, []
        return events

    def _look(self) -> Orders | None:
        """The orders, when they are new. They are replaced whole, so what is there can be read."""
        try:
            status = (self._run_dir / NAME).stat()
        except FileNotFoundError:
            return None
        stamp = (status.st_mtime_ns, status.st_ino)
        if stamp == self._stamp:
            return None
        self._stamp = stamp
        return Orders.load(self._run_dir)

    def _obey(self, orders: Orders, supervisor: Supervisor, now_ms: int) -> None:
        if orders.stands_down is not None and not self._stood_down:
            self._stood_down = True
            supervisor.receive(StandDownAsked(now_ms, orders.stands_down))
        allocation = supervisor.allocation
        movable = self._seen(supervisor).movable
        gave, kept = [], []
        for agent_id in sorted(allocation.served - orders.serves.keys()):
            if agent_id not in movable:
                kept.append(agent_id)
                continue
            belief = supervisor.beliefs.get(agent_id)
            gave.append(
                [agent_id, now_ms, None if belief is None else supervisor.beliefs.estimator.kept(belief)]
            )
            supervisor.hand_on(agent_id)
            self._events.append(("handed_on", {"id": agent_id}))
        self._awaited = {it: handed for it, handed in orders.serves.items() if it not in allocation.served}
        if gave:
            self._tell("gave", gave)
        if kept:
            self._tell("kept", kept)

    def _take_awaited(self, supervisor: Supervisor, now_ms: int) -> None:
        """Missions of several aPads begin within some seconds of each other, so another's now may be to come here."""
        for agent_id, handed in list(self._awaited.items()):
            if now_ms < handed.at_ms:
                continue
            del self._awaited[agent_id]
            estimator = supervisor.beliefs.estimator
            supervisor.take_on(
                agent_id, None if handed.kept is None else estimator.restored(agent_id, handed.kept)
            )
            self._events.append(("took_on", {"id": agent_id}))

    def _seen(self, supervisor: Supervisor) -> Seen:
        seen = seen_of(self._name, self._start_m, supervisor)
        return replace(seen, movable=seen.movable - self._stays)

    def _tell(self, kind: str, data: Any) -> None:
        self._say(json.dumps({"squad": {kind: data}}))


@dataclass(frozen=True, slots=True)
class MemberParts:
    """What one of several aPads' supervisors has beside its own: a seat, and whom it serves."""

    link: MemberLink
    allocation: Allocation
    failed_go_tos: int

    def around(self, context: FlightContext) -> FlightContext:
        """The same with the seat in them."""
        watchers, noticed = context.watchers, context.noticed
        return replace(
            context,
            watchers=lambda supervisor: (self.link.watcher(supervisor), *watchers(supervisor)),
            noticed=lambda now_ms: [*self.link.noticed(now_ms), *noticed(now_ms)],
            breakdown=Breakdown(self.failed_go_tos),
        )


def member_parts(
    scenario: Scenario,
    options: RunOptions,
    run_dir: Path,
    start_state: StartState,
    say: Callable[[str], None],
) -> MemberParts | None:
    """None for one that is alone."""
    if not options.is_one_of_several:
        return None
    allocation = Allocation(start_state.beliefs, scenario.fleet.ids)
    share_again(allocation, start_state.journal)
    for agent_id in allocation.served_for_others:
        start_state.beliefs.admit(agent_id, None)
    apad, profile_of = scenario.apad, scenario.mission.docking.profile_of
    # What a camera would see of them is known beside their fleet alone.
    stays = frozenset(it for it in scenario.fleet.ids if profile_of(it) is DockingProfile.CAMERA)
    link = MemberLink(run_dir, apad.name, apad.start_m, say, stays)
    return MemberParts(link, allocation, scenario.sharing.failed_go_tos)


def share_again(allocation: Allocation, journal: JournalContents) -> None:
    """Whom a former supervisor of the run served, according to its journal."""
    for line in journal.lines:
        if line["kind"] == "took_on":
            allocation.take(line["id"])
        elif line["kind"] == "handed_on":
            allocation.give(line["id"])

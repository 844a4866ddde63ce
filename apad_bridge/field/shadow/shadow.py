"""Somebody else's mission beside ours: at each of their decisions, what our strategy would have done on our beliefs.

The shadow only reads facts: of a bag, or of a graph that it listens to. It keeps beliefs as a supervisor does, from the
packets of their aMussels, from those aMussels' own topics, or from a supervisor's fresh beliefs where a bag has nothing
else. Each later packet tells how far the estimate had gone wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import dist

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.measurement import Docked, Released
from apad_bridge.events.mission_events import MissionState
from apad_bridge.field.field_log.log_facts import (
    AmusselCharged,
    AmusselPlaced,
    BeliefsReport,
    Held,
    LoggedFact,
    PacketLogged,
    Place,
    Posed,
    Witness,
    Work,
    WorkBegan,
    WorkEnded,
)
from apad_bridge.field.shadow.compared import (
    ELSEWHERE,
    Accuracy,
    ComparedBelief,
    ComparedDecision,
    TheirMove,
)
from apad_bridge.field.shadow.our_choice import Moment, OurChoice
from apad_bridge.field.shadow.shadow_beliefs import ShadowBeliefs
from apad_bridge.mission.policy.home_places import with_exchanged_homes, with_new_homes
from apad_bridge.planning.registry import Trust
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.schema import Scenario
from firmware_model.packets import StatusPacket

_SETTLED_MS = 500
"""Half a tick after their order all is heard that they knew: ROS keeps no order between topics."""
_SAME_MS = 2000
"""The vehicle and a supervisor tell of one go-to within this time."""
_JOINED_MS = 10_000
"""So long after the first fact, the vehicle may report a dock that was filled before: subscribing takes time."""


@dataclass(slots=True)
class _Pending:
    """A decision of theirs, from its begin on: a go-to whose purpose is not known yet, until `theirs` is.

    Our choice waits for all that was said at the same time as their order.
    """

    at_ms: MissionMs
    goal_m: Place | None = None
    theirs: TheirMove | None = None
    ours: TheirMove | None = None
    beliefs: dict[int, Belief] | None = None


class Shadow:
    """`take` returns the decisions that a fact completes, and `end` the last ones. Facts come in the order heard."""

    def __init__(self, scenario: Scenario, trust: Trust | None = None) -> None:
        """ScenarioError, or ValueError, for a scenario whose board or strategy cannot be loaded.

        A strategy in a file is executed with `trust` alone.
        """
        self.decisions: list[ComparedDecision] = []
        self._mission = scenario.mission
        self._beliefs = ShadowBeliefs(scenario)
        self._choice = OurChoice(scenario, self._beliefs.fleet, trust)
        self._state = MissionState(dock_count=scenario.apad.docks)
        self._place_m: Place | None = None
        self._pose_witness = Witness.SUPERVISOR
        self._supervised_ms: int | None = None
        """The time of a supervisor's first sample, which tells what the docks hold already; None without a supervisor.

        With one, the vehicle's own silence about a dock may be a busy network's.
        """
        self._ordered: set[int] = set()
        """aMussels of which the shadow heard an order to dock, or knew the dock before: their dockings are new ones."""
        self._begin_s: float | None = None
        self._now_ms = MissionMs(0)
        self._pending: _Pending | None = None
        self._last: TheirMove | None = None
        """Their last decision."""
        self._collects = False
        """Their last decision was to collect: the batch is under way."""
        self._works: dict[str, WorkBegan] = {}

    def take(self, fact: LoggedFact) -> list[ComparedDecision]:
        if self._begin_s is None:
            self._begin_s = fact.at_s
        done = len(self.decisions)
        now_ms = MissionMs(max(self._now_ms, round(1000 * (fact.at_s - self._begin_s))))
        if now_ms > self._now_ms:
            if self._pending is not None and now_ms > self._pending.at_ms + _SETTLED_MS:
                self._choose()
            self._now_ms = now_ms
            self._beliefs.fleet.advance(now_ms)
        self._learn(fact)
        return self.decisions[done:]

    def end(self) -> list[ComparedDecision]:
        """Completes the go-to under way."""
        done = len(self.decisions)
        self._choose()
        self._resolve_by_place()
        return self.decisions[done:]

    @property
    def accuracy(self) -> Accuracy:
        return self._beliefs.accuracy

    def _learn(self, fact: LoggedFact) -> None:
        match fact:
            case Posed(_, witness, _, place_m):
                if witness is Witness.SUPERVISOR and self._supervised_ms is None:
                    self._supervised_ms = self._now_ms
                if witness is Witness.VEHICLE or self._pose_witness is Witness.SUPERVISOR:
                    self._pose_witness, self._place_m = witness, place_m
            case PacketLogged(_, agent_id, _, data):
                self._heard(self._beliefs.packet(agent_id, data, self._now_ms))
            case AmusselPlaced(_, agent_id, place_m):
                self._topics(agent_id, place_m, None)
            case AmusselCharged(_, agent_id, charge):
                self._topics(agent_id, None, charge)
            case BeliefsReport():
                self._heard(self._beliefs.of_others(fact, self._now_ms))
            case Held(_, witness, agent_id, is_held):
                if witness is Witness.SUPERVISOR or self._supervised_ms is None:
                    self._held(
                        agent_id, is_held=is_held, was_held=is_held and self._was_held(agent_id, witness)
                    )
            case WorkBegan():
                self._began(fact)
            case WorkEnded(_, _, key, is_done):
                self._ended(key, is_done=is_done)
            case _:
                pass

    def _topics(self, agent_id: int, place_m: Place | None, charge: float | None) -> None:
        is_docked = agent_id in self._docked
        self._heard(self._beliefs.topics(agent_id, place_m, charge, is_docked=is_docked, now_ms=self._now_ms))

    def _heard(self, believed: list[StatusPacket]) -> None:
        for packet in believed:
            homes = with_new_homes(self._state.homes, self._beliefs.fleet.all())
            self._state = replace(self._state, homes=homes)
            self._record_error(packet)

    def _record_error(self, packet: StatusPacket) -> None:
        """Completes the estimates of the aMussel's decisions, which this packet is the first to check."""
        for n, it in enumerate(self.decisions):
            estimate = it.estimate
            if it.theirs.agent_id != packet.agent_id or estimate is None or estimate.told_after_s is not None:
                continue
            after_s = self._now_ms / 1000 - it.at_s
            told = replace(
                estimate,
                charge_error=estimate.charge - packet.primary,
                place_error_m=dist(estimate.place_m, (packet.north_m, packet.east_m)),
                told_after_s=after_s,
            )
            self.decisions[n] = replace(it, estimate=told)

    # What they do.

    @property
    def _docked(self) -> dict[int, int]:
        return {agent_id: dock_index for dock_index, agent_id in self._state.docked}

    def _was_held(self, agent_id: int, witness: Witness) -> bool:
        """The dock that now tells of this aMussel was filled before the shadow listened: no decision that it heard."""
        if agent_id in self._ordered:
            return False
        if witness is Witness.SUPERVISOR:
            return self._now_ms == self._supervised_ms
        return self._now_ms <= _JOINED_MS

    def _held(self, agent_id: int, *, is_held: bool, was_held: bool) -> None:
        """`was_held`: the dock is full, and was so before; what we would have done with an empty one does not count."""
        docked = self._docked
        if is_held == (agent_id in docked) or agent_id not in self._beliefs.ids:
            return
        move = TheirMove(StepKind.COLLECT if is_held else StepKind.DEPLOY, agent_id)
        if was_held:
            self._choice.forget()
            if self._pending is not None:
                self._pending.ours = None
        else:
            if move != self._last:
                self._resolve(move)
            if self._pending is not None and self._pending.theirs is not None:
                self._choose()  # as the docks were before
        self._ordered.add(agent_id)
        self._choice.charging.restart(agent_id)
        if is_held:
            if not (free := set(range(self._state.dock_count)) - set(docked.values())):
                return
            docked[agent_id] = min(free)
            self._beliefs.fleet.learn(agent_id, Docked(), self._now_ms)
            self._choice.charging.begin(docked, self._now_ms)
        else:
            del docked[agent_id]
            if self._place_m is not None:
                self._beliefs.fleet.learn(agent_id, Released(*self._place_m), self._now_ms)
                if self._mission.exchanges_places:
                    self._take_place(agent_id, self._place_m)
            released = dict(self._state.released) | {agent_id: self._now_ms}
            self._state = replace(self._state, released=tuple(sorted(released.items())))
        self._state = replace(
            self._state, docked=tuple(sorted((index, agent) for agent, index in docked.items()))
        )

    def _take_place(self, agent_id: int, place_m: Place) -> None:
        """The released one takes the place at which it was released from whoever had it."""
        homes = self._state.homes
        other = min(homes, key=lambda it: (dist(place_m, it[1:]), it[0]), default=(agent_id,))[0]
        self._state = replace(self._state, homes=with_exchanged_homes(homes, [(agent_id, other)]))

    def _began(self, began: WorkBegan) -> None:
        self._works[began.key] = began
        agent_id = began.agent_id
        if began.work is Work.DOCK and agent_id is not None:
            self._ordered.add(agent_id)
            if agent_id not in self._docked:
                self._resolve(TheirMove(StepKind.COLLECT, agent_id))
        elif began.work is Work.UNDOCK and agent_id is not None and agent_id in self._docked:
            self._resolve(TheirMove(StepKind.DEPLOY, agent_id))
        elif began.work is Work.GO_TO and not self._is_same(began.goal_m):
            self._resolve_by_place()
            self._pending = _Pending(self._now_ms, began.goal_m)

    def _is_same(self, goal_m: Place | None) -> bool:
        """A hold, or a go-to that another witness or another try repeats, is no decision."""
        near_m = 2 * self._mission.victory_radius_m
        pending = None if self._pending is None or self._pending.theirs is not None else self._pending
        is_new = pending is not None and pending.at_ms >= self._now_ms - _SAME_MS
        if goal_m is None:
            return is_new
        if pending is not None and pending.goal_m is None and is_new:
            pending.goal_m = goal_m
            return True
        places = [self._place_m, None if pending is None else pending.goal_m]
        return any(it is not None and dist(goal_m, it) <= near_m for it in places)

    def _ended(self, key: str, *, is_done: bool) -> None:
        began = self._works.pop(key, None)
        if began is None or began.work is not Work.GO_TO or self._pending is None:
            return
        if is_done and self._pending.goal_m is None:
            self._pending.goal_m = self._place_m

    # Theirs beside ours.

    def _choose(self) -> None:
        if (pending := self._pending) is None:
            return
        if pending.ours is None:
            pending.ours = self._choice.move(Moment(self._now_ms, self._state, self._place_m, self._collects))
            pending.beliefs = {it.agent_id: it for it in self._beliefs.fleet.all()}
        if pending.theirs is not None:
            self._pending = None
            self._note(pending, pending.theirs, pending.ours)

    def _resolve_by_place(self) -> None:
        """A go-to that came to no docking: whom they went to is told by the place alone."""
        self._choose()
        if (pending := self._pending) is None:
            return
        goal_m, beliefs = pending.goal_m, pending.beliefs or {}
        if goal_m is None:
            self._pending = None
            return
        homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in self._state.homes}
        docked = self._docked
        moves = {
            TheirMove(StepKind.COLLECT, it.agent_id): (it.north_m, it.east_m)
            for it in beliefs.values()
            if it.agent_id not in docked
        } | {
            TheirMove(StepKind.DEPLOY, agent_id): homes[agent_id] for agent_id in docked if agent_id in homes
        }
        nearest = min(moves, key=lambda it: dist(goal_m, moves[it]), default=None)
        is_near = nearest is not None and dist(goal_m, moves[nearest]) <= self._mission.docking.catch_radius_m
        self._resolve(nearest if nearest is not None and is_near else TheirMove(ELSEWHERE))

    def _resolve(self, theirs: TheirMove) -> None:
        """Their decision was taken when the go-to under way began; without one, it is taken now.

        What repeats the last decision is another try, or another go-to after an aMussel that has drifted.
        """
        if theirs == self._last and theirs.kind != ELSEWHERE:
            self._pending = None
            return
        self._last = theirs
        if self._pending is None:
            self._pending = _Pending(self._now_ms)
        self._pending.theirs = theirs
        if self._pending.ours is not None:
            self._choose()

    def _note(self, pending: _Pending, theirs: TheirMove, ours: TheirMove) -> None:
        belief = None if theirs.agent_id is None else (pending.beliefs or {}).get(theirs.agent_id)
        estimate = None
        if belief is not None:
            place_m = belief.north_m, belief.east_m
            estimate = ComparedBelief(belief.age_s(pending.at_ms), belief.primary, place_m)
        self.decisions.append(ComparedDecision(pending.at_ms / 1000, theirs, ours, estimate))
        self._choice.compare(theirs, ours)
        if theirs.kind != ELSEWHERE:
            self._collects = theirs.kind == StepKind.COLLECT

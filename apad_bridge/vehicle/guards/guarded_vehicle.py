"""A vehicle behind its gate, with a monitor that reacts between orders, and the one owner of its stops.

Who comes first: a pilot, a person's stop, a guard's stop, other clients, the mission. While a pilot steers, nothing goes
out. A stop in force is the only order until a person continues. A stop goes to the vehicle at once, and not by way of the
mission: a mission that has ended, or hangs on a strategy, needs it most.
"""

from __future__ import annotations

from dataclasses import replace

from apad_bridge.events.guard_events import (
    Cause,
    DangerOver,
    GuardReacted,
    HoldRepeated,
    OthersCommanded,
    Reaction,
    SentBackIn,
    StopKind,
)
from apad_bridge.scenario.blocks.guard_options import LOOK_MS
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    GoalOfOthers,
    GoTo,
    Hold,
    HoldWanted,
    MoveArm,
    OpenDock,
    OrderCut,
    PilotReported,
    PoseReported,
    ReleaseByName,
    ReleaseWanted,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.gate import PILOT_STEERS, Refusal, Safety
from apad_bridge.vehicle.guards.guarded_orders import goal_of, is_meant_as_stop, may_hold
from apad_bridge.vehicle.guards.monitor import MonitorFinding, UnderWay
from apad_bridge.vehicle.guards.stop_enforcer import StopEnforcer
from apad_bridge.vehicle.guards.stops import StopsEnded
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact, VehicleLink

_Answer = CommandAccepted | Arrived | CommandFailed
_Wish = HoldWanted | ReleaseWanted | OrderCut
"""A link's facts for this class alone."""
PILOT_HAD_IT = "a pilot has steered the aPad: continue, or take it over"
HOLD_AGAIN_MS = 10_000
"""A real vehicle that did not take a hold, and has no other order, gets the hold again so often."""


class GuardedVehicle:
    """A VehicleLink behind the gate. `advance` is called once a tick or more often, and looks once a tick. `look_between`
    stops a real vehicle whose position goes bad between two ticks.

    A refused command fails at once, with the guard's reason. If the vehicle is under way then, it holds where it is,
    because what it was doing has made way for that command. A refused hold near the vehicle is meant as a stop: it holds
    right where it is, or its controllers go off where it may not hold.
    """

    def __init__(self, link: VehicleLink, safety: Safety, *, obeys_speed: bool = True) -> None:
        self._link = link
        self._safety = safety
        self.gate = safety.gate
        self.gate.note_vehicle(obeys_speed=obeys_speed)
        self._stops = safety.gate.stops
        self._facts: list[LinkFact] = []
        """Facts of this class's own that nobody has taken yet."""
        self._taken: list[LinkFact] = []
        """Facts that were taken between two ticks, and wait for the next."""
        self._under_way: UnderWay | None = None
        self._ordered: GoTo | Hold | None = None
        """The newest order where to go or stay. Until the vehicle has accepted it, it follows the one before."""
        self._mechanism: CloseDock | OpenDock | None = None
        """The newest order to a dock that the vehicle has not answered."""
        self._hold_again_ms: int | None = None
        """The time from which on the newest order, a hold that the vehicle did not take, is due again."""
        self._own_id = 0
        """Commands of the guards' own have ids below 0, which no port uses."""
        self._looked_ms = -1
        self._looked_between_ms = -1
        self._enforcer = StopEnforcer(safety, self._send, self._take_id)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """The link's facts, and the failures of refused commands. Once a tick the monitor looks, and reacts."""
        facts = [*self._taken, *self._take_facts(now_ms)]
        self._taken = []
        if now_ms > self._looked_ms:
            self._looked_ms = now_ms
            self._enforcer.go_on(now_ms)
            self._look(now_ms)
        facts += self._facts
        self._facts = []
        return [it for it in facts if not (isinstance(it, _Wish) or _is_own(it))]

    def look_between(self, now_ms: int) -> None:
        """Takes the facts of a real vehicle between two ticks, and stops it where its position has gone bad.

        Every `LOOK_MS`. The next `advance` returns the facts: of positions and charges the newest, as for a whole tick.
        """
        if not self._safety.needs_person or now_ms - self._looked_between_ms < LOOK_MS:
            return
        self._looked_between_ms = now_ms
        facts = self._take_facts(now_ms)
        replaced = tuple({type(it) for it in facts} & {PoseReported, BatteryReported})
        self._taken = [it for it in self._taken if not isinstance(it, replaced)] + facts
        if self.gate.watch.fault(now_ms):
            self._look(now_ms)
        else:
            self._enforcer.watch(now_ms)

    def _take_facts(self, now_ms: int) -> list[LinkFact]:
        """The link's new facts, of which the gate and the stops have taken note."""
        facts = [*self._facts, *self._link.advance(now_ms)]
        self._facts = []
        had_pilot = bool(self.gate.pilot)
        self.gate.observe(facts)
        for fact in facts:
            self._take(fact, now_ms)
        if self.gate.pilot and not had_pilot:
            self._leave_to_pilot(now_ms)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        stop, situation = self._stops.in_force, self.gate.situation(now_ms)
        if isinstance(command, Hold) and stop is not None and is_meant_as_stop(command, situation):
            # The stop in force has done it: a second hold would only move the place.
            if stop.kind is StopKind.HOLD:
                self._facts.append(CommandAccepted(now_ms, command.command_id))
            else:
                self._facts.append(CommandFailed(now_ms, command.command_id, stop.text()))
            return
        cleared = self.gate.clear(command, now_ms)
        if isinstance(cleared, Cleared) and isinstance(command, Hold) and self.gate.awaits_person:
            cleared = Refusal("person", self.gate.awaits_person)
        if isinstance(cleared, Cleared):
            self._send(cleared, now_ms)
        elif self.gate.awaits_person or self.gate.pilot:
            self._note_refusal(command, cleared, now_ms)
        elif isinstance(command, Hold) and is_meant_as_stop(command, situation):
            self._stop_here(command, now_ms)
        else:
            self._note_refusal(command, cleared, now_ms)
            if self._under_way is not None:
                self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)

    def close(self) -> None:
        self._link.close()

    # A person's words.

    def stop(self, by: str, now_ms: int, *, off: bool = False, hands: bool = False) -> None:
        """A person's stop: HOLD where that may be, else OFF. A second one, and one for `hands` at the docks, is OFF."""
        before = self._stops.in_force
        is_second = before is not None and before.is_persons and before.ordered_ms < now_ms
        wants_off = off or hands or is_second or (before is not None and before.kind is StopKind.OFF)
        kind = StopKind.OFF if wants_off or not may_hold(self.gate.situation(now_ms)) else StopKind.HOLD
        if self.gate.pilot == PILOT_STEERS:
            self._stops.refuse(kind, by, self.gate.pilot, now_ms)
            return
        reason = "hands at the docks" if hands else ""
        self._begin_stop(kind, by, reason, now_ms, is_persons=True, stills_arms=hands)

    def allow_motion(
        self,
        by: str,
        stop: int | None,
        now_ms: int,
        *,
        pilot_left: bool = False,
        ends: StopsEnded = StopsEnded.ANY,
    ) -> None:
        """A person lets the vehicle move again, if none but stop number `stop` is in force, and `ends` names its kind.

        From then on its position is believed, and a danger that is still there is a new one.
        """
        if pilot_left:
            self._link.command(self.gate.take_from_pilot(self._take_id()), now_ms)
        self.gate.forget_others()
        if not self._stops.may_end(stop, ends):
            return
        self._enforcer.note_continued()
        self._stops.end(by, now_ms)
        self.gate.watch.believe()
        self._safety.monitor.begin_anew()

    def go_back_in(self, by: str, lookout: str, now_ms: int) -> None:
        """Goes straight back inside the fence on a person's word, with a lookout, and then holds."""
        if (cleared := self.gate.clear_way_back(self._take_id(), now_ms)) is None:
            return  # the person was told already
        self.gate.events.append(SentBackIn(by, lookout))
        self._stops.way_back = cleared.order.command_id
        self._send(cleared, now_ms)

    # The link's facts.

    def _take(self, fact: LinkFact, now_ms: int) -> None:
        match fact:
            case CommandAccepted(_, command_id) if self._stops.is_sent_by(command_id):
                self._enforcer.taken(now_ms)
                self._note_acceptance(fact)
            case CommandAccepted():
                self._note_acceptance(fact)
            case CommandFailed(_, command_id, reason) if self._stops.is_sent_by(command_id):
                self._enforcer.failed(reason, now_ms)
            case Arrived(_, command_id) | CommandFailed(_, command_id):
                self._note_end(command_id)
                self._note_failed_hold(fact, now_ms)
                if command_id == self._stops.way_back:
                    self._stops.way_back = None
                    self._enforcer.send(now_ms)
            case OrderCut():
                self._enforcer.note_cut(now_ms)
            case HoldWanted(_, north_m, east_m, heading_rad):
                self._wish(Hold(self._take_id(), north_m, east_m, heading_rad), now_ms)
            case ReleaseWanted(_, dock_index, agent_id):
                self._wish(ReleaseByName(self._take_id(), dock_index, agent_id), now_ms)
            case CommandedByOthers(_, client):
                self._others_command(client, now_ms)
            case GoalOfOthers():
                self._judge_others(fact, now_ms)
            case PilotReported() if not self.gate.pilot and self._safety.needs_person:
                # A pilot who lets go has not said that the mission may go on.
                self.gate.note_others(PILOT_HAD_IT)

    def _wish(self, command: Hold | ReleaseByName, now_ms: int) -> None:
        """Orders what a link asks for, as far as nobody else has the vehicle. A stop in force stands alone."""
        if self.gate.awaits_person or self.gate.pilot:
            return
        cleared = self.gate.clear(command, now_ms)
        if isinstance(cleared, Cleared):
            self._send(cleared, now_ms)
        else:
            self.gate.note_refused(command, cleared)

    def _others_command(self, client: str, now_ms: int) -> None:
        if not self._safety.needs_person:
            return
        who = client or "another client, which this stack does not name,"
        self.gate.events.append(OthersCommanded(client))
        if (stop := self._stops.in_force) is not None and not self.gate.pilot:
            self._enforcer.send_again(f"{who} commands the aPad", now_ms)
        elif stop is None:
            self.gate.note_others(f"{who} commands the aPad: continue, take it over, or give it back")

    def _judge_others(self, goal: GoalOfOthers, now_ms: int) -> None:
        """Ends another client's go-to that a guard would refuse us, or of which nobody can tell where it leads."""
        situation = self.gate.situation(now_ms)
        if self.gate.pilot or situation.place_m is None or situation.position_fault:
            return
        who = goal.client or "another client"
        if goal.fault:
            reason = f"{who} ordered a go-to to a place that cannot be used: {goal.fault}"
        elif goal.north_m is None or goal.east_m is None:
            if not self._safety.needs_person:
                return
            reason = f"{who} sent a goal that was not heard: nobody can tell where it leads"
        elif fault := self._safety.waters.fault_of_way(situation.place_m, (goal.north_m, goal.east_m)):
            reason = f"{who} ordered a go-to that leaves the waters: {fault}"
        else:
            return
        self._react(MonitorFinding(Cause.OTHERS, Reaction.HOLD, reason), now_ms)

    def _leave_to_pilot(self, now_ms: int) -> None:
        """Fails the order under way: the pilot ends every order of ours."""
        self._fail_present(self.gate.pilot, now_ms)
        self._under_way = self._ordered = None
        self._enforcer.leave_to_pilot()
        self.gate.watch.note_goal(None)

    def _note_acceptance(self, fact: CommandAccepted) -> None:
        if self._ordered is None or fact.command_id != self._ordered.command_id:
            return  # of an order that another one has replaced
        self.gate.watch.note_goal(goal_of(self._ordered), fact.at_ms)
        if isinstance(self._ordered, GoTo):
            self._under_way = UnderWay(self._ordered, fact.at_ms)

    def _note_end(self, command_id: int) -> None:
        if self._mechanism is not None and command_id == self._mechanism.command_id:
            self._mechanism = None
        if self._under_way is not None and command_id == self._under_way.command.command_id:
            self._under_way = self._ordered = None
            self.gate.watch.note_goal(None)

    def _note_failed_hold(self, fact: Arrived | CommandFailed, now_ms: int) -> None:
        held = self._ordered
        if isinstance(held, Hold) and held.command_id == fact.command_id and self._safety.needs_person:
            self._hold_again_ms = now_ms + HOLD_AGAIN_MS

    def _repeat_hold(self, now_ms: int) -> None:
        """Orders a hold again that the vehicle did not take: without an order it would drift, and nobody be told."""
        held, due_ms = self._ordered, self._hold_again_ms
        if not isinstance(held, Hold) or due_ms is None or now_ms < due_ms:
            return
        self._hold_again_ms = now_ms + HOLD_AGAIN_MS
        if self.gate.awaits_person or self.gate.pilot:
            return
        again = replace(held, command_id=self._take_id())
        cleared = self.gate.clear(again, now_ms)
        if isinstance(cleared, Cleared):
            self.gate.events.append(HoldRepeated(round(held.north_m, 2), round(held.east_m, 2)))
            self._send(cleared, now_ms)
        else:
            self.gate.note_refused(again, cleared)

    # Sending.

    def _note_refusal(self, command: VehicleCommand, refusal: Refusal, now_ms: int) -> None:
        self.gate.note_refused(command, refusal)
        if not isinstance(command, MoveArm):  # nobody awaits an answer to it
            self._facts.append(CommandFailed(now_ms, command.command_id, f"refused: {refusal.reason}"))

    def _stop_here(self, command: Hold, now_ms: int) -> None:
        """Ends the vehicle's motion in the one way that its position allows; `command` gives the id."""
        situation = self.gate.situation(now_ms)
        if may_hold(situation) and situation.place_m is not None:
            here = replace(command, north_m=situation.place_m[0], east_m=situation.place_m[1])
            self._send(self.gate.clear_stop(here), now_ms)
        else:
            self._send(self.gate.clear_stop(Stop(command.command_id)), now_ms)

    def _send(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        if not isinstance(command, MoveArm | ReleaseByName):
            self._hold_again_ms = None
            self._mechanism = command if isinstance(command, CloseDock | OpenDock) else self._mechanism
            self._under_way = UnderWay(command) if isinstance(command, GoTo) else None
            self._ordered = command if isinstance(command, GoTo | Hold) else None
            if self._ordered is None:
                self.gate.watch.note_goal(None)
        self._link.command(cleared, now_ms)

    def _take_id(self) -> int:
        self._own_id -= 1
        return self._own_id

    # Stops.

    def _begin_stop(
        self,
        kind: StopKind,
        by: str,
        reason: str,
        now_ms: int,
        *,
        is_persons: bool = False,
        stills_arms: bool = False,
    ) -> None:
        self._fail_present(reason or f"stopped by {by}", now_ms)
        self._enforcer.begin(kind, by, reason, now_ms, is_persons=is_persons, stills_arms=stills_arms)

    def _fail_present(self, reason: str, now_ms: int) -> None:
        """Reports what is under way as failed: its own answer may never come."""
        for command in (None if self._under_way is None else self._under_way.command, self._mechanism):
            if command is not None and command.command_id >= 0:
                self._facts.append(CommandFailed(now_ms, command.command_id, reason))
        self._mechanism = None

    # The monitor.

    def _look(self, now_ms: int) -> None:
        if self._under_way is not None and self.gate.watch.place_m is not None:
            self._under_way = self._under_way.moved_to(self.gate.watch.place_m, now_ms)
        monitor = self._safety.monitor
        changes = monitor.look(self.gate.situation(now_ms), self._under_way, now_ms) if monitor.checks else []
        for change in changes:
            if isinstance(change, MonitorFinding):
                self._react(change, now_ms)
                continue
            self.gate.events.append(DangerOver(change))
            if change is Cause.POSITION and not self._safety.needs_person:
                self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)
        self._enforcer.watch(now_ms)
        self._repeat_hold(now_ms)

    def _react(self, finding: MonitorFinding, now_ms: int) -> None:
        """Fails the command under way, and brings the vehicle to rest. A person's word ends a real vehicle's stop."""
        wants_off = finding.reaction is Reaction.STOP or not may_hold(self.gate.situation(now_ms))
        reaction = Reaction.STOP if wants_off and finding.reaction is Reaction.HOLD else finding.reaction
        self.gate.events.append(
            GuardReacted(
                finding.cause,
                reaction,
                finding.reason,
                calls_pilot=finding.cause is Cause.OUTSIDE or bool(self.gate.pilot),
            )
        )
        if self.gate.pilot == PILOT_STEERS:
            return  # the pilot has it, and a person is told; an order would take it out of the pilot's hands
        if not self._safety.needs_person:
            self._react_simulated(replace(finding, reaction=reaction), now_ms)
            return
        stop = self._stops.in_force
        if stop is not None and self._stops.way_back is None and (stop.kind is StopKind.OFF or not wants_off):
            # A hull that has not obeyed yet gets no new time by what a guard sees of it.
            is_news = finding.cause is Cause.OTHERS or not self._enforcer.is_judging
            if finding.cause is not Cause.POSITION and is_news:
                self._enforcer.send_again(finding.reason, now_ms)
            return
        if stop is not None and stop.kind is StopKind.HOLD and wants_off:
            self._enforcer.become_off(finding.reason, now_ms)
            self._enforcer.send(now_ms)
        elif self._stops.way_back is not None and finding.cause is Cause.OUTSIDE:
            return  # a person sent it back from there
        else:
            kind = StopKind.OFF if wants_off else StopKind.HOLD
            self._begin_stop(kind, f"guard: {finding.cause}", finding.reason, now_ms)

    def _react_simulated(self, finding: MonitorFinding, now_ms: int) -> None:
        """A simulated vehicle goes on by itself when the danger is over."""
        self._fail_present(finding.reason, now_ms)
        back = None
        if finding.reaction is Reaction.RETURN:
            back = self.gate.clear_return(self._take_id(), self._safety.return_speed_m_s)
        if back is not None:
            self._send(back, now_ms)
        elif finding.reaction is Reaction.STOP:
            self._send(self.gate.clear_stop(Stop(self._take_id())), now_ms)
        else:
            self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)


def _is_own(fact: LinkFact) -> bool:
    """True for the answer to a command of the guards' own."""
    return isinstance(fact, _Answer) and fact.command_id < 0

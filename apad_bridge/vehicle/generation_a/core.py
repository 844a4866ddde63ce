"""Turns the port's commands into goals for a generation A aPad, and its messages into facts. No ROS, no clock.

For the docks it trusts `position_static`, and what the aPad answers where that is silent: a successful perch may have done
nothing (one more than there are docks), and a release may never answer (the published server crashes in it). Every wait
ends, by the constants below, in mission time.

Other parties send goals to the same server, which runs one at a time. Their orders are let end. A core that `takes_back`
its vehicle then asks again for the hold that should be (`HoldWanted`). Any other core reports `CommandedByOthers`, and
orders no hold that would stop the other's order: a person gives the vehicle back.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoalOfOthers,
    GoTo,
    Hold,
    HoldWanted,
    MoveArm,
    OpenDock,
    OrderCut,
    PilotLeft,
    PilotReported,
    PoseReported,
    Primitive,
    ReleaseByName,
    ReleaseWanted,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    ENDS,
    GO_TO,
    PERCH,
    RELEASE,
    DocksReceived,
    GoalCode,
    GoalOrder,
    GoalSeen,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
    OffAnswered,
    OffOrder,
    Received,
)
from apad_bridge.vehicle.generation_a.off_order import ControllersOff
from apad_bridge.vehicle.generation_a.others_goals import SERVER_SILENT_MS, ServerWatch
from apad_bridge.vehicle.go_to_progress import GoToProgress
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived
from apad_bridge.vehicle.telemetry import (
    FAR_M,
    DeferredMessages,
    ReachCheck,
    Readings,
    SilenceWatch,
)
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact

TAKEN_MS = 5_000
"""A goal without the action server's acknowledgement for so long has failed: nobody serves it. While the
whole vehicle is silent, goals wait for it; the port's own time-outs go on."""
PERCHED_MS = 1_000
"""The longest delay of `position_static` after a successful perch (the topic comes at 20 Hz)."""
ARRIVED_MS = 3_000
"""So long within the victory radius, while the action server is silent, counts as arrival."""
LEFT_ALONE_MS = 60_000
"""Another party's order is let end for so long, and no longer: a goal of an unknown kind never ends."""


@dataclass(slots=True)
class _SentGoal:
    """An unfinished goal."""

    command: Primitive
    before: Cleared[VehicleCommand]
    order: GoalOrder
    sent_ms: int
    is_taken: bool = False
    """The server knows it."""
    is_accepted: bool = False
    """The vehicle follows it."""
    ended_ms: int | None = None
    """The time at which the server ended the goal, while `position_static` does not confirm it yet."""
    pre_empted_ms: int | None = None
    """The time at which another party's goal took its place; it fails when that one has ended."""
    progress: GoToProgress | None = None
    """A go-to's way, watched while the server is silent."""
    near_since_ms: int | None = None


class GenerationACore:
    """`receive` takes a message, `command` returns the goal to send, `advance` the facts stamped up to its time.

    `battery_v` is (empty, full), `docks` are those that the vehicle reports, from `now_ms` on. Goal keys begin with
    `nonce`, which no two runs on one server may share. `gate` judges each goal. `take_orders` returns the goals that a
    silent vehicle may not have heard, `take_question` whether to ask the vehicle what it holds.
    """

    def __init__(
        self,
        docks: ReportedDocks,
        battery_v: tuple[float, float],
        nonce: str,
        now_ms: int = 0,
        out_of_reach: ReachCheck = lambda agent_id, pose, now_ms: None,
        *,
        takes_back: bool = True,
        gate: Gate | None = None,
        pilots: frozenset[str] = frozenset(),
    ) -> None:
        self._gate = gate or Gate.without_guards()
        self._now_ms = now_ms
        self.readings = Readings(battery_v)
        self.docks = docks
        self._server = ServerWatch(nonce, pilots)
        self._off = ControllersOff()
        self._pilot_runs = False
        self._takes_back = takes_back
        self._out_of_reach = out_of_reach
        self._nonce = nonce
        self._deferred: DeferredMessages[Received] = DeferredMessages(now_ms, self.readings.dropped)
        self._facts: list[LinkFact] = []
        self._goals: dict[str, _SentGoal] = {}
        self._latest_key = ""
        self._silence = SilenceWatch()
        self._orders: list[_SentGoal] = []
        self._own_orders = 0
        self._post: GoTo | Hold | None = None
        """The command at whose place the vehicle should stay."""
        self._away_ms: int | None = None
        """The time since which another party has sent it away from there."""

    @property
    def dropped(self) -> Counter[str]:
        """Unusable messages of the vehicle, by reason."""
        return self.readings.dropped + self.docks.dropped + self._server.dropped

    def silent_topics(self, now_ms: int) -> list[str]:
        """Topics without a message up to `now_ms`, below the aPad's namespace or an aMussel's."""
        newest = (
            ("position", self.readings.position_ms),
            ("action_server/status", self._server.status_ms),
        )
        held = [
            f"/{self.docks.object_prefix}{it}/position_static" for it in self.docks.unreported_ids(now_ms)
        ]
        return [topic for topic, at_ms in newest if at_ms < now_ms] + held

    @property
    def unacknowledged(self) -> list[str]:
        """Keys of the goals without the server's acknowledgement."""
        return [key for key, sent in self._goals.items() if not sent.is_taken]

    @property
    def awaited_mechanisms(self) -> list[str]:
        """Keys of the unfinished goals to docking mechanisms."""
        return [key for key, sent in self._goals.items() if isinstance(sent.command, CloseDock | OpenDock)]

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> Cleared[GoalOrder] | None:
        """The goal to send; None for a stop, and for a perch or release from afar, which the vehicle would call done."""
        command, self._now_ms = cleared.order, now_ms
        assert not isinstance(command, MoveArm), "the stack has no such order, as its capabilities state"
        if isinstance(command, PilotLeft):
            return None  # nothing but a pilot's own goals tells of a pilot here
        if isinstance(command, ReleaseByName):
            name = f"{self.docks.object_prefix}{command.agent_id}"
            return self._let_out(
                GoalOrder(self._own_key(), RELEASE, name=name, agent_id=command.agent_id), cleared
            )
        self._orders = []
        # A hold that was wanted before this command would replace it.
        self._facts = [it for it in self._facts if not isinstance(it, HoldWanted)]
        self._off.forget()
        if isinstance(command, Stop):
            if self.unacknowledged:
                self._facts.append(OrderCut(now_ms))
            self._post, self._away_ms, self._goals = None, None, {}
            self._off.order(cleared)
            return None
        if (
            isinstance(command, CloseDock | OpenDock)
            and (why := self._why_from_afar(command, now_ms)) is not None
        ):
            self._facts.append(CommandFailed(now_ms, command.command_id, why))
            return None
        if (
            isinstance(command, Hold)
            and not command.pre_empts
            and not self._takes_back
            and self._server.others_run
        ):
            self._post, self._goals = None, {}
            return None
        order = self._send(f"{self._nonce}-{command.command_id}", command, cleared, now_ms)
        return self._let_out(order, cleared)

    def _let_out(self, order: GoalOrder, before: Cleared[VehicleCommand]) -> Cleared[GoalOrder] | None:
        """Asks the gate about each goal for the command `before`. A command whose goal it refuses has failed."""
        cleared = self._gate.clear_for_wire(order, _as_command(order), before, self._now_ms)
        if cleared is not None:
            return cleared
        if (sent := self._goals.pop(order.key, None)) is not None:
            if isinstance(sent.command, CloseDock):
                self.docks.perch_refused(sent.command.agent_id)
            self._facts.append(
                CommandFailed(self._now_ms, sent.command.command_id, "a guard refused its goal")
            )
        return None

    def _send(self, key: str, command: Primitive, before: Cleared[VehicleCommand], now_ms: int) -> GoalOrder:
        progress = None
        match command:
            case GoTo(_, north_m, east_m) | Hold(_, north_m, east_m):
                pre_empts = isinstance(command, Hold) and command.pre_empts
                ends = (*self._goals, *self._server.others_under_way) if pre_empts else ()
                order = GoalOrder(key, GO_TO, north_m, east_m, pre_empts=pre_empts, ends=ends)
                progress = GoToProgress(north_m, east_m, SERVER_SILENT_MS, now_ms, self.readings.pose)
                self._post = command if isinstance(command, Hold) else None
                self._away_ms = None
            case CloseDock(_, _, agent_id):
                self.docks.order_perch(agent_id)
                order = GoalOrder(key, PERCH, name=f"{self.docks.object_prefix}{agent_id}", agent_id=agent_id)
            case OpenDock(_, _, agent_id):
                self.docks.order_release(agent_id, now_ms)
                order = GoalOrder(
                    key, RELEASE, name=f"{self.docks.object_prefix}{agent_id}", agent_id=agent_id
                )
        self._goals[key] = _SentGoal(command, before, order, now_ms, progress=progress)
        self._latest_key = key
        return order

    def take_orders(self) -> list[Cleared[GoalOrder]]:
        """The goals to repeat, because the vehicle was silent when they were sent, returned once."""
        repeated, self._orders = self._orders, []
        let_out = (self._let_out(it.order, it.before) for it in repeated)
        return [it for it in let_out if it is not None]

    def _want_release(self, now_ms: int) -> None:
        """Asks for the release of an aMussel that the vehicle may still hold, as soon as no goal of ours runs."""
        is_free = not self._goals and not self._server.others_run and not self._off.is_ordered
        if self.docks.unordered_releases and is_free:
            self._facts.append(ReleaseWanted(now_ms, *self.docks.unordered_releases.pop(0)))

    def take_off_order(self) -> Cleared[OffOrder] | None:
        """The order that switches the controllers off, once each time that it must be sent."""
        if (taken := self._off.take_order()) is None:
            return None
        order, before = taken
        return self._gate.clear_for_wire(order, Stop(0), before, self._now_ms)

    def take_question(self) -> bool:
        """True, once, when the vehicle should be asked what it holds (`check_docking_availability`)."""
        return self.docks.take_question()

    def _own_key(self) -> str:
        self._own_orders += 1
        return f"{self._nonce}-own-{self._own_orders}"

    def _why_from_afar(self, command: CloseDock | OpenDock, now_ms: int) -> str | None:
        pose, agent_id = self.readings.pose, command.agent_id
        if isinstance(command, CloseDock):
            return self._out_of_reach(agent_id, pose, now_ms)
        lost_m = self.docks.lost_m.get(agent_id)
        if pose is None or lost_m is None:
            return None
        away_m = math.dist(lost_m, (pose.north_m, pose.east_m))
        if away_m <= FAR_M:
            return None
        return (
            f"aMussel {agent_id} is in no dock: its dock opened, by the last report, {away_m:.1f} m from here"
        )

    def _watch_silence(self, now_ms: int) -> None:
        position_ms = self.readings.position_ms
        if position_ms < 0 or not self._silence.look(position_ms, now_ms):
            return
        latest = self._goals.get(self._latest_key)
        # A real vehicle that was silent waits for a person; the simulated one goes on.
        if not self._silence.is_silent and latest is not None and not latest.is_taken and self._takes_back:
            latest.sent_ms = now_ms
            self._orders.append(latest)

    def receive(self, message: Received, now_ms: int) -> None:
        """Takes a message; one stamped after `now_ms` waits for its time."""
        if self._deferred.defers(message, now_ms):
            return
        match message:
            case PoseReported() | StateRefReceived() | BatteryReceived():
                self.readings.receive(message)
            case HeldPositionReceived():
                self._receive_held_position(message)
            case GoalStatusReceived():
                self._server.receive(message)
                self._receive_goals(message)
            case GoalSeen():
                self._see_goal(message)
            case OffAnswered():
                if (fact := self._off.receive(message)) is not None:
                    self._facts.append(fact)
            case DocksReceived():
                self._apply_dock_facts(
                    self.docks.receive_answer(message, server_lives=self._server.lives(self.readings))
                )

    def advance(self, now_ms: int) -> list[LinkFact]:
        """New facts, each stamped at or before `now_ms`; of poses and places only the newest."""
        self._now_ms = now_ms
        for message in self._deferred.advance(now_ms):
            self.receive(message, now_ms)
        self._watch_silence(now_ms)
        self._apply_dock_facts(
            self.docks.silent(self.readings, server_lives=self._server.lives(self.readings))
        )
        self._server.look(self.readings)
        self._time_out_goals(now_ms)
        self._watch_others(now_ms)
        self._want_release(now_ms)
        facts, self._facts = self._facts, []
        facts += self.docks.places(self.readings)
        return facts + self.readings.take(self._gate)

    def _see_goal(self, goal: GoalSeen) -> None:
        """Takes a goal on its way to the server; another client's go-to is for the guards to judge."""
        self._server.see(goal)
        if goal.kind != GO_TO or self._server.is_ours(goal.key):
            return
        others = GoalOfOthers(goal.at_ms, goal.client, goal.north_m, goal.east_m)
        others = self.readings.usable_goal(others, "action_server/goal")
        if not self._takes_back:
            self._facts.append(others)

    def _receive_held_position(self, message: HeldPositionReceived) -> None:
        if (reason := out_of_range(north_m=message.north_m, east_m=message.east_m)) is not None:
            self.docks.dropped[f"position_static: {reason}"] += 1
            if not message.released:  # whoever ordered a release, its place says nothing more
                return
        self._apply_dock_facts(self.docks.receive(message))

    def _apply_dock_facts(self, facts: list[LinkFact]) -> None:
        """Passes on changes at the docks, and tells disagreements; a change that fulfils a goal ends it."""
        self._facts += facts
        told, self.docks.disagreements = self.docks.disagreements, []
        self._gate.events += [DocksDisagree(it, reason) for it, reason in told]
        for key, sent in list(self._goals.items()):
            if any(_fulfils(fact, sent.command) for fact in facts):
                del self._goals[key]

    def _receive_goals(self, message: GoalStatusReceived) -> None:
        named_keys = set()
        for status in message.words:
            named_keys.add(status.key)
            if (sent := self._goals.get(status.key)) is not None:
                sent.is_taken = True
                if status.code is GoalCode.ACTIVE and not sent.is_accepted:
                    self._accept(sent, message.at_ms)
                elif status.code in ENDS:
                    self._end_goal(status, sent, message.at_ms)
        if not message.whole:
            return
        for key, sent in list(self._goals.items()):
            if (
                sent.is_taken
                and key not in named_keys
                and sent.ended_ms is None
                and sent.pre_empted_ms is None
            ):
                self._end_goal(GoalStatusEntry(key, GoalCode.LOST, "did it restart?"), sent, message.at_ms)

    def _accept(self, sent: _SentGoal, at_ms: int) -> None:
        sent.is_accepted = True
        if sent.progress is not None:
            sent.progress.begin(self.readings.pose, at_ms)
        if isinstance(sent.command, OpenDock):
            self.docks.release_accepted(sent.command.agent_id, at_ms)
        elif isinstance(sent.command, GoTo | Hold):
            self._facts.append(CommandAccepted(at_ms, sent.command.command_id))

    def _end_goal(self, status: GoalStatusEntry, sent: _SentGoal, at_ms: int) -> None:
        match sent.command, status.code:
            case CloseDock(_, _, agent_id), GoalCode.SUCCEEDED if not self.docks.holds(agent_id):
                is_over = False
            case OpenDock(_, _, agent_id), GoalCode.SUCCEEDED | GoalCode.LOST if self.docks.holds(agent_id):
                # The published server crashes in a release, so only `position_static` shows the result.
                is_over = False
            case _:
                is_over = True
        if not is_over:
            sent.ended_ms = at_ms if sent.ended_ms is None else sent.ended_ms
            return
        if status.key == self._latest_key and status.code is GoalCode.PREEMPTED:
            if sent.pre_empted_ms is None:
                sent.pre_empted_ms = at_ms
            return
        del self._goals[status.key]
        if status.code is GoalCode.SUCCEEDED:
            self._report_success(sent.command, at_ms)
        elif status.key == self._latest_key or status.code not in (GoalCode.PREEMPTED, GoalCode.RECALLED):
            if isinstance(sent.command, CloseDock):
                self.docks.perch_refused(sent.command.agent_id)
            reason = f"the aPad's action server says {status.code.name}"
            self._fail(sent.command, at_ms, f"{reason}: {status.text}" if status.text else reason)

    def _report_success(self, command: Primitive, at_ms: int) -> None:
        """Reports a finished go-to, or a mechanism that already was as commanded and would cause no report."""
        match command:
            case GoTo(command_id):
                self._post = command
                self._facts.append(Arrived(at_ms, command_id))
            case CloseDock(_, _, agent_id):
                self._facts.append(DockClosed(at_ms, self.docks.dock_index_of(agent_id), agent_id))
            case OpenDock(_, dock_index, agent_id):
                self._facts.append(DockOpened(at_ms, dock_index, agent_id))

    def _time_out_goals(self, now_ms: int) -> None:
        for key, sent in list(self._goals.items()):
            reason = None
            if sent.progress is not None and self.readings.pose is not None:
                self._watch_way(sent, self.readings.pose, now_ms)
            silent_ms = self._server.silent_for_ms(self.readings, sent.sent_ms)
            if not sent.is_taken and not self._silence.is_silent and now_ms - sent.sent_ms >= TAKEN_MS:
                reason = f"no action server took the goal within {TAKEN_MS / 1000:g} s"
            elif sent.is_taken and silent_ms >= ARRIVED_MS and _has_come(sent, now_ms):
                self._server.dropped["the action server was silent: arrival by position"] += 1
                del self._goals[key]
                self._report_success(sent.command, now_ms)
            elif sent.is_taken and silent_ms >= SERVER_SILENT_MS and not _still_comes(sent, now_ms):
                reason = "the aPad's action server fell silent after it took the goal"
            elif sent.pre_empted_ms is not None and self._others_are_done(sent.pre_empted_ms, now_ms):
                reason = "the aPad's action server reports PREEMPTED: another client's goal replaced it"
            elif (
                isinstance(sent.command, CloseDock)
                and sent.ended_ms is not None
                and now_ms - sent.ended_ms >= PERCHED_MS
            ):
                reason = "the aPad reports a perch, but holds nothing: is a dock free?"
            if reason is not None:
                del self._goals[key]
                self._fail(sent.command, now_ms, reason)

    def _watch_way(self, sent: _SentGoal, pose: PoseReported, now_ms: int) -> None:
        assert sent.progress is not None
        sent.progress.take(pose, now_ms)
        radius_m = sent.command.victory_radius_m if isinstance(sent.command, GoTo) else 0.0
        if math.dist((sent.order.north_m, sent.order.east_m), (pose.north_m, pose.east_m)) > radius_m:
            sent.near_since_ms = None
        elif sent.near_since_ms is None:
            sent.near_since_ms = now_ms

    def _others_are_done(self, since_ms: int, now_ms: int) -> bool:
        """No other party's goal runs, by a status later than `since_ms`, or it has run for long enough."""
        is_over = self._server.status_ms > since_ms and not self._server.others_run
        return is_over or now_ms - since_ms >= LEFT_ALONE_MS

    def _watch_others(self, now_ms: int) -> None:
        """Notices that another party sends the vehicle away from where it should stay, and that it is done."""
        new = self._server.take_new()
        has_new = bool(new)
        if not self._takes_back:
            if self._server.pilot_runs != self._pilot_runs:
                self._pilot_runs = self._server.pilot_runs
                self._facts.append(PilotReported(now_ms, self._pilot_runs))
            self._facts += [CommandedByOthers(now_ms, client) for client in dict.fromkeys(new)]
            self._facts += [GoalOfOthers(now_ms, it, None, None) for it in self._server.take_unseen(now_ms)]
        runs_ours = any(it.pre_empted_ms is None for it in self._goals.values())
        for key, sent in list(self._goals.items()):
            if isinstance(sent.command, Hold) and sent.pre_empted_ms is not None:
                del self._goals[key]
                has_new = True
        if has_new and self._post is not None and not runs_ours and self._away_ms is None:
            self._server.dropped["another client sent the aPad away from its hold"] += 1
            self._away_ms = now_ms
        if self._post is None or self._away_ms is None or not self._others_are_done(self._away_ms, now_ms):
            return
        self._away_ms = None
        if self._takes_back:
            self._facts.append(HoldWanted(now_ms, self._post.north_m, self._post.east_m))

    def _fail(self, command: Primitive, at_ms: int, reason: str) -> None:
        self._facts.append(CommandFailed(at_ms, command.command_id, reason))
        if isinstance(command, OpenDock):
            self._apply_dock_facts(self.docks.receive_refusal(command.agent_id, at_ms))


def _as_command(order: GoalOrder) -> Primitive:
    """The command that guards judge. A goal names neither a speed nor a dock."""
    if order.kind == GO_TO:
        return Hold(0, order.north_m, order.east_m, pre_empts=order.pre_empts)
    return CloseDock(0, 0, order.agent_id) if order.kind == PERCH else OpenDock(0, 0, order.agent_id)


def _has_come(sent: _SentGoal, now_ms: int) -> bool:
    return sent.near_since_ms is not None and now_ms - sent.near_since_ms >= ARRIVED_MS


def _still_comes(sent: _SentGoal, now_ms: int) -> bool:
    """A go-to that gets nearer, or has come, though its server is silent: the vehicle moves on without the server."""
    return sent.progress is not None and (
        sent.near_since_ms is not None or now_ms < sent.progress.deadline_ms
    )


def _fulfils(fact: LinkFact, command: Primitive) -> bool:
    match fact, command:
        case (DockClosed(_, _, agent_id), CloseDock(_, _, wanted)) | (
            DockOpened(_, _, agent_id),
            OpenDock(_, _, wanted),
        ):
            return agent_id == wanted
    return False

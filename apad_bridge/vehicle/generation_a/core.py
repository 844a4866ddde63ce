"""Turns the port's commands into goals for a generation A aPad, and its messages into facts. No ROS, no clock.

For the docks it trusts `position_static` only: a successful perch may have done nothing (a fifth perch), and
a release may never answer (the published server crashes in it). Every wait ends, by the constants below, in
mission time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.scenario.schema import PAPER_DOCKS
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoTo,
    Hold,
    OpenDock,
)
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    ENDS,
    GO_TO,
    PERCH,
    RELEASE,
    GoalCode,
    GoalOrder,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
    Received,
)
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.stack_messages import BatteryReceived, PoseReceived, StateRefReceived
from apad_bridge.vehicle.telemetry import DeferredMessages, Readings, Sight, SilenceWatch, why_out_of_reach

Command = GoTo | Hold | CloseDock | OpenDock
TAKEN_MS = 5_000
"""A goal without the action server's acknowledgement for so long has failed: nobody serves it. While the
whole vehicle is silent, goals wait for it; the port's own time-outs go on."""
PERCHED_MS = 1_000
"""The longest delay of `position_static` after a successful perch (the topic comes at 20 Hz)."""


@dataclass(slots=True)
class _SentGoal:
    """An unfinished goal."""

    command: Command
    order: GoalOrder
    sent_ms: int
    is_taken: bool = False
    ended_ms: int | None = None
    """The time at which the server ended the goal, while `position_static` does not confirm it yet."""


class GenerationACore:
    """`receive` takes a message, `command` returns the goal to send, `advance` the facts stamped up to its time.

    `battery_v` is (empty, full). `docked` are the agents by dock index that the vehicle is known to hold at
    `now_ms`. Goal keys begin with `nonce`, which no two runs on one server may share.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        battery_v: tuple[float, float],
        nonce: str,
        docked: Mapping[int, int] | None = None,
        now_ms: int = 0,
        object_prefix: str = "amussel",
        sight: Sight = lambda now_ms: {},
        dock_count: int = PAPER_DOCKS,
    ) -> None:
        self.readings = Readings(battery_v)
        self.docks = ReportedDocks(agent_ids, docked or {}, now_ms, dock_count)
        self._sight = sight
        self._nonce = nonce
        self._object_prefix = object_prefix
        self._deferred: DeferredMessages[Received] = DeferredMessages(now_ms)
        self._facts: list[LinkFact] = []
        self._goals: dict[str, _SentGoal] = {}
        self._latest_key = ""
        self._silence = SilenceWatch()
        self._is_silent = False
        self._resend: GoalOrder | None = None
        self._status_ms = -1

    @property
    def dropped(self) -> Counter[str]:
        """Unusable messages of the vehicle, by reason."""
        return self.readings.dropped + self.docks.dropped

    def silent_topics(self, now_ms: int) -> list[str]:
        """Topics without a message up to `now_ms`, below the aPad's namespace or an aMussel's."""
        newest = (
            ("position", self.readings.position_ms),
            ("action_server/status", self._status_ms),
        )
        held = [f"/{self._object_prefix}{it}/position_static" for it in self.docks.unreported_ids(now_ms)]
        return [topic for topic, at_ms in newest if at_ms < now_ms] + held

    @property
    def unacknowledged(self) -> list[str]:
        """Keys of the goals without the server's acknowledgement."""
        return [key for key, sent in self._goals.items() if not sent.is_taken]

    @property
    def awaited_mechanisms(self) -> list[str]:
        """Keys of the unfinished goals to docking mechanisms."""
        return [key for key, sent in self._goals.items() if isinstance(sent.command, CloseDock | OpenDock)]

    def command(self, command: Command, now_ms: int) -> GoalOrder | None:
        """The goal to send; None for a perch from afar, which the vehicle would report as done."""
        if isinstance(command, CloseDock):
            why = why_out_of_reach(command.agent_id, self.readings.pose, self._sight, now_ms)
            if why is not None:
                self._facts.append(CommandFailed(now_ms, command.command_id, why))
                return None
        key = f"{self._nonce}-{command.command_id}"
        match command:
            case GoTo(_, north_m, east_m) | Hold(_, north_m, east_m):
                order = GoalOrder(key, GO_TO, north_m, east_m)
            case CloseDock(_, _, agent_id):
                order = GoalOrder(key, PERCH, name=f"{self._object_prefix}{agent_id}")
            case OpenDock(_, _, agent_id):
                self.docks.order_release(agent_id, now_ms)
                order = GoalOrder(key, RELEASE, name=f"{self._object_prefix}{agent_id}")
        self._goals[key] = _SentGoal(command, order, now_ms)
        self._latest_key = key
        return order

    def take_resend(self) -> GoalOrder | None:
        """A goal to repeat, returned once: the vehicle was silent when the goal was sent, and is back now."""
        order, self._resend = self._resend, None
        return order

    def _watch_silence(self, now_ms: int) -> None:
        position_ms = self.readings.position_ms
        changed = self._silence.look(position_ms, now_ms) if position_ms >= 0 else None
        if changed is None:
            return
        self._is_silent = changed.is_silent
        latest = self._goals.get(self._latest_key)
        if not changed.is_silent and latest is not None and not latest.is_taken:
            latest.sent_ms, self._resend = now_ms, latest.order

    def receive(self, message: Received, now_ms: int) -> None:
        """Takes a message; one stamped after `now_ms` waits for its time."""
        if self._deferred.defers(message, now_ms):
            return
        match message:
            case PoseReceived() | StateRefReceived() | BatteryReceived():
                self.readings.receive(message)
            case HeldPositionReceived():
                self._receive_held_position(message)
            case GoalStatusReceived():
                self._receive_goals(message)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """New facts, each stamped at or before `now_ms`; of poses and places only the newest."""
        for message in self._deferred.advance(now_ms):
            self.receive(message, now_ms)
        self._watch_silence(now_ms)
        self._apply_dock_facts(self.docks.silent(self.readings.position_ms))
        self._time_out_goals(now_ms)
        facts, self._facts = self._facts, []
        facts += self.docks.places()
        return facts + self.readings.take()

    def _receive_held_position(self, message: HeldPositionReceived) -> None:
        if (reason := out_of_range(north_m=message.north_m, east_m=message.east_m)) is not None:
            self.docks.dropped[f"position_static: {reason}"] += 1
            return
        self._apply_dock_facts(self.docks.receive(message))

    def _apply_dock_facts(self, facts: list[LinkFact]) -> None:
        """Passes on changes at the docks; a change that fulfils a goal ends it."""
        self._facts += facts
        for key, sent in list(self._goals.items()):
            if any(_fulfils(fact, sent.command) for fact in facts):
                del self._goals[key]

    def _receive_goals(self, message: GoalStatusReceived) -> None:
        named_keys = set()
        for status in message.words:
            named_keys.add(status.key)
            if (sent := self._goals.get(status.key)) is not None:
                sent.is_taken = True
                if status.code in ENDS:
                    self._end_goal(status, sent, message.at_ms)
        if not message.whole:
            return
        self._status_ms = max(self._status_ms, message.at_ms)
        for key, sent in list(self._goals.items()):
            if sent.is_taken and key not in named_keys and sent.ended_ms is None:
                self._end_goal(GoalStatusEntry(key, GoalCode.LOST, "did it restart?"), sent, message.at_ms)

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
        del self._goals[status.key]
        if status.code is GoalCode.SUCCEEDED:
            self._report_success(sent.command, at_ms)
        elif status.key == self._latest_key or status.code not in (GoalCode.PREEMPTED, GoalCode.RECALLED):
            reason = f"the aPad's action server says {status.code.name}"
            self._fail(sent.command, at_ms, f"{reason}: {status.text}" if status.text else reason)

    def _report_success(self, command: Command, at_ms: int) -> None:
        """Reports a finished go-to, or a mechanism that already was as commanded and would cause no report."""
        match command:
            case GoTo(command_id):
                self._facts.append(Arrived(at_ms, command_id))
            case CloseDock(_, _, agent_id):
                self._facts.append(DockClosed(at_ms, self.docks.dock_index_of(agent_id), agent_id))
            case OpenDock(_, dock_index, agent_id):
                self._facts.append(DockOpened(at_ms, dock_index, agent_id))

    def _time_out_goals(self, now_ms: int) -> None:
        for key, sent in list(self._goals.items()):
            reason = None
            if not sent.is_taken and not self._is_silent and now_ms - sent.sent_ms >= TAKEN_MS:
                reason = f"no action server took the goal within {TAKEN_MS / 1000:g} s"
            elif (
                isinstance(sent.command, CloseDock)
                and sent.ended_ms is not None
                and now_ms - sent.ended_ms >= PERCHED_MS
            ):
                reason = "the aPad says it perched, but holds nothing: is a dock free?"
            if reason is not None:
                del self._goals[key]
                self._fail(sent.command, now_ms, reason)

    def _fail(self, command: Command, at_ms: int, reason: str) -> None:
        if isinstance(command, OpenDock):
            self.docks.withdraw_release(command.agent_id)
        self._facts.append(CommandFailed(at_ms, command.command_id, reason))


def _fulfils(fact: LinkFact, command: Command) -> bool:
    match fact, command:
        case (DockClosed(_, _, agent_id), CloseDock(_, _, wanted)) | (
            DockOpened(_, _, agent_id),
            OpenDock(_, _, wanted),
        ):
            return agent_id == wanted
    return False

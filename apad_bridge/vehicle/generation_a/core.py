"""What an aPad of generation A says, as facts; what the port commands, as goals. No ROS in here, and no clock.

It trusts `position_static` for the docks and nothing else: a perch that succeeds may have done nothing (a fifth one), and a
release may never answer (the published server crashes in it). Every wait ends, by the constants below, in mission time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

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
from apad_bridge.vehicle.generation_a.docks import DocksByHearsay
from apad_bridge.vehicle.generation_a.messages import (
    ENDS,
    GO_TO,
    PERCH,
    RELEASE,
    GoalCode,
    GoalOrder,
    GoalsHeard,
    GoalWord,
    Heard,
    StaticHeard,
)
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.stack_messages import BatteryHeard, PoseHeard, StateHeard
from apad_bridge.vehicle.telemetry import InTime, Readings, Sight, SilenceWatch, why_out_of_reach

Command = GoTo | Hold | CloseDock | OpenDock
TAKEN_MS = 5_000
"""A goal that the action server has not acknowledged for so long has failed: nobody serves it. While the whole vehicle is
silent, goals wait for it; the port's own time-outs go on."""
PERCHED_MS = 1_000
"""After a perch succeeded, how long `position_static` may take to say so (it comes at 20 Hz)."""


@dataclass(slots=True)
class _Sent:
    """A goal that is not over."""

    command: Command
    order: GoalOrder
    sent_ms: int
    is_taken: bool = False
    ended_ms: int | None = None
    """When the server was done with it, if the docks have not shown so yet."""


class GenerationACore:
    """`hear` takes what came, `command` gives the goal to send, `advance` the facts stamped up to its time.

    `battery_v` is (empty, full). `docked` are agents by slot known to be held at `now_ms`. Goal keys begin with `nonce`,
    which no two runs on one server may share.
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
    ) -> None:
        self.readings = Readings(battery_v)
        self.docks = DocksByHearsay(agent_ids, docked or {}, now_ms)
        self._sight = sight
        self._nonce = nonce
        self._object_prefix = object_prefix
        self._in_time: InTime[Heard] = InTime(now_ms)
        self._facts: list[LinkFact] = []
        self._goals: dict[str, _Sent] = {}
        self._latest_key = ""
        self._silence = SilenceWatch()
        self._is_silent = False
        self._again: GoalOrder | None = None
        self._status_ms = -1

    @property
    def dropped(self) -> Counter[str]:
        """Words of the vehicle that were of no use, by reason."""
        return self.readings.dropped + self.docks.dropped

    def unheard(self, now_ms: int) -> list[str]:
        """Topics, below the aPad's namespace or an aMussel's, that have not spoken up to `now_ms`."""
        spoken = (
            ("position", self.readings.position_ms),
            ("action_server/status", self._status_ms),
        )
        held = [f"/{self._object_prefix}{it}/position_static" for it in self.docks.unheard(now_ms)]
        return [topic for topic, at_ms in spoken if at_ms < now_ms] + held

    @property
    def untaken(self) -> list[str]:
        """Keys of goals that the server has not acknowledged."""
        return [key for key, sent in self._goals.items() if not sent.is_taken]

    @property
    def awaited_mechanisms(self) -> list[str]:
        """Keys of goals to docking mechanisms that have not answered."""
        return [key for key, sent in self._goals.items() if isinstance(sent.command, CloseDock | OpenDock)]

    def command(self, command: Command, now_ms: int) -> GoalOrder | None:
        """The goal to send; None for a perch from afar, which the vehicle would take for done."""
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
        self._goals[key] = _Sent(command, order, now_ms)
        self._latest_key = key
        return order

    def again(self) -> GoalOrder | None:
        """A goal to send once more, told once: the vehicle was silent when it was sent, and is heard now."""
        order, self._again = self._again, None
        return order

    def _watch_silence(self, now_ms: int) -> None:
        heard_ms = self.readings.position_ms
        changed = self._silence.look(heard_ms, now_ms) if heard_ms >= 0 else None
        if changed is None:
            return
        self._is_silent = changed.is_silent
        latest = self._goals.get(self._latest_key)
        if not changed.is_silent and latest is not None and not latest.is_taken:
            latest.sent_ms, self._again = now_ms, latest.order

    def hear(self, heard: Heard, now_ms: int) -> None:
        """What is stamped after `now_ms` waits for its time."""
        if self._in_time.puts_off(heard, now_ms):
            return
        match heard:
            case PoseHeard() | StateHeard() | BatteryHeard():
                self.readings.hear(heard)
            case StaticHeard():
                self._hear_static(heard)
            case GoalsHeard():
                self._hear_goals(heard)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts not told before, each stamped at or before `now_ms`; poses and places are the newest only."""
        for heard in self._in_time.advance(now_ms):
            self.hear(heard, now_ms)
        self._watch_silence(now_ms)
        self._take_docks(self.docks.silent(self.readings.position_ms))
        self._end_waits(now_ms)
        facts, self._facts = self._facts, []
        facts += self.docks.places()
        return facts + self.readings.take()

    def _hear_static(self, heard: StaticHeard) -> None:
        if not (math.isfinite(heard.north_m) and math.isfinite(heard.east_m)):
            self.docks.dropped["position_static: not finite"] += 1
            return
        self._take_docks(self.docks.hear(heard))

    def _take_docks(self, facts: list[LinkFact]) -> None:
        """What changed at the docks; a goal that wanted just that is over."""
        self._facts += facts
        for key, sent in list(self._goals.items()):
            if any(_is_wanted(fact, sent.command) for fact in facts):
                del self._goals[key]

    def _hear_goals(self, heard: GoalsHeard) -> None:
        named = set()
        for word in heard.words:
            named.add(word.key)
            if (sent := self._goals.get(word.key)) is not None:
                sent.is_taken = True
                if word.code in ENDS:
                    self._end_goal(word, sent, heard.at_ms)
        if not heard.whole:
            return
        self._status_ms = max(self._status_ms, heard.at_ms)
        for key, sent in list(self._goals.items()):
            if sent.is_taken and key not in named and sent.ended_ms is None:
                self._end_goal(GoalWord(key, GoalCode.LOST, "did it restart?"), sent, heard.at_ms)

    def _end_goal(self, word: GoalWord, sent: _Sent, at_ms: int) -> None:
        match sent.command, word.code:
            case CloseDock(_, _, agent_id), GoalCode.SUCCEEDED if not self.docks.holds(agent_id):
                is_over = False
            case OpenDock(_, _, agent_id), GoalCode.SUCCEEDED | GoalCode.LOST if self.docks.holds(agent_id):
                # The published server crashes in a release: what became of it is for `position_static` to tell.
                is_over = False
            case _:
                is_over = True
        if not is_over:
            sent.ended_ms = at_ms if sent.ended_ms is None else sent.ended_ms
            return
        del self._goals[word.key]
        if word.code is GoalCode.SUCCEEDED:
            self._tell_success(sent.command, at_ms)
        elif word.key == self._latest_key or word.code not in (GoalCode.PREEMPTED, GoalCode.RECALLED):
            reason = f"the aPad's action server says {word.code.name}"
            self._fail(sent.command, at_ms, f"{reason}: {word.text}" if word.text else reason)

    def _tell_success(self, command: Command, at_ms: int) -> None:
        """Of a go-to; or of a mechanism that already was as commanded, so that who commanded hears of it."""
        match command:
            case GoTo(command_id):
                self._facts.append(Arrived(at_ms, command_id))
            case CloseDock(_, _, agent_id):
                self._facts.append(DockClosed(at_ms, self.docks.dock_index_of(agent_id), agent_id))
            case OpenDock(_, dock_index, agent_id):
                self._facts.append(DockOpened(at_ms, dock_index, agent_id))

    def _end_waits(self, now_ms: int) -> None:
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


def _is_wanted(fact: LinkFact, command: Command) -> bool:
    match fact, command:
        case (DockClosed(_, _, agent_id), CloseDock(_, _, wanted)) | (
            DockOpened(_, _, agent_id),
            OpenDock(_, _, wanted),
        ):
            return agent_id == wanted
    return False

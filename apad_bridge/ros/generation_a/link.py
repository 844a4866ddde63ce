"""A vehicle link to ANY aPad of generation A on ROS, ours or a real one.

    link = GenerationALink(scenario, docks, gate, our_clock=True)
    link.wait_until_ready(10.0)        # VehicleNotReady, one line that names the missing parts

Stamps: with `our_clock` (our master, our simulated aPad) facts carry those of their messages, which are mission time.
Without, a fact is stamped with the tick that receives it, because the clocks of a vehicle at sea are not ours.

Beside what both generations publish, an aPad of generation A publishes its action server's status, and which aMussels it
holds where.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import rospy
from actionlib_msgs.msg import GoalID, GoalStatusArray

from apad_bridge.ros.generation_a.contacts_link import DockInquiry
from apad_bridge.ros.links.legacy_link import LegacyLink, OpenedAPad
from apad_bridge.ros.links.service_calls import CallFailed
from apad_bridge.ros.links.vehicle_subscribers import POSE_FIELDS, VehicleSubscribers, publisher_of
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.types.live_types import differing_listeners, unreadable_topics
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import AMUSSEL, of_amussel, of_apad
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import CloseDock, OpenDock, VehicleCommand
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    GoalCode,
    GoalOrder,
    GoalSeen,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
    OffAnswered,
    Received,
)
from apad_bridge.vehicle.generation_a.stack import STACK
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.order_queue import Rank
from apad_bridge.vehicle.stack_messages import UNSTAMPED
from apad_bridge.vehicle.telemetry import ReachCheck
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.contacts import FloatingPlaces, why_out_of_reach

use_generated_messages()

from apad.msg import aPadActionGoal, aPadActionResult  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from navcon_msgs.srv import EnableControl  # noqa: E402

_STATUS = ("header.stamp", "status_list")
_GOAL = ("goal_id.id", "goal.id", "goal.pose.position.x", "goal.pose.position.y")
_RESULT = ("header.stamp", "status.goal_id.id", "status.status", "status.text")
_STATIC = ("header.stamp", "position.north", "position.east", "status")
_GOALS, _CANCELS = "goals", "cancels"
_SWITCHES = ("VelCon_enable", "FADP_enable")
"""The lines of orders; those of the last two switch the controllers."""
ANSWER_S = 0.25
"""Wall seconds that `advance` waits for the answer of a dock's mechanism commanded at the same tick."""
ANSWER_ON_OUR_CLOCK_S = 5.0
"""Longer on our own clock: waiting costs nothing there, and a busy machine decides as an idle one."""


class Subscribers(VehicleSubscribers):
    """Subscribes to the aPad called `name` and to `position_static` of each aMussel."""

    def __init__(self, name: str, agent_ids: Iterable[int], inbox: Inbox[Received], *, stamped: bool) -> None:
        self.server_node = ""
        """The node that publishes the action server's status; empty before its first message."""
        super().__init__(name, inbox, stamped=stamped, pose_fields=(*POSE_FIELDS, "status"))
        server = of_apad(name, "action_server")
        self._listen(f"{server}/status", GoalStatusArray, _STATUS, self._take_status, is_vital=True)
        self._listen(f"{server}/goal", aPadActionGoal, _GOAL, self._take_goal)
        self._listen(f"{server}/result", aPadActionResult, _RESULT, self._take_result, is_vital=True)
        self._known: set[int] = set()
        self.listen_to(agent_ids)

    def listen_to(self, agent_ids: Iterable[int]) -> None:
        """Subscribes to `position_static` of these too."""
        for agent_id in sorted(set(agent_ids) - self._known):
            self._known.add(agent_id)
            topic = of_amussel(agent_id, "position_static")
            self._listen(topic, NavSts, _STATIC, self._take_static, agent_id, is_checked_before=False)

    @property
    def missing(self) -> list[str]:
        """A line for a person about each part that a flight needs and that is not connected."""
        lines = super().missing
        return lines if self.server_node else [*lines, "no message from its action server"]

    def _take_static(self, message: Any, agent_id: int) -> None:
        position, released = message.position, message.status == 1
        contact = HeldPositionReceived(
            self._stamp(message), agent_id, position.north, position.east, released
        )
        self._inbox.put(contact, always=released)

    def _take_status(self, message: Any) -> None:
        self.server_node = publisher_of(message)
        self._inbox.put(
            GoalStatusReceived(self._stamp(message), self._statuses(message.status_list), whole=True)
        )

    def _take_goal(self, message: Any) -> None:
        """A goal on its way to the server: actionlib itself would tell neither its place nor who sent it."""
        place, key, client = message.goal.pose.position, message.goal_id.id, publisher_of(message)
        self._inbox.put(GoalSeen(UNSTAMPED, key, message.goal.id, place.x, place.y, client), always=True)

    def _take_result(self, message: Any) -> None:
        result = GoalStatusReceived(self._stamp(message), self._statuses([message.status]), whole=False)
        self._inbox.put(result, always=True)

    def _statuses(self, statuses: Iterable[Any]) -> tuple[GoalStatusEntry, ...]:
        known = []
        for status in statuses:
            try:
                known.append(GoalStatusEntry(status.goal_id.id, GoalCode(status.status), status.text))
            except ValueError:
                self._inbox.drop("a goal's status of no known code")
        return tuple(known)


class GenerationALink(LegacyLink[GenerationACore]):
    """The VehicleLink of the scenario's aPad; `docks` are those that it reports."""

    STACK = STACK
    MEND = "put its own into apad_bridge/ros/definitions and run launch_scripts/install"

    def __init__(
        self,
        scenario: Scenario,
        docks: ReportedDocks,
        gate: Gate,
        now_ms: int = 0,
        *,
        our_clock: bool,
        out_of_reach: ReachCheck,
    ) -> None:
        name, pilots = scenario.apad.name, () if scenario.guards is None else scenario.guards.pilots
        core = GenerationACore(
            docks,
            scenario.apad.battery.range_v,
            f"musselbed-{secrets.token_hex(4)}",
            now_ms,
            out_of_reach,
            takes_back=our_clock,
            gate=gate,
            pilots=frozenset(map(rospy.resolve_name, pilots)),
        )
        super().__init__(scenario.apad, core, gate, now_ms)
        self._answer_s = ANSWER_ON_OUR_CLOCK_S if our_clock else ANSWER_S
        self._mechanism_ms: int | None = None
        self._subscribers = Subscribers(name, scenario.fleet.ids, self._inbox, stamped=our_clock)
        self._inquiry = DockInquiry(name, self._inbox)
        server = of_apad(name, "action_server")
        self._goals = self._sender.add_topic(_GOALS, f"{server}/goal", aPadActionGoal, self._server)
        self._sender.add_topic(_CANCELS, f"{server}/cancel", GoalID, self._server, may_be_late=True)
        for switch in _SWITCHES:
            self._sender.add_service(switch, of_apad(name, switch), EnableControl)

    def serve(self, agent_ids: Iterable[int]) -> None:
        self._subscribers.listen_to(agent_ids)
        self._core.docks.serve(agent_ids)

    def _missing(self) -> list[str]:
        unread = [] if self._goals.readers() else [f"no subscriber on {self._goals.name}"]
        return self._subscribers.missing + unread

    def _differences(self) -> list[str]:
        goal_types = {self._goals.name: aPadActionGoal}
        return [*unreadable_topics(self._subscribers.needed), *differing_listeners(goal_types)]

    def _server(self) -> str:
        return self._subscribers.server_node

    @property
    def can_stop(self) -> bool:
        return self._sender.are_open(_SWITCHES)

    def _prepare(self) -> None:
        """A vehicle without these services can be stopped by a go-to alone; a real one should not fly so."""
        self._sender.begin()
        try:
            self._sender.wait_until_open(_SWITCHES)
        except CallFailed as failed:
            self._inbox.drop(f"controllers cannot be switched off: {failed}")

    def _send(self, cleared: Cleared[GoalOrder]) -> None:
        order = cleared.order
        rank = Rank.HOLD if order.pre_empts else Rank.ORDER
        for key in order.ends:
            self._sender.send(_CANCELS, rank, cleared, GoalID(id=key), _not_awaited)
        self._sender.send(_GOALS, rank, cleared, _goal_message(order), _not_awaited)

    def _switch_off(self) -> None:
        """Cancels every client's goal, then ends the thrust, then the controller that would ask for it."""
        if (cleared := self._core.take_off_order()) is None:
            return
        request = EnableControl._request_class(enable=False)
        thrust, controller = _SWITCHES

        parts: list[str | None] = []
        """The answers of the cancel and of the switches: a server whose goal goes on has not taken the OFF."""

        def answered(_: Any, refused: str | None, was_cut: bool) -> None:
            parts.append(refused)
            if len(parts) == 2:
                why_not = next(filter(None, parts), None)
                self._inbox.put(OffAnswered(UNSTAMPED, cleared.order.number, why_not), always=True)

        def thrust_is_off(_: Any, refused: str | None, was_cut: bool) -> None:
            if refused is not None:
                answered(None, refused, was_cut)
            else:
                self._sender.send(controller, Rank.OFF, cleared, request, answered)

        self._sender.send(_CANCELS, Rank.OFF, cleared, GoalID(), answered)
        self._sender.send(thrust, Rank.OFF, cleared, request, thrust_is_off)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`. At the tick of a mechanism's command it waits up to `ANSWER_S` for the answer."""
        self._now_ms = now_ms
        self._drain()
        if self._mechanism_ms == now_ms:
            self._mechanism_ms = None
            self._wait_while(lambda: self._core.awaited_mechanisms, self._answer_s)
        facts = self._core.advance(now_ms)
        for order in self._core.take_orders():
            self._send(order)
        self._switch_off()
        if self._core.take_question():
            self._inquiry.ask()
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        if isinstance(cleared.order, CloseDock | OpenDock):
            self._mechanism_ms = now_ms
        if (order := self._core.command(cleared, now_ms)) is not None:
            self._send(order)
        self._switch_off()

    def close(self) -> None:
        self._subscribers.close()
        self._sender.close()

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Waits until each topic has come up to `now_ms`, because ROS keeps no order between topics.

        Returns the topics that have not. A topic that was late is not waited for again until it has come.
        """

        def missing() -> list[str]:
            silent_topics = set(self._core.silent_topics(now_ms))
            self._excused &= silent_topics | set(self._unanswered())
            return sorted(silent_topics - self._excused)

        still_missing = self._wait_while(missing, timeout_s)
        self._excused |= set(still_missing)
        return still_missing

    def _unanswered(self) -> list[str]:
        return [*self._core.unacknowledged, *self._core.awaited_mechanisms]


def _not_awaited(_: Any, refused: str | None, was_cut: bool) -> None:
    """The action server's own status tells what became of a goal."""


def _goal_message(order: GoalOrder) -> Any:
    """Leaves the stamp out: the server then sets its own, so that a clock of ours that is off does no harm."""
    message = aPadActionGoal()
    message.goal_id.id = order.key
    message.goal.id = order.kind
    message.goal.pose.position.x, message.goal.pose.position.y = order.north_m, order.east_m
    message.goal.pose.orientation.w = 1.0
    message.goal.object = order.name
    return message


def open_link(
    scenario: Scenario,
    gate: Gate,
    sight: FloatingPlaces,
    docked: Mapping[int, int],
    now_ms: int,
    *,
    our_clock: bool,
) -> OpenedAPad:
    prefix, places = rospy.resolve_name(AMUSSEL)[1:], STACK.capabilities(scenario.apad.docks).docks
    docks = ReportedDocks(scenario.fleet.ids, docked, now_ms, places, prefix)
    out_of_reach = partial(why_out_of_reach, sight)
    return OpenedAPad(
        GenerationALink(scenario, docks, gate, now_ms, our_clock=our_clock, out_of_reach=out_of_reach)
    )

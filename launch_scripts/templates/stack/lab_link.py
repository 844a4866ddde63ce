"""The ROS side of the stack. The core of musselbed's generation B keeps tasks, time-outs and the pilot's rights."""

from collections.abc import Iterable, Mapping
from typing import Any

import rosgraph
import rospy
from geometry_msgs.msg import PoseStamped
from lab_stack import STACK
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from apad_bridge.assembly import flight_parts
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.links.legacy_link import LegacyLink, OpenedAPad
from apad_bridge.ros.links.order_sender import Answered
from apad_bridge.ros.links.vehicle_subscribers import VehicleSubscribers
from apad_bridge.ros.types.live_types import unreadable_topics
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import GoTo, Hold, OrderCut, Stop, VehicleCommand
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import (
    ManualReceived,
    NumberedOrder,
    PrimitiveStatus,
    ServiceAnswered,
    StatusReceived,
)
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.order_queue import Rank
from apad_bridge.vehicle.stack_messages import UNSTAMPED
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.contacts import FloatingPlaces
from apad_bridge.world.generation_b.docks import BenchDocks

GOAL, OFF = "helm/goal", "helm/off"


class Subscribers(VehicleSubscribers):
    """rospy's threads call these; they convert, and leave the message to the flight's thread."""

    def __init__(self, name: str, inbox: Any) -> None:
        super().__init__(name, inbox, stamped=False)
        self._listen(f"{name}/is_under_way", Bool, ("data",), self._take_under_way, is_vital=True)
        self._listen(f"{name}/manual", Bool, ("data",), self._take_manual)

    def _take_under_way(self, message: Any) -> None:
        status = PrimitiveStatus.RUNNING if message.data else PrimitiveStatus.DONE
        self._inbox.put(StatusReceived(UNSTAMPED, False, status))

    def _take_manual(self, message: Any) -> None:
        self._inbox.put(ManualReceived(UNSTAMPED, bool(message.data)), always=True)


class LabLink(LegacyLink[GenerationBCore]):
    STACK = STACK
    MEND = "source the boat's workspace"

    def __init__(self, scenario: Scenario, docks: BenchDocks, gate: Gate, now_ms: int) -> None:
        battery_v, docking = scenario.apad.battery.range_v, scenario.mission.docking
        core = GenerationBCore(docks, battery_v, docking, now_ms, takes_back=False, gate=gate)
        super().__init__(scenario.apad, core, gate, now_ms)
        self._subscribers = Subscribers(self.name, self._inbox)
        self._sender.add_topic(GOAL, f"{self.name}/{GOAL}", PoseStamped)
        self._sender.add_service(OFF, f"{self.name}/{OFF}", Trigger)

    def serve(self, agent_ids: Iterable[int]) -> None:
        self._core.docks.serve(agent_ids)

    def _missing(self) -> list[str]:
        try:
            subscribers = Graph.read(rosgraph.get_master_uri()).subscribers
        except Unreachable as error:
            return [*self._subscribers.missing, str(error)]
        goal = rospy.resolve_name(f"{self.name}/{GOAL}")
        return self._subscribers.missing + ([] if subscribers.get(goal) else [f"nobody reads {goal}"])

    def _differences(self) -> list[str]:
        return unreadable_topics(self._subscribers.needed)

    @property
    def can_stop(self) -> bool:
        return self._sender.are_open([OFF])

    def _prepare(self) -> None:
        self._sender.begin()
        self._sender.wait_until_open([OFF])

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        self._drain()
        facts = self._core.advance(now_ms)
        self._send()
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self._core.command(cleared, now_ms)
        self._send()

    def receive_dock_report(self, report: DockReport) -> None:
        self._core.receive_dock_report(report)

    def close(self) -> None:
        self._subscribers.close()
        self._sender.close()

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        return []  # no simulated boat follows our clock

    def _send(self) -> None:
        """Sends what the gate has let out. A stop that holds is a goal too: on one line, no older goal can follow it."""
        for cleared in self._core.take_calls():
            call, answered = cleared.order, self._answer_to(cleared.order)
            match call.order:
                case GoTo(_, north_m, east_m) | Hold(_, north_m, east_m):
                    is_stop = isinstance(call.order, Hold) and call.order.pre_empts
                    goal = PoseStamped()
                    goal.pose.position.x, goal.pose.position.y = north_m, east_m
                    goal.pose.orientation.w = 1.0
                    self._sender.send(GOAL, Rank.HOLD if is_stop else Rank.ORDER, cleared, goal, answered)
                case Stop():
                    self._sender.send(OFF, Rank.OFF, cleared, Trigger._request_class(), answered)

    def _answer_to(self, call: NumberedOrder) -> Answered:
        """Runs in the sender's thread. A topic has no answer: its order counts as taken when it has left."""

        def answered(response: Any, refused: str | None, was_cut: bool) -> None:
            if was_cut:
                self._inbox.put(OrderCut(UNSTAMPED), always=True)
            if refused is None and response is not None and not response.success:
                refused = response.message or "it does not take the order"
            self._inbox.put(ServiceAnswered(UNSTAMPED, call.number, refused), always=True)

        return answered


def opened(
    scenario: Scenario,
    gate: Gate,
    sight: FloatingPlaces,
    docked: Mapping[int, int],
    now_ms: int,
    *,
    our_clock: bool,
) -> OpenedAPad:
    docks = BenchDocks(scenario.fleet.ids, flight_parts.misses(scenario), sight, docked, scenario.apad.docks)
    return OpenedAPad(LabLink(scenario, docks, gate, now_ms))

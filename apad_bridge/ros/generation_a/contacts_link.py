"""A VehicleLink that only listens to an aPad's `position_static` of our aMussels, and commands nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.ros.links.service_calls import ServiceAddress, ask_service
from apad_bridge.ros.system.inbox import Inbox, Listening
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import AMUSSEL, of_amussel, of_apad
from apad_bridge.vehicle.capabilities import published_docks
from apad_bridge.vehicle.commands import PoseReported, VehicleCommand
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import DocksReceived, GoalStatusReceived, HeldPositionReceived
from apad_bridge.vehicle.generation_a.others_goals import ServerWatch
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.stack_messages import UNSTAMPED
from apad_bridge.vehicle.telemetry import Readings
from apad_bridge.vehicle.vehicle_link import APadSeen, Carried, Cleared, LetGo, LinkFact

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import GetDockingInfo  # noqa: E402


class DockInquiry:
    """Asks the aPad which objects its docks hold.

    It calls `check_docking_availability` of the aPad called `name`, and puts a `DocksReceived` into the inbox."""

    def __init__(self, name: str, inbox: Inbox[Any]) -> None:
        self._address = ServiceAddress(of_apad(name, "check_docking_availability"), GetDockingInfo)
        self._inbox = inbox

    def ask(self) -> None:
        ask_service(self._address, GetDockingInfo._request_class(), self._answered)

    def _answered(self, response: Any, refused: str | None) -> None:
        held = None if refused is not None else frozenset(it.strip("/") for it in response.slots)
        self._inbox.put(DocksReceived(UNSTAMPED, held), always=True)


class ContactsLink(Listening[HeldPositionReceived | PoseReported | DocksReceived | GoalStatusReceived]):
    """Gives a fleet alone the contacts of docks that somebody else's planner commands.

    It also subscribes to the position and the action server's status of the aPad `apad` (its namespace), so that neither a
    gap in the Wi-Fi nor a server that is silent about a dock is taken for a release, and to know where its modem is.
    """

    def __init__(
        self,
        apad: str,
        agent_ids: Iterable[int],
        docked: Mapping[int, int],
        now_ms: int,
        dock_count: int,
    ) -> None:
        super().__init__()
        ids = list(agent_ids)
        self._docks = ReportedDocks(
            ids, docked, now_ms, published_docks(dock_count), rospy.resolve_name(AMUSSEL)[1:]
        )
        self._inquiry = DockInquiry(apad, self._inbox)
        self._readings = Readings((0.0, 1.0))
        self._server = ServerWatch("")
        self._subscribers = [
            rospy.Subscriber(
                of_amussel(agent_id, "position_static"), NavSts, self._take, agent_id, tcp_nodelay=True
            )
            for agent_id in ids
        ]
        self._subscribers += [
            rospy.Subscriber(of_apad(apad, "position"), NavSts, self._note_apad),
            rospy.Subscriber(f"{of_apad(apad, 'action_server')}/status", GoalStatusArray, self._note_server),
        ]

    @property
    def dropped(self) -> Counter[str]:
        """Unusable messages, by reason."""
        return super().dropped + self._readings.dropped + self._docks.dropped

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Contacts and the aPad's place, stamped `now_ms` because the clocks of a vehicle at sea are not ours."""
        facts: list[LinkFact] = []
        for message in self._inbox.take():
            match replace(message, at_ms=now_ms):
                case PoseReported() as pose:
                    self._readings.receive(pose)
                case DocksReceived() as answer:
                    facts += self._docks.receive_answer(
                        answer, server_lives=self._server.lives(self._readings)
                    )
                case GoalStatusReceived() as status:
                    self._server.receive(status)
                case HeldPositionReceived() as held:
                    if (reason := out_of_range(north_m=held.north_m, east_m=held.east_m)) is not None:
                        self._docks.dropped[f"position_static: {reason}"] += 1
                    else:
                        facts += self._docks.receive(held)
        facts += [
            *self._docks.silent(self._readings, server_lives=self._server.lives(self._readings)),
            *self._docks.places(self._readings),
        ]
        if self._docks.take_question():
            self._inquiry.ask()
        contacts = [fact for fact in facts if isinstance(fact, Carried | LetGo)]
        poses = self._readings.take(Gate.without_guards())
        return [
            *(APadSeen(it.at_ms, it.north_m, it.east_m) for it in poses if isinstance(it, PoseReported)),
            *contacts,
        ]

    @property
    def can_stop(self) -> bool:
        """A fleet alone stops no vehicle, and whoever commands the vehicle has the watchdog's ear."""
        return False

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def _note_apad(self, message: Any) -> None:
        place, yaw = message.position, message.orientation.yaw
        self._inbox.put(PoseReported(UNSTAMPED, place.north, place.east, yaw))

    def _note_server(self, _: Any) -> None:
        self._inbox.put(GoalStatusReceived(UNSTAMPED, (), whole=True))

    def _take(self, message: Any, agent_id: int) -> None:
        place, released = message.position, message.status == 1
        contact = HeldPositionReceived(UNSTAMPED, agent_id, place.north, place.east, released)
        self._inbox.put(contact, always=released)

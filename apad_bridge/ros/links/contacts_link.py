"""A VehicleLink that only listens to an aPad's `position_static` of our aMussels, and commands nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import rospy

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, of_apad
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import HeldPositionReceived
from apad_bridge.vehicle.link import APadSeen, Carried, LetGo, LinkFact

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402


class ContactsLink:
    """Gives a fleet alone the contacts of docks that somebody else's planner commands.

    It also subscribes to the position of the aPad `apad` (its namespace), so that a gap in the Wi-Fi is not taken for a
    release, and to know where the aPad's modem is.
    """

    def __init__(
        self,
        apad: str,
        agent_ids: Iterable[int],
        docked: Mapping[int, int],
        now_ms: int,
        dock_count: int,
    ) -> None:
        ids = list(agent_ids)
        self.dropped: Counter[str] = Counter()
        self._docks = ReportedDocks(ids, docked, now_ms, dock_count)
        self._inbox: Inbox[tuple[int, float, float, bool]] = Inbox()
        self._apad_places: Inbox[tuple[float, float]] = Inbox()
        self._apad_position_ms = now_ms
        self._subscribers = [
            rospy.Subscriber(
                of_amussel(agent_id, "position_static"), NavSts, self._take, agent_id, tcp_nodelay=True
            )
            for agent_id in ids
        ]
        self._subscribers.append(rospy.Subscriber(of_apad(apad, "position"), NavSts, self._note_apad))

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Contacts and the aPad's place, stamped `now_ms` because the clocks of a vehicle at sea are not ours."""
        facts: list[LinkFact] = []
        for agent_id, north_m, east_m, released in self._inbox.take():
            if (reason := out_of_range(north_m=north_m, east_m=east_m)) is not None:
                self.dropped[f"position_static: {reason}"] += 1
                continue
            facts += self._docks.receive(HeldPositionReceived(now_ms, agent_id, north_m, east_m, released))
        seen: list[LinkFact] = []
        for north_m, east_m in self._apad_places.take():
            self._apad_position_ms = now_ms
            if (reason := out_of_range(north_m=north_m, east_m=east_m)) is not None:
                self.dropped[f"position: {reason}"] += 1
            else:
                seen = [APadSeen(now_ms, north_m, east_m)]
        facts += [*self._docks.silent(self._apad_position_ms), *self._docks.places()]
        return [*seen, *(fact for fact in facts if isinstance(fact, Carried | LetGo))]

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _note_apad(self, message: Any) -> None:
        self._apad_places.put((message.position.north, message.position.east))

    def _take(self, message: Any, agent_id: int) -> None:
        position, released = message.position, message.status == 1
        self._inbox.put((agent_id, position.north, position.east, released), always=released)

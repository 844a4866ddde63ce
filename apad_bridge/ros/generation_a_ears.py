"""What an aPad of generation A says beside what both do: its action server's words, and what it holds where."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from actionlib_msgs.msg import GoalStatusArray

from apad_bridge.ros.links.inbox import Inbox
from apad_bridge.ros.links.legacy_subscribers import POSE_FIELDS, LegacyEars
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, of_apad
from apad_bridge.vehicle.generation_a.messages import (
    GoalCode,
    GoalsHeard,
    GoalWord,
    Heard,
    StaticHeard,
)

use_generated_messages()

from apad.msg import aPadActionResult  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402

_STATUS = ("header.stamp", "status_list")
_RESULT = ("header.stamp", "status.goal_id.id", "status.status", "status.text")


class Ears(LegacyEars):
    """Subscribes to the aPad called `name` and to `position_static` of each aMussel."""

    def __init__(self, name: str, agent_ids: Iterable[int], inbox: Inbox[Heard], *, stamped: bool) -> None:
        self.has_heard_server = False
        super().__init__(name, inbox, stamped=stamped, pose_fields=(*POSE_FIELDS, "status"))
        server = of_apad(name, "action_server")
        self._listen(f"{server}/status", GoalStatusArray, _STATUS, self._take_status, is_vital=True)
        self._listen(f"{server}/result", aPadActionResult, _RESULT, self._take_result, is_vital=True)
        self._known: set[int] = set()
        self.listen_to(agent_ids)

    def listen_to(self, agent_ids: Iterable[int]) -> None:
        """To what is said of these too."""
        for agent_id in sorted(set(agent_ids) - self._known):
            self._known.add(agent_id)
            self._listen(of_amussel(agent_id, "position_static"), NavSts, (), self._take_static, agent_id)

    @property
    def missing(self) -> list[str]:
        """What is not connected of that which a flight cannot do without, for a person."""
        lines = super().missing
        return lines if self.has_heard_server else [*lines, "no word of its action server"]

    def _take_static(self, message: Any, agent_id: int) -> None:
        position, released = message.position, message.status == 1
        heard = StaticHeard(self._stamp(message), agent_id, position.north, position.east, released)
        self._inbox.put(heard, always=released)

    def _take_status(self, message: Any) -> None:
        self.has_heard_server = True
        self._inbox.put(GoalsHeard(self._stamp(message), self._words(message.status_list), whole=True))

    def _take_result(self, message: Any) -> None:
        heard = GoalsHeard(self._stamp(message), self._words([message.status]), whole=False)
        self._inbox.put(heard, always=True)

    def _words(self, statuses: Iterable[Any]) -> tuple[GoalWord, ...]:
        words = []
        for status in statuses:
            try:
                words.append(GoalWord(status.goal_id.id, GoalCode(status.status), status.text))
            except ValueError:
                self._inbox.drop("a goal's status of no known code")
        return tuple(words)

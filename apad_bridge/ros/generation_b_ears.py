"""What an aPad of generation B says beside what both do: how its primitives stand, its arms, and whether a pilot steers."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Bool, Float32MultiArray, Int32, String

from apad_bridge.ros.links.inbox import Inbox
from apad_bridge.ros.links.legacy_subscribers import LegacyEars
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.generation_b.messages import (
    PRIMITIVE_FINISHED,
    ArmHeard,
    FinishedHeard,
    Heard,
    PilotHeard,
    Status,
    StatusHeard,
)
from apad_bridge.vehicle.stack_messages import UNSTAMPED

_OPEN = 0.5
"""`dock_out` is 1.0 for an arm that stands open, and 0.0."""
_DATA = ("data",)


class Ears(LegacyEars):
    """Subscribes to the aPad called `name`. Nothing but poses has a stamp."""

    def __init__(self, name: str, inbox: Inbox[Heard], *, stamped: bool) -> None:
        super().__init__(name, inbox, stamped=stamped)
        self._listen(of_apad(name, "goto_status"), Int32, _DATA, self._take_status, False)
        self._listen(of_apad(name, "docking_status"), Int32, _DATA, self._take_status, True)
        self._listen(of_apad(name, "eventString"), String, _DATA, self._take_event)
        self._listen(of_apad(name, "manual"), Bool, _DATA, self._take_manual)
        self._listen(of_apad(name, "dock_out"), Float32MultiArray, _DATA, self._take_arms)

    def _take_status(self, message: Any, docking: bool) -> None:
        try:
            heard = StatusHeard(UNSTAMPED, docking, Status(message.data))
        except ValueError:
            self._inbox.drop("a primitive's status of no known code")
            return
        self._inbox.put(heard, always=True)

    def _take_event(self, message: Any) -> None:
        if message.data == PRIMITIVE_FINISHED:
            self._inbox.put(FinishedHeard(UNSTAMPED))

    def _take_manual(self, message: Any) -> None:
        self._inbox.put(PilotHeard(UNSTAMPED, bool(message.data)), always=True)

    def _take_arms(self, message: Any) -> None:
        slot = next((slot for slot, opening in enumerate(message.data) if opening > _OPEN), None)
        self._inbox.put(ArmHeard(UNSTAMPED, slot), always=True)

"""Asks an aPad of generation A which objects its docks hold."""

from __future__ import annotations

from typing import Any

from apad_bridge.ros.links.service_calls import ServiceAddress, ask_service
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.generation_a.messages import DocksReceived
from apad_bridge.vehicle.stack_messages import UNSTAMPED

use_generated_messages()

from misc_msgs.srv import GetDockingInfo  # noqa: E402


class DockInquiry:
    """Calls `check_docking_availability` of the aPad called `name`, and puts a `DocksReceived` into the inbox."""

    def __init__(self, name: str, inbox: Inbox[Any]) -> None:
        self._address = ServiceAddress(of_apad(name, "check_docking_availability"), GetDockingInfo)
        self._inbox = inbox

    def ask(self) -> None:
        ask_service(self._address, GetDockingInfo._request_class(), self._answered)

    def _answered(self, response: Any, refused: str | None) -> None:
        held = None if refused is not None else frozenset(it.strip("/") for it in response.slots)
        self._inbox.put(DocksReceived(UNSTAMPED, held), always=True)

"""Switches a generation A aPad's controllers off.

The stack has no primitive for it. By the source of the published stack, `VelCon_enable` false disables all six axes, so
that no thrust is left, and the next go-to enables them again. A cancelled goal alone leaves the vehicle on its way. So
OFF is three orders, in this sequence: cancel every goal, `VelCon_enable` false, `FADP_enable` false.
"""

from __future__ import annotations

from apad_bridge.vehicle.commands import CommandAccepted, CommandFailed, VehicleCommand
from apad_bridge.vehicle.generation_a.messages import OffAnswered, OffOrder
from apad_bridge.vehicle.vehicle_link import Cleared


class ControllersOff:
    """The OFF that is ordered, until another command replaces it. `take_order` returns what must be sent."""

    def __init__(self) -> None:
        self._command: Cleared[VehicleCommand] | None = None
        self._number = 0
        """The number of the newest order."""
        self._is_taken = False
        self._must_send = False

    @property
    def is_ordered(self) -> bool:
        return self._command is not None

    def order(self, stop: Cleared[VehicleCommand]) -> None:
        self._command, self._is_taken, self._must_send = stop, False, True
        self._number += 1

    def forget(self) -> None:
        """Another command has replaced it."""
        self._command, self._must_send = None, False

    def receive(self, answer: OffAnswered) -> CommandAccepted | CommandFailed | None:
        """The fact that an answer tells; None for one that tells nothing new."""
        if self._command is None or answer.number != self._number or self._is_taken:
            return None
        command_id = self._command.order.command_id
        if answer.refused is None:
            self._is_taken = True
            return CommandAccepted(answer.at_ms, command_id)
        return CommandFailed(answer.at_ms, command_id, answer.refused)

    def take_order(self) -> tuple[OffOrder, Cleared[VehicleCommand]] | None:
        """The order to send and the command for which it goes out, once."""
        must_send, self._must_send = self._must_send, False
        return (OffOrder(self._number), self._command) if must_send and self._command is not None else None

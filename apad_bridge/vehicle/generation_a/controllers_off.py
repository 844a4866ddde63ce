"""Switches a generation A aPad's controllers off, and repeats that until the vehicle has taken it.

The stack has no primitive for it. By the source of the published stack, `VelCon_enable` false disables all six axes, so
that no thrust is left, and the next go-to enables them again. A cancelled goal alone leaves the vehicle on its way. So
OFF is three orders, in this sequence: cancel every goal, `VelCon_enable` false, `FADP_enable` false.
"""

from __future__ import annotations

from apad_bridge.vehicle.commands import CommandAccepted, CommandFailed
from apad_bridge.vehicle.generation_a.messages import OffAnswered, OffOrder

ANSWER_MS = 3_000
"""Services without an answer for so long are asked again."""


class ControllersOff:
    """The OFF that is ordered, until another command replaces it. `take_order` returns what must be sent."""

    def __init__(self) -> None:
        self._command_id: int | None = None
        self._first_number = self._number = 0
        """Numbers of the first and of the newest sending of this command."""
        self._sent_ms = 0
        self._is_taken = False
        self._must_send = False

    @property
    def is_ordered(self) -> bool:
        return self._command_id is not None

    def order(self, command_id: int, now_ms: int) -> None:
        self._command_id, self._is_taken = command_id, False
        self._first_number = self._number + 1
        self._send(now_ms)

    def forget(self) -> None:
        """Another command has replaced it."""
        self._command_id, self._must_send = None, False

    def receive(self, answer: OffAnswered) -> CommandAccepted | CommandFailed | None:
        """The fact that an answer tells; None for one that tells nothing new."""
        if self._command_id is None or answer.number < self._first_number or self._is_taken:
            return None
        if answer.refused is None:
            self._is_taken = True
            return CommandAccepted(answer.at_ms, self._command_id)
        return CommandFailed(answer.at_ms, self._command_id, answer.refused)

    def advance(self, now_ms: int) -> None:
        if self._command_id is not None and not self._is_taken and now_ms - self._sent_ms >= ANSWER_MS:
            self._send(now_ms)

    def take_order(self) -> OffOrder | None:
        """The order to send, once."""
        must_send, self._must_send = self._must_send, False
        return OffOrder(self._number) if must_send else None

    def _send(self, now_ms: int) -> None:
        self._number, self._sent_ms, self._must_send = self._number + 1, now_ms, True

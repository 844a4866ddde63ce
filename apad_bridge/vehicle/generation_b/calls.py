"""Sends orders to generation B's services, with time-outs and repeats. Only the last order counts."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.commands import Hold, Stop, VehicleCommand
from apad_bridge.vehicle.generation_b.messages import (
    NumberedOrder,
    ServiceAnswered,
    ServiceOrder,
)
from apad_bridge.vehicle.vehicle_link import Cleared

ANSWER_MS = 5_000
"""A service without an answer for so long has failed: its node is gone, or its callback hangs."""
STOP_ANSWER_MS = 3_000
"""A stop without an answer for so long is ordered again by whoever ordered it."""
RETRY_MS = 1_000
TRIES = 3


@dataclass(slots=True)
class PendingCall:
    order: ServiceOrder
    before: Cleared[VehicleCommand]
    number: int
    sent_ms: int
    first_number: int
    """The number of the first call of this order: a stop that is ordered again may still be taken by an earlier call."""
    tries: int = 1
    answered_ms: int | None = None
    retry_ms: int | None = None
    first_cause: str | None = None


class OrderCalls:
    """Numbers orders and sends each up to `TRIES` times. A new order ends the wait for the previous one."""

    def __init__(self) -> None:
        self._number = 0
        self._to_send: list[NumberedOrder] = []
        self.pending: PendingCall | None = None

    @property
    def unanswered(self) -> list[str]:
        """The order that still waits for its service's answer, if there is one."""
        pending = self.pending
        if pending is None or pending.answered_ms is not None or pending.retry_ms is not None:
            return []
        return [f"order {pending.number}"]

    def order(self, order: ServiceOrder, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        """Sends an order for the command `cleared`."""
        before, number = self.pending, self._send(order, cleared)
        is_again = before is not None and before.order == order == Stop(0) and before.answered_ms is None
        first_number = before.first_number if is_again and before else number
        self.pending = PendingCall(order, cleared, number, now_ms, first_number)

    def forget(self) -> None:
        self.pending, self._to_send = None, []

    def take(self) -> list[NumberedOrder]:
        """The calls to send, returned once."""
        calls, self._to_send = self._to_send, []
        return calls

    def receive(self, answer: ServiceAnswered) -> bool:
        """Takes a service's answer; True when it has taken the order. Answers to replaced orders change nothing."""
        pending = self.pending
        if pending is None or pending.answered_ms is not None:
            return False
        if not pending.first_number <= answer.number <= pending.number:
            return False
        if answer.refused is not None and answer.number != pending.number:
            return False
        if answer.refused is None:
            pending.answered_ms = answer.at_ms
        else:
            self._refuse(pending, answer.refused, answer.at_ms)
        return answer.refused is None

    def retry_or_fail(self, now_ms: int) -> str | None:
        """Repeats a due call; after the last try returns the first cause."""
        pending = self.pending
        if pending is None or pending.answered_ms is not None:
            return None
        order = pending.order
        is_stop = isinstance(order, Stop) or (isinstance(order, Hold) and order.pre_empts)
        answer_ms = STOP_ANSWER_MS if is_stop else ANSWER_MS
        if pending.retry_ms is None and now_ms - pending.sent_ms >= answer_ms:
            self._refuse(pending, f"its service did not answer within {answer_ms / 1000:g} s", now_ms)
        if pending.retry_ms is None or now_ms < pending.retry_ms:
            return None
        if pending.tries >= (1 if is_stop else TRIES):
            self.pending = None
            return pending.first_cause
        pending.tries += 1
        pending.number, pending.sent_ms = self._send(pending.order, pending.before), now_ms
        pending.retry_ms = None
        return None

    def _refuse(self, pending: PendingCall, reason: str, at_ms: int) -> None:
        pending.first_cause = pending.first_cause or reason
        pending.retry_ms = at_ms + RETRY_MS

    def _send(self, order: ServiceOrder, cleared: Cleared[VehicleCommand]) -> int:
        self._number += 1
        self._to_send.append(NumberedOrder(self._number, order, cleared))
        return self._number

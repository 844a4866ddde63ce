"""The one order that counts, until its service has answered: time-outs, and the same order again."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.generation_b.messages import Answered, Call, Order

ANSWER_MS = 5_000
"""A service that has not answered for so long has failed: its node is gone, or its callback hangs."""
AGAIN_MS = 1_000
TRIES = 3


@dataclass(slots=True)
class Pending:
    order: Order
    number: int
    sent_ms: int
    tries: int = 1
    answered_ms: int | None = None
    again_ms: int | None = None
    first_cause: str | None = None


class Calls:
    """Numbers orders and sends each up to `TRIES` times. A new order ends the waiting for the one before."""

    def __init__(self) -> None:
        self._number = 0
        self._to_send: list[Call] = []
        self.pending: Pending | None = None

    @property
    def unanswered(self) -> list[str]:
        """The order whose service has still to answer, if there is one."""
        pending = self.pending
        if pending is None or pending.answered_ms is not None or pending.again_ms is not None:
            return []
        return [f"order {pending.number}"]

    def order(self, order: Order, now_ms: int) -> None:
        self.pending = Pending(order, self._send(order), now_ms)

    def forget(self) -> None:
        self.pending, self._to_send = None, []

    def take(self) -> list[Call]:
        """What is to be sent, told once."""
        calls, self._to_send = self._to_send, []
        return calls

    def hear(self, answer: Answered) -> None:
        """Answers to orders that were replaced meanwhile change nothing."""
        pending = self.pending
        if pending is None or answer.number != pending.number or pending.answered_ms is not None:
            return
        if answer.refused is None:
            pending.answered_ms = answer.at_ms
        else:
            self._refuse(pending, answer.refused, answer.at_ms)

    def failed(self, now_ms: int) -> str | None:
        """Sends again what is due; the first cause, when the order was tried often enough."""
        pending = self.pending
        if pending is None or pending.answered_ms is not None:
            return None
        if pending.again_ms is None and now_ms - pending.sent_ms >= ANSWER_MS:
            self._refuse(pending, f"its service did not answer within {ANSWER_MS / 1000:g} s", now_ms)
        if pending.again_ms is None or now_ms < pending.again_ms:
            return None
        if pending.tries >= TRIES:
            self.pending = None
            return pending.first_cause
        pending.tries += 1
        pending.number, pending.sent_ms, pending.again_ms = self._send(pending.order), now_ms, None
        return None

    def _refuse(self, pending: Pending, reason: str, at_ms: int) -> None:
        pending.first_cause = pending.first_cause or reason
        pending.again_ms = at_ms + AGAIN_MS

    def _send(self, order: Order) -> int:
        self._number += 1
        self._to_send.append(Call(self._number, order))
        return self._number

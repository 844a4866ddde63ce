"""Words heard before their time: a stamp may be ahead of the tick that is being worked."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from apad_bridge.vehicle.stack_messages import StateHeard


class Stamped(Protocol):
    @property
    def at_ms(self) -> int: ...


Word = TypeVar("Word", bound=Stamped)


class InTime(Generic[Word]):
    """Keeps what is stamped later until `advance` has come to its time. Mission time begins at `now_ms`."""

    def __init__(self, now_ms: int) -> None:
        self._now_ms = now_ms
        self._later: list[Word] = []

    def puts_off(self, heard: Word, now_ms: int) -> bool:
        """Whether it is kept for later. `stateRef` is not: it says how far the vehicle has come."""
        if heard.at_ms <= now_ms or isinstance(heard, StateHeard):
            return False
        self._later.append(heard)
        return True

    def advance(self, now_ms: int) -> list[Word]:
        """All that was kept, to be heard again. ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        self._now_ms = now_ms
        later, self._later = self._later, []
        return later

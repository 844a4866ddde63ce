"""Queues calls of other threads, such as ROS services or a test, for the mission of a flight.

The supervisor's thread runs a call at the next tick; the caller waits for the answer, for a limited time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.script_values import Refused, Status

ANSWER_S = 10.0
"""A tick comes once a mission second; after so many wall seconds without one the caller withdraws the call."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The mission's state after a tick. `goto_order` and `docking_order` count the orders of each kind."""

    goto: Status = Status.IDLE
    docking: Status = Status.IDLE
    goto_order: int = 0
    docking_order: int = 0
    goto_m: float | None = None
    """Metres to go, while a go-to is under way."""
    failure: str | None = None
    paused: bool = False


class _Call:
    def __init__(self, act: Callable[[FlightMission, ManualMission | None], Any]) -> None:
        self.act = act
        self.done = threading.Event()
        self.answer: Any = None
        self.withdrawn = False


class CallQueue:
    """`call`, `call_mission` and `wait` are for any thread, the other methods for the mission's thread."""

    def __init__(self) -> None:
        self._lock = threading.Condition()
        self._calls: list[_Call] = []
        self.ended_by: str | None = None
        self._snapshot = Snapshot()
        self._listeners: list[Callable[[Snapshot], None]] = []

    def call(self, act: Callable[[ManualMission], T], timeout_s: float = ANSWER_S) -> T:
        """Runs `act` at the next tick; returns its result or raises its error.

        Refused when a plan flies the aPad, when the mission is over, or without a tick within `timeout_s`.
        """

        def by_hand(_: FlightMission, manual: ManualMission | None) -> T:
            if manual is None:
                raise Refused("the mission flies the aPad: call take_over first")
            return act(manual)

        return self._call(by_hand, timeout_s)

    def call_mission(
        self, act: Callable[[FlightMission], T], timeout_s: float = ANSWER_S, *, stays: bool = False
    ) -> T:
        """Like `call`, but also while a plan flies the aPad. A call that `stays` is run by a later tick all the same."""
        return self._call(lambda flown, _: act(flown), timeout_s, stays=stays)

    def _call(
        self,
        act: Callable[[FlightMission, ManualMission | None], T],
        timeout_s: float,
        *,
        stays: bool = False,
    ) -> T:
        call = _Call(act)
        with self._lock:
            if self.ended_by is not None:
                raise Refused(f"the mission is over: {self.ended_by}")
            self._calls.append(call)
        if not call.done.wait(timeout_s):
            with self._lock:
                is_late = not call.done.is_set()
                call.withdrawn = is_late and not stays
            if is_late:
                what = "it goes out with the next tick" if stays else "nothing was ordered"
                raise Refused(f"no mission tick came within {timeout_s:g} s: {what}")
        if isinstance(call.answer, Exception):
            raise call.answer
        answer: T = call.answer
        return answer

    def wait(self, timeout_s: float) -> Snapshot:
        """The snapshot of the next tick, or the newest when none comes within `timeout_s` wall seconds."""
        with self._lock:
            before = self._snapshot
            self._lock.wait_for(lambda: self._snapshot is not before or self.ended_by is not None, timeout_s)
            return self._snapshot

    @property
    def has_calls(self) -> bool:
        """A call waits for the next tick."""
        with self._lock:
            return any(not it.withdrawn for it in self._calls)

    def listen(self, listener: Callable[[Snapshot], None]) -> None:
        """Registers a listener. The supervisor's thread calls it after each tick, so it must not wait."""
        self._listeners.append(listener)

    def serve(self, flown: FlightMission, manual: Callable[[], ManualMission | None]) -> None:
        """Runs the calls since the last tick; each may change who flies the aPad, so each asks `manual` again."""
        with self._lock:
            calls, self._calls = self._calls, []
        for call in calls:
            with self._lock:
                if call.withdrawn:
                    continue
                try:
                    call.answer = call.act(flown, manual())
                except Refused as refused:
                    call.answer = refused
                call.done.set()

    def show(self, manual: ManualMission | None) -> None:
        """Ends the tick: passes the new snapshot to waiting threads and listeners."""
        snapshot = (
            Snapshot()
            if manual is None
            else Snapshot(
                goto=manual.goto,
                docking=manual.docking,
                goto_order=manual.goto_orders,
                docking_order=manual.docking_orders,
                goto_m=manual.metres_to_go,
                failure=manual.failure,
                paused=manual.paused,
            )
        )
        with self._lock:
            self._snapshot = snapshot
            self._lock.notify_all()
        for listener in self._listeners:
            listener(snapshot)

    def close(self, reason: str) -> None:
        with self._lock:
            self.ended_by = reason
            for call in self._calls:
                call.answer = Refused(f"the mission is over: {reason}")
                call.done.set()
            self._calls = []
            self._lock.notify_all()

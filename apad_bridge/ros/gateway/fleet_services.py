"""The services by which people change a flying fleet: /musselbed/spawn, retire, hand_over, take_back and inject_fault.

    rosservice call /musselbed/hand_over "{id: 7}"

A service answers at the next mission tick: that the change is done, or why not. Claims of other nodes make requests too.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import rospy

from apad_bridge.ros.gateway.claims import ClaimBoard
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours
from apad_bridge.supervisor.roster import (
    Fault,
    FaultRequest,
    PresenceRequest,
    Presences,
    RosterRequest,
    Trigger,
)

use_generated_messages()

from musselbed_msgs.srv import (  # noqa: E402
    AmusselById,
    AmusselByIdResponse,
    InjectFault,
    InjectFaultResponse,
    SpawnAmussel,
    SpawnAmusselResponse,
)

ANSWER_S = 10.0
"""A tick comes once a mission second. After so long without one, a call is answered without it."""
_A_PERSON = "a service call"


@dataclass(slots=True)
class _Call:
    request: RosterRequest
    done: threading.Event = field(default_factory=threading.Event)
    refusal: str | None = None


class FleetServices:
    """The roster's source of requests: `take` and `answer` are for the flight's thread, the rest for rospy's."""

    def __init__(self, presences: Presences, claims: ClaimBoard) -> None:
        self._presences = presences
        self._claims = claims
        self._lock = threading.Lock()
        self._waiting: list[_Call] = []
        self._taken: list[_Call] = []
        self._warned: set[RosterRequest] = set()
        self._services = [
            rospy.Service(ours("spawn"), SpawnAmussel, self._spawn),
            rospy.Service(ours("retire"), AmusselById, self._change(Trigger.RETIRE)),
            rospy.Service(ours("hand_over"), AmusselById, self._change(Trigger.HAND_OVER)),
            rospy.Service(ours("take_back"), AmusselById, self._change(Trigger.TAKE_BACK)),
            rospy.Service(ours("inject_fault"), InjectFault, self._inject),
        ]

    def take(self) -> list[RosterRequest]:
        with self._lock:
            self._taken, self._waiting = self._waiting, []
        return [*self._claims.changes(self._presences.of), *(call.request for call in self._taken)]

    def answer(self, request: RosterRequest, refusal: str | None) -> None:
        for call in self._taken:
            if call.request is request:
                call.refusal = refusal
                call.done.set()
                return
        # A claim is requested again at each tick until it is done: its refusal is logged once.
        if refusal is not None and request not in self._warned:
            self._warned.add(request)
            rospy.logwarn(f"{refusal} (claimed by {getattr(request, 'by', '')})")

    def close(self) -> None:
        for service in self._services:
            service.shutdown("the flight is over")
        self._claims.close()

    def _call(self, request: RosterRequest) -> str | None:
        """Waits for the answer: None, or the refusal."""
        call = _Call(request)
        with self._lock:
            self._waiting.append(call)
        if call.done.wait(ANSWER_S):
            return call.refusal
        with self._lock:
            if call in self._waiting:
                self._waiting.remove(call)
        return f"the flight made no tick for {ANSWER_S:g} s"

    def _change(self, trigger: Trigger) -> Callable[[Any], Any]:
        def answer(request: Any) -> Any:
            refusal = self._call(PresenceRequest(request.id, trigger, _A_PERSON))
            return AmusselByIdResponse(accepted=refusal is None, message=refusal or "")

        return answer

    def _spawn(self, request: Any) -> Any:
        charges = request.primary, request.secondary
        at = request.north_m, request.east_m
        refusal = self._call(PresenceRequest(request.id, Trigger.SPAWN, _A_PERSON, at, charges))
        return SpawnAmusselResponse(accepted=refusal is None, message=refusal or "")

    def _inject(self, request: Any) -> Any:
        if request.fault not in list(Fault):
            known = ", ".join(Fault)
            return InjectFaultResponse(
                accepted=False, message=f"no fault {request.fault!r}: there are {known}"
            )
        refusal = self._call(FaultRequest(request.id, Fault(request.fault)))
        return InjectFaultResponse(accepted=refusal is None, message=refusal or "")

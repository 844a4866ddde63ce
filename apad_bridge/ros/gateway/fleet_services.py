"""The services by which people change a flying fleet: /musselbed/spawn, retire, hand_over, take_back and inject_fault.

    rosservice call /musselbed/hand_over "{id: 7}"

A service answers at the next mission tick: that the change is done, or why not. Claims of other nodes make requests too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rospy

from apad_bridge.ros.gateway.claims import ClaimBoard
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.world.roster import (
    AskedRequests,
    FaultRequest,
    PresenceRequest,
    Presences,
    PresenceTrigger,
    RosterRequest,
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

_A_PERSON = "a service call"


class FleetServices:
    """The roster's source of requests: `take` and `answer` are for the flight's thread, the rest for any other."""

    def __init__(self, presences: Presences, claims: ClaimBoard) -> None:
        self._presences = presences
        self._claims = claims
        self._asked = AskedRequests()
        self._warned: set[RosterRequest] = set()
        self._services = [
            rospy.Service(ours("spawn"), SpawnAmussel, self._spawn),
            rospy.Service(ours("retire"), AmusselById, self._change(PresenceTrigger.RETIRE)),
            rospy.Service(ours("hand_over"), AmusselById, self._change(PresenceTrigger.HAND_OVER)),
            rospy.Service(ours("take_back"), AmusselById, self._change(PresenceTrigger.TAKE_BACK)),
            rospy.Service(ours("inject_fault"), InjectFault, self._inject),
        ]

    def ask(self, request: RosterRequest) -> str | None:
        match request:
            case PresenceRequest(agent_id, PresenceTrigger.TAKE_BACK | PresenceTrigger.RETIRE):
                if (node := self._claims.real_by(agent_id)) is not None:
                    return f"{node} claims aMussel {agent_id} as real, and would make it so again: end that first"
        return self._asked.ask(request)

    def take(self) -> list[RosterRequest]:
        return [*self._claims.changes(self._presences.of), *self._asked.take()]

    def answer(self, request: RosterRequest, refusal: str | None) -> None:
        if self._asked.answer(request, refusal):
            return
        # A claim is requested again at each tick until it is done: its refusal is logged once.
        if refusal is not None and isinstance(request, PresenceRequest) and request not in self._warned:
            self._warned.add(request)
            rospy.logwarn(f"{refusal} (claimed by {request.by})")

    def close(self) -> None:
        for service in self._services:
            service.shutdown("the flight is over")
        self._claims.close()

    def _change(self, trigger: PresenceTrigger) -> Callable[[Any], Any]:
        def answer(request: Any) -> Any:
            refusal = self.ask(PresenceRequest(request.id, trigger, _A_PERSON))
            return AmusselByIdResponse(accepted=refusal is None, message=refusal or "")

        return answer

    def _spawn(self, request: Any) -> Any:
        charges = request.primary, request.secondary
        at = request.north_m, request.east_m
        refusal = self.ask(PresenceRequest(request.id, PresenceTrigger.SPAWN, _A_PERSON, at, charges))
        return SpawnAmusselResponse(accepted=refusal is None, message=refusal or "")

    def _inject(self, request: Any) -> Any:
        if request.fault not in list(TimedFault):
            known = ", ".join(TimedFault)
            return InjectFaultResponse(
                accepted=False, message=f"no fault {request.fault!r}: there are {known}"
            )
        # ROS 1 fills a field that is left out with 0: that is the table's default here, and no aMussel's id.
        value, for_s = request.value or None, request.for_s or None
        refusal = self.ask(FaultRequest(request.id or None, TimedFault(request.fault), value, for_s))
        return InjectFaultResponse(accepted=refusal is None, message=refusal or "")

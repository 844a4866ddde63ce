"""A person's orders about one aMussel: ping it, permit it to surface, hand it over or take it back, cause a fault.

A permission passes the gate as every order does, a ping waits for its turn in the water, and the roster decides the rest.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from pydantic import Field, FiniteFloat

from apad_bridge.events.person_events import PersonOrdered
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.orders import Order, PermitSurfacing, PingAgent
from apad_bridge.mission.script_values import Refused
from apad_bridge.scenario.timed_faults import TABLE, TimedFault
from apad_bridge.world.roster import (
    FaultRequest,
    NoRoster,
    PresenceRequest,
    PresenceTrigger,
    Roster,
    RosterRequest,
)


class AMusselAct(StrEnum):
    PING = "ping"
    PERMIT = "permit to surface"
    HAND_OVER = "hand over"
    TAKE_BACK = "take back"
    FAULT = "cause a fault"


@dataclass(frozen=True, slots=True)
class AMusselRequest:
    act: AMusselAct
    by: Annotated[str, Field(min_length=1, max_length=100)]
    """The person's name."""
    agent: int
    fault: TimedFault | None = None
    """The fault to cause; None in every other order."""
    value: FiniteFloat | None = None
    """The fault's value; None for the table's."""
    for_s: FiniteFloat | None = None
    """Its span in seconds of mission time; None for the table's."""


@dataclass(frozen=True, slots=True)
class AMusselOrders:
    """Orders of a person about the aMussels of one run."""

    ids: Container[int] = ()
    roster: Roster | NoRoster = field(default_factory=NoRoster)
    has_water: bool = False
    """False: nothing is pinged, because there is no water between the modems."""

    def carry_out(self, request: AMusselRequest, calls: CallQueue) -> str:
        """Gives the order; returns what a person has to know of it. Refused, with the reason."""
        if request.agent not in self.ids:
            raise Refused(f"there is no aMussel {request.agent} in this run")
        match request.act:
            case AMusselAct.PING if not self.has_water:
                raise Refused("this scenario has no water: there is nothing to ping by")
            case AMusselAct.PING:
                self._order(request, PingAgent(request.agent), calls)
                return "the range comes with the events"
            case AMusselAct.PERMIT:
                self._order(request, PermitSurfacing(request.agent), calls)
                return "given to the guards: a refusal comes with the events"
            case AMusselAct.HAND_OVER | AMusselAct.TAKE_BACK:
                return self._ask(
                    PresenceRequest(request.agent, PresenceTrigger[request.act.name], request.by)
                )
            case AMusselAct.FAULT:
                if request.fault is None:
                    raise Refused(f"name the fault: {', '.join(TimedFault)}")
                agent = None if TABLE[request.fault].is_of_apad else request.agent
                return self._ask(FaultRequest(agent, request.fault, request.value, request.for_s))

    def _order(self, request: AMusselRequest, order: Order, calls: CallQueue) -> None:
        def give(mission: FlightMission) -> None:
            mission.emit(PersonOrdered(request.act.value, request.by, request.agent))
            mission.order(order)

        calls.call_mission(give)

    def _ask(self, request: RosterRequest) -> str:
        if (refusal := self.roster.ask(request)) is not None:
            raise Refused(refusal)
        return ""


NO_AMUSSELS = AMusselOrders()

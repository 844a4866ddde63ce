"""The first plan of a mission, with nothing commanded: neither the vehicle nor an aMussel hears a word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from agents.coordinator import Coordinator, Heard
from agents.one_process import OneProcess
from agents.outputs import WifiSent
from apad_bridge import building
from apad_bridge.ether import Ether
from apad_bridge.facts import Medium, Send, WifiHeard
from apad_bridge.mission.orders import Note
from apad_bridge.runs.flying import Surroundings
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.supervisor import TICK_MS
from apad_bridge.vehicle import VehicleCommand
from apad_bridge.vehicle_link import VehicleLink


class _Unmoved:
    """A vehicle that is listened to and never commanded."""

    def __init__(self, vehicle: VehicleLink) -> None:
        self.advance = vehicle.advance
        self.close = vehicle.close

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        pass


class _Unsaid:
    """An ether that is listened to and never spoken into."""

    def __init__(self, ether: Ether) -> None:
        self.advance = ether.advance

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        pass

    def said(self, send: Send, now_ms: int) -> None:
        pass


def dry(surroundings: Surroundings) -> Surroundings:
    """The same, but neither the vehicle nor a real aMussel hears a word."""
    ether = surroundings.ether
    return replace(
        surroundings,
        vehicle=_Unmoved(surroundings.vehicle),
        ether=None if ether is None else _Unsaid(ether),
    )


def first_plan(scenario: Scenario, starts: Sequence[Start]) -> dict[str, Any] | None:
    """The journal's `plan` event of the first plan, with its time `t` in mission milliseconds; None if none is made."""
    births = building.births(scenario, starts)
    host = OneProcess(building.fleet_config(scenario), births)
    coordinator = Coordinator(host, dict.fromkeys(births, 0), scenario.theta)
    supervisor, apad = building.supervisor(scenario), building.simulated_apad(scenario)
    for now_ms in range(0, round(scenario.duration_s * 1000) + 1, TICK_MS):
        for came in coordinator.advance(now_ms):
            if isinstance(came, Heard) and isinstance(came.output, WifiSent):
                supervisor.receive(WifiHeard(came.mission_ms, came.output.data))
        for fact in apad.advance(now_ms):
            supervisor.receive(fact)
        host.take_truths()
        for action in supervisor.advance(now_ms):
            if isinstance(action, Note) and action.kind == "plan":
                return {"t": now_ms, **action.data}
    return None

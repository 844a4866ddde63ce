"""The scenario of the published simulator of generation A, whose speed is proportional to the distance that is left."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.guard_events import GuardReacted, OrderRefused
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import BatteryReported, CommandAccepted, GoTo, PoseReported, VehicleCommand
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact

SCENARIOS = Path(__file__).parents[4] / "launch_scripts" / "scenarios"
TOP_M_S, ACCELERATION_M_S2, STEPS = 6.0, 2.0, 10


class Proportional:
    """A link to a vehicle that wants `gain` times the distance as its speed, whatever speed it is ordered."""

    def __init__(self, gain: float, place_m: tuple[float, float]) -> None:
        self.gain, self.place_m = gain, place_m
        self.goal_m, self.velocity_m_s = place_m, 0j
        self.fastest_m_s = 0.0
        self.taken: list[VehicleCommand] = []
        self._facts: list[LinkFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        for _ in range(STEPS):
            gap_m = complex(*self.goal_m) - complex(*self.place_m)
            change = min(self.gain, TOP_M_S / max(abs(gap_m), 1e-9)) * gap_m - self.velocity_m_s
            self.velocity_m_s += min(1.0, ACCELERATION_M_S2 / STEPS / max(abs(change), 1e-9)) * change
            moved = complex(*self.place_m) + self.velocity_m_s / STEPS
            self.place_m = moved.real, moved.imag
            self.fastest_m_s = max(self.fastest_m_s, abs(self.velocity_m_s))
        facts, self._facts = self._facts, []
        told = [PoseReported(now_ms, *self.place_m, 0.0, now_ms), BatteryReported(now_ms, 15.0, 0.9)]
        return [*facts, *told]

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        self.taken.append(command)
        if isinstance(command, GoTo):
            self.goal_m = command.north_m, command.east_m
            self._facts.append(CommandAccepted(now_ms, command.command_id))

    def close(self) -> None:
        pass


def flown(scenario: Scenario, gain: float) -> tuple[list[str], float]:
    """The causes of guards on twelve legs over the pool, of 25 m at least one, and the greatest speed: m/s."""
    draw, wire = random.Random(1), Proportional(gain, scenario.apad.start_m)
    vehicle = GuardedVehicle(wire, safety_of(scenario, needs_person=True), obeys_speed=False)
    now_ms = 0
    for leg in range(12):
        goal_m = (1.0, 1.0) if leg % 2 else (draw.uniform(18, 27), draw.uniform(14, 20))
        vehicle.advance(now_ms := now_ms + 1_000)
        speed_m_s, radius_m = scenario.mission.speed_m_s, scenario.mission.victory_radius_m
        vehicle.command(GoTo(leg + 1, *goal_m, speed_m_s, radius_m), now_ms)
        for _ in range(60):
            vehicle.advance(now_ms := now_ms + 1_000)
            if math.dist(wire.place_m, goal_m) < radius_m:
                break
    causes = [
        it.guard if isinstance(it, OrderRefused) else str(it.cause)
        for it in vehicle.gate.take_events()
        if isinstance(it, GuardReacted | OrderRefused)
    ]
    return causes, wire.fastest_m_s


@pytest.mark.parametrize("gain", [0.15, 0.33])
def test_it_flies_within_its_guards_as_fast_as_the_published_controller_goes(gain: float) -> None:
    causes, fastest_m_s = flown(load(SCENARIOS / "published-a.yaml"), gain)
    assert causes == [] and fastest_m_s > 3.0


def test_by_the_limits_of_a_real_apad_it_is_stopped() -> None:
    real, published = (load(SCENARIOS / f"{it}.yaml") for it in ("real-apad", "published-a"))
    slow = replace(real, apad=replace(real.apad, max_speed_m_s=published.apad.max_speed_m_s))
    assert "speed" in flown(slow, 0.33)[0]

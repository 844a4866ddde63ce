"""The processor time of beliefs: an event of one aMussel, and a tick of a fleet that reports every second."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import TimeslotSilent
from apad_bridge.beliefs.twin import Twin
from beliefs.filters import MINUTE, NOMINAL
from firmware_model.packets import StatusPacket
from firmware_model.states import State

_REPEATS = 400
_TICKS = 60
HOUR = 60 * MINUTE


def _packet(agent_id: int, number: int, agent_ms: int, charge: float) -> StatusPacket:
    return StatusPacket(agent_id, number, State.SLEEPING, charge, 1.0, 3.0, 4.0, 3.0, agent_ms)


def _median_us(events: list[Callable[[], object]]) -> float:
    took_us = []
    for event in events:
        began_s = time.process_time()
        event()
        took_us.append(1e6 * (time.process_time() - began_s))
    return statistics.median(took_us)


def event_costs() -> dict[str, float]:
    """Medians in microseconds: a packet in time, a silent timeslot, and a packet after a day of silence."""
    twin = Twin(NOMINAL, {})
    first = twin.update(None, _packet(1, 0, 0, 0.9), MissionMs(0))
    assert first is not None
    silent = first
    for hour in range(1, 25):
        found = twin.update(silent, TimeslotSilent(), MissionMs(hour * HOUR))
        assert found is not None
        silent = found
    in_time, at_ms = _packet(1, 1, 30 * MINUTE, 0.897), MissionMs(30 * MINUTE)
    late, late_ms = _packet(1, 1, 25 * HOUR, 0.6), MissionMs(25 * HOUR)
    return {
        "us_per_event": _median_us([lambda: twin.update(first, in_time, at_ms)] * _REPEATS),
        "us_per_silent_slot": _median_us([lambda: twin.update(silent, TimeslotSilent(), late_ms)] * _REPEATS),
        "us_per_mixture_event": _median_us([lambda: twin.update(silent, late, late_ms)] * _REPEATS),
    }


def tick_ms(agents: int, theta: int) -> dict[str, float]:
    """A second's packets of the whole fleet, then the beliefs of all: median and worst of a minute."""
    sensor = replace(
        NOMINAL.sensor, apart_ms=max(NOMINAL.sensor.apart_ms, 20_000 * theta)
    )  # as missions have it
    twin = Twin(replace(NOMINAL, scale=TimeScale(theta), sensor=sensor), {})
    fleet = FleetBeliefs(twin, range(1, agents + 1), due_every_ms=1000)
    took_ms = []
    for tick in range(_TICKS + 5):
        now_ms = MissionMs(1000 * tick)
        packets = [_packet(n, tick, theta * now_ms, 0.9) for n in range(1, agents + 1)]
        began_s = time.process_time()
        fleet.advance(now_ms)
        for packet in packets:
            fleet.hear(packet, now_ms)
        fleet.all()
        took_ms.append(1000 * (time.process_time() - began_s))
    after_birth = took_ms[5:]
    return {
        "agents": agents,
        "theta": theta,
        "median": statistics.median(after_birth),
        "mean": statistics.mean(after_birth),
    }

"""The medium: packets a second that 24, 100 and 1000 aMussels send to their aPad, and receptions a second of broadcasts."""

from __future__ import annotations

import heapq
import random
import statistics
import time
from pathlib import Path
from typing import Any

from rich.console import Console

from agents.modem.frames import FrameKind, ModemFrame
from agents.water.medium import Began, FrameHeard, ModemMoved, WaterMedium
from agents.water.places import ModemPlace
from agents.water.sound import Sound
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import from_data, load, resolve
from benchmarks.rows import told
from firmware_model.keyed_hash import blake2b

SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "sound-12.yaml"
HOURS = 20
SHORT_HOURS = 2
FLEETS = (24, 100, 1000)
PACKETS = 3000
BROADCASTS = 30
REPEATS = 5
SPAN_MS = 1500
"""Mean time between the begins of two packets: the length of a timeslot for packets of 16 bytes."""


def _filled(agents: int, range_limit_m: float) -> tuple[WaterMedium, random.Random]:
    """aMussels at random, 3600 square metres to each, and the aPad (0) in the middle."""
    draw = random.Random(agents)
    side_m = 60 * agents**0.5
    medium = WaterMedium(
        Sound(range_limit_m=range_limit_m),
        1,
        [(0, 0), *((n, (n - 1) % 254 + 1) for n in range(1, agents + 1))],
    )
    medium.receive(ModemMoved(0, ModemPlace(round(side_m * 5e5), round(side_m * 5e5), 0, in_water=True)), 0)
    for n in range(1, agents + 1):
        north, east = (round(draw.uniform(0, side_m) * 1e6) for _ in range(2))
        medium.receive(ModemMoved(n, ModemPlace(north, east, 5_000_000)), 0)
    return medium, draw


def _packets(agents: int) -> dict[str, float]:
    medium, draw = _filled(agents, 5000)
    frames = [ModemFrame(FrameKind.UNICAST, (n - 1) % 254 + 1, 0, bytes(16)) for n in range(1, agents + 1)]
    plan, at_ms = [], 0
    for _ in range(PACKETS):
        at_ms += draw.randrange(1, 2 * SPAN_MS)
        plan.append((at_ms, draw.randrange(agents)))
    heard = 0
    began_s = time.perf_counter()
    for at_ms, n in plan:
        heard += sum(isinstance(it, FrameHeard) for it in medium.receive(Began(n + 1, frames[n]), at_ms))
    heard += sum(isinstance(it, FrameHeard) for it in medium.advance(at_ms + 10_000))
    took_s = time.perf_counter() - began_s
    return {"per_s": PACKETS / took_s, "heard": heard / PACKETS}


def _broadcasts(agents: int) -> float:
    medium, _ = _filled(agents, 5000)
    frame = ModemFrame(FrameKind.BROADCAST, 0, None, bytes(16))
    began_s = time.perf_counter()
    for n in range(BROADCASTS):
        medium.receive(Began(0, frame), 10_000 * n)
        medium.advance(10_000 * n + 9_999)
    return agents * BROADCASTS / (time.perf_counter() - began_s)


def _floor() -> float:
    """Packets a second of a loop that draws each packet's chance and keeps it in a heap, and does nothing else."""
    heap: list[tuple[int, int]] = []
    began_s = time.perf_counter()
    for n in range(PACKETS):
        blake2b(n.to_bytes(32, "little"), digest_size=32, person=b"sound").digest()
        heapq.heappush(heap, (n + 505, n))
        if heap[0][0] <= n:
            heapq.heappop(heap)
    return PACKETS / (time.perf_counter() - began_s)


def _flight_s(agents: int, hours: int, *, by_sound: bool) -> float:
    """Wall seconds of so many hours of agent time, hourly reports in timeslots, in one process; nobody is collected."""
    data = resolve(load(SCENARIO))
    side_m, frame_s = 60 * agents**0.5, 60 * (agents * 1.7 // 60 + 2)
    data.update(duration_s=hours * 3600 / data["theta"])
    data["area"]["polygon_m"] = [[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]]
    data["apad"]["start_m"] = [side_m / 2, side_m / 2]
    data["fleet"].update(count=agents, hosting="one_process", start={"charge": [0.9, 1.0]})
    data["board"]["whole"]["cycle"]["slots"].update(frame_s=frame_s, slot_s=1.7)
    data["mission"]["collection"] = "none"
    if not by_sound:
        data["water"] = None
    scenario = from_data(data, "benchmark")
    began_s = time.perf_counter()
    fly_in_memory(scenario)
    return time.perf_counter() - began_s


def measure(short: bool = False) -> dict[str, Any]:
    """Medians of fresh media; `of_floor` is the share of the rate that drawing and queueing alone would reach."""
    repeats, hours = (1, SHORT_HOURS) if short else (REPEATS, HOURS)
    floor = statistics.median(_floor() for _ in range(REPEATS))
    result: dict[str, Any] = {
        "floor_packets_per_s": floor,
        "packets": PACKETS,
        "repeats": repeats,
        "hours": hours,
        "agents": {},
    }
    for agents in FLEETS:
        runs = [_packets(agents) for _ in range(repeats)]
        per_s = statistics.median(run["per_s"] for run in runs)
        row = {
            "packets_per_s": per_s,
            "of_floor": per_s / floor,
            "heard": runs[0]["heard"],
            "flight_s": _flight_s(agents, hours, by_sound=True),
            "flight_without_sound_s": _flight_s(agents, hours, by_sound=False),
            "broadcast_receptions_per_s": statistics.median(_broadcasts(agents) for _ in range(repeats)),
        }
        result["agents"][str(agents)] = row
        told({"agents": agents, **row})
    return result


def show(result: dict[str, Any], console: Console) -> None:
    for agents, row in result["agents"].items():
        console.print(
            f"{agents:>5} aMussels: {row['packets_per_s']:8.0f} packets/s ({row['of_floor']:.0%} of the floor, "
            f"{row['heard']:.0%} heard), {row['broadcast_receptions_per_s']:8.0f} receptions/s of broadcasts; "
            f"{result['hours']} h in {row['flight_s']:.1f} s, without sound {row['flight_without_sound_s']:.1f} s"
        )

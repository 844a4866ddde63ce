"""Measures a real aPad and the way to it before a mission, and has the findings made of that (`doctor/preflight.py`).

Nothing is ordered here, and no node of ours is on the graph: the aPad's publishers are asked past the master.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from typing import Any

from apad_bridge.assembly.safety import battery_fraction_per_m
from apad_bridge.assembly.stacks import STACKS
from apad_bridge.doctor.finding import Finding, fail, ok
from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable, call_for_reply, connect
from apad_bridge.doctor.preflight import (
    EnergyNeed,
    PositionSample,
    check_delay,
    check_energy,
    check_fence,
    check_gps,
    check_loss,
    check_pilot,
    check_position,
    check_reaction,
    check_watchdog,
)
from apad_bridge.ros.doctor_apad_checks import named_like
from apad_bridge.ros.types.any_message import AnyMessages
from apad_bridge.ros.types.wire_probe import NotAnnounced, messages_within, next_messages
from apad_bridge.ros_names.names import CLOCK, USE_SIM_TIME, in_full, of_apad
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.fence import fence_of
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start

WATCHED_S = 3.0
ROUND_TRIPS = 20
_S_PER_HOUR = 3600
_FLOAT64, _LENGTH = struct.Struct("<d"), struct.Struct("<I")
Resolve = Callable[[str], str]
"""The name of a topic of the aPad after the run's remappings."""


def check_way(graph: Graph) -> Iterator[Finding]:
    """The delay to the master's machine."""
    try:
        yield check_delay([_round_trip_s(graph.uri) for _ in range(ROUND_TRIPS)], graph.uri)
    except Unreachable as error:
        yield fail("delay", str(error), "see the line of the master")


def check_parameters(graph: Graph, apad: str) -> Finding:
    """The parameters by which other places or times would be meant."""
    found = []
    for name in (USE_SIM_TIME, *(f"{apad}/LocalOrigin{it}" for it in ("Lat", "Lon"))):
        code, _, value = call_for_reply(graph.uri, "getParam", name)
        found.append(f"{name} {value if code == 1 else 'not set'}")
        if name == USE_SIM_TIME and code == 1 and value:
            mend = "rosparam set /use_sim_time false, and start the nodes again; for a simulated aPad: --time ros"
            return fail(f"{apad} parameters", f"{name} is true: no real vehicle follows a {CLOCK}", mend)
    return ok(f"{apad} parameters", ", ".join(found))


def check_vehicle(
    graph: Graph,
    scenario: Scenario,
    starts: Sequence[Start],
    namespace: str = "",
    remapped: Resolve = lambda name: name,
) -> Iterator[Finding]:
    """Watches the scenario's aPad for `WATCHED_S`, and judges it by the scenario."""
    apad = in_full(namespace, scenario.apad.name)
    guards = scenario.guards or GuardOptions()

    def topic(leaf: str) -> str:
        return remapped(of_apad(apad, leaf))

    samples = _positions(graph, topic("position"))
    yield check_position(apad, samples, WATCHED_S, guards.jump_m, 2 * scenario.apad.max_speed_m_s)
    yield check_gps(apad, samples)
    yield check_loss(apad, samples, WATCHED_S)
    place_m = _last_place(samples)
    places = [(it.north_m, it.east_m) for it in starts]
    yield from check_fence(apad, place_m, fence_of(scenario.area), guards.clearance_m, places)
    yield check_reaction(guards, apad)
    generations = [it.generation for it in STACKS if apad in named_like(graph, it)]
    is_b = Generation.B in generations
    yield check_pilot(apad, hears_pilot=is_b, steers=_word(graph, topic("manual"), _bool))
    yield check_watchdog(apad, drifts=is_b, word=_word(graph, topic("watchdog"), _text))
    charge = _word(graph, topic("battery_level"), _percent)
    yield check_energy(apad, charge, energy_need(scenario, place_m))
    yield check_parameters(graph, apad)
    told = ", ".join(f"{it} {version(it)}" for it in ("musselbed", "rospy"))
    yield ok(f"{apad} software", f"generation {', '.join(generations) or 'unknown'}; here {told}")


def energy_need(scenario: Scenario, place_m: tuple[float, float] | None) -> EnergyNeed:
    """Share of the battery that the mission's time can take, by the scenario's model of the aPad."""
    apad, speed_m_s = scenario.apad, scenario.mission.speed_m_s
    per_m = battery_fraction_per_m(apad, speed_m_s)
    home_m = apad.start_m if scenario.area.home_m is None else scenario.area.home_m
    reserve = scenario.guards.battery_reserve if scenario.guards is not None else None
    return EnergyNeed(
        at_rest=apad.battery.hotel_w * scenario.duration_s / _S_PER_HOUR / apad.battery.capacity_wh,
        under_way=per_m * speed_m_s * scenario.duration_s,
        way_home=0.0 if place_m is None else per_m * math.dist(place_m, home_m),
        reserve=max(reserve or 0.0, scenario.mission.end_at_apad_fraction),
    )


def _round_trip_s(uri: str) -> float:
    begun_s = time.monotonic()
    connect(uri).close()
    return time.monotonic() - begun_s


def _positions(graph: Graph, topic: str) -> list[PositionSample]:
    """Messages of `WATCHED_S`, read by the publisher's own definition. An unreadable message is no position."""
    try:
        spoken, messages = messages_within(graph, topic, WATCHED_S)
        kind = AnyMessages().class_of(spoken.kind, spoken.md5, spoken.text)
    except (NotAnnounced, ValueError):
        return []
    samples = []
    for at_s, data in messages:
        try:
            samples.append(_sample(at_s, kind().deserialize(data)))
        except Exception:  # genpy raises whatever its generated code raises
            continue
    return samples


def _sample(at_s: float, message: Any) -> PositionSample:
    variance = getattr(message, "position_variance", None)
    return PositionSample(
        at_s,
        message.header.seq,
        message.position.north,
        message.position.east,
        getattr(message, "status", 0),
        0.0 if variance is None else variance.north,
        0.0 if variance is None else variance.east,
    )


def _last_place(samples: Sequence[PositionSample]) -> tuple[float, float] | None:
    finite = [it for it in samples if math.isfinite(it.north_m) and math.isfinite(it.east_m)]
    return (finite[-1].north_m, finite[-1].east_m) if finite else None


def _word(graph: Graph, topic: str, read: Callable[[bytes], Any]) -> Any:
    """The next message of a topic; None where none comes, or none that can be read."""
    try:
        (data,) = next_messages(graph, topic)
        return read(data)
    except (NotAnnounced, struct.error, UnicodeDecodeError):
        return None


def _bool(data: bytes) -> bool:
    return data[:1] == b"\x01"


def _text(data: bytes) -> str:
    (length,) = _LENGTH.unpack_from(data)
    return data[_LENGTH.size : _LENGTH.size + length].decode()


def _percent(data: bytes) -> float | None:
    (percent,) = _FLOAT64.unpack(data)
    return percent / 100 if math.isfinite(percent) else None

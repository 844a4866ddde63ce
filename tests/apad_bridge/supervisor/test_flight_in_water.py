"""Flights whose packets go through the water: the supervisor receives the packets that reached the aPad, at their time."""

from __future__ import annotations

import json
from dataclasses import replace
from math import dist
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from journals import facts_of
from scenario_files import POOL_FILE, WHOLE_FILE

from agents.packet_medium import Medium
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.fleet_events import Presence
from apad_bridge.runs.in_memory import MemoryRecorder, fly_in_memory, open_flight
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.packet_relay import (
    FLEET_ALONE,
    RANGE,
    PacketOrigin,
    PacketRelay,
    RelayedPacket,
    RelayOutcome,
    whole_flight,
)
from apad_bridge.vehicle.vehicle_link import APadSeen
from apad_bridge.world.roster import (
    AskedRequests,
    PresenceChange,
    PresenceRequest,
    Presences,
    PresenceTrigger,
    Roster,
)
from apad_bridge.world.world import World
from firmware_model.packets import AcousticStatus, CommandPacket, Kind, SlotAssignment
from firmware_model.packets.codec import load_codec

APAD_M = (14.0, 10.5)


def in_water(duration_s: float, water: dict[str, Any], **hearing: Any) -> Scenario:
    data = resolve(load(WHOLE_FILE))
    data.update(duration_s=duration_s, water=water)
    data["hearing"]["mode"] = "physical"
    data["hearing"].update(hearing)
    data["fleet"]["hosting"] = "one_process"
    return from_data(data, "in water")


def packets(recorder: MemoryRecorder) -> list[dict[str, Any]]:
    return [data for _, kind, data in facts_of(recorder) if kind == "packet"]


def test_every_packet_is_told_with_its_slot_its_way_and_its_end() -> None:
    """Two hours at theta 30 are 240 s. The aPad waits where it began, its modem 0.5 m deep; the bottom is at 3 m."""
    scenario = in_water(250, {})
    _, recorder = fly_in_memory(scenario)
    ended = packets(recorder)
    assert len(ended) == 12 * 1
    places = {it.agent_id: (it.north_m, it.east_m, 3.0) for it in starts_of(scenario)}
    for packet in ended:
        agent_id, ((node, outcome, snr_db, ended_ms, way_ms, range_m),) = packet["from"], packet["heard"]
        # An hour, 70 s of sampling and processing, and then the next frame of 300 s: timeslot n opens 5 n s later.
        assert packet["began_ms"] == 3_900_000 + 5000 * (agent_id - 1)
        assert (packet["timeslot"], packet["what"], packet["bytes"], packet["lasted_ms"]) == (
            agent_id - 1,
            "unicast",
            45,
            868,
        )
        metres = dist(places[agent_id], (*APAD_M, 0.5))
        assert way_ms == pytest.approx(metres / 1.5, abs=0.001)
        assert range_m == pytest.approx(metres, abs=0.01)
        assert ended_ms == packet["began_ms"] + 868 + -(-metres // 1.5)
        assert (node, outcome) == (0, "received") and snr_db > 50
        status = load_codec("musselbed-1").decode(bytes.fromhex(packet["data"]))
        assert isinstance(status, AcousticStatus) and status.agent_id == agent_id
    again = json.loads(json.dumps(ended))
    assert [it | {"heard": [tuple(row) for row in it["heard"]]} for it in again] == ended


def test_the_mission_is_flown_by_sound_alone() -> None:
    """Hours of sleep, permissions that wake, Wi-Fi only from the surface: four aMussels are charged and brought back."""
    figures, recorder = fly_in_memory(in_water(3600, {"wifi": {}}))
    assert figures["services"] >= 4 and figures["amussels_lost"] == 0
    assert "received" in {row[1] for packet in packets(recorder) for row in packet["heard"]}
    assert any(packet["from"] == 0 for packet in packets(recorder))


def test_a_dock_is_not_closed_around_one_that_never_heard_the_permission(tmp_path: Path) -> None:
    """On twins, which assume that commands arrive: four permissions in five are lost. An empty dock gains nothing."""
    links = tmp_path / "links.csv"
    links.write_text("from, to, loss, since_s, until_s\napad, *, 0.8, ,\n")
    data = resolve(in_water(3600, {"wifi": {}, "links_file": str(links)}))
    model = {"drain_deviation": 0.05, "sensor_noise": 0.005, "bias_deviation": 0.02, "unscheduled": 0.01}
    data["beliefs"] = {"estimator": "twin", "twin": {**model, "fix_deviation_m": 0.5}}
    figures, recorder = fly_in_memory(from_data(data, "hardly heard"))
    reasons = {data["reason"] for _, kind, data in facts_of(recorder) if kind == "given_up"}
    assert reasons <= {"it does not answer the permission to surface"}
    released = [data["full"] for _, kind, data in facts_of(recorder) if kind == "released"]
    assert figures["services"] == len(released) >= 4 and all(released)


def test_a_scenario_without_water_is_what_it_was() -> None:
    data = resolve(load(POOL_FILE))
    again, pool = (
        fleet_parts.fleet_config(flight_config(it)) for it in (from_data(data, "again"), load(POOL_FILE))
    )
    assert data["water"] is None and again == pool


@pytest.mark.parametrize(
    ("water", "error"),
    [
        ({"sound": {"sound_speed_m_s": 300}}, "water.sound.sound_speed_m_s"),
        ({"sound": {"loudness_db": 3}}, "water.sound.loudness_db"),
        (
            {"sound": {"error_curve": {"snrs_db": [0, 5], "sizes": [16], "rates": [[0.5]]}}},
            "error_curve: rates must have a row for each size",
        ),
        (
            {"links_file": "/nowhere/links.csv"},
            "water.links_file: /nowhere/links.csv: No such file or directory",
        ),
        # The paper's hearing and a model of the air contradict each other.
        ({"wifi": {}}, r"water.wifi: .*hearing.mode"),
    ],
)
def test_water_that_cannot_be_is_refused(water: dict[str, Any], error: str) -> None:
    with pytest.raises(ScenarioError, match=error):
        in_water(10, water, mode="paper" if "wifi" in water else "physical")


def test_links_may_change_while_a_run_flies(tmp_path: Path) -> None:
    """All links are cut from the second hour on; then an unreadable file leaves the links as they were."""
    path = tmp_path / "links.csv"
    path.write_text("from,to,loss\n")
    scenario = in_water(500, {"links_file": str(path)})
    flight, recorder = open_flight(scenario)
    for now_ms in range(0, 500_000, 1000):
        if now_ms == 200_000:
            path.write_text("from,to,loss\n*,apad,1\n")
        if now_ms == 300_000:
            path.write_text("nonsense\n")
        flight.tick(now_ms)
    by_hour: dict[int, set[str]] = {}
    for packet in packets(recorder):
        by_hour.setdefault(packet["began_ms"] // 3_600_000, set()).add(packet["heard"][0][1])
    assert by_hour == {1: {"received"}, 2: {"cut"}, 3: {"cut"}, 4: {"cut"}}
    changes = [(at_ms, data) for at_ms, kind, data in facts_of(recorder) if kind == "links"]
    assert changes[0] == (200_000, {"rules": [(None, 0, 1.0, 0, None)], "problem": None})
    assert changes[1][0] == 300_000 and "line 1: the columns" in changes[1][1]["problem"]
    assert len(changes) == 2


def test_an_aPad_learns_ways_assigns_slots_and_finds_its_aMussels() -> None:
    """The aPad's packets keep out of the 12 timeslots of 5 s; an aMussel that was never moved is found at its start."""
    talk = {"assigns": True, "ping_period_s": 5}
    scenario = in_water(1800, {"talk": talk, "localisation": {"apart_m": 2.0, "deviation_m": 0.2}})
    figures, recorder = fly_in_memory(scenario)
    assert figures["amussels_lost"] == 0
    words = [packet for packet in packets(recorder) if packet["from"] == 0]
    taken_ms = 12 * 5000
    assert all(packet["began_ms"] % 300_000 >= taken_ms for packet in words)
    assert {packet["what"] for packet in words} == {"ping", "unicast"}
    ranges = [data for _, kind, data in facts_of(recorder) if kind == "range" and data["range_m"] is not None]
    places = {it.agent_id: (it.north_m, it.east_m, 3.0) for it in starts_of(scenario)}
    early = ranges[:12]
    for data in early:
        assert data["range_m"] == pytest.approx(dist(places[data["id"]], (*APAD_M, 0.5)), abs=0.6)
    fixes = [data for _, kind, data in facts_of(recorder) if kind == "fix"]
    assert fixes, "an aPad on its ways finds somebody"
    assert all(fix["hdop"] <= 5 and fix["ranges"] >= 3 for fix in fixes)
    for fix in fixes:
        if fix["id"] not in {data["agent"] for _, kind, data in facts_of(recorder) if kind == "dock"}:
            error_m = dist(places[fix["id"]][:2], (fix["north_m"], fix["east_m"]))
            assert error_m < 6 * (fix["covariance"][0] + fix["covariance"][2]) ** 0.5


SEEN_FROM_AFAR: Any = SimpleNamespace(advance=lambda now_ms: [APadSeen(now_ms, *APAD_M)], close=lambda: None)
"""Another aPad, which stands still: a fleet alone commands no vehicle."""


def fly_to(flight: Flight, until_ms: int) -> None:
    for now_ms in range(0, until_ms, 1000):
        flight.tick(now_ms)


def test_a_fleet_alone_shares_what_reached_the_aPad_and_hears_what_its_planner_says(tmp_path: Path) -> None:
    links = tmp_path / "links.csv"
    links.write_text("from,to,loss\n3,apad,1\n")
    scenario = in_water(200, {"links_file": str(links)})
    permission = load_codec("musselbed-1").encode(CommandPacket(Kind.PERMISSION, 7))
    said, heard = [RelayedPacket(PacketOrigin.REMOTE_SUPERVISOR, 7, Medium.SOUND, permission, 0)], []
    take = lambda now_ms: [said.pop() for _ in said[:]]  # noqa: E731
    relay = PacketRelay(FLEET_ALONE, [take], {RelayOutcome.PUBLISH: heard.append})
    flight, recorder = open_flight(scenario, join=lambda it: replace(it, vehicle=SEEN_FROM_AFAR, relay=relay))
    fly_to(flight, 200_000)
    by_sound = {packet.agent_id for packet in heard if packet.medium is Medium.SOUND}
    # 7 was permitted to surface before its first timeslot, and sends by Wi-Fi since.
    assert by_sound == set(range(1, 13)) - {3, 7}
    assert (Medium.WIFI, 7) in {(packet.medium, packet.agent_id) for packet in heard}
    (word,) = [packet for packet in packets(recorder) if packet["from"] == 0]
    assert word["began_ms"] == 60_000, "it waited for the end of the timeslots"


def test_a_real_amussel_is_pinged_by_its_bridge_and_the_others_through_the_water() -> None:
    """A ping every 5 s, of 12 in turn. The bridge measures 5, and not 3; 7 is retired."""
    scenario, real = in_water(100, {"talk": {"ping_period_s": 5, "waits": False}}), frozenset({3, 5})
    published: list[RelayedPacket] = []
    arrived: list[RelayedPacket] = []

    def with_real_ones(context: FlightContext) -> FlightContext:
        changes = [PresenceChange(0, it, Presence.REAL, "/lab") for it in sorted(real)]
        changes.append(PresenceChange(0, 7, Presence.RETIRED, "/lab"))
        presences = Presences(scenario.fleet.ids, scenario.area.depth_m, changes)
        world = context.world
        roster = Roster(presences, AskedRequests(), world.fleet.coordinator, world.faults)
        relay = PacketRelay(
            whole_flight(lambda: presences.simulated),
            [lambda now_ms: [arrived.pop() for _ in arrived[:]]],
            {RelayOutcome.PUBLISH: published.append},
        )
        return replace(context, world=World(world.fleet, world.faults, roster=roster), relay=relay)

    flight, recorder = open_flight(scenario, join=with_real_ones)
    for now_ms in range(0, 100_000, 1000):
        flight.tick(now_ms)
        if published and published[-1].agent_id == 5 and not arrived:
            arrived.append(RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 5, RANGE, b"12.3456", now_ms))
    pings = [it for it in published if it.medium == RANGE]
    assert {(it.agent_id, it.data) for it in pings} == {(3, b""), (5, b"")}
    in_water_pinged = {it["address"] for it in packets(recorder) if it["from"] == 0 and it["what"] == "ping"}
    assert in_water_pinged == set(range(1, 13)) - real
    outcomes: dict[int, set[float | None]] = {}
    for _, kind, data in facts_of(recorder):
        if kind == "range":
            outcomes.setdefault(data["id"], set()).add(data["range_m"])
    assert outcomes[3] == outcomes[7] == {None} and outcomes[5] == {12.346}
    places = {it.agent_id: (it.north_m, it.east_m, 3.0) for it in starts_of(scenario)}
    for agent_id in set(range(1, 13)) - real - {7}:
        metres = dist(places[agent_id], (*APAD_M, 0.5))
        assert outcomes[agent_id]
        assert all(it == pytest.approx(metres, abs=1.0) for it in outcomes[agent_id])


def test_the_delay_to_one_that_was_handed_over_is_measured_anew() -> None:
    """A range of 30 m is 20 ms at 1500 m/s. The simulated one was assigned its timeslot by its own range."""
    scenario = in_water(200, {"talk": {"assigns": True}})
    presences = Presences(scenario.fleet.ids, scenario.area.depth_m)
    asked: list[PresenceRequest] = []
    refusals: list[str | None] = []
    requests: Any = SimpleNamespace(
        take=lambda: [asked.pop() for _ in asked[:]], answer=lambda _, refusal: refusals.append(refusal)
    )
    published: list[RelayedPacket] = []
    arrived: list[RelayedPacket] = []

    def with_requests(context: FlightContext) -> FlightContext:
        world = context.world
        roster = Roster(presences, requests, world.fleet.coordinator, world.faults)
        relay = PacketRelay(
            whole_flight(lambda: presences.simulated),
            [lambda now_ms: [arrived.pop() for _ in arrived[:]]],
            {RelayOutcome.PUBLISH: published.append},
        )
        return replace(context, world=World(world.fleet, world.faults, roster=roster), relay=relay)

    flight, recorder = open_flight(scenario, join=with_requests)
    for now_ms in range(0, 200_000, 1000):
        if now_ms == 100_000:
            asked.append(PresenceRequest(5, PresenceTrigger.HAND_OVER, "/lab"))
        flight.tick(now_ms)
        if published and published[-1].medium == RANGE and not arrived:
            arrived.append(RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 5, RANGE, b"30.0", now_ms))
    assert refusals == [None]
    words = [load_codec("musselbed-1").decode(it.data) for it in published if it.medium is Medium.SOUND]
    assert [it.offset_ms for it in words if isinstance(it, SlotAssignment)] == [-20]
    in_water_pinged = [it["address"] for it in packets(recorder) if it["from"] == 0 and it["what"] == "ping"]
    assert 5 in in_water_pinged


def test_the_error_curve_is_the_scenario_s() -> None:
    """At any SNR half of all packets are lost: 36 of three hours, within 4 standard deviations of 18."""
    curve = {"snrs_db": [-300, 300], "sizes": [1], "rates": [[0.5, 0.5]]}
    ended = packets(fly_in_memory(in_water(380, {"sound": {"error_curve": curve}}))[1])
    lost = sum(packet["heard"][0][1] == "noise" for packet in ended)
    assert len(ended) == 36 and abs(lost - 18) <= 12

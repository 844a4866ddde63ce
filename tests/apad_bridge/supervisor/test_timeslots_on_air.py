"""24 aMussels in hourly timeslots for 20 simulated hours, through the water: collisions and deliveries.

The predictions here use timeslots, drifts and places, and neither boards nor the medium.
"""

from __future__ import annotations

from dataclasses import replace
from math import dist, sqrt
from pathlib import Path
from typing import Any

import pytest
from journals import facts_of
from scenario_files import WHOLE_FILE

from agents.fleet_config import drift_of
from agents.hosting.in_process import InProcessHost
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.world import World

AGENTS, HOURS = 24, 20
SLOT_MS, FRAME_MS, PACKET_MS = 1700, 60_000, 868
PPM_50 = 50_000
"""Parts of 10^9."""
APAD_M = (100.0, 100.0, 0.5)


def scenario(seed: int = 1, **water: Any) -> Scenario:
    """Places at random in 200 x 200 m, the aPad in the middle and staying there; a louder packet is no better off."""
    data = resolve(load(WHOLE_FILE))
    data.update(seed=seed, duration_s=(HOURS * 3600 + 600) / 30)
    data["area"]["polygon_m"] = [[0, 0], [200, 0], [200, 200], [0, 200]]
    data["fleet"].update(count=AGENTS, start={"charge": [0.95, 1.0]}, hosting="one_process")
    data["board"]["whole"]["cycle"]["slots"].update(frame_s=FRAME_MS / 1000, slot_s=SLOT_MS / 1000)
    data["hearing"]["mode"] = "physical"
    data["mission"]["collection"] = "none"
    data["apad"]["start_m"] = [*APAD_M[:2]]
    data["water"] = {**water, "sound": {"capture_db": 200.0}}
    return from_data(data, "on air")


def statuses(flown: Scenario, drift_ppb: int = 0) -> list[dict[str, Any]]:
    """Every packet of an aMussel's."""
    initial_states = fleet_parts.initial_states(flown, starts_of(flown))
    config = replace(fleet_parts.fleet_config(flight_config(flown)), clock_drift_ppb=drift_ppb)
    fleet = fleet_parts.fleet_of(
        flight_config(flown), InProcessHost(config, initial_states), dict.fromkeys(initial_states, 0)
    )
    recorder = MemoryRecorder(flown)
    vehicle = InProcessVehicle(SimulatedAPad(flown.apad))
    flight_parts.flight(
        flight_config(flown),
        FlightContext(vehicle=vehicle, pace=AsFastAsPossible(), world=World(fleet)),
        recorder,
    ).run()
    packets = [data for _, kind, data in facts_of(recorder) if kind == "packet"]
    return [it for it in packets if it["from"] != 0 and it["what"] == "unicast"]


def outcome(packet: dict[str, Any]) -> str:
    return str(packet["heard"][0][1])


def predicted_collisions(flown: Scenario, drift_ppb: int) -> set[tuple[int, int]]:
    """(aMussel, hour) of each packet that meets another at the aPad: from timeslots, drifts and distances."""
    heard = []
    for start in starts_of(flown):
        drift = drift_of(flown.seed, start.agent_id, drift_ppb)
        way_ms = -(-dist((start.north_m, start.east_m, 3.0), APAD_M) // 1.5)
        for hour in range(1, HOURS + 1):
            # Awake at the hour, 10 s of samples and 60 s of work; then the next frame's timeslot, all by its own clock.
            reading_ms = hour * 3_600_000 + 70_000
            frame_ms = -(-reading_ms // FRAME_MS) * FRAME_MS + (start.agent_id - 1) * SLOT_MS
            if frame_ms - FRAME_MS >= reading_ms:
                frame_ms -= FRAME_MS
            begin_ms = -(-frame_ms * 10**9 // (10**9 + drift)) + way_ms
            heard.append((begin_ms, start.agent_id, hour))
    heard.sort()
    return {
        here[1:]
        for n, here in enumerate(heard)
        for m in (n - 1, n + 1)
        if 0 <= m < len(heard) and abs(heard[m][0] - here[0]) < PACKET_MS
    }


def test_with_clocks_that_agree_nothing_collides_in_20_hours() -> None:
    heard = statuses(scenario())
    assert len(heard) == AGENTS * HOURS
    assert {outcome(it) for it in heard} == {"received"}
    assert {it["timeslot"] for it in heard} == set(range(AGENTS))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_with_50_ppm_and_no_beacon_as_many_collide_as_predicted(seed: int) -> None:
    flown = scenario(seed)
    collided = {
        (it["from"], it["began_ms"] // 3_600_000)
        for it in statuses(flown, PPM_50)
        if outcome(it) == "collided"
    }
    assert collided == predicted_collisions(flown, PPM_50) and len(collided) > 50


@pytest.mark.parametrize("loss", [0.1, 0.5, 0.9])
def test_what_is_delivered_under_loss(loss: float, tmp_path: Path) -> None:
    """480 packets: within 3.3 standard deviations of the expected share, which one run in a thousand leaves."""
    (tmp_path / "links.csv").write_text(f"from,to,loss\n*,apad,{loss}\n")
    heard = statuses(scenario(links_file=str(tmp_path / "links.csv")))
    delivered = sum(outcome(it) == "received" for it in heard)
    total = AGENTS * HOURS
    assert len(heard) == total
    assert {outcome(it) for it in heard} == {"received", "lost"}
    assert delivered / total == pytest.approx(1 - loss, abs=3.3 * sqrt(loss * (1 - loss) / total))


def test_with_50_ppm_and_a_beacon_an_hour_nothing_collides() -> None:
    """A clock is off by 180 ms at most when the next beacon arrives, and timeslots leave 832 ms between packets."""
    heard = statuses(scenario(talk={"assigns": True, "beacon_period_s": 3600.0}), PPM_50)
    assert len(heard) == AGENTS * HOURS
    assert {outcome(it) for it in heard} == {"received"}
    for it in heard:
        # Travel time is compensated: its packets arrive when its timeslot opens, except for an hour's drift.
        late_ms = (it["heard"][0][3] - PACKET_MS - (it["from"] - 1) * SLOT_MS) % FRAME_MS
        assert min(late_ms, FRAME_MS - late_ms) <= 190


@pytest.mark.parametrize(("beacon_period_s", "expected"), [(3600.0, AGENTS * HOURS), (0.0, AGENTS)])
def test_boards_that_doubt_their_clocks_speak_while_beacons_come(
    beacon_period_s: float, expected: int
) -> None:
    """50 ppm for 65 minutes are 195 ms, within a guard of 250; for 125 minutes they are 375. So without a beacon the
    aMussels fall silent after the first hour, and with a beacon an hour they never do."""
    data = resolve(scenario(talk={"assigns": True, "beacon_period_s": beacon_period_s}))
    whole = data["board"]["whole"]
    whole.update(clock_drift_ppm=50.0, timekeeping={"bound_ppm": 50.0, "beacon_wait_s": 60.0})
    whole["cycle"]["slots"]["guard_s"] = 0.25
    heard = statuses(from_data(data, "doubting"), PPM_50)
    assert len(heard) == expected
    assert {outcome(it) for it in heard} == {"received"}

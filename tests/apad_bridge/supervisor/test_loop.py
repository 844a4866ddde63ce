"""The flight loop in memory: repeats give the same trace, recorded stimuli replay it, and a relay joins two halves."""

import gc
import json
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journals import Witness, facts_of
from scenario_files import POOL_FILE, SOUND_FILE, WHOLE_FILE

from agents.hosting.host import Grant
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from agents.mussel.stimuli import from_wire
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.division import members
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.display import MakeStatus, ParentDisplay
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.runs.several.lockstep import fly_in_step
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import from_data as scenario_from
from apad_bridge.scenario.loader import load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.packet_relay import (
    FLEET_ALONE,
    FLEET_WITH_DOCKS,
    MISSION_ALONE,
    Division,
    PacketOrigin,
    PacketRelay,
    RelayedPacket,
    RelayOutcome,
)
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.simulated_fleet import FlightFleet, NoFleet
from apad_bridge.world.world import World
from firmware_model.states import State
from firmware_model.stimuli import ResetCause


def whole_board() -> dict[str, Any]:
    """A cycle so short that a window cuts every part of it, on batteries that a day at the bottom empties."""
    data = resolve(load(WHOLE_FILE))["board"]
    data["whole"]["cycle"].update(alarm_s=2500, report_s=601)
    data["whole"]["power"].update(kept_on=["gsm"])
    return dict(data)


def short_scenario(board: dict[str, Any] | None = None, **changes: Any) -> Scenario:
    data = resolve(load(POOL_FILE))
    data.update(name="short", duration_s=120, theta=600)
    data["fleet"].update(count=6, start={"charge": [0.5, 0.75]})
    data["area"]["polygon_m"] = [[0, 0], [6, 0], [6, 4], [0, 4]]
    data["apad"]["start_m"] = [3, 2]
    data["mission"]["docking"].update(dock_s=3, undock_s=1)
    data["board"] = board or data["board"]
    data["board"]["float_timeout_s"] = 432000
    data["mission"].update(changes)
    return scenario_from(data, "short")


def flown(scenario: Scenario, kill_at_ms: dict[int, int] | None = None) -> Witness:
    """A flight whose aMussels are killed at these times."""
    fleets: list[FlightFleet] = []
    flight, witness = open_flight(
        scenario, join=lambda it: fleets.append(it.world.fleet) or it, recorder_of=Witness
    )
    assert isinstance(witness, Witness)
    while not flight.supervisor.has_ended:
        for agent_id, at_ms in (kill_at_ms or {}).items():
            if at_ms == flight.now_ms:
                fleets[0].host.kill(agent_id)
        flight.tick(flight.now_ms)
        flight.now_ms += 1000
    return witness


def test_the_same_seed_gives_the_same_events_and_truths() -> None:
    scenario = short_scenario()
    first, second = flown(scenario), flown(scenario)
    assert facts_of(first) == facts_of(second) and first.kept == second.kept
    assert sum(kind == "released" for _, kind, _ in facts_of(first)) >= 4


def by_agent(truths: Iterable[Truth]) -> dict[int, list[Truth]]:
    found: dict[int, list[Truth]] = {}
    for truth in truths:
        found.setdefault(truth.agent_id, []).append(truth)
    return found


SCENARIOS = {"worst case": short_scenario(), "whole": short_scenario(whole_board(), full_when="both")}


@cache
def recorded_flight(name: str) -> Witness:
    """A flight in which two aMussels are killed."""
    return flown(SCENARIOS[name], kill_at_ms={2: 20_000, 5: 60_000})


def test_what_was_recorded_of_whole_boards_has_all_that_there_is_to_cut() -> None:
    assert {truth.state for truth in recorded_flight("whole").kept} >= set(State) - {
        State.OFF,
        State.HOVERING,
        State.CALLING,
        State.LOST,
        State.AWAITING_BEACON,
    }


@pytest.mark.parametrize("board", SCENARIOS)
@settings(max_examples=10, deadline=None)
@given(cuts_ms=st.lists(st.integers(0, 120_000), max_size=20))
def test_recorded_stimuli_played_again_in_any_windows_give_the_same_truths(
    board: str, cuts_ms: list[int]
) -> None:
    """Only the journal's `stimulus` and `died` lines go in; no mission, no vehicle and no coordinator take part."""
    scenario, recorded = SCENARIOS[board], recorded_flight(board)
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    host = InProcessHost(fleet_parts.fleet_config(flight_config(scenario)), initial_states)
    assert any(kind == "died" for _, kind, _ in facts_of(recorded))
    end_ms = 120_000 * scenario.theta
    for agent_id in initial_states:
        moments = [
            (data["agent_ms"], data["wire"] if kind == "stimulus" else None)
            for _, kind, data in json.loads(json.dumps(facts_of(recorded)))
            # Stimuli of the last tick are for a window that is never granted.
            if kind in ("stimulus", "died") and data["id"] == agent_id and data["agent_ms"] < end_ms
        ]
        # A death stands at the end of the last answered window: before the stimuli of that very time.
        moments.sort(key=lambda it: (it[0], it[1] is not None))
        windows = sorted({*(cut * scenario.theta for cut in cuts_ms), end_ms})
        for until_ms in windows:
            due = [moment for moment in moments if moment[0] <= until_ms]
            moments = moments[len(due) :]
            pending: list[Any] = []
            for at_ms, wire in due:
                if wire is None:
                    host.grant({agent_id: Grant(at_ms, tuple(pending))})
                    pending = []
                    host.kill(agent_id)
                    host.grant({agent_id: Grant(at_ms)})
                    host.restart(agent_id, at_ms, ResetCause.BROWN_OUT)
                else:
                    fields = [bytes.fromhex(it) if isinstance(it, str) else it for it in wire]
                    pending.append((at_ms, from_wire(fields)))
            host.grant({agent_id: Grant(until_ms, tuple(pending))})
    assert by_agent(host.take_truths()) == by_agent(recorded.kept)


ELSEWHERE = {
    PacketOrigin.LOCAL_AMUSSEL: PacketOrigin.REMOTE_AMUSSEL,
    PacketOrigin.LOCAL_SUPERVISOR: PacketOrigin.REMOTE_SUPERVISOR,
    PacketOrigin.LOCAL_DOCK: PacketOrigin.REMOTE_DOCK,
}


def joined(division: Division, out: list[RelayedPacket], into: list[RelayedPacket]) -> PacketRelay:
    """One of two relays that lists join. It hears its peers alone, as by their topics."""

    def take(now_ms: int) -> list[RelayedPacket]:
        packets, into[:] = [replace(packet, source=ELSEWHERE[packet.source]) for packet in into], []
        return [it for it in packets if it.source in division.peers]

    return PacketRelay(division, [take], {RelayOutcome.PUBLISH: out.append})


class Shared(InProcessVehicle):
    """The mission's vehicle; a fleet without a mission sees its contacts alone: no poses, no commands."""

    def __init__(self, apad: SimulatedAPad) -> None:
        super().__init__(apad)
        self.contacts: list[Any] = []

    def advance(self, now_ms: int) -> list[Any]:
        facts = super().advance(now_ms)
        self.contacts += [fact for fact in facts if type(fact).__name__ in ("Carried", "LetGo")]
        return facts

    def take_contacts(self, now_ms: int) -> list[Any]:
        taken, self.contacts = self.contacts, []
        return taken


@pytest.mark.parametrize("division", [FLEET_ALONE, FLEET_WITH_DOCKS])
def test_a_fleet_alone_and_a_mission_alone_joined_by_a_relay_serve_aMussels(division: Division) -> None:
    """The fleet learns of docks from its own link to the aPad, or from the mission alone."""
    scenario = short_scenario()
    to_fleet: list[RelayedPacket] = []
    to_mission: list[RelayedPacket] = []
    vehicle = Shared(SimulatedAPad(scenario.apad))
    sees = vehicle.take_contacts if division is FLEET_ALONE else lambda now_ms: []
    seen: Any = SimpleNamespace(advance=sees, close=lambda: None)
    relays = joined(division, to_mission, to_fleet), joined(MISSION_ALONE, to_fleet, to_mission)
    fleet_side, _ = open_flight(
        short_scenario(collection="none"), join=lambda it: replace(it, vehicle=seen, relay=relays[0])
    )
    alone = World(NoFleet())
    mission_side, _ = open_flight(
        scenario, join=lambda it: replace(it, vehicle=vehicle, world=alone, relay=relays[1])
    )
    for now_ms in range(0, 120_000, 1000):
        fleet_side.tick(now_ms)
        mission_side.tick(now_ms)
    assert mission_side.supervisor.mission.state.services >= 4
    assert fleet_side.supervisor.mission.state.cost_m == 0


@pytest.mark.parametrize(
    ("lost", "killed", "ended_by"),
    [
        (None, 6, "loss of the fleet: every aMussel died too often"),
        ("no nursery", 1, "loss of the fleet: no nursery"),
        (None, 5, "mission time"),
    ],
)
def test_a_mission_ends_with_its_whole_fleet_and_not_with_a_part_of_it(
    lost: str | None, killed: int, ended_by: str
) -> None:
    """Its host restarts nobody."""
    hosts: list[Any] = []
    flight, recorder = open_flight(short_scenario(), join=lambda it: hosts.append(it.world.fleet.host) or it)
    (host,) = hosts
    host.restart = lambda *_: setattr(host._host, "lost", lost) or "it stays dead"
    for _ in range(5):
        flight.step()
    for agent_id in range(1, 1 + killed):
        host.kill(agent_id)
    assert str(flight.run()) == ended_by
    gave_up = [data["gave_up"] for _, kind, data in facts_of(recorder) if kind == "died"]
    assert gave_up == ["it stays dead"] * killed


@pytest.mark.parametrize("scenario", [POOL_FILE, WHOLE_FILE, SOUND_FILE])
def test_ticks_leave_no_garbage_cycle(scenario: Path) -> None:
    """A flight's process looks for cycles so seldom because of this."""
    flight, _ = open_flight(load(scenario))
    for _ in range(30):
        flight.step()
    gc.collect()
    gc.disable()
    try:
        for _ in range(150):
            flight.step()
        assert gc.collect() == 0
    finally:
        gc.enable()


class CollectingDisplay(ParentDisplay):
    """Looks for garbage cycles at each minute of the flight."""

    def __init__(self) -> None:
        self.found: list[int] = []

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        super().show_status(now_ms, status)
        if now_ms % 60_000 == 0:
            self.found.append(gc.collect())


def test_records_and_statuses_leave_no_garbage_cycle(pool: Scenario, tmp_path: Path) -> None:
    """A supervisor in a process of its own makes a record and a status at each tick."""
    scenario = replace(pool, duration_s=240.0, fleet=replace(pool.fleet, hosting=Hosting.ONE_PROCESS))
    directory = RunDirectory.create(scenario.name, datetime.now(UTC), tmp_path / "run")
    display = CollectingDisplay()
    gc.disable()
    try:
        fly_in_step(members(scenario, starts_of(scenario)), scenario.sharing, directory, display)
    finally:
        gc.enable()
    _, _, *found = display.found  # the first minute fills caches
    assert found == [0, 0, 0]

"""Simulated aMussels that are handed over to real ones and taken back, retired, or get faults, in a flight in memory."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any, cast

import pytest
from journals import facts_of, journal_of, state_of
from scenario_files import POOL_FILE

from agents.coordinator import Coordinator
from agents.hosting.faulty_host import FaultyHost
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Output, Truth
from agents.mussel.physical import Physical
from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, to_json
from agents.packet_medium import Medium
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import Presence, PresenceChanged
from apad_bridge.events.mission_events import MissionChanged, Phase
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.runs.start_state import StartState
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.packet_relay import PacketOrigin, PacketRelay, RelayedPacket, whole_flight
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.fault_injection import FaultInjection
from apad_bridge.world.roster import (
    TABLE,
    FaultRequest,
    PresenceChange,
    PresenceRequest,
    Presences,
    PresenceTrigger,
    Roster,
    RosterRequest,
)
from apad_bridge.world.simulated_fleet import FlightFleet, WithoutWater
from apad_bridge.world.world import World
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

THE_ONE = 3


class Paper:
    """A queue for the test's requests."""

    def __init__(self) -> None:
        self.asked: list[RosterRequest] = []
        self.answers: list[str | None] = []

    def take(self) -> list[RosterRequest]:
        asked, self.asked = self.asked, []
        return asked

    def answer(self, asked: RosterRequest, refusal: str | None) -> None:
        self.answers.append(refusal)


class Elsewhere:
    """The process by which a real aMussel's packets arrive."""

    def __init__(self) -> None:
        self.packets: list[StatusPacket] = []

    def take(self, now_ms: int) -> list[RelayedPacket]:
        packets, self.packets = self.packets, []
        return [
            RelayedPacket(
                PacketOrigin.REMOTE_AMUSSEL, it.agent_id, Medium.WIFI, MusselbedCodec().encode(it), now_ms
            )
            for it in packets
        ]


class Witness(MemoryRecorder):
    """Keeps the newest truth of each aMussel."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.newest: dict[int, Truth] = {}

    def truths(self, truths: list[Truth]) -> None:
        super().truths(truths)
        self.newest |= {truth.agent_id: truth for truth in truths}


class Bench:
    def __init__(self, charge: float = 0.95) -> None:
        self.scenario = quiet_scenario(charge)
        initial_states = fleet_parts.initial_states(self.scenario, starts_of(self.scenario))
        host = InProcessHost(fleet_parts.fleet_config(flight_config(self.scenario)), initial_states)
        self.paper, self.elsewhere = Paper(), Elsewhere()
        self.recorder = Witness(self.scenario)
        self.presences = Presences(initial_states, self.scenario.area.depth_m)
        self.host, self.coordinator = (
            host,
            Coordinator(host, dict.fromkeys(initial_states, 0), self.scenario.time_scale),
        )
        self.faults = FaultInjection(FaultyHost(host, self.scenario.seed), self.scenario.time_scale)
        self.flight = self.begin(
            self.recorder, Roster(self.presences, self.paper, self.coordinator, self.faults)
        )

    def begin(self, recorder: MemoryRecorder, roster: Roster) -> Flight:
        return flight_parts.flight(
            flight_config(self.scenario),
            FlightContext(
                vehicle=InProcessVehicle(flight_parts.simulated_apad(self.scenario)),
                pace=AsFastAsPossible(),
                world=World(
                    FlightFleet(self.coordinator, self.host, WithoutWater(self.coordinator, self.host)),
                    self.faults,
                    roster=roster,
                ),
                relay=PacketRelay(whole_flight(lambda: self.presences.simulated), [self.elsewhere.take], {}),
            ),
            recorder,
        )

    def ask(self, *asked: RosterRequest) -> list[str | None]:
        self.paper.asked, self.paper.answers = list(asked), []
        self.ticks(1)
        return self.paper.answers

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.flight.tick(self.flight.now_ms)
            self.flight.now_ms += 1000

    def real_one_says(
        self, north_m: float, primary: float, state: State = State.ACTIVE, ahead_ms: int = 0
    ) -> None:
        agent_ms = self.flight.now_ms * self.scenario.theta + ahead_ms
        self.elsewhere.packets.append(
            StatusPacket(THE_ONE, 0, state, primary, 0.8, north_m, 0.5, 3.0, agent_ms)
        )
        self.ticks(1)

    def home_m(self) -> tuple[float, float] | None:
        """The place to which the mission brings it back; None for one that is not known."""
        homes = {agent_id: place_m for agent_id, *place_m in self.flight.supervisor.mission.state.homes}
        return None if (place_m := homes.get(THE_ONE)) is None else (place_m[0], place_m[1])

    def truth(self) -> tuple[State, float]:
        """The simulated aMussel's state, and its place north in metres."""
        truth = self.recorder.newest[THE_ONE]
        return truth.state, truth.physical.north_um / 1e6


def quiet_scenario(charge: float) -> Scenario:
    data = resolve(load(POOL_FILE))
    data.update(name="quiet", duration_s=600)
    data["fleet"].update(count=4, start={"charge": [charge, charge]}, drift={"mode": "physical"})
    return from_data(data, "quiet")


@pytest.mark.parametrize(("presence", "trigger"), list(product(Presence, PresenceTrigger)))
def test_every_pair_is_in_the_table_or_refused(presence: Presence, trigger: PresenceTrigger) -> None:
    may = {
        Presence.SIMULATED: {PresenceTrigger.HAND_OVER, PresenceTrigger.RETIRE},
        Presence.REAL: {PresenceTrigger.TAKE_BACK, PresenceTrigger.RETIRE},
        Presence.RETIRED: {PresenceTrigger.SPAWN, PresenceTrigger.HAND_OVER},
    }
    assert ((presence, trigger) in TABLE) is (trigger in may[presence])


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_real_one_is_believed_while_its_twin_goes_on_unheard_and_takes_over_where_it_is_left(
    bench: Bench,
) -> None:
    bench.ticks(5)
    beliefs = bench.flight.supervisor.beliefs
    assert bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test")) == [None]
    bench.ticks(5)
    # Its twin reports every second, and is muted. What was believed of it lives on.
    assert beliefs.get(THE_ONE).heard_ms <= bench.flight.now_ms - 6000 and bench.home_m() is None
    journaled = [
        it.event.snapshot for it in bench.recorder.journal.entries if isinstance(it.event, MissionChanged)
    ]
    assert THE_ONE not in {agent_id for agent_id, _, _ in journaled[-1].homes}, "a resumed run would know it"
    _, twin_m = bench.truth()
    bench.real_one_says(north_m=twin_m + 4.0, primary=0.5)
    belief = beliefs.get(THE_ONE)
    assert (belief.north_m, belief.primary) == pytest.approx((twin_m + 4.0, 0.5), abs=0.01)
    assert bench.truth()[1] == pytest.approx(twin_m)
    assert bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.TAKE_BACK, "a test")) == [None]
    bench.ticks(10)
    assert bench.truth()[1] == pytest.approx(twin_m + 4.0, abs=0.01)
    heard = beliefs.get(THE_ONE)
    assert heard is not None and heard.heard_ms > belief.heard_ms
    # At theta 30 it loses a minute's charge every two ticks.
    assert 0.48 < heard.primary < 0.5
    assert [data["is"] for _, kind, data in facts_of(bench.recorder) if kind == "presence"] == [
        "real",
        "simulated",
    ]


@pytest.mark.parametrize("ahead_ms", [3_600_000 * 30, 20_000 * 30, -4000 * 30])
def test_a_real_ones_clock_counts_for_nothing_after_it_is_taken_back_nor_its_twins_before(
    bench: Bench, ahead_ms: int
) -> None:
    bench.ticks(5)
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"))
    bench.real_one_says(20.0, 0.5, ahead_ms=ahead_ms)
    beliefs = bench.flight.supervisor.beliefs
    assert beliefs.get(THE_ONE).north_m == 20.0
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.TAKE_BACK, "a test"))
    taken_ms = bench.flight.now_ms
    bench.ticks(1)
    assert beliefs.get(THE_ONE).heard_ms == taken_ms


def test_the_apad_goes_to_a_real_one_where_that_is_and_no_longer_to_its_simulated_place() -> None:
    bench = Bench(charge=0.5)
    bench.ticks(2)
    bench.ask(*(PresenceRequest(it, PresenceTrigger.RETIRE, "a test") for it in (1, 2, 4)))
    mission = bench.flight.supervisor.mission
    while mission.state.phase is not Phase.GO_COLLECT:
        bench.ticks(1)
        assert bench.flight.now_ms < 60_000
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"))
    bench.ticks(5)
    assert mission.state.phase is Phase.IDLE
    reasons = {
        data["agent"]: data["reason"] for _, kind, data in facts_of(bench.recorder) if kind == "given_up"
    }
    assert "another board has its id now" in reasons[THE_ONE]
    went = len(facts_of(bench.recorder))
    for _ in range(20):
        bench.real_one_says(2.0, 0.4)
    goals = {
        (data["north_m"], data["east_m"])
        for _, kind, data in facts_of(bench.recorder)[went:]
        if kind == "primitive" and data["name"] == "go to point"
    }
    assert goals == {(2.0, 0.5)}
    assert bench.home_m() == (2.0, 0.5), "it would be brought back to the place of the simulated one"


def test_one_that_is_retired_on_the_way_to_it_is_left() -> None:
    bench = Bench(charge=0.5)
    bench.ticks(3)
    mission = bench.flight.supervisor.mission
    assert mission.state.phase is Phase.GO_COLLECT
    first = mission.state.plan[0].agent_id
    bench.ask(PresenceRequest(first, PresenceTrigger.RETIRE, "a test"))
    bench.ticks(2)
    assert first not in [it.agent_id for it in mission.state.plan] and mission.state.plan


def test_uptimes_are_of_the_simulated_ones_and_others_are_told_apart(bench: Bench) -> None:
    bench.ticks(11)
    bench.ask(
        PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"),
        PresenceRequest(1, PresenceTrigger.RETIRE, "a test"),
    )
    bench.ticks(8)
    figures = uptime_figures(bench.recorder.meter, bench.flight.now_ms - 1000)
    # Ticks 1 to 19 of two aMussels, and ticks 1 to 11 of the two whose presence changed at the end of tick 11.
    assert figures["counted_s"] == 2 * 19 + 2 * 11
    assert figures["uptime_paper"] == {"mean": 100.0, "max": 100.0, "min": 100.0}
    assert figures["active_mean"] == (2 * 19 + 2 * 11) / 19
    assert figures["excluded"] == {"amussels": 2, "beside_real_s": 8, "retired_s": 8, "samples_taken": 0}


def test_taken_back_before_anything_was_heard_of_the_real_one_is_refused(bench: Bench) -> None:
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"))
    (refusal,) = bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.TAKE_BACK, "a test"))
    assert refusal is not None and "no report came" in refusal


def test_a_retired_one_is_planned_for_no_more_and_may_be_spawned_elsewhere() -> None:
    bench = Bench(charge=0.5)  # below the threshold: all of them are to be collected
    bench.ticks(3)
    assert (
        bench.ask(*(PresenceRequest(it, PresenceTrigger.RETIRE, "a test") for it in (1, 2, 4))) == [None] * 3
    )
    assert bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.RETIRE, "a test")) == [None]
    bench.ticks(60)
    assert bench.flight.supervisor.beliefs.all() == []
    assert not [it for it in facts_of(bench.recorder) if it[1] == "dock"]
    assert bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.SPAWN, "a test", (7.0, 8.0), (0.25, 0.75))) == [
        None
    ]
    bench.ticks(2)
    belief = bench.flight.supervisor.beliefs.get(THE_ONE)
    assert (belief.north_m, belief.east_m, belief.primary) == pytest.approx((7.0, 8.0, 0.25), abs=0.01)
    assert bench.home_m() == pytest.approx((7.0, 8.0), abs=0.01), (
        "it would be brought back to the place before"
    )


def test_a_reset_by_fault_is_a_reset(bench: Bench) -> None:
    bench.ticks(3)
    before = bench.truth()
    assert bench.ask(FaultRequest(THE_ONE, TimedFault.BROWN_OUT)) == [None]
    wires = [data["wire"] for _, kind, data in facts_of(bench.recorder) if kind == "stimulus"]
    assert wires[-1:] == [[8, 1]]
    bench.ticks(3)
    assert bench.truth() == (State.ACTIVE, pytest.approx(before[1]))


def test_what_cannot_be_is_refused_in_words(bench: Bench) -> None:
    bench.ticks(2)
    unknown, spawned = bench.ask(
        PresenceRequest(77, PresenceTrigger.RETIRE, "a test"),
        PresenceRequest(1, PresenceTrigger.SPAWN, "a test"),
    )
    assert unknown == "aMussel 77 is not of this fleet"
    assert spawned == "aMussel 1 is simulated: it cannot spawn"
    bench.ask(PresenceRequest(1, PresenceTrigger.HAND_OVER, "a test"))
    (faulty,) = bench.ask(FaultRequest(1, TimedFault.WATCHDOG))
    assert faulty == "aMussel 1 is real: faults are for simulated ones"
    (slipped,) = bench.ask(FaultRequest(2, TimedFault.COIL_SLIP))
    assert slipped == "aMussel 2 is in no dock, by its reports: coil_slip happens only there"


@pytest.mark.parametrize(
    ("at", "charges", "refusal"),
    [
        ((5.0, 5.0), (0.0, 0.0), "charges above 0"),
        ((5.0, 5.0), (0.5, 0.0), "charges above 0"),
        ((5.0, 5.0), (0.5, 1.1), "up to 1"),
        ((5.0, 5.0), (float("nan"), 1.0), "charges above 0"),
        ((float("nan"), 5.0), (0.5, 1.0), "a place is metres"),
        ((1e9, 5.0), (0.5, 1.0), "a place is metres"),
    ],
)
def test_what_is_left_out_of_a_spawning_is_refused(
    bench: Bench, at: tuple[float, float], charges: tuple[float, float], refusal: str
) -> None:
    bench.ticks(2)
    bench.ask(PresenceRequest(1, PresenceTrigger.RETIRE, "a test"))
    (answer,) = bench.ask(PresenceRequest(1, PresenceTrigger.SPAWN, "a test", at, charges))
    assert answer is not None and refusal in answer
    assert bench.ask(PresenceRequest(1, PresenceTrigger.SPAWN, "a test", (5.0, 5.0), (0.5, 1.0))) == [None]


def test_one_in_a_dock_is_left_alone() -> None:
    bench = Bench(charge=0.5)
    beliefs = bench.flight.supervisor.beliefs
    while not any(belief.state is State.CHARGING for belief in beliefs.all()):
        bench.ticks(1)
        assert bench.flight.now_ms < 300_000
    docked = next(belief.agent_id for belief in beliefs.all() if belief.state is State.CHARGING)
    (refusal,) = bench.ask(PresenceRequest(docked, PresenceTrigger.RETIRE, "a test"))
    assert refusal == f"aMussel {docked} is in a dock: undock it first"


def test_one_that_another_aPad_serves_changes_its_presence_only_when_it_is_back(bench: Bench) -> None:
    bench.ticks(2)
    bench.flight.supervisor.allocation.give(THE_ONE)
    asked = PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test")
    (refusal,) = bench.ask(asked)
    assert refusal is not None and "another aPad serves" in refusal
    bench.flight.supervisor.allocation.take(THE_ONE)
    assert bench.ask(asked) == [None]


def test_of_a_real_one_the_mission_s_docks_decide_and_not_its_last_report(bench: Bench) -> None:
    bench.ticks(2)
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"))
    back = PresenceRequest(THE_ONE, PresenceTrigger.TAKE_BACK, "a test")

    def taken_back(held: frozenset[int]) -> object:
        bench.ticks(1)
        beliefs, now_ms = bench.flight.supervisor.beliefs, bench.flight.now_ms
        return bench.presences.do(back, bench.coordinator, beliefs, now_ms, held)

    bench.real_one_says(2.0, 0.5)
    assert taken_back(frozenset({THE_ONE})) == f"aMussel {THE_ONE} is in a dock: undock it first"
    bench.real_one_says(2.0, 0.5, State.CHARGING)
    assert not isinstance(taken_back(frozenset()), str)
    assert bench.presences.of(THE_ONE) is Presence.SIMULATED


def test_what_was_done_is_answered_when_it_is_recorded(bench: Bench) -> None:
    """A caller that got the answer that an id is real may rely on it, whatever process dies next."""
    order: list[str] = []

    class RosterRequests(Paper):
        def answer(self, asked: RosterRequest, refusal: str | None) -> None:
            order.append("answered")

    class Records(Witness):
        def event(self, at_ms: int, event: Event) -> None:
            if isinstance(event, PresenceChanged):
                order.append("said")

        def tick(self, *_: Any) -> None:
            order.append("on disk")

    requests = RosterRequests()
    requests.asked = [PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test")]
    bench.flight = bench.begin(
        Records(bench.scenario), Roster(bench.presences, requests, bench.coordinator, bench.faults)
    )
    bench.ticks(1)
    assert order == ["said", "on disk", "answered"]


def test_another_supervisor_knows_who_is_real_and_who_is_retired(bench: Bench) -> None:
    bench.ticks(3)
    bench.ask(
        PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"),
        PresenceRequest(1, PresenceTrigger.RETIRE, "a test"),
    )
    bench.ask(
        PresenceRequest(1, PresenceTrigger.SPAWN, "a test", (7.0, 8.0), (0.5, 0.5)),
        PresenceRequest(2, PresenceTrigger.RETIRE, "a test"),
    )
    lines = [{"t": at_ms, "kind": kind, **data} for at_ms, kind, data in facts_of(bench.recorder)]
    again = Presences([1, 2, 3, 4], 3.0, state_of(lines).presences.values())
    assert [again.of(it) for it in (1, 2, 3, 4)] == [
        Presence.SIMULATED,
        Presence.RETIRED,
        Presence.REAL,
        Presence.SIMULATED,
    ]
    assert again.simulated == {1, 4}
    coordinator = Coordinator(bench.host, bench.coordinator.granted_ms, bench.scenario.time_scale)
    again.mute_as_before(coordinator)
    spoke = {it.agent_id for it in coordinator.advance(bench.flight.now_ms + 5000) if isinstance(it, Output)}
    assert spoke == {1, 4}


def resumed(bench: Bench, journal_lines: list[Any]) -> Coordinator:
    """The fleet under a new coordinator, after a kill that left these lines in the journal."""
    lines = [{"t": at_ms, "kind": kind, **data} for at_ms, kind, data in journal_lines]
    journal = journal_of(json.loads(json.dumps(lines)))
    state = StartState(
        cast(Recorder, bench.recorder), bench.presences, cast(LearnedState, None), journal=journal
    )
    coordinator = Coordinator(bench.host, bench.coordinator.granted_ms, bench.scenario.time_scale)
    state.deliver_again(coordinator)
    return coordinator


def bodies(bench: Bench) -> dict[int, Physical]:
    return {it.agent_id: it.physical for it in [*bench.recorder.newest.values(), *bench.host.take_truths()]}


@pytest.mark.parametrize("killed", ["before the window", "after the window, which nobody recorded"])
@pytest.mark.parametrize(
    "asked",
    [
        [
            PresenceRequest(1, PresenceTrigger.RETIRE, "a test"),
            PresenceRequest(1, PresenceTrigger.SPAWN, "a test", (7.0, 8.0)),
        ],
        [FaultRequest(1, TimedFault.BATTERY_LOSS, 0.25), FaultRequest(2, TimedFault.BATTERY_LOSS, 0.125)],
        [FaultRequest(1, TimedFault.BUOYANCY_STUCK, None), FaultRequest(2, TimedFault.BROWN_OUT, None)],
        [FaultRequest(2, TimedFault.CLOCK_SKEW, 50.0), FaultRequest(1, TimedFault.BATTERY_AGEING, 0.1)],
    ],
)
def test_stimuli_under_way_as_the_supervisor_died_arrive_once_and_at_their_own_time(
    asked: list[RosterRequest], killed: str
) -> None:
    calm, bench = Bench(), Bench()
    for it in (calm, bench):
        it.ticks(9)
        for one in asked:
            it.ask(one)
    lines = list(facts_of(bench.recorder))
    assert any(kind == "stimulus" for _, kind, _ in lines)
    end_ms = bench.flight.now_ms + 20_000
    if killed.startswith("after"):
        bench.coordinator.advance(bench.flight.now_ms)
    resumed(bench, lines).advance(end_ms)
    calm.coordinator.advance(end_ms)
    assert bodies(bench) == bodies(calm)


def test_a_contact_that_waits_for_a_body_is_not_closed_around_it_again(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    wires: list[tuple[int, AgentStimulus]] = [
        (1, ContactClosed(5, 6)),
        (2, ContactClosed(5, 6)),
        (2, ContactOpened()),
    ]
    lines = [
        {"t": 1000, "kind": "stimulus", "id": n, "agent_ms": 1000, "wire": to_json(it)} for n, it in wires
    ]
    bench = Bench()
    learned = flight_parts.initial_learned_state(flight_config(bench.scenario))
    recorder = Recorder(directory, bench.scenario, learned.allocation.served)
    state = StartState(recorder, bench.presences, learned, journal=journal_of(lines))
    held = state.deliver_again(bench.coordinator).held
    recorder.close()
    assert held == (1,)


def test_changes_of_ids_that_are_not_of_the_fleet_are_nobodys() -> None:
    again = Presences([1], 3.0, [PresenceChange(5, 9, Presence.REAL, "/lab")])
    assert again.of(9) is None and again.simulated == {1}

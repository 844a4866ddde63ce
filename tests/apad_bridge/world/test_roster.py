"""Simulated aMussels that are handed over to real ones and taken back, retired, or get faults, in a flight in memory."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path
from typing import Any, cast

import pytest
from flying import play
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
from apad_bridge.events.mission_events import MissionChanged
from apad_bridge.mission.facts import AMusselHeard
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
from apad_bridge.supervisor.sample_collection import SampleCollection
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
from firmware_model.packets import LogRecords, StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.sensors import NO_COUNTS
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
            samples=SampleCollection(self.scenario.fleet.ids),
        )

    def ask(self, *asked: RosterRequest) -> list[str | None]:
        self.paper.asked, self.paper.answers = list(asked), []
        self.ticks(1)
        return self.paper.answers

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.flight.tick(self.flight.now_ms)
            self.flight.now_ms += 1000

    # Moves of a transcript.

    def answer(self, move: str) -> str:
        """A line's answer: what was asked and told, with the aMussels whose presence or step changed."""
        before = len(facts_of(self.recorder))
        said = self.do(move)
        shown = [TOLD[kind](data) for _, kind, data in facts_of(self.recorder)[before:] if kind in TOLD]
        return "; ".join(it for it in (said, *shown) if it)

    def do(self, move: str) -> str:
        name, *words = move.split()
        numbers = [float(it) for it in words if re.fullmatch(r"[\d.e-]+|nan", it)]
        supervisor = self.flight.supervisor
        mission, beliefs = supervisor.mission, supervisor.beliefs
        told_of: dict[str, Callable[[], object]] = {
            "ticks": lambda: self.ticks(int(words[0])),
            "real": lambda: self.real_one_says(numbers[0], numbers[1], State[words[2]], int(numbers[2])),
            "fault": lambda: told(self.ask(FaultRequest(int(words[0]), TimedFault(words[1])))),
            "elsewhere": lambda: supervisor.allocation.give(int(words[0])),
            "back": lambda: supervisor.allocation.take(int(words[0])),
            "believed": self.believed,
            "body": lambda: "{.name} at {:.2f} m".format(*self.truth()),
            "home": lambda: str(self.home_m() and tuple(round(it, 2) for it in self.home_m())),
            "see beliefs": lambda: [it.agent_id for it in beliefs.all()],
            "see plan": lambda: [it.agent_id for it in mission.state.plan],
            "see journal": self.journaled_homes,
            "see phase": lambda: mission.state.phase.value,
        }
        if name == "until":
            while not (move.endswith(mission.state.phase.value) or self.charging):
                self.ticks(1)
            return ""
        act = told_of.get(move if name == "see" else name)
        if act is not None:
            answer = act()
            return "" if answer is None or name in ("elsewhere", "back") else str(answer)
        whom = self.charging if words[0] == "docked" else int(words[0])
        place, charges = tuple(numbers[1:3]) or None, tuple(numbers[3:5]) or None
        return told(self.ask(PresenceRequest(whom, PresenceTrigger[name.upper()], "a test", place, charges)))

    def journaled_homes(self) -> list[int]:
        entries = self.recorder.journal.entries
        *_, newest = (it.event.snapshot for it in entries if isinstance(it.event, MissionChanged))
        return sorted(agent_id for agent_id, _, _ in newest.homes)

    def believed(self) -> str:
        belief = self.flight.supervisor.beliefs.get(THE_ONE)
        age_s = (self.flight.now_ms - belief.heard_ms) // 1000
        return f"{belief.north_m:.2f} m, {belief.primary:.2f}, heard {age_s} s ago"

    @property
    def charging(self) -> int | None:
        """An aMussel that is believed to charge."""
        return next(
            (it.agent_id for it in self.flight.supervisor.beliefs.all() if it.state is State.CHARGING), None
        )

    def real_one_says(self, north_m: float, primary: float, state: State, ahead_s: int) -> None:
        agent_ms = (self.flight.now_ms + 1000 * ahead_s) * self.scenario.theta
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


def told(refusals: list[str | None]) -> str:
    return "; ".join(it or "done" for it in refusals)


TOLD: dict[str, Callable[[dict[str, Any]], str]] = {
    "presence": lambda it: f"{it['id']} is {it['is']}",
    "given_up": lambda it: f"{it['agent']} is left: {it['reason']}",
    "stimulus": lambda it: f"stimulus {[*map(int, it['wire'])]}" if it["wire"][0] == 8 else "",
    "dock": lambda it: f"docked {it['agent']}",
    "primitive": lambda it: (
        f"goes to {it['north_m']:.2f}, {it['east_m']:.2f}"
        if (it["name"], it["phase"]) == ("go to point", "started")
        else ""
    ),
}
"""The events that a transcript shows."""


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


STORIES: dict[str, tuple[float, str]] = {
    # A resumed run would bring it back to the place of the simulated one.
    "what was believed of one that is handed over is in no journal": (
        0.95,
        """
        ticks 5     |
        hand_over 3 | done; 3 is real
        ticks 5     |
        see journal | [1, 2, 4]
        """,
    ),
    # Its twin reports every second, and is muted. At theta 30 it loses a minute's charge every two ticks.
    "a real one is believed while its twin goes on unheard, which takes over where it is left": (
        0.95,
        """
        ticks 5                |
        believed               | 15.62 m, 0.95, heard 1 s ago
        body                   | ACTIVE at 15.62 m
        hand_over 3            | done; 3 is real
        ticks 5                |
        believed               | 15.62 m, 0.95, heard 6 s ago
        home                   | None
        real 20.0 0.5 ACTIVE 0 |
        believed               | 20.00 m, 0.50, heard 1 s ago
        body                   | ACTIVE at 15.62 m
        take_back 3            | done; 3 is simulated
        ticks 10               |
        body                   | ACTIVE at 20.00 m
        believed               | 20.00 m, 0.49, heard 1 s ago
        """,
    ),
    **{
        f"the clock of a real one, {off_s} s ahead, counts for nothing after it is taken back": (
            0.95,
            f"""
            ticks 5                      |
            hand_over 3                  | done; 3 is real
            real 20.0 0.5 ACTIVE {off_s} |
            believed                     | 20.00 m, 0.50, heard 1 s ago
            take_back 3                  | done; 3 is simulated
            ticks 1                      |
            believed                     | 20.00 m, 0.50, heard 1 s ago
            """,
        )
        for off_s in (3600, 20, -4)
    },
    # It would else be brought back to the place of the simulated one.
    "the aPad goes to a real one where that is and no longer to its simulated place": (
        0.5,
        """
        ticks 2               | goes to 24.04, 7.36
        retire 1              | done; 1 is retired
        retire 2              | done; 1 is left: nothing is believed of it any more; goes to 3.13, 11.67;
                              | 2 is retired
        retire 4              | done; 2 is left: nothing is believed of it any more; goes to 15.62, 14.30;
                              | 4 is retired
        until go to aMussel   |
        hand_over 3           | done; 3 is real
        ticks 5               | 3 is left: another board has its id now, and has not been heard;
                              | 4 is left: it never reported
        see phase             | idle wait
        real 2.0 0.4 ACTIVE 0 | goes to 2.00, 0.50
        real 2.0 0.4 ACTIVE 0 |
        real 2.0 0.4 ACTIVE 0 |
        home                  | (2.0, 0.5)
        """,
    ),
    "one that is retired on the way to it is left": (
        0.5,
        """
        ticks 3  | goes to 24.04, 7.36
        see plan | [1, 2, 3, 4]
        retire 1 | done; 1 is retired
        ticks 2  | 1 is left: nothing is believed of it any more; goes to 3.13, 11.67
        see plan | [2, 3, 4]
        """,
    ),
    "taken back before anything was heard of the real one is refused": (
        0.95,
        """
        hand_over 3 | done; 3 is real
        take_back 3 | no report came from the real aMussel 3: retire it, and spawn it somewhere
        """,
    ),
    "a retired one is planned for no more and may be spawned elsewhere, its new home": (
        0.5,
        """
        ticks 3               | goes to 24.04, 7.36
        retire 1              | done; 1 is retired
        retire 2              | done; 1 is left: nothing is believed of it any more; goes to 3.13, 11.67;
                              | 2 is retired
        retire 4              | done; 2 is left: nothing is believed of it any more; goes to 15.62, 14.30;
                              | 4 is retired
        retire 3              | done; 3 is retired
        ticks 60              | 3 is left: nothing is believed of it any more; 4 is left: it never reported
        see beliefs           | []
        spawn 3 7 8 0.25 0.75 | done; 3 is simulated
        ticks 2               | goes to 7.00, 8.00
        believed              | 7.00 m, 0.25, heard 1 s ago
        home                  | (7.0, 8.0)
        """,
    ),
    "a reset by fault is a reset": (
        0.95,
        """
        ticks 3           |
        body              | ACTIVE at 15.62 m
        fault 3 brown_out | done; stimulus [8, 1]
        ticks 3           |
        body              | ACTIVE at 15.62 m
        """,
    ),
    "what cannot be is refused in words": (
        0.95,
        """
        ticks 2           |
        retire 77         | aMussel 77 is not of this fleet
        spawn 1           | aMussel 1 is simulated: it cannot spawn
        hand_over 1       | done; 1 is real
        fault 1 watchdog  | aMussel 1 is real: faults are for simulated ones
        fault 2 coil_slip | aMussel 2 is in no dock, by its reports: coil_slip happens only there
        """,
    ),
    "a spawning without a place and charges that can be is refused": (
        0.95,
        """
        ticks 2             |
        retire 1            | done; 1 is retired
        spawn 1 5 5 0 0     | primary and secondary are charges above 0 and up to 1 (0 if left out): give both
        spawn 1 5 5 0.5 0   | primary and secondary are charges above 0 and up to 1 (0 if left out): give both
        spawn 1 5 5 0.5 1.1 | primary and secondary are charges above 0 and up to 1 (0 if left out): give both
        spawn 1 5 5 nan 1   | primary and secondary are charges above 0 and up to 1 (0 if left out): give both
        spawn 1 nan 5 0.5 1 | a place is metres north and east of the scenario's origin, 50000 m away at most
        spawn 1 1e9 5 0.5 1 | a place is metres north and east of the scenario's origin, 50000 m away at most
        spawn 1 5 5 0.5 1   | done; 1 is simulated
        """,
    ),
    "one in a dock is left alone": (
        0.5,
        """
        until docked  | goes to 24.04, 7.36; docked 1; goes to 3.13, 11.67
        retire docked | aMussel 1 is in a dock: undock it first
        """,
    ),
    "one that another aPad serves changes its presence only when it is back": (
        0.95,
        """
        ticks 2     |
        elsewhere 3 |
        hand_over 3 | another aPad serves aMussel 3 and would not know of the change
        back 3      |
        hand_over 3 | done; 3 is real
        """,
    ),
}


@pytest.mark.parametrize(("charge", "story"), STORIES.values(), ids=STORIES)
def test_story(charge: float, story: str) -> None:
    play(story, Bench(charge).answer)


def test_of_a_real_one_the_mission_s_docks_decide_and_not_its_last_report(bench: Bench) -> None:
    bench.ticks(2)
    bench.ask(PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"))
    back = PresenceRequest(THE_ONE, PresenceTrigger.TAKE_BACK, "a test")
    answers = []
    for state, held in ((State.ACTIVE, frozenset({THE_ONE})), (State.CHARGING, frozenset[int]())):
        bench.real_one_says(2.0, 0.5, state, 0)
        bench.ticks(1)
        beliefs, now_ms = bench.flight.supervisor.beliefs, bench.flight.now_ms
        answers.append(bench.presences.do(back, bench.coordinator, beliefs, now_ms, held))
    assert answers[0] == f"aMussel {THE_ONE} is in a dock: undock it first"
    assert bench.presences.of(THE_ONE) is Presence.SIMULATED


def test_uptimes_are_of_the_simulated_ones_and_others_are_told_apart(bench: Bench) -> None:
    bench.ticks(11)
    bench.ask(
        PresenceRequest(THE_ONE, PresenceTrigger.HAND_OVER, "a test"),
        PresenceRequest(1, PresenceTrigger.RETIRE, "a test"),
    )
    bench.ticks(8)
    figures = uptime_figures(bench.recorder.meter, bench.flight.now_ms - 1000)
    # Ticks 1 to 19 of two aMussels, and ticks 1 to 11 of the two whose presence changed at the end of tick 11.
    excluded = {"amussels": 2, "beside_real_s": 8, "retired_s": 8, "samples_taken": 0}
    wanted = {"counted_s": 2 * 19 + 2 * 11, "uptime_paper": {"mean": 100.0, "max": 100.0, "min": 100.0}}
    wanted |= {"active_mean": (2 * 19 + 2 * 11) / 19, "excluded": excluded}
    assert {name: figures[name] for name in wanted} == wanted


def test_samples_of_a_real_one_and_of_a_simulated_one_are_told_apart(bench: Bench) -> None:
    """Each counts its own samples from 0, and forgets what is acknowledged: whatever is not kept is lost."""

    def uploads(reading: int, count: int) -> list[SampleRecord]:
        log = [SampleRecord(it, 1000 * it, (reading, *NO_COUNTS[1:]), 0) for it in range(count)]
        packet = LogRecords.of(THE_ONE, 0, 0, count, log)
        bench.flight.supervisor.receive(AMusselHeard(Medium.WIFI, bench.flight.now_ms, packet.encode()))
        bench.ticks(1)
        return log

    simulated = uploads(111, 10)
    assert bench.answer(f"hand_over {THE_ONE}").startswith("done")
    real = uploads(222, 15)
    bench.real_one_says(0.0, 0.9, State.SLEEPING, 0)
    assert bench.answer(f"take_back {THE_ONE}").startswith("done")
    later = uploads(111, 12)[10:]
    assert bench.recorder.uploaded[THE_ONE] == [*simulated, *real, *later]


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
    for move in ("hand_over 3", "retire 1", "spawn 1 7 8 0.5 0.5", "retire 2"):
        assert bench.answer(move).startswith("done")
    again = Presences([1, 2, 3, 4], 3.0, state_of(lines_of(facts_of(bench.recorder))).presences.values())
    known = {1: Presence.SIMULATED, 2: Presence.RETIRED, 3: Presence.REAL, 4: Presence.SIMULATED}
    assert {it: again.of(it) for it in known} == known and again.simulated == {1, 4}
    coordinator = Coordinator(bench.host, bench.coordinator.granted_ms, bench.scenario.time_scale)
    again.mute_as_before(coordinator)
    spoke = {it.agent_id for it in coordinator.advance(bench.flight.now_ms + 5000) if isinstance(it, Output)}
    assert spoke == {1, 4}


def lines_of(facts: Iterable[Any]) -> list[dict[str, Any]]:
    return [{"t": at_ms, "kind": kind, **data} for at_ms, kind, data in facts]


def resumed(bench: Bench, facts: list[Any]) -> Coordinator:
    """The fleet under a new coordinator, after a kill that left these facts in the journal."""
    journal = journal_of(json.loads(json.dumps(lines_of(facts))))
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

"""A mission is taken over in flight, stopped, flown by hand, and given back; its orders meet the guards.

The stories are transcripts: each line has what a person, a node or a guard does, and behind the bar the answer and what the
flight tells meanwhile.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from flying import Flying, play
from journals import facts_of

from apad_bridge.assembly import flight_parts
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import Estimator
from apad_bridge.events.guard_events import StopKind
from apad_bridge.events.mission_events import MissionEnd, MissionState, Phase
from apad_bridge.events.person_orders import Act
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.orders import Order, SendCommand
from apad_bridge.mission.policy.planner import PlanRules
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.planning import registry
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.control_protocol import Request
from apad_bridge.supervisor.control_server import carry_out
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.vehicle.commands import CommandedByOthers, GoTo, OpenDock, PilotReported, PoseReported
from apad_bridge.vehicle.outcomes import DockChanged, PrimitiveSucceeded
from apad_bridge.vehicle.vehicle_link import LinkFact, VehicleLink
from apad_bridge.world.apad.in_process import InProcessVehicle
from firmware_model.packets import Kind
from firmware_model.states import State


class Overheard:
    """A link that also reports the facts which a test puts in."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link
        self.command, self.close = link.command, link.close
        self.facts: list[LinkFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts, self.facts = self.facts, []
        return [*self._link.advance(now_ms), *facts]


@pytest.fixture
def fenced(pool: Scenario) -> Scenario:
    fence = ((-4.0, -4.0), (32.0, -4.0), (32.0, 25.0), (-4.0, 25.0))
    return replace(pool, area=replace(pool.area, fence=fence))


TOLD: dict[str, Callable[[dict[str, Any]], str]] = {
    "override": lambda it: f"{it['by']} takes it" if it["taken"] else f"{it['by']} gives it back",
    "plan": lambda it: f"plan {it['what']}",
    "dock": lambda it: f"{'docked' if it['closed'] else 'undocked'} {it['agent']}",
    "stuck": lambda it: it["reason"] if "end_by" in it["reason"] else "",
    "given_up": lambda it: f"given up {it['agent']}",
}
"""The events that a transcript shows."""
HAND: dict[str, Callable[[ManualMission], object]] = {
    "go": lambda hand: hand.go_to(20.0, 12.0),
    "go far": lambda hand: hand.go_to(14.0, 10.5),
    "hold": lambda hand: hand.hold(18.0, 6.0),
    "hold here": lambda hand: hand.hold(),
    "pause": lambda hand: hand.pause(),
    "resume": lambda hand: hand.resume(),
    "dock 3": lambda hand: hand.dock(0, 3),
    "undock": lambda hand: hand.undock(0),
    "permit 3": lambda hand: hand.permit_surfacing(3),
    "call up 3": lambda hand: hand.call_up(3),
    "send 3": lambda hand: hand.send_command(Kind.PERMISSION, 3),
}


class Story(Flying):
    """A flight in which a person, another party, a guard and a pilot have their say."""

    def __init__(
        self, pool: Scenario, by_hand: bool = False, needs_person: bool = False, ends: bool = False
    ) -> None:
        self._needs_person = needs_person
        pool = replace(pool, mission=replace(pool.mission, end_by=200.0 if ends else None))
        super().__init__(pool, self._join, **({"command_sources": ()} if by_hand else {}))
        self._shown = 0
        """The number of the journal's facts that were shown."""

    def _join(self, context: FlightContext) -> FlightContext:
        self.link = Overheard(context.vehicle)
        safety = replace(context.safety, needs_person=self._needs_person)
        return replace(context, vehicle=self.link, safety=safety)

    @property
    def seen(self) -> dict[str, object]:
        """What a line may ask for."""
        mission, hand, stop = self.flight.supervisor.mission, self.calls.wait(0), self.gate.stops.in_force
        return {
            "phase": mission.state.phase.value,
            "docks": mission.docks,
            "goto": hand.goto.name,
            "docking": hand.docking.name,
            "docked": len(mission.state.docked),
            "services": mission.state.services,
            "paused": self.by_hand.paused if mission.by_hand else None,
            "past": "210 s" if self.now_ms >= 210_000 else "",
            "stop in force": None
            if stop is None
            else f"{stop.number} {stop.kind.value} by {stop.by}, {stop.state.value}",
            "awaits": self.gate.awaits_person,
            "ended by": mission.state.ended_by,
        }

    def do(self, move: str) -> object:
        name, _, rest = move.partition(" ")
        match name:
            case _ if move in self.seen:
                return self.seen[move]
            case "until":
                what, _, value = rest.partition(" ")
                self.until(lambda: str(self.seen[what]) == value)
            case "plans":
                before = len(self.events("plan"))
                self.until(lambda: len(self.events("plan")) > before)
            case "seconds":
                self.seconds(int(rest))
            case "mission":
                acts = {"finish": lambda it: it.finish(MissionEnd(EndReason.CALL, "seen enough"))}
                return self.told_by(acts.get(rest, lambda it: getattr(it, rest)()))
            case "hand" if rest == "go to 3":
                there = self.flight.supervisor.beliefs.get(3)
                return self.call(lambda hand: hand.go_to(there.north_m, there.east_m)) or ""
            case "hand":
                return self.call(HAND[rest]) or ""
            case "stop" | "continue" | "return":
                request = Request(Act.GIVE_BACK if name == "return" else Act(name), "Anna")
                answer = self.answered(lambda: carry_out(request, self.calls, self.gate))
                words = ["yes" if answer.accepted else "no", answer.message, answer.steers]
                return ", ".join(it for it in words if it)
            case _ if move in DONE:
                DONE[move](self)
            case "stays":
                return math.dist(self.here_m, self.kept_m) < 1
            case "at":
                return math.dist(self.here_m, map(float, rest.split())) < 1
            case _:
                raise AssertionError(move)
        return ""

    def answer(self, move: str) -> str:
        """The answer of a line's move, and what the flight told meanwhile."""
        try:
            said = str(self.do(move))
        except Refused as refused:
            said = f"refused: {refused}"
        facts = facts_of(self.records)
        shown = [TOLD[kind](data) for _, kind, data in facts[self._shown :] if kind in TOLD]
        self._shown = len(facts)
        return "; ".join(it for it in (said, *shown) if it)

    @property
    def here_m(self) -> tuple[float, float]:
        pose = self.flight.supervisor.pose
        return pose.north_m, pose.east_m

    def told_by(self, act: Callable[[Any], object]) -> object:
        told: list[object] = []
        self.call_mission(lambda mission: told.append(act(mission)))
        return told[0] or ""


DONE: dict[str, Callable[[Story], object]] = {
    "guard": lambda it: it.flight._vehicle.stop("position", it.now_ms, off=False),
    "guard off": lambda it: it.flight._vehicle.stop("position", it.now_ms, off=True),
    "others": lambda it: it.link.facts.append(CommandedByOthers(it.now_ms)),
    "others said": lambda it: it.gate.note_others("a person must let the aPad go on"),
    "pilot": lambda it: it.link.facts.append(PilotReported(it.now_ms, True)),
    "stay": lambda it: setattr(it, "kept_m", it.here_m),
}


_BY_ANNA, _BY_POSITION = (
    f"...until a person continues: stop 1 (hold, by {it})..." for it in ("Anna", "position")
)
STORIES: dict[str, tuple[dict[str, bool], str]] = {
    "taken over it does as it is told, and given back it brings home whom it holds and plans again": (
        {},
        """
        until docked 1            | plan collect; docked 4
        until phase go to aMussel |
        hand go far               | refused: the mission flies the aPad: call take_over first
        mission take_over         | person takes it
        phase                     | by hand or script
        hand go far               |
        until goto DONE           |
        seconds 120               |
        at 14 10.5                | True
        docks                     | (4, None, None, None)
        mission give_back         | person gives it back
        until services 2          | plan redeploy; undocked 4; plan collect; docked 7; docked 10; docked 6;
                                  | docked 2; plan redeploy; undocked 2
        """,
    ),
    "by hand it holds where it is told, and sends no command while it is paused": (
        {},
        """
        seconds 5         | plan collect
        mission take_over | person takes it
        hand hold         |
        seconds 60        |
        at 18 6           | True
        hand pause        |
        hand send 3       | refused: the aPad was stopped: continue first, or resume where a script paused it
        """,
    ),
    "it is not given back in the middle of a docking": (
        {},
        """
        seconds 5          | plan collect
        mission take_over  | person takes it
        mission take_over  | the aPad was taken over already; person takes it
        hand go to 3       |
        until goto DONE    |
        hand dock 3        |
        mission give_back  | refused: a docking is under way: wait for its end, or order a hold
        until docking DONE | docked 3
        mission give_back  | person gives it back
        mission give_back  | the mission flies the aPad already
        phase              | charging wait
        docks              | (3, None, None, None)
        """,
    ),
    "given back under a stop it stays there, and the answer names the stop": (
        {},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        mission give_back         | the mission waits: stop 1 (hold, by Anna) is in force;
                                  | person gives it back; plan collect
        seconds 30                |
        stop in force             | 1 hold by Anna, at rest
        continue                  | yes, the mission steers
        mission give_back         | the mission flies the aPad already
        """,
    ),
    "a call can end the flight, and then nobody takes it": (
        {},
        """
        seconds 3         | plan collect
        mission finish    |
        ended by          | seen enough
        mission take_over | refused: the mission is over: seen enough
        """,
    ),
    # The second stop is OFF: the hull coasts on.
    "a stopped mission holds until a person continues, however often it was stopped": (
        {},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        phase                     | by hand or script
        stop                      | yes, nobody steers: ...
        seconds 5                 |
        stay                      |
        seconds 120               |
        stays                     | True
        continue                  | yes, the mission steers; person gives it back; plan collect
        plans                     | docked 4; docked 7; docked 10; docked 6; plan redeploy
        continue                  | no, nothing was stopped: there is nothing to continue; the mission steers
        """,
    ),
    # A node that calls these services has not seen who is in the water.
    "to take it over is no word that a person's hold is over": (
        {},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        mission take_over         | the aPad was taken over already; person takes it
        hand go                   | refused: ...until a person continues: stop 1 (hold, by Anna)...
        seconds 60                |
        stop in force             | 1 hold by Anna, at rest
        continue                  | yes, a person steers: only give-back...
        stop in force             | None
        """,
    ),
    "to give it back is no word that a person's hold is over": (
        {},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        stay                      |
        mission give_back         | the mission waits: stop 1 (hold, by Anna) is in force;
                                  | person gives it back; plan collect
        seconds 60                |
        stays                     | True
        stop in force             | 1 hold by Anna, at rest
        continue                  | yes, the mission steers
        stop in force             | None
        """,
    ),
    "a go-to of a person is stopped and continued": (
        {},
        """
        seconds 3         | plan collect
        mission take_over | person takes it
        hand go           |
        stop              | yes, a person steers: only give-back...
        paused            | True
        seconds 60        |
        goto              | RUNNING
        continue          | yes, a person steers: only give-back...
        until goto DONE   |
        continue          | no, nothing was stopped: there is nothing to continue;
                          | a person steers: only give-back...
        return            | yes, the mission steers; person gives it back; plan collect
        phase             | go to aMussel
        """,
    ),
    # Then only that person's word gives it back.
    "a stop changes nobody's right to steer: mission take_over, stop": (
        {},
        """
        until phase go to aMussel | plan collect
        mission take_over         | person takes it
        stop                      | yes, a person steers: only give-back...
        continue                  | yes, a person steers: only give-back...
        seconds 60                |
        phase                     | by hand or script
        return                    | yes, the mission steers; person gives it back; plan collect
        plans                     | docked 4; docked 7; docked 10; docked 6; plan redeploy
        """,
    ),
    "a stop changes nobody's right to steer: stop, mission take_over": (
        {},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        mission take_over         | the aPad was taken over already; person takes it
        continue                  | yes, a person steers: only give-back...
        seconds 60                |
        phase                     | by hand or script
        return                    | yes, the mission steers; person gives it back; plan collect
        plans                     | docked 4; docked 7; docked 10; docked 6; plan redeploy
        """,
    ),
    "a flight by hand that was not stopped has nothing to continue": (
        {"by_hand": True},
        """
        seconds 3 |
        continue  | no, nothing was stopped: there is nothing to continue;
                  | orders and the script steer: no mission plans in this flight
        stop      | yes, orders and the script steer...
        continue  | yes, orders and the script steer...
        """,
    ),
    # The mission itself was not paused.
    "a guard's stop by hand, which stopped no order, is continued all the same": (
        {"by_hand": True},
        """
        seconds 3     |
        guard off     |
        seconds 2     |
        stop in force | 1 off by position, obeyed
        continue      | yes, orders and the script steer...
        stop in force | None
        """,
    ),
    "after another party steered it only a person lets it go on: mission give_back": (
        {"needs_person": True},
        """
        until phase go to aMussel | plan collect
        others                    |
        seconds 30                | vehicle takes it
        phase                     | by hand or script
        awaits                    |
                                  | another client... continue, take it over, or give it back
        hand go                   | refused: ...another client... continue, take it over, or give it back
        mission give_back         |
                                  | the mission waits: another client... continue, take it over, or give it back;
                                  | person gives it back; plan collect
        seconds 2                 |
        awaits                    |
        """,
    ),
    "after another party steered it only a person lets it go on: mission take_over": (
        {"needs_person": True},
        """
        until phase go to aMussel | plan collect
        others                    |
        seconds 30                | vehicle takes it
        phase                     | by hand or script
        awaits                    |
                                  | another client... continue, take it over, or give it back
        hand go                   | refused: ...another client... continue, take it over, or give it back
        mission take_over         | the aPad was taken over already; person takes it
        seconds 2                 |
        awaits                    |
        """,
    ),
    "after another party steered it only a person lets it go on: continue": (
        {"needs_person": True},
        """
        until phase go to aMussel | plan collect
        others                    |
        seconds 30                | vehicle takes it
        phase                     | by hand or script
        awaits                    |
                                  | another client... continue, take it over, or give it back
        hand go                   | refused: ...another client... continue, take it over, or give it back
        continue                  | yes, the mission steers; person gives it back; plan collect
        seconds 2                 |
        awaits                    |
        """,
    ),
    "without a mission of ours a person's word lets a stopped aPad move: mission take_over": (
        {"by_hand": True},
        """
        seconds 3         |
        others said       |
        seconds 1         |
        hand go           | refused: nothing moves until a person continues: a person must let the aPad go on
        mission take_over | no mission plans in this flight: orders are taken without it; person takes it
        seconds 2         |
        hand go           |
        until goto DONE   |
        """,
    ),
    "without a mission of ours a person's word lets a stopped aPad move: continue": (
        {"by_hand": True},
        """
        seconds 3       |
        others said     |
        seconds 1       |
        hand go         | refused: nothing moves until a person continues: a person must let the aPad go on
        continue        | yes, orders and the script steer...
        seconds 2       |
        hand go         |
        until goto DONE |
        """,
    ),
    # By a service, an action or a script: they call the same. A pilot keeps no aMussel from surfacing.
    **{
        f"an order that could not leave is refused, and not accepted first: {act}": (
            {"by_hand": True},
            f"""
            seconds 10     |
            {act:<14} | {answer}
            seconds 10     |
            hand go        | refused: {why}
            hand hold here | refused: {why}
            hand dock 3    | refused: {why}
            hand undock    | refused: {why}
            hand permit 3  | {surfacing}
            hand call up 3 | {surfacing}
            goto           | IDLE
            docking        | IDLE
            """,
        )
        for act, answer, why, surfacing in (
            ("stop", "yes, orders and the script steer...", _BY_ANNA, f"refused: {_BY_ANNA}"),
            ("guard", "", _BY_POSITION, f"refused: {_BY_POSITION}"),
            ("pilot", "", "the pilot has it: a pilot steers the aPad", ""),
        )
    },
    "a paused script does not go on under a stop": (
        {"by_hand": True},
        """
        seconds 3       |
        hand go         |
        hand pause      |
        stop            | yes, orders and the script steer...
        hand resume     | refused: ...until a person continues: stop 1 (hold, by Anna)...
        seconds 60      |
        goto            | RUNNING
        continue        | yes, orders and the script steer...
        until goto DONE |
        """,
    ),
    "a person is told when end_by passes while the aPad is stopped": (
        {"ends": True},
        """
        until phase go to aMussel | plan collect
        stop                      | yes, nobody steers: ...; stop takes it
        until past 210 s          |
                                  | mission.end_by passes while it may not move: stop 1 (hold, by Anna) is in force
        """,
    ),
    "a person is told when end_by passes while a pilot has the aPad": (
        {"ends": True},
        """
        until phase go to aMussel | plan collect
        pilot                     |
        until past 210 s          | given up 4;
                                  | mission.end_by passes while it may not move: the pilot has it: a pilot steers the aPad
        """,
    ),
}


@pytest.mark.parametrize(("setup", "story"), STORIES.values(), ids=STORIES)
def test_story(fenced: Scenario, setup: dict[str, bool], story: str) -> None:
    play(story, Story(fenced, **setup).answer)


class Told(dict[int, Belief]):
    def all(self) -> list[Belief]:
        return list(self.values())

    @property
    def estimator(self) -> Estimator:
        raise AssertionError("nobody forecasts here")


def test_a_mechanism_that_opens_when_a_person_takes_over_is_a_service_all_the_same(pool: Scenario) -> None:
    told = Told({3: Belief(3, 0, State.CHARGING, 1.0, 1.0, 5.0, 5.0)})
    to_redeploy = MissionState(
        Phase.GO_DEPLOY,
        plan=(Step(StepKind.DEPLOY, 3, 0),),
        docked=((0, 3),),
        homes=((3, 5.0, 5.0),),
        failed_tries=((7, 5),),
    )
    takeover = FlightMission(
        lambda state: EnergyExchange(
            PlanRules(
                pool.mission, registry.collection("cautious"), registry.redeployment("greedy-redeploy")
            ),
            told,
            state,
        ),
        lambda state: ManualMission(pool.mission, 1.0, told, (), state),
        CallQueue(),
        to_redeploy,
    )
    takeover.moved(5.0, 5.0)

    def ordered(orders: list[Order], kind: type[GoTo] | type[OpenDock]) -> int:
        return next(it.command_id for it in orders if isinstance(it, kind))

    go_to = ordered(takeover.advance(1000), GoTo)
    undock = ordered(takeover.receive(PrimitiveSucceeded(2000, go_to), 2000), OpenDock)
    takeover.take_over()
    takeover.advance(3000)
    assert takeover.by_hand is not None and takeover.by_hand.docking is Status.RUNNING
    with pytest.raises(Refused, match="a docking is under way"):
        takeover.give_back()
    takeover.receive(DockChanged(4000, 0, 3, False, ()), 4000)
    orders = takeover.receive(PrimitiveSucceeded(4000, undock), 4000)
    assert SendCommand(Kind.RELEASE, 3) in orders
    assert takeover.state.services == 1 and takeover.by_hand.docking is Status.DONE
    assert takeover.by_hand.events.take("docking")[0].agent == 3
    # A person who gives the aPad back gives those another chance that were left alone.
    assert takeover.state.failed_tries == ((7, 5),)
    takeover.give_back()
    assert takeover.state.failed_tries == ()


def test_a_resumed_flight_goes_on_in_the_hands_in_which_it_was(pool: Scenario) -> None:
    mission = Flying(pool).flight.supervisor.mission
    assert isinstance(mission, FlightMission) and mission.by_hand is None
    again = FlightMission(
        mission._planned, mission._by_hand, CallQueue(), MissionState(phase=Phase.COMMANDED, cost_m=7.0)
    )
    assert again.by_hand is not None and again.state.cost_m == 7.0


def test_a_flight_by_hand_has_nobody_to_give_it_back_to(pool: Scenario) -> None:
    hand = open_flight(pool, RunSpec(command_sources=()))[0].supervisor.mission
    assert hand.take_over() == "no mission plans in this flight: orders are taken without it"
    with pytest.raises(Refused, match="no mission to which to give the aPad back"):
        hand.give_back()


def test_a_remark_stands_in_the_journal_and_changes_nothing_else(pool: Scenario) -> None:
    flying, undisturbed = Flying(pool), Flying(pool)
    flying.seconds(5)
    remark = Request(Act.REMARK, "Anna", "a boat\nto the north")
    assert flying.answered(lambda: carry_out(remark, flying.calls, flying.gate)).accepted
    flying.until(lambda: flying.now_ms >= 400_000)
    undisturbed.until(lambda: undisturbed.now_ms >= flying.now_ms)
    assert flying.events("remark") == [{"text": "a boat\nto the north", "by": "Anna"}]
    others = [it for it in facts_of(flying.records) if it[1] != "remark"]
    assert others == facts_of(undisturbed.records)


class WithoutPosition(InProcessVehicle):
    """A vehicle that says everything but where it is."""

    def advance(self, now_ms: int) -> list[LinkFact]:
        return [it for it in super().advance(now_ms) if not isinstance(it, PoseReported)]


def test_a_stop_by_hand_does_not_wait_for_the_first_position(pool: Scenario) -> None:
    vehicle = WithoutPosition(flight_parts.simulated_apad(pool))
    flying = Flying.by_calls(pool, lambda context: replace(context, vehicle=vehicle))
    flying.seconds(3)
    answer = flying.answered(lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate))
    assert not answer.accepted and "has taken the stop, and nobody can tell if it slows" in answer.message
    stop = flying.gate.stops.in_force
    assert stop is not None and stop.kind is StopKind.OFF and stop.taken_ms is not None


def test_the_mission_calls_up_and_fetches_nobody_outside_the_fence(pool: Scenario) -> None:
    """Half of the pool is fenced off: aMussels there are neither permitted to surface nor gone to."""
    half = ((-4.0, -4.0), (32.0, -4.0), (32.0, 10.0), (-4.0, 10.0))
    fenced_off = replace(
        pool,
        area=replace(pool.area, fence=half),
        apad=replace(pool.apad, start_m=(14.0, 5.0)),
        duration_s=900.0,
    )
    flying = Flying(fenced_off)
    flying.until(lambda: flying.phase is Phase.ENDED)
    assert {it["order"] for it in flying.events("refused")} == {"go to point", "permit to surface"}
    assert flying.flight.supervisor.mission.state.services > 0
    assert [data for _, kind, data in facts_of(flying.records) if kind == "dock" and data["closed"]]


@pytest.mark.parametrize("phase", [Phase.GO_COLLECT, Phase.DOCK, Phase.CHARGE, Phase.GO_DEPLOY, Phase.UNDOCK])
def test_a_mission_that_a_guard_stopped_gives_nothing_up_and_goes_on_when_a_person_continues_it(
    fenced: Scenario, phase: Phase
) -> None:
    flying = Story(fenced, needs_person=True)
    flying.until(lambda: flying.phase is phase)
    mission, vehicle = flying.flight.supervisor.mission, flying.flight._vehicle
    vehicle.stop("the test", flying.now_ms, off=True)
    flying.seconds(20)  # a docking under way has ended
    steps, orders = mission.state.plan, flying.events("primitive")
    done = len(mission.state.docked), mission.state.services
    flying.seconds(200)
    assert vehicle.gate.awaits_person and mission.state.plan == steps
    assert flying.events("primitive") == orders
    assert flying.do("continue") == "yes, the mission steers"
    flying.until(lambda: (len(mission.state.docked), mission.state.services) != done, limit_s=600)
    assert flying.events("given_up") == [] and vehicle.gate.awaits_person == ""

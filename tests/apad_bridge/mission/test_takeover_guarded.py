"""A flight whose orders by hand, by the mission and by another party meet the guards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from flying import Flying
from journals import facts_of

from apad_bridge.events.mission_events import Phase
from apad_bridge.events.person_orders import Act
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.control_protocol import Request
from apad_bridge.supervisor.control_server import carry_out
from apad_bridge.vehicle.commands import CommandedByOthers, PilotReported
from apad_bridge.vehicle.guards.gate import PILOT_STEERS
from apad_bridge.vehicle.vehicle_link import LinkFact, VehicleLink


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


def continue_by_command(flying: Flying) -> None:
    assert flying.answered(
        lambda: carry_out(Request(Act.CONTINUE, "Anna"), flying.calls, flying.gate)
    ).accepted


WORDS: dict[str, Callable[[Flying], None]] = {
    "give_back": lambda it: it.call_mission(lambda flown: flown.give_back()),
    "take_over": lambda it: it.call_mission(lambda flown: flown.take_over()),
    "continue": continue_by_command,
}


@pytest.mark.parametrize("word", WORDS)
def test_after_another_party_steered_it_only_a_person_lets_it_go_on(fenced: Scenario, word: str) -> None:
    overheard: list[Overheard] = []

    def needs_person(context: FlightContext) -> FlightContext:
        overheard.append(Overheard(context.vehicle))
        return replace(context, vehicle=overheard[0], safety=replace(context.safety, needs_person=True))

    flying = Flying(fenced, needs_person)
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    gate = flying.flight._vehicle.gate
    overheard[0].facts.append(CommandedByOthers(flying.now_ms))
    flying.seconds(30)
    assert flying.phase is Phase.COMMANDED and "take it over" in gate.awaits_person
    with pytest.raises(Refused, match="continue, take it over, or give it back"):
        flying.call(lambda hand: hand.go_to(14.0, 10.5))
    WORDS[word](flying)
    flying.seconds(2)
    assert gate.awaits_person == ""
    assert [it["by"] for it in flying.events("override")] == ["vehicle", "person"]


@pytest.mark.parametrize("phase", [Phase.GO_COLLECT, Phase.DOCK, Phase.CHARGE, Phase.GO_DEPLOY, Phase.UNDOCK])
def test_a_mission_that_a_guard_stopped_gives_nothing_up_and_goes_on_when_a_person_continues_it(
    fenced: Scenario, phase: Phase
) -> None:
    flying = Flying(fenced, lambda it: replace(it, safety=replace(it.safety, needs_person=True)))
    flying.until(lambda: flying.phase is phase)
    mission, vehicle = flying.flight.supervisor.mission, flying.flight._vehicle
    vehicle.stop("the test", flying.now_ms, off=True)
    flying.seconds(20)  # a docking under way has ended
    steps, orders = mission.state.plan, flying.events("primitive")
    done = len(mission.state.docked), mission.state.services
    flying.seconds(200)
    assert vehicle.gate.awaits_person and mission.state.plan == steps
    assert flying.events("primitive") == orders
    continue_by_command(flying)
    flying.until(lambda: (len(mission.state.docked), mission.state.services) != done, limit_s=600)
    assert flying.events("given_up") == [] and vehicle.gate.awaits_person == ""


def test_a_person_is_told_when_end_by_passes_while_the_apad_is_stopped(fenced: Scenario) -> None:
    flying = Flying(replace(fenced, mission=replace(fenced.mission, end_by=200.0)))
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    assert flying.answered(lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate)).accepted
    flying.until(lambda: flying.now_ms >= 210_000)
    ((at_ms, told),) = [(at_ms, data) for at_ms, kind, data in facts_of(flying.records) if kind == "stuck"]
    assert at_ms == 200_000
    assert "mission.end_by passes while it may not move: stop 1 (hold, by Anna)" in told["reason"]


def test_a_person_is_told_when_end_by_passes_while_a_pilot_has_the_apad(fenced: Scenario) -> None:
    overheard: list[Overheard] = []

    def with_pilot(context: FlightContext) -> FlightContext:
        overheard.append(Overheard(context.vehicle))
        return replace(context, vehicle=overheard[0])

    flying = Flying(replace(fenced, mission=replace(fenced.mission, end_by=200.0)), with_pilot)
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    overheard[0].facts.append(PilotReported(flying.now_ms, True))
    flying.until(lambda: flying.now_ms >= 210_000)
    (told,) = [it["reason"] for it in flying.events("stuck") if "end_by" in it["reason"]]
    assert told == f"mission.end_by passes while it may not move: {PILOT_STEERS}"


HAND_WORDS = {it: WORDS[it] for it in ("take_over", "continue")}


@pytest.mark.parametrize("word", HAND_WORDS)
def test_without_a_mission_of_ours_a_person_s_word_lets_a_stopped_apad_move(
    fenced: Scenario, word: str
) -> None:
    """By hand and beside a script: a call is refused until a person has said so."""
    flying = Flying.by_calls(fenced)
    flying.seconds(3)
    flying.flight._vehicle.gate.note_others("a person must let the aPad go on")
    flying.seconds(1)
    with pytest.raises(Refused, match="a person must let the aPad go on"):
        flying.call(lambda hand: hand.go_to(20.0, 12.0))
    HAND_WORDS[word](flying)
    flying.seconds(2)
    flying.call(lambda hand: hand.go_to(20.0, 12.0))
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)


MOVES: dict[str, Callable[[ManualMission], object]] = {
    "go to": lambda hand: hand.go_to(20.0, 12.0),
    "hold": lambda hand: hand.hold(),
    "dock": lambda hand: hand.dock(0, 3),
    "undock": lambda hand: hand.undock(0),
    "permit to surface": lambda hand: hand.permit_surfacing(3),
    "call up": lambda hand: hand.call_up(3),
}


@pytest.mark.parametrize("stopped_by", ["a person", "a guard", "a pilot"])
def test_an_order_that_could_not_leave_is_refused_and_not_accepted_first(
    fenced: Scenario, stopped_by: str
) -> None:
    """By a service, an action or a script: they call the same. A pilot keeps no aMussel from surfacing."""
    overheard: list[Overheard] = []

    def with_pilot(context: FlightContext) -> FlightContext:
        overheard.append(Overheard(context.vehicle))
        return replace(context, vehicle=overheard[0])

    flying = Flying.by_calls(fenced, with_pilot)
    flying.seconds(10)
    if stopped_by == "a person":
        assert flying.answered(
            lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate)
        ).accepted
    elif stopped_by == "a guard":
        flying.flight._vehicle.stop("position", flying.now_ms)
    else:
        overheard[0].facts.append(PilotReported(flying.now_ms, True))
    flying.seconds(10)
    why = {
        "a person": "until a person continues: stop 1 .*by Anna",
        "a guard": "until a person continues: stop 1 .*by position",
        "a pilot": PILOT_STEERS,
    }[stopped_by]
    may = ("permit to surface", "call up") if stopped_by == "a pilot" else ()
    for name, move in MOVES.items():
        if name not in may:
            with pytest.raises(Refused, match=why):
                flying.call(move)
    assert (flying.calls.wait(0).goto, flying.calls.wait(0).docking) == (Status.IDLE, Status.IDLE)
    for name in may:
        flying.call(MOVES[name])


def test_a_paused_script_does_not_go_on_under_a_stop(fenced: Scenario) -> None:
    flying = Flying.by_calls(fenced)
    flying.seconds(3)
    flying.call(lambda hand: hand.go_to(20.0, 12.0))
    flying.call(lambda hand: hand.pause())
    assert flying.answered(lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate)).accepted
    with pytest.raises(Refused, match=r"stop 1 .*by Anna"):
        flying.call(lambda hand: hand.resume())
    flying.seconds(60)
    assert flying.calls.wait(0).goto is Status.RUNNING
    continue_by_command(flying)
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)

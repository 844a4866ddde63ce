"""A mission is taken over in flight, flown by hand, and given back."""

import math
from dataclasses import replace

import pytest
from flying import Flying
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
from apad_bridge.mission.flight_mission import FLIES_ALREADY, FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.orders import Order, SendCommand
from apad_bridge.mission.planner import PlanRules
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.planning import registry
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.control_protocol import Request
from apad_bridge.supervisor.control_server import NOTHING_STOPPED, carry_out
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.vehicle.commands import GoTo, OpenDock, PoseReported
from apad_bridge.vehicle.outcomes import DockChanged, PrimitiveSucceeded
from apad_bridge.vehicle.vehicle_link import LinkFact
from apad_bridge.world.apad.in_process import InProcessVehicle
from firmware_model.packets import Kind
from firmware_model.states import State


@pytest.fixture
def flying(pool: Scenario) -> Flying:
    return Flying(pool)


def test_taken_over_it_does_as_it_is_told_and_given_back_it_plans_again(flying: Flying) -> None:
    flying.until(
        lambda: len(flying.flight.supervisor.mission.state.docked) == 1 and flying.phase is Phase.GO_COLLECT
    )
    with pytest.raises(Refused, match="the mission flies the aPad: call take_over first"):
        flying.call(lambda hand: hand.go_to(14.0, 10.5))
    flying.call_mission(lambda mission: mission.take_over())
    docked, plans = flying.flight.supervisor.mission.state.docked, len(flying.events("plan"))
    assert flying.phase is Phase.COMMANDED
    flying.call(lambda hand: hand.go_to(14.0, 10.5))
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)
    # It stays there with its aMussels, and plans nothing, for as long as somebody flies it.
    flying.seconds(120)
    pose = flying.flight.supervisor.pose
    assert pose is not None and abs(pose.north_m - 14) + abs(pose.east_m - 10.5) < 1
    assert flying.flight.supervisor.mission.state.docked == docked
    assert len(flying.events("plan")) == plans
    flying.call_mission(lambda mission: mission.give_back())
    flying.until(lambda: flying.flight.supervisor.mission.state.services >= 2)
    assert [it["taken"] for it in flying.events("override")] == [True, False]
    # It charged the held aMussels and brought them home first, then collected the next.
    first, second = flying.events("plan")[plans : plans + 2]
    assert (first["what"], [step["agent"] for step in first["steps"]]) == ("redeploy", [docked[0][1]])
    assert second["what"] == "collect"


def test_by_hand_it_holds_where_it_is_told_and_sends_no_command_while_it_is_paused(flying: Flying) -> None:
    flying.seconds(5)
    flying.call_mission(lambda mission: mission.take_over())
    flying.call(lambda hand: hand.hold(18.0, 6.0))
    flying.seconds(60)
    pose = flying.flight.supervisor.pose
    assert pose is not None and math.dist((pose.north_m, pose.east_m), (18.0, 6.0)) < 1
    flying.call(lambda hand: hand.pause())
    with pytest.raises(Refused, match="the aPad was stopped: continue first"):
        flying.call(lambda hand: hand.send_command(Kind.PERMISSION, 3))


def test_it_is_not_given_back_in_the_middle_of_a_docking(flying: Flying) -> None:
    flying.seconds(5)
    flying.call_mission(lambda mission: mission.take_over())
    flying.call_mission(lambda mission: mission.take_over())
    there = flying.flight.supervisor.beliefs.get(3)
    flying.call(lambda hand: hand.go_to(there.north_m, there.east_m))
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)
    flying.call(lambda hand: hand.dock(0, 3))
    with pytest.raises(Refused, match="a docking is under way"):
        flying.call_mission(lambda mission: mission.give_back())
    flying.until(lambda: flying.calls.wait(0).docking is Status.DONE)
    flying.call_mission(lambda mission: mission.give_back())
    flying.call_mission(lambda mission: mission.give_back())
    assert flying.phase is Phase.CHARGE
    assert flying.flight.supervisor.mission.docks == (3, None, None, None)


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


def test_an_apad_that_is_given_back_under_a_stop_stays_there_and_the_answer_names_the_stop(
    flying: Flying,
) -> None:
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    assert asked(flying, Act.STOP)[0]
    answers: list[str] = []
    flying.call_mission(lambda mission: answers.append(mission.give_back()))
    assert answers[0].startswith("the mission waits: stop 1 (hold")
    flying.seconds(30)
    assert flying.gate.stops.in_force is not None and asked(flying, Act.CONTINUE)[0]
    flying.call_mission(lambda mission: answers.append(mission.give_back()))
    assert answers[1] == FLIES_ALREADY


def test_a_call_can_end_the_flight_and_then_nobody_takes_it(flying: Flying) -> None:
    flying.seconds(3)
    flying.call_mission(lambda flown: flown.finish(MissionEnd(EndReason.CALL, "seen enough")))
    assert str(flying.flight.supervisor.mission.state.ended_by) == "seen enough"
    with pytest.raises(Refused, match="the mission is over: seen enough"):
        flying.calls.call_mission(lambda mission: mission.take_over())


def test_a_resumed_flight_goes_on_in_the_hands_in_which_it_was(flying: Flying) -> None:
    mission = flying.flight.supervisor.mission
    assert isinstance(mission, FlightMission) and mission.by_hand is None
    again = FlightMission(
        mission._planned, mission._by_hand, CallQueue(), MissionState(phase=Phase.COMMANDED, cost_m=7.0)
    )
    assert again.by_hand is not None and again.state.cost_m == 7.0


def test_a_flight_by_hand_has_nobody_to_give_it_back_to(pool: Scenario) -> None:
    hand = open_flight(pool, RunSpec(command_sources=()))[0].supervisor.mission
    assert isinstance(hand, FlightMission)
    assert hand.take_over() == "no mission plans in this flight: orders are taken without it"
    with pytest.raises(Refused, match="no mission to which to give the aPad back"):
        hand.give_back()


def asked(flying: Flying, act: Act, text: str = "") -> tuple[bool, str]:
    """A command's request, carried out while the flight goes on, and its answer."""
    answer = flying.answered(lambda: carry_out(Request(act, "Anna", text), flying.calls, flying.gate))
    return answer.accepted, answer.message


def test_a_stopped_mission_holds_until_a_person_continues_however_often_it_was_stopped(
    flying: Flying,
) -> None:
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    assert asked(flying, Act.STOP) == (True, "") and flying.phase is Phase.COMMANDED
    assert asked(flying, Act.STOP) == (True, "")
    flying.seconds(5)
    held = flying.flight.supervisor.pose
    plans = len(flying.events("plan"))
    flying.seconds(120)
    pose = flying.flight.supervisor.pose
    # The second stop is OFF: the hull coasts on.
    assert pose is not None and math.dist((pose.north_m, pose.east_m), (held.north_m, held.east_m)) < 1.0
    assert len(flying.events("plan")) == plans and asked(flying, Act.CONTINUE) == (True, "")
    flying.until(lambda: len(flying.events("plan")) > plans)
    assert asked(flying, Act.CONTINUE) == (False, f"{NOTHING_STOPPED}; the mission steers")
    assert flying.events("operator") == [
        {"order": order, "by": "Anna"} for order in ("stop", "stop", "continue")
    ]


@pytest.mark.parametrize("word", ["take_over", "give_back"])
def test_who_commands_the_apad_is_no_word_that_a_persons_hold_is_over(flying: Flying, word: str) -> None:
    """A node that calls these services has not seen who is in the water."""
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    assert asked(flying, Act.STOP) == (True, "")
    flying.call_mission(lambda mission: getattr(mission, word)())
    orders = flying.events("primitive")
    if word == "take_over":
        with pytest.raises(Refused, match=r"until a person continues: stop 1 \(hold, by Anna\) is in force"):
            flying.call(lambda mission: mission.go_to(20.0, 12.0))
    flying.seconds(60)
    assert flying.gate.stops.in_force is not None and flying.gate.stops.in_force.rest_ms is not None
    moved = [it for it in flying.events("primitive")[len(orders) :] if it["phase"] == "succeeded"]
    assert [it["name"] for it in moved if it["name"] == "go to point"] == []
    assert asked(flying, Act.CONTINUE) == (True, "") and flying.gate.stops.in_force is None


def test_a_go_to_of_a_person_is_stopped_and_continued(flying: Flying) -> None:
    flying.seconds(3)
    flying.call_mission(lambda flown: flown.take_over())
    flying.call(lambda mission: mission.go_to(10.0, 10.0))
    assert asked(flying, Act.STOP) == (True, "") and flying.by_hand.paused
    flying.seconds(60)
    assert flying.by_hand.goto is Status.RUNNING and asked(flying, Act.CONTINUE) == (True, "")
    flying.until(lambda: flying.by_hand.goto is Status.DONE)
    accepted, why = asked(flying, Act.CONTINUE)
    assert not accepted and "a person steers: only give-back" in why
    assert asked(flying, Act.GIVE_BACK) == (True, "") and flying.phase is not Phase.COMMANDED


@pytest.mark.parametrize("words", [("take over", "stop"), ("stop", "take over")])
def test_a_stop_changes_nobodys_right_to_steer(flying: Flying, words: tuple[str, str]) -> None:
    """A person took the aPad over, before the stop or under it: then only that person's word gives it back."""
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    for word in words:
        if word == "stop":
            assert asked(flying, Act.STOP) == (True, "")
        else:
            flying.call_mission(lambda flown: flown.take_over())
    plans = len(flying.events("plan"))
    answer = flying.answered(lambda: carry_out(Request(Act.CONTINUE, "Anna"), flying.calls, flying.gate))
    assert answer.accepted and answer.steers.startswith("a person steers")
    flying.seconds(60)
    assert flying.phase is Phase.COMMANDED and len(flying.events("plan")) == plans
    assert asked(flying, Act.GIVE_BACK) == (True, "")
    flying.until(lambda: len(flying.events("plan")) > plans)


def test_a_remark_stands_in_the_journal_and_changes_nothing_else(pool: Scenario) -> None:
    flying, undisturbed = Flying(pool), Flying(pool)
    flying.seconds(5)
    assert asked(flying, Act.REMARK, "a boat\nto the north") == (True, "")
    flying.until(lambda: flying.now_ms >= 400_000)
    undisturbed.until(lambda: undisturbed.now_ms >= flying.now_ms)
    assert flying.events("remark") == [{"text": "a boat\nto the north", "by": "Anna"}]
    others = [it for it in facts_of(flying.records) if it[1] != "remark"]
    assert others == facts_of(undisturbed.records)


def test_a_flight_by_hand_that_was_not_stopped_has_nothing_to_continue(pool: Scenario) -> None:
    flying = Flying.by_calls(pool)
    flying.seconds(3)
    accepted, why = asked(flying, Act.CONTINUE)
    assert not accepted and why.startswith(NOTHING_STOPPED)
    assert asked(flying, Act.STOP) == (True, "") and asked(flying, Act.CONTINUE) == (True, "")


class WithoutPosition(InProcessVehicle):
    """A vehicle that says everything but where it is."""

    def advance(self, now_ms: int) -> list[LinkFact]:
        return [it for it in super().advance(now_ms) if not isinstance(it, PoseReported)]


def test_a_stop_by_hand_does_not_wait_for_the_first_position(pool: Scenario) -> None:
    vehicle = WithoutPosition(flight_parts.simulated_apad(pool))
    flying = Flying.by_calls(pool, lambda context: replace(context, vehicle=vehicle))
    flying.seconds(3)
    accepted, why = asked(flying, Act.STOP)
    assert not accepted and "has taken the stop, and nobody can tell if it slows" in why
    stop = flying.gate.stops.in_force
    assert stop is not None and stop.kind is StopKind.OFF and stop.taken_ms is not None


def test_a_stop_by_hand_that_stopped_no_order_is_continued_all_the_same(pool: Scenario) -> None:
    """A guard's stop: the mission itself was not paused."""
    flying = Flying.by_calls(pool)
    flying.seconds(3)
    flying.flight._vehicle.stop("the test", flying.now_ms, off=True)
    flying.seconds(2)
    assert asked(flying, Act.CONTINUE) == (True, "") and flying.gate.stops.in_force is None

"""Calls of other threads: run at a tick, answered, refused, or withdrawn when no tick comes."""

import threading
from collections.abc import Callable

import pytest

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import LastPacket
from apad_bridge.events.mission_events import PRE_EMPTED, AMusselReleased, MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.orders import PermitSurfacing, SendCommand
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, Manoeuvre, OpenDock
from apad_bridge.vehicle.outcomes import DockChanged, NothingCaught, PrimitiveFailed, PrimitiveSucceeded
from firmware_model.packets import Kind
from firmware_model.states import State


class Believed:
    """A fleet of one aMussel, 1 m off, in the state that the test sets."""

    estimator = LastPacket()

    def __init__(self, state: State) -> None:
        self.state = state
        self.primary = 0.5

    def get(self, agent_id: int) -> Belief | None:
        return Belief(7, 0, self.state, self.primary, 1.0, 1.0, 0.0) if agent_id == 7 else None

    def all(self) -> list[Belief]:
        return [Belief(7, 0, self.state, self.primary, 1.0, 1.0, 0.0)]


def commanded(pool: Scenario, state: State = State.ACTIVE) -> tuple[ManualMission, Believed]:
    believed = Believed(state)
    mission = ManualMission(pool.mission, pool.apad.max_speed_m_s, believed, ())
    mission.moved(0.0, 0.0)
    mission.advance(1000)
    return mission, believed


def test_a_call_is_done_at_the_next_tick_by_the_flight_s_thread(pool: Scenario) -> None:
    command_source, told = CallQueue(), []
    flight, _ = open_flight(pool, RunSpec(command_sources=(), calls=command_source))

    def caller() -> None:
        told.append(
            command_source.call(lambda mission: (mission.go_to(14.0, 12.0), threading.current_thread())[1])
        )
        while command_source.wait(20).goto is Status.RUNNING:
            pass
        told.append(command_source.wait(20).goto)
        with pytest.raises(Refused, match="dock 1 is empty"):
            command_source.call(lambda mission: mission.undock(0))
        command_source.call(lambda mission: mission.finish(MissionEnd(EndReason.CALL, "enough")))

    thread = threading.Thread(target=caller, daemon=True)
    thread.start()
    assert str(flight.run()) == "enough"
    thread.join(60)
    assert told == [threading.current_thread(), Status.DONE]
    with pytest.raises(Refused, match="the mission is over: enough"):
        command_source.call(lambda mission: None)


def test_a_call_that_no_tick_answers_is_withdrawn(pool: Scenario) -> None:
    command_source, done = CallQueue(), []
    with pytest.raises(Refused, match="nothing was ordered"):
        command_source.call(lambda mission: done.append(1), timeout_s=0.01)
    assert not command_source.has_calls
    with pytest.raises(Refused, match="with the next tick"):
        command_source.call_mission(lambda mission: done.append(2), 0.01, stays=True)
    assert command_source.has_calls
    # A later tick runs the one that stays, and not the other one.
    open_flight(pool, RunSpec(command_sources=(), calls=command_source))[0].step()
    assert done == [2] and not command_source.has_calls


def test_the_permission_is_repeated_and_then_the_docking_fails(pool: Scenario) -> None:
    mission, _ = commanded(pool)
    mission.dock(2, 7)
    said = [1.0] * mission.advance(1000).count(PermitSurfacing(7))
    for second in range(2, 120):
        said += [float(second)] * mission.advance(second * 1000).count(PermitSurfacing(7))
    # Every 10 s, six times in all, as the scenario says; then the mission gives it up.
    assert said == [1.0, 11.0, 21.0, 31.0, 41.0, 51.0]
    assert (mission.docking, mission.failure) == (
        Status.FAILED,
        "it does not answer the permission to surface",
    )
    (event,) = mission.events.take("docking")
    assert (event.at_s, event.agent, event.dock, event.status) == (61.0, 7, 3, Status.FAILED)


def test_one_that_comes_up_is_docked_and_one_that_does_not_is_given_up(pool: Scenario) -> None:
    mission, believed = commanded(pool)
    mission.dock(0, 7, Manoeuvre(0.2, 0.1))
    mission.advance(1000)
    believed.state = State.SURFACING
    assert mission.advance(50_000) == []
    believed.state = State.FLOATING
    (order,) = mission.advance(51_000)
    assert isinstance(order, CloseDock)
    assert (order.dock_index, order.agent_id, order.manoeuvre) == (0, 7, Manoeuvre(0.2, 0.1))
    mission.receive(DockChanged(52_000, 0, 7, True, ((0, 7),)), 52_000)
    mission.receive(PrimitiveSucceeded(52_000, order.command_id), 52_000)
    assert (mission.docking, mission.docks) == (Status.DONE, (7, None, None, None))
    late, stuck = commanded(pool)
    late.dock(0, 7)
    stuck.state = State.SURFACING
    late.advance(121_000)
    assert late.docking is Status.RUNNING
    late.advance(121_001)
    assert (late.docking, late.failure) == (Status.FAILED, "it does not come up")


def search(mission: ManualMission) -> GoTo:
    """A docking by hand that caught nothing: the go-to that its search orders."""
    (order,) = (order for order in mission.take_orders() if isinstance(order, CloseDock))
    orders = mission.receive(NothingCaught(1000, order.command_id), 1000)
    (go_to,) = (order for order in orders if isinstance(order, GoTo))
    assert mission.docking is Status.RUNNING
    return go_to


@pytest.mark.parametrize("stop", [ManualMission.hold, ManualMission.pause])
def test_a_person_ends_a_search_by_a_hold_or_a_pause(
    pool: Scenario, stop: Callable[[ManualMission], None]
) -> None:
    mission, believed = commanded(pool)
    believed.state = State.FLOATING
    mission.dock(0, 7)
    go_to = search(mission)
    stop(mission)
    assert any(isinstance(order, Hold) for order in mission.take_orders())
    assert mission.docking is Status.PREEMPTED
    mission.receive(PrimitiveFailed(1000, go_to.command_id, PRE_EMPTED), 1000)
    assert not any(isinstance(order, GoTo | CloseDock) for order in mission.advance(2000))


def test_a_search_by_hand_ends_with_the_docking(pool: Scenario) -> None:
    mission, believed = commanded(pool)
    believed.state = State.FLOATING
    mission.dock(0, 7)
    go_to = search(mission)
    (again,) = mission.receive(PrimitiveSucceeded(3000, go_to.command_id), 3000)
    assert isinstance(again, CloseDock)
    mission.receive(PrimitiveSucceeded(18_000, again.command_id), 18_000)
    assert mission.docking is Status.DONE


def test_a_pause_is_no_part_of_the_time_that_an_amussel_has_to_come_up(pool: Scenario) -> None:
    mission, _ = commanded(pool)
    mission.dock(2, 7)
    mission.advance(1000)
    mission.advance(5000)
    mission.pause()
    mission.advance(5000)
    assert mission.advance(500_000) == []
    mission.resume()
    # Of the ten seconds until the next permission four were over.
    assert PermitSurfacing(7) not in mission.advance(505_999)
    assert PermitSurfacing(7) in mission.advance(506_000)


def test_what_is_heard_of_an_older_go_to_changes_nothing(pool: Scenario) -> None:
    mission, _ = commanded(pool)
    mission.go_to(5.0, 0.0)
    first = next(it for it in mission.advance(1000) if isinstance(it, GoTo))
    mission.go_to(9.0, 0.0)
    second = next(it for it in mission.advance(1000) if isinstance(it, GoTo))
    mission.receive(PrimitiveFailed(1000, first.command_id, "pre-empted"), 1000)
    assert (mission.goto, mission.goto_orders) == (Status.RUNNING, 2)
    assert (mission.state.planned_m, mission.state.cost_m) == (9.0, 0.0)  # nothing was driven of the first
    mission.receive(PrimitiveFailed(2000, second.command_id, "stalled"), 2000)
    assert (mission.goto, mission.failure) == (Status.FAILED, "stalled")


def test_one_that_was_let_go_is_told_that_it_may_sink(pool: Scenario) -> None:
    mission, believed = commanded(pool)
    mission.receive(DockChanged(2000, 1, 7, True, ((1, 7),)), 2000)
    believed.state, believed.primary = State.CHARGING, 0.995
    mission.undock(1)
    order = next(it for it in mission.advance(3000) if isinstance(it, OpenDock))
    mission.receive(DockChanged(8000, 1, 7, False, ()), 8000)
    told = mission.receive(PrimitiveSucceeded(8000, order.command_id), 8000)
    assert told[0] == SendCommand(Kind.RELEASE, 7)
    assert [(it.kind, it.data) for it in told if isinstance(it, AMusselReleased)] == [
        ("released", {"agent": 7, "full": True})
    ]
    assert (mission.state.services, mission.docking) == (1, Status.DONE)


def test_events_are_told_once(pool: Scenario) -> None:
    mission, believed = commanded(pool)
    for second in range(2, 5):
        mission.advance(second * 1000)
    assert [(it.kind, it.agent) for it in mission.events.take()] == [("heard", 7), ("low", 7)]
    believed.primary = 0.9
    mission.advance(5000)
    assert mission.events.take() == []
    believed.primary, believed.state = 0.8, State.FLOATING
    mission.advance(6000)
    mission.advance(7000)
    assert [(it.at_s, it.kind, it.reason) for it in mission.events.take()] == [
        (6.0, "state", "FLOATING"),
        (6.0, "low", None),
    ]
    believed.state = State.SINKING
    mission.advance(8000)
    assert [it.kind for it in mission.events.take()] == ["state"]


def test_a_lost_one_is_not_docked(pool: Scenario) -> None:
    mission, _ = commanded(pool, State.LOST)
    with pytest.raises(Refused, match="aMussel 7 is lost"):
        mission.dock(0, 7)


def test_what_changes_nothing_says_so_and_an_id_left_out_is_asked_for(pool: Scenario) -> None:
    mission, _ = commanded(pool)
    assert mission.resume() is False
    mission.pause()
    assert mission.resume() is True
    with pytest.raises(Refused, match="aMussel 0 never reported: give the aMussel's id"):
        mission.dock(1, 0)

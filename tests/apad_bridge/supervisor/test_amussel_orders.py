"""A person's orders about single aMussels, through the socket of a run's directory."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flying import Flying
from scenario_files import SOUND_FILE

from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.supervisor.amussel_orders import AMusselAct, AMusselOrders, AMusselRequest
from apad_bridge.supervisor.control_protocol import Answer, ask
from apad_bridge.supervisor.control_server import control_offered
from apad_bridge.world.roster import AskedRequests, FaultRequest, Presences, Roster
from apad_bridge.world.world import World
from firmware_model.states import State


class Requests(AskedRequests):
    """The queue of a run without services."""

    def answer(self, request: Any, refusal: str | None) -> None:  # type: ignore[override]
        assert super().answer(request, refusal)


class FlyingWithRoster(Flying):
    """A flight three seconds after its begin, whose roster has requests of other threads."""

    def __init__(self, scenario: Scenario, *, real_hull: bool = False) -> None:
        self.requests = Requests()
        self.roster: Roster
        presences = Presences(scenario.fleet.ids, scenario.area.depth_m)

        def with_roster(context: Any) -> Any:
            fleet = context.world.fleet
            faults = flight_parts.fault_injection(flight_config(scenario), fleet, real_hull=real_hull)
            self.roster = Roster(presences, self.requests, fleet.coordinator, faults)
            return replace(context, world=World(fleet, faults, roster=self.roster))

        super().__init__(scenario, with_roster)
        self.seconds(3)

    @property
    def is_asked(self) -> bool:
        return super().is_asked or bool(self.requests._waiting)


@pytest.fixture
def flying(pool: Scenario, tmp_path: Path) -> Iterator[FlyingWithRoster]:
    flying = FlyingWithRoster(pool)
    orders = AMusselOrders(pool.fleet.ids, flying.roster)
    with control_offered(tmp_path, flying.calls, flying.gate, amussels=orders):
        yield flying


def asked(
    flying: FlyingWithRoster, run_dir: Path, act: AMusselAct, agent: int = 3, fault: TimedFault | None = None
) -> Answer:
    answer = flying.answered(lambda: ask(run_dir, AMusselRequest(act, "Anna", agent, fault)))
    assert isinstance(answer, Answer)
    return answer


def test_a_permission_reaches_the_amussel_and_is_noted(flying: FlyingWithRoster, tmp_path: Path) -> None:
    assert asked(flying, tmp_path, AMusselAct.PERMIT, 9).accepted
    flying.seconds(1)
    (order,) = flying.events("operator")
    assert (order["order"], order["agent"], order["by"]) == ("permit to surface", 9, "Anna")
    flying.until(lambda: flying.flight.supervisor.beliefs.get(9).state is State.SURFACING, 30)


def test_presence_and_faults_go_through_the_roster(flying: FlyingWithRoster, tmp_path: Path) -> None:
    assert asked(flying, tmp_path, AMusselAct.HAND_OVER) == Answer(True, "")
    assert [(it["id"], it["is"], it["by"]) for it in flying.events("presence")] == [(3, "real", "Anna")]
    refused = asked(flying, tmp_path, AMusselAct.FAULT, 3, TimedFault.BROWN_OUT)
    assert refused == Answer(False, "aMussel 3 is real: faults are for simulated ones")
    assert asked(flying, tmp_path, AMusselAct.FAULT, 4, TimedFault.BROWN_OUT) == Answer(True, "")
    assert [(it["id"], it["fault"]) for it in flying.events("fault")] == [(4, "brown_out")]
    not_docked = asked(flying, tmp_path, AMusselAct.FAULT, 4, TimedFault.COIL_SLIP)
    assert "in no dock" in not_docked.message and not not_docked.accepted


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (AMusselRequest(AMusselAct.PERMIT, "Anna", 99), "there is no aMussel 99 in this run"),
        (AMusselRequest(AMusselAct.PING, "Anna", 3), "there is nothing to ping by"),
        (AMusselRequest(AMusselAct.FAULT, "Anna", 3), "name the fault: brown_out, watchdog, killed"),
    ],
)
def test_what_cannot_be_is_refused(
    flying: FlyingWithRoster, tmp_path: Path, request_: AMusselRequest, why: str
) -> None:
    answer = flying.answered(lambda: ask(tmp_path, request_))
    assert not answer.accepted and why in answer.message
    assert flying.events("operator") == []


def test_no_fault_is_caused_where_a_real_hull_flies(pool: Scenario, tmp_path: Path) -> None:
    flying = FlyingWithRoster(pool, real_hull=True)
    orders = AMusselOrders(pool.fleet.ids, flying.roster)
    with control_offered(tmp_path, flying.calls, flying.gate, amussels=orders):
        answer = asked(flying, tmp_path, AMusselAct.FAULT, 3, TimedFault.WATCHDOG)
    assert answer == Answer(False, "a real aPad flies: faults are for runs with the simulated one")
    assert flying.events("fault") == []


def test_a_ping_brings_a_range() -> None:
    scenario = load(SOUND_FILE)
    flying = FlyingWithRoster(scenario)
    orders = AMusselOrders(scenario.fleet.ids, flying.roster, has_water=True)
    # Nothing is pinged by itself here within half a minute.
    flying.seconds(30)
    before = len(flying.events("range"))
    request = AMusselRequest(AMusselAct.PING, "Anna", 5)
    flying.answered(lambda: orders.carry_out(request, flying.calls))
    flying.until(lambda: any(it["id"] == 5 for it in flying.events("range")[before:]), 60)
    (ranged,) = (it for it in flying.events("range")[before:] if it["id"] == 5)
    assert 0 < ranged["range_m"] < 40


def test_a_flight_that_does_not_tick_answers_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("apad_bridge.world.roster.ANSWER_S", 0.05)
    requests = AskedRequests()
    assert requests.ask(FaultRequest(1, TimedFault.WATCHDOG)) == "the flight made no tick for 0.05 s"
    assert requests.take() == []


def test_each_caller_gets_its_own_answer() -> None:
    requests, answers = AskedRequests(), {}

    def caller(agent: int) -> None:
        answers[agent] = requests.ask(FaultRequest(agent, TimedFault.WATCHDOG))

    threads = [threading.Thread(target=caller, args=(n,)) for n in range(5)]
    for thread in threads:
        thread.start()
    told = 0
    while told < 5:
        for request in requests.take():
            assert requests.answer(request, f"no, {request.agent_id}")
            told += 1
    for thread in threads:
        thread.join()
    assert answers == {n: f"no, {n}" for n in range(5)}
    assert not requests.answer(FaultRequest(9, TimedFault.WATCHDOG), None)

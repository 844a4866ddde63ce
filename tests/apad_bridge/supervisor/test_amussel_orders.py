"""A person's orders about single aMussels, through the socket of a run's directory."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

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
from apad_bridge.world.roster import AskedRequests, FaultRequest, Presences, Roster, RosterRequest
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
    return flying.answered(lambda: ask(run_dir, AMusselRequest(act, "Anna", agent, fault)))


def test_a_permission_reaches_the_amussel_and_is_noted(flying: FlyingWithRoster, tmp_path: Path) -> None:
    assert asked(flying, tmp_path, AMusselAct.PERMIT, 9).accepted
    flying.seconds(1)
    (order,) = flying.events("operator")
    assert (order["order"], order["agent"], order["by"]) == ("permit to surface", 9, "Anna")
    flying.until(lambda: flying.flight.supervisor.beliefs.get(9).state is State.SURFACING, 30)


Row = tuple[AMusselAct, int, TimedFault | None, str]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        pytest.param(
            [
                (AMusselAct.HAND_OVER, 3, None, ""),
                (
                    AMusselAct.FAULT,
                    3,
                    TimedFault.BROWN_OUT,
                    "aMussel 3 is real: faults are for simulated ones",
                ),
                (AMusselAct.FAULT, 4, TimedFault.BROWN_OUT, ""),
                (AMusselAct.FAULT, 4, TimedFault.COIL_SLIP, "aMussel 4 is in no dock"),
            ],
            {"presence": (3, "real"), "fault": (4, "brown_out")},
            id="presence and faults go through the roster",
        ),
        pytest.param(
            [
                (AMusselAct.PERMIT, 99, None, "there is no aMussel 99 in this run"),
                (AMusselAct.PING, 3, None, "this scenario has no water: there is nothing to ping by"),
                (AMusselAct.FAULT, 3, None, "name the fault: brown_out, watchdog, killed"),
            ],
            {},
            id="what cannot be is refused",
        ),
    ],
)
def test_orders_are_carried_out_or_refused(
    flying: FlyingWithRoster, tmp_path: Path, rows: list[Row], told: dict[str, tuple[int, str]]
) -> None:
    for act, agent, fault, why_not in rows:
        answer = asked(flying, tmp_path, act, agent, fault)
        assert answer.message.startswith(why_not) and answer.accepted is (why_not == "")
    found = {
        kind: (it["id"], it.get("is") or it["fault"])
        for kind in ("presence", "fault")
        for it in flying.events(kind)
    }
    assert found == told and flying.events("operator") == []
    assert {it["by"] for it in flying.events("presence")} <= {"Anna"}


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


def test_what_a_long_tick_has_taken_up_is_answered_by_what_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    requests, taken = AskedRequests(), list[RosterRequest]()

    class Answered(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            """The flight takes the request during the first wait, and answers it during the second."""
            if taken:
                return requests.answer(taken[0], None)
            taken.extend(requests.take())
            return False

    monkeypatch.setattr("apad_bridge.world.roster.threading", Mock(Event=Answered))
    assert requests.ask(FaultRequest(1, TimedFault.WATCHDOG)) is None and taken


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

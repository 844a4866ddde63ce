"""Tests the API's calls in flights in memory: answers, orders, refusals, and the end of every wait."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.events.run import EndReason
from apad_bridge.mission.values import Refused, Status, dock_index_of, dock_of
from apad_bridge.runs.script_in_memory import ScriptFlight, fly_script
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api, Behaviour


def results_of(scenario: Scenario, script: Callable[[Api, list[Any]], object]) -> list[Any]:
    """The list that the script filled, in a flight without an error."""
    found: list[Any] = []
    flight = fly_script(scenario, lambda api: script(api, found))
    assert flight.error is None, flight.ended_by
    return found


def test_docks_count_from_1_in_the_api_and_from_0_on_the_wire() -> None:
    assert [dock_index_of(dock, 4) for dock in (1, 2, 3, 4)] == [0, 1, 2, 3]
    assert [dock_of(dock_index) for dock_index in range(4)] == [1, 2, 3, 4]
    for wrong in (0, 5, -1, True):
        with pytest.raises(Refused, match="the docks are 1 to 4"):
            dock_index_of(wrong, 4)


def test_who_there_is_and_where(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        api.sleep(5)
        agent, here = api.agent(3), api.get_location(api.id_self)
        found += [api.now(), api.agents(), api.battery(3) == agent.battery == api.belief(3).primary]
        found += [agent.state, agent.dock, agent.age_s, (here.north_m, here.east_m)]
        found += [api.home(3).north_m - agent.location.north_m, api.docks(), api.free_docks()]
        found += [
            api.beliefs()[3].agent_id,
            sorted(api.pool()) == [i for i in api.agents() if api.battery(i) <= 0.8],
        ]

    now, agents, same, state, dock, age, here, moved, docks, free, three, pool_is_low = results_of(
        pool, script
    )
    assert (now, agents, same, state, dock, age) == (5.0, list(range(1, 13)), True, "ACTIVE", None, 0.0)
    assert here == pytest.approx((14, 10.5))
    # It drifts by at most half a centimetre a second, and five seconds have passed.
    assert abs(moved) <= 0.025
    assert (docks, free) == ({1: None, 2: None, 3: None, 4: None}, [1, 2, 3, 4])
    assert (three, pool_is_low) == (3, True)


def test_the_apads_battery_falls_by_its_load(pool: Scenario) -> None:
    """250 Wh from full, at a constant 36 W and a hundred times less for thrust: 100 s take 1 Wh, that is 0.004."""
    battery = replace(pool.apad.battery, capacity_wh=250.0, hotel_w=36.0, start_fraction=1.0)

    def script(api: Api, found: list[Any]) -> None:
        found.append(api.battery(api.id_self))
        api.sleep(100)
        found.append(api.battery(api.id_self))

    before, after = results_of(replace(pool, apad=replace(pool.apad, battery=battery)), script)
    assert before == pytest.approx(1.0, abs=1e-3)
    assert before - after == pytest.approx(0.004, rel=0.1)


def test_a_go_to_runs_and_ends_and_another_pre_empts_it(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        found.append(api.goto_status())
        api.go_to_local(14.0, 15.5, speed=1.0, victory_radius=0.2)
        found.append(api.goto_status(api.id_self))
        found.append(api.wait_goto(timeout=2))
        found.append(api.wait_goto())
        found.append(abs(api.get_location(api.id_self).east_m - 15.5) <= 0.3)
        api.go_to_local(0.0, 0.0)
        api.sleep(2)
        api.go_to_local(14.0, 14.0)
        api.wait_goto()
        found.append([(it.kind, it.status) for it in api.events("goto")])
        found.append(api.cost())

    idle, running, early, late, near, events, cost = results_of(pool, script)
    assert (idle, running, early, late, near) == (0, 1, Status.RUNNING, Status.DONE, True)
    assert events == [("goto", Status.DONE), ("goto", Status.DONE)]
    assert cost > 5


@pytest.mark.parametrize(
    "as_point", [lambda it: [it.lat, it.lon], lambda it: it], ids=["degrees", "location"]
)
def test_a_go_to_by_degrees_or_to_a_location_is_the_same_place(pool: Scenario, as_point: Any) -> None:
    def script(api: Api, found: list[Any]) -> None:
        there = api.get_location(7)
        api.go_to(as_point(there))
        api.wait_goto()
        here = api.get_location(api.id_self)
        found.append(((here.north_m - there.north_m) ** 2 + (here.east_m - there.east_m) ** 2) ** 0.5)

    assert results_of(pool, script)[0] <= pool.mission.victory_radius_m


def test_collect_and_deploy_bring_one_up_and_home(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        home = api.home(5) if 5 in api.agents() else api.get_location(5)
        found.append(api.collect(5, 3))
        found.append((api.docks()[3], api.agent(5).dock))
        api.wait_until(lambda: api.agent(5).state == "CHARGING", timeout=30)
        found.append(api.agent(5).state)
        charge = api.battery(5)
        api.sleep(30)
        found.append(api.battery(5) > charge)
        found.append(api.deploy(5))
        found.append(api.docks()[3])
        found.append(api.wait_until(lambda: api.agent(5).state == "ACTIVE", timeout=30))
        there = api.get_location(5)
        found.append(abs(there.north_m - home.north_m) + abs(there.east_m - home.east_m) < 2)
        found.append([(it.kind, it.dock) for it in api.events(agent=5) if it.kind in ("docked", "undocked")])

    collected, docked, state, rose, let_go, free, sank, at_home, events = results_of(pool, script)
    assert (collected, docked, state, rose) == (True, (5, 3), "CHARGING", True)
    assert (let_go, free, sank, at_home) == (True, None, True, True)
    assert events == [("docked", 3), ("undocked", 3)]


def test_pausing_holds_and_resuming_goes_on(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        api.go_to_local(14.0, 20.5)
        api.sleep(4)
        api.pause()
        api.sleep(8)
        before = api.get_location(api.id_self)
        api.sleep(5)
        after = api.get_location(api.id_self)
        found.append(abs(after.east_m - before.east_m))
        found.append(after.east_m)
        found.append(api.goto_status())
        with pytest.raises(Refused, match="paused"):
            api.go_to_local(0, 0)
        api.resume()
        found.append(api.wait_goto())
        found.append(abs(api.get_location(api.id_self).east_m - 20.5))

    moved, paused_at, status, ended, missed = results_of(pool, script)
    assert (status, ended) == (Status.RUNNING, Status.DONE)
    assert moved < 0.05
    assert 11 < paused_at < 16
    assert missed <= 0.5


def test_a_held_place_is_held(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        api.go_to_local(14.0, 20.5)
        api.sleep(3)
        api.hold()
        found.append(api.wait_goto(5))
        api.sleep(10)
        first = api.get_location(api.id_self)
        api.sleep(10)
        found.append(abs(api.get_location(api.id_self).east_m - first.east_m))

    status, moved = results_of(pool, script)
    assert status is Status.PREEMPTED
    assert moved < 0.05


def test_abort_ends_the_flight_there(pool: Scenario) -> None:
    after: list[str] = []

    def script(api: Api) -> None:
        api.sleep(7)
        try:
            api.abort("seen enough")
        except Exception:
            after.append("swallowed")
        after.append("went on")

    flight = fly_script(pool, script)
    assert (flight.ended_by, flight.mission_s, after) == ("seen enough", 7.0, [])


def test_the_end_of_the_mission_s_time_ends_the_script(pool: Scenario) -> None:
    left: list[str] = []

    def script(api: Api) -> None:
        try:
            while True:
                api.sleep(500)
        finally:
            left.append("orderly")

    flight = fly_script(replace(pool, duration_s=60.0), script)
    assert (flight.ended_by, flight.mission_s, left) == ("mission time", 60.0, ["orderly"])


def test_events_are_waited_for_and_given_up(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        found.append(api.wait_event("heard", agent=4, timeout=20))
        found.append(api.wait_event("docked", timeout=3))
        found.append(api.now())
        api.events()
        api.permit_surfacing(4)
        event = api.wait_event("state", agent=4, timeout=60)
        found.append((event.reason, event.kind) if event else None)
        up = api.wait_until(lambda: api.agent(4).state == "FLOATING", timeout=60)
        api.tell_clear(4)
        found.append(up and api.wait_until(lambda: api.agent(4).state == "ACTIVE", timeout=60))

    heard, nothing, at_s, first, sank = results_of(pool, script)
    assert (heard.kind, heard.agent) == ("heard", 4)
    assert (nothing, at_s) == (None, heard.at_s + 3)
    assert first in (("SURFACING", "state"), ("FLOATING", "state"))
    assert sank is True


class Counting(Behaviour):
    def __init__(self, ticks: int) -> None:
        self.left = ticks
        self.heard: set[int] = set()
        self.began_s = -1.0

    def begin(self, api: Api) -> None:
        self.began_s = api.now()

    def tick(self, api: Api) -> bool:
        self.left -= 1
        return self.left == 0

    def event(self, api: Api, event: Any) -> None:
        if event.kind == "heard":
            self.heard.add(event.agent)


def test_a_behaviour_acts_once_a_second_until_it_is_done_or_late(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        quick, slow = Counting(5), Counting(500)
        found.append((api.run(quick), api.now() - quick.began_s, len(quick.heard)))
        found.append((api.run(slow, timeout=10), api.now() - slow.began_s))

    assert results_of(pool, script) == [(True, 4.0, 12), (False, 10.0)]


def test_plans_and_costs_are_the_mission_s(pool: Scenario) -> None:
    def script(api: Api, found: list[Any]) -> None:
        api.wait_until(lambda: len(api.pool()) >= 4, timeout=600)
        plan = api.plan_collection()
        worst = sorted(api.pool(), key=api.battery)[:4]
        found.append(([agent for agent, _ in plan.steps], worst, [dock for _, dock in plan.steps]))
        greedy = api.plan_collection(batch=2, strategy="greedy")
        found.append((len(greedy.steps), api.cost_of(greedy).distance_m, api.cost_of(plan).distance_m))
        found.append(api.plan_redeployment().steps)

    (agents, worst, docks), (count, short_m, long_m), nobody = results_of(pool, script)
    assert (agents, docks) == (worst, [1, 2, 3, 4])
    assert count == 2
    assert short_m < long_m
    assert nobody == ()


def test_a_dock_that_is_taken_is_refused(pool: Scenario) -> None:
    def script(api: Api) -> None:
        assert api.collect(10, 1)
        with pytest.raises(Refused, match="dock 1 holds aMussel 10"):
            api.docking(True, 1, 4)
        with pytest.raises(Refused, match="aMussel 10 is in dock 1 already"):
            api.docking(True, 2, 10)
        with pytest.raises(Refused, match="dock 1 holds aMussel 10, not 4"):
            api.docking(False, 1, 4)

    assert fly_script(pool, script).error is None


def failed(flight: ScriptFlight) -> str:
    assert flight.ended_by.startswith(f"{EndReason.SCRIPT_FAILED}: ")
    return flight.ended_by.removeprefix(f"{EndReason.SCRIPT_FAILED}: ")


def test_a_script_that_polls_without_letting_time_pass_is_told_so(pool: Scenario) -> None:
    def script(api: Api) -> None:
        api.go_to_local(0, 0)
        while api.goto_status() == 1:
            pass

    assert "put a time.sleep into the loop" in failed(fly_script(pool, script))


def test_an_error_is_one_line_that_names_the_script_s_own(pool: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "wrong.py"
    path.write_text("time.sleep(3)\n\ndef deep():\n    return api.battery(1) / 0\n\ndeep()\n")
    flight = fly_script(pool, path)
    assert failed(flight) == "wrong.py, line 4: ZeroDivisionError: float division by zero"
    assert flight.mission_s == 3.0


def test_time_is_mission_time_however_it_is_got(pool: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "clocks.py"
    path.write_text(
        "import time as again\nfrom time import sleep, strftime\n"
        "before = time.time(), again.monotonic(), time.perf_counter_ns()\nsleep(2.5)\nagain.sleep(1)\n"
        "print(before, again.time(), time.monotonic_ns(), callable(strftime), __name__)\n"
        "print('two', 'words', sep='-', end='!')\nprint('a\\nb')\nraise SystemExit\n"
    )
    flight = fly_script(pool, path)
    # A sleep ends at the first tick at or after its end.
    assert flight.said == ("(0.0, 0.0, 0) 4.0 4000000000 True __main__", "two-words!", "a", "b")
    assert (flight.ended_by, flight.mission_s) == (EndReason.SCRIPT_ENDED, 4.0)


def test_a_script_may_import_what_lies_beside_it(pool: Scenario, tmp_path: Path) -> None:
    (tmp_path / "my_routes_x17.py").write_text("ROUTE = [(14.0, 11.5)]\n")
    path = tmp_path / "route.py"
    path.write_text("from my_routes_x17 import ROUTE\napi.go_to_local(*ROUTE[0])\nprint(api.wait_goto())\n")
    assert fly_script(pool, path).said == (str(Status.DONE),)

"""Tests the API's calls in flights in memory: answers, orders, refusals, and the end of every wait."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.script_values import Refused, Status, dock_index_of, dock_of
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api, Behaviour


def flies(scenario: Scenario, script: Callable[[Api], object]) -> None:
    """A flight in which the script, with what it asserts, comes to its end without an error."""
    flight = fly_script(scenario, script)
    assert flight.error is None, flight.ended_by


def flown(script: Callable[[Api], object]) -> Callable[[Scenario], None]:
    """A test whose body is such a script of a flight in the pool."""
    return lambda pool: flies(pool, script)


def test_docks_count_from_1_in_the_api_and_from_0_on_the_wire() -> None:
    assert [(dock_index_of(dock, 4), dock_of(dock - 1)) for dock in (1, 2, 3, 4)] == [
        *enumerate((1, 2, 3, 4))
    ]
    for wrong in (0, 5, -1, True):
        with pytest.raises(Refused, match="the docks are 1 to 4"):
            dock_index_of(wrong, 4)


@flown
def test_who_there_is_and_where(api: Api) -> None:
    """It drifts by at most half a centimetre a second."""
    api.sleep(5)
    agent, here = api.agent(3), api.get_location(api.id_self)
    assert (api.now(), api.agents(), api.beliefs()[3].agent_id) == (5.0, list(range(1, 13)), 3)
    assert (agent.state, agent.dock, agent.age_s) == ("ACTIVE", None, 0.0)
    assert api.battery(3) == agent.battery == api.belief(3).primary
    assert (here.north_m, here.east_m) == pytest.approx((14, 10.5))
    assert abs(api.home(3).north_m - agent.location.north_m) <= 0.025
    assert (api.docks(), api.free_docks()) == (dict.fromkeys((1, 2, 3, 4)), [1, 2, 3, 4])
    assert sorted(api.pool()) == [i for i in api.agents() if api.battery(i) <= 0.8]


def test_the_apads_battery_falls_by_its_load(pool: Scenario) -> None:
    """250 Wh from full, at a constant 36 W and a hundred times less for thrust: 100 s take 1 Wh, that is 0.004."""
    battery = replace(pool.apad.battery, capacity_wh=250.0, hotel_w=36.0, start_fraction=1.0)

    def script(api: Api) -> None:
        before = api.battery(api.id_self)
        assert before == pytest.approx(1.0, abs=1e-3)
        api.sleep(100)
        assert before - api.battery(api.id_self) == pytest.approx(0.004, rel=0.1)

    flies(replace(pool, apad=replace(pool.apad, battery=battery)), script)


@pytest.mark.parametrize(
    "as_point", [lambda it: [it.lat, it.lon], lambda it: it], ids=["degrees", "location"]
)
def test_a_go_to_by_degrees_or_to_a_location_is_the_same_place(pool: Scenario, as_point: Any) -> None:
    def script(api: Api) -> None:
        there = api.get_location(7)
        api.go_to(as_point(there))
        api.wait_goto()
        here = api.get_location(api.id_self)
        away_m = math.dist((here.north_m, here.east_m), (there.north_m, there.east_m))
        assert away_m <= pool.mission.victory_radius_m

    flies(pool, script)


@flown
def test_collect_and_deploy_bring_one_up_and_home(api: Api) -> None:
    home = api.get_location(5)
    assert api.collect(5, 3) and (api.docks()[3], api.agent(5).dock) == (5, 3)
    assert api.wait_until(lambda: api.agent(5).state == "CHARGING", timeout=30)
    charge = api.battery(5)
    api.sleep(30)
    assert api.battery(5) > charge
    assert api.deploy(5) and api.docks()[3] is None
    assert api.wait_until(lambda: api.agent(5).state == "ACTIVE", timeout=30)
    there = api.get_location(5)
    assert abs(there.north_m - home.north_m) + abs(there.east_m - home.east_m) < 2
    events = [(it.kind, it.dock) for it in api.events(agent=5) if it.kind in ("docked", "undocked")]
    assert events == [("docked", 3), ("undocked", 3)]


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


@flown
def test_a_behaviour_acts_once_a_second_until_it_is_done_or_late(api: Api) -> None:
    quick, slow = Counting(5), Counting(500)
    assert (api.run(quick), api.now() - quick.began_s, len(quick.heard)) == (True, 4.0, 12)
    assert (api.run(slow, timeout=10), api.now() - slow.began_s) == (False, 10.0)


@flown
def test_plans_and_costs_are_the_mission_s(api: Api) -> None:
    api.wait_until(lambda: len(api.pool()) >= 4, timeout=600)
    plan = api.plan_collection()
    lowest = sorted(api.pool(), key=api.battery)[:4]
    assert list(plan.steps) == list(zip(lowest, (1, 2, 3, 4), strict=True))
    greedy = api.plan_collection(batch=2, strategy="greedy")
    assert len(greedy.steps) == 2 and api.cost_of(greedy).distance_m < api.cost_of(plan).distance_m
    assert api.plan_redeployment().steps == ()


# What a script calls, step by step, and what the API answers.

Call = Callable[[Api], Any]
do, HEARD, STILL = methodcaller, attrgetter("kind", "agent", "at_s"), pytest.approx(0.0, abs=0.05)


def calls(*each: Call) -> Call:
    """The last one's answer."""
    return lambda api: [it(api) for it in each][-1]


def is_in(state: str) -> Call:
    """aMussel 4 comes into this state within a minute."""
    return lambda api: api.wait_until(lambda: api.agent(4).state == state, timeout=60)


def east_m(api: Api) -> float:
    return api.get_location(api.id_self).east_m


def moved_m(seconds: float) -> Call:
    return lambda api: -east_m(api) + (api.sleep(seconds) or east_m(api))


SCENES: dict[str, list[tuple[Call, Any]]] = {
    "a go-to runs and ends, and another pre-empts it": [
        (do("goto_status"), 0),
        (do("go_to_local", 14.0, 15.5, speed=1.0, victory_radius=0.2), None),
        (do("goto_status", "apad1"), 1),
        (do("wait_goto", timeout=2), Status.RUNNING),
        (do("wait_goto"), Status.DONE),
        (east_m, pytest.approx(15.5, abs=0.3)),
        (calls(do("go_to_local", 0.0, 0.0), do("sleep", 2), do("go_to_local", 14.0, 14.0)), None),
        (do("wait_goto"), Status.DONE),
        (lambda api: [(it.kind, it.status) for it in api.events("goto")], [("goto", Status.DONE)] * 2),
        (lambda api: api.cost() > 5, True),
    ],
    "pausing holds, and resuming goes on": [
        (calls(do("go_to_local", 14.0, 20.5), do("sleep", 4), do("pause"), do("sleep", 8)), None),
        (moved_m(5), STILL),
        (east_m, pytest.approx(13.5, abs=2.5)),
        (do("goto_status"), Status.RUNNING),
        (
            do("go_to_local", 0, 0),
            "refused: the aPad was stopped: continue first, or resume where a script paused it",
        ),
        (calls(do("resume"), do("wait_goto")), Status.DONE),
        (east_m, pytest.approx(20.5, abs=0.5)),
    ],
    "a held place is held": [
        (calls(do("go_to_local", 14.0, 20.5), do("sleep", 3), do("hold")), None),
        (do("wait_goto", 5), Status.PREEMPTED),
        (calls(do("sleep", 10), moved_m(10)), STILL),
    ],
    "events are waited for and given up": [
        (lambda api: HEARD(api.wait_event("heard", agent=4, timeout=20)), ("heard", 4, 1.0)),
        (do("wait_event", "docked", timeout=3), None),
        (do("now"), 4.0),
        (calls(do("events"), do("permit_surfacing", 4)), None),
        (lambda api: api.wait_event("state", agent=4, timeout=60).reason, "SURFACING"),
        (is_in("FLOATING"), True),
        (calls(do("tell_clear", 4), is_in("ACTIVE")), True),
    ],
    "a dock that is taken is refused": [
        (do("collect", 10, 1), True),
        (do("docking", True, 1, 4), "refused: dock 1 holds aMussel 10"),
        (do("docking", True, 2, 10), "refused: aMussel 10 is in dock 1 already"),
        (do("docking", False, 1, 4), "refused: dock 1 holds aMussel 10, not 4"),
    ],
}


@pytest.mark.parametrize("steps", SCENES.values(), ids=SCENES)
def test_a_scene(pool: Scenario, steps: list[tuple[Call, Any]]) -> None:
    def script(api: Api) -> None:
        for call, expected in steps:
            try:
                found = call(api)
            except Refused as refused:
                found = f"refused: {refused}"
            assert found == expected

    flies(pool, script)


SCRIPTS = {
    "abort ends the flight there, whatever the script catches": (
        "time.sleep(7)\ntry:\n    api.abort('seen enough')\nexcept Exception:\n    print('swallowed')\nprint('went on')\n",
        "seen enough",
        7.0,
        (),
    ),
    "who polls without letting time pass is told so": (
        "api.go_to_local(0, 0)\nwhile api.goto_status() == 1:\n    pass\n",
        f"{EndReason.SCRIPT_FAILED}: .*put a time.sleep into the loop.*",
        0.0,
        (),
    ),
    "an error is one line that names the script's own": (
        "time.sleep(3)\n\ndef deep():\n    return api.battery(1) / 0\n\ndeep()\n",
        f"{EndReason.SCRIPT_FAILED}: mine.py, line 4: ZeroDivisionError: float division by zero",
        3.0,
        (),
    ),
    # A sleep ends at the first tick at or after its end.
    "time is mission time however it is got": (
        "import time as again\nfrom time import sleep, strftime\n"
        "before = time.time(), again.monotonic(), time.perf_counter_ns()\nsleep(2.5)\nagain.sleep(1)\n"
        "print(before, again.time(), time.monotonic_ns(), callable(strftime), __name__)\n"
        "print('two', 'words', sep='-', end='!')\nprint('a\\nb')\nraise SystemExit\n",
        EndReason.SCRIPT_ENDED,
        4.0,
        ("(0.0, 0.0, 0) 4.0 4000000000 True __main__", "two-words!", "a", "b"),
    ),
    "it may import what lies beside it": (
        "from my_routes_x17 import ROUTE\napi.go_to_local(*ROUTE[0])\nprint(api.wait_goto())\n",
        EndReason.SCRIPT_ENDED,
        3.0,
        (str(Status.DONE),),
    ),
}
"""A script's text, the end of its flight, the mission time of that in s, and what the script said."""


@pytest.mark.parametrize(("text", "ended", "mission_s", "said"), SCRIPTS.values(), ids=SCRIPTS)
def test_a_file_is_flown_as_a_script(
    pool: Scenario, tmp_path: Path, text: str, ended: str, mission_s: float, said: tuple[str, ...]
) -> None:
    (tmp_path / "my_routes_x17.py").write_text("ROUTE = [(14.0, 11.5)]\n")
    (tmp_path / "mine.py").write_text(text)
    flight = fly_script(pool, tmp_path / "mine.py")
    assert re.fullmatch(ended, flight.ended_by)
    assert (flight.mission_s, flight.said) == (mission_s, said)

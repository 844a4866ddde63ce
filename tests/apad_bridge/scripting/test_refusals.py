"""Tests that the API refuses impossible calls and wrong arguments in one line, and that the script may go on."""

from collections.abc import Callable

import numpy as np
import pytest

from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.script_values import Refused
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from tests.apad_bridge.scripting.test_api import flown


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (lambda api: api.battery(99), "aMussel 99 is not of this scenario; there are 1 to 12"),
        (lambda api: api.get_location("apad9"), "'apad9' is not this aPad, which is called 'apad1'"),
        (lambda api: api.goto_status("apad9"), "'apad9' is not this aPad"),
        (lambda api: api.go_to([14.0, 10.5]), "go_to takes .*degrees, go_to_local metres"),
        (lambda api: api.go_to_local(1e6, 0), "go_to_local metres"),
        (lambda api: api.go_to_local(1, 1, speed=0), "speed and victory radius must be above 0"),
        (lambda api: api.go_to_local(1, float("nan")), "the goal lies nan m"),
        (lambda api: api.docking(True, 5, 3), "there is no dock 5: the docks are 1 to 4"),
        (lambda api: api.docking(True, 1), "needs the aMussel's id"),
        (lambda api: api.docking(True, 1, 7), "aMussel 7 is believed .* m away: go there first"),
        (lambda api: api.docking(False, 2), "dock 2 is empty"),
        (lambda api: api.deploy(3), "aMussel 3 is in no dock"),
        (
            lambda api: api._do(lambda mission: mission.go_to(4.8e6, 0.0)),
            "4800000 m from the scenario's origin",
        ),
        (lambda api: api.hold([0, 0]), "m from the scenario's origin"),
        (lambda api: api.home(99), "never reported from the water"),
        (lambda api: api.sleep(float("nan")) or api.wait_until(lambda: True, -1), "cannot be waited for"),
        (lambda api: api.plan_collection(batch=0), "a batch of 0"),
        (lambda api: api.plan_collection(strategy="lazy"), "unknown strategy 'lazy'"),
        (
            lambda api: api.wait_event("dockd", timeout=5),
            "no events 'dockd': the kinds are goto, docking, docked",
        ),
        (lambda api: api.events("foo"), "no events 'foo'"),
        (lambda api: api.go_to_local(1, 1, speed=50), "speed of 50 m/s: apad.max_speed_m_s is 1 m/s"),
        (lambda api: api.sleep(-1), "a time of -1 s cannot be waited for"),
        (lambda api: api.collect(4, 5), "there is no dock 5"),
        (lambda api: api.go_to(5), r"go_to: point must be \[latitude, longitude\] in degrees, not 5"),
        (lambda api: api.go_to([1, 2, 3]), "go_to: point must be"),
        (lambda api: api.go_to_local("north", 1), "go_to_local: north_m must be a valid number, not 'north'"),
        (lambda api: api.go_to_local(1, 1, speed="fast"), "speed must be a valid number, not 'fast'"),
        (lambda api: api.hold("here"), "hold: point must be"),
        (lambda api: api.hold([1, "x"]), "hold: point must be"),
        (lambda api: api.battery(True), "battery: id must be a valid integer or a valid string, not True"),
        (
            lambda api: api.battery("3"),
            "'3' is not this aPad, which is called 'apad1', and no aMussel's number",
        ),
        (
            lambda api: api.agent(api.id_self),
            r"not 'apad1': battery\(id_self\), get_location\(id_self\), docks\(\) and cost\(\) tell of the aPad",
        ),
        (lambda api: api.battery(3, 4), "battery: argument 2: Unexpected positional argument"),
        (lambda api: api.docking(2, 1, 3), "docking: dock must be a valid boolean"),
        (lambda api: api.docking(True), "docking: number: Missing required argument"),
        (lambda api: api.docking(True, 1, 3, yaw_rate="slow"), "yaw_rate must be a valid number"),
        (lambda api: api.tell_clear("x"), "tell_clear: id must be a valid integer, not 'x'"),
        (lambda api: api.collect(4, 1, timeout="x"), "timeout must be a valid number"),
        (lambda api: api.get_location(None), "id must be a valid integer or a valid string, not None"),
        (lambda api: api.sleep("x"), "sleep: seconds must be a valid number, not 'x'"),
        (lambda api: api.wait_until(True, 5), "wait_until: condition must be callable, not True"),
        (lambda api: api.say(5), "say: text must be a valid string, not 5"),
        (lambda api: api.note("seen", t=5), "the journal has fields of these names itself: t"),
        (lambda api: api.note("seen", what=5, at_ms=5), "names itself: at_ms, what"),
        (
            lambda api: api.note("seen", litres=float("nan")),
            "only plain data can be written into the journal",
        ),
        (lambda api: api.note("seen", it=object()), "only plain data can be written into the journal"),
        (lambda api: api.run(5), "run: behaviour must be an instance of Behaviour, not 5"),
        (lambda api: api.cost_of(5), "cost_of: plan must be an instance of Plan, not 5"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(
    pool: Scenario, script: Callable[[Api], object], message: str
) -> None:
    def caught(api: Api) -> None:
        with pytest.raises(Refused, match=rf"\A.*{message}.*\Z"):  # which a second line would not match
            script(api)

    assert fly_script(pool, caught).end_reason is EndReason.SCRIPT_ENDED


@flown
def test_numbers_of_numpy_are_numbers_and_arrays_are_points(api: Api) -> None:
    assert api.battery(np.int64(3)) == api.battery(3)
    api.go_to(np.array([43.9331, 15.4444]))
    api.go_to_local(np.float32(1), 2)
    with pytest.raises(Refused, match="dock 1 is empty"):
        api.docking(np.bool_(False), 1)


def test_a_call_that_does_not_exist_is_answered_with_the_nearest_and_the_page(pool: Scenario) -> None:
    flight = fly_script(pool, lambda api: api.goto([45.0, 14.0]))  # type: ignore[attr-defined]
    assert flight.end_reason is EndReason.SCRIPT_FAILED
    assert flight.ended_by.endswith(
        "AttributeError: there is no api.goto: did you mean api.go_to? docs/reference/api.md has every call"
    )

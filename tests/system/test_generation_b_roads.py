"""Every road to the simulated aPad of generation B, over real TCPROS: services, simple services, the action below."""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack
from typing import Any

import pytest
from programs import done, with_helpers
from scenario_files import write_scenario

from apad_bridge.ros.simulated_node.apad_process import start_apad_node
from apad_bridge.ros.system.master import end_process, loopback_environment, start_master

pytestmark = pytest.mark.system
DRIFT_M_S = (0.05, -0.1)
RUNNING, PREEMPTED, DONE = "1", "2", "3"
"""Of `goto_status` and `docking_status`."""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What `order_by_every_road` heard."""
    folder = tmp_path_factory.mktemp("roads")
    scenario = write_scenario(folder / "roads.yaml", apad={"generation": "b", "drift_m_s": list(DRIFT_M_S)})
    with ExitStack() as stack:
        master = start_master(folder / "ros", timeout_s=120, orphan_s=60)
        stack.callback(master.stop)
        stack.callback(end_process, start_apad_node(scenario, master.uri, folder / "apad.log"))
        command = (sys.executable, "-m", "tests.system.order_by_every_road", scenario)
        said = done(*command, env=with_helpers(loopback_environment(folder / "ros", master.uri))).stdout
    return {"start_m": [14, 10.5], **json.loads(said.splitlines()[-1])}


def test_a_goal_of_the_action_goes_there_and_says_so_by_action_and_topics(told: Any) -> None:
    north_m, east_m = told["start_m"]
    action = told["action"]
    assert action["state"] == "SUCCEEDED"
    assert action["said"][-2:] == [RUNNING, DONE] and action["events"] == ["/PRIMITIVE_FINISHED"]
    there_m = action["place_m"]
    assert there_m[1] == pytest.approx(east_m, abs=0.1)
    assert (
        action["distance_m"] == pytest.approx(north_m + 3 - there_m[0], abs=1e-3)
        and action["distance_m"] < 0.5
    )
    # It begins at 1 s, and a word of what is left comes ten times a second until the end.
    assert len(action["feedback"]) == pytest.approx(10 * (action["stamp_s"] - 1), abs=1)
    distances_m = [distance_m for distance_m, _ in action["feedback"]]
    assert distances_m == sorted(distances_m, reverse=True) and distances_m[0] == pytest.approx(3, abs=0.05)


def test_whatever_ends_leaves_the_controllers_off(told: Any) -> None:
    for drifted_m in (told["action"]["drifted_m"], told["cancelled_drifted_m"]):
        # Ten seconds; a little of its own way north may be left.
        assert drifted_m[1] == pytest.approx(10 * DRIFT_M_S[1], abs=0.05)
        assert drifted_m[0] >= 10 * DRIFT_M_S[0] - 0.01
    assert told["cancelled"] == "PREEMPTED" and told["cancelled_said"][-2:] == [RUNNING, PREEMPTED]


def test_whatever_is_ordered_pre_empts_the_goal_under_way(told: Any) -> None:
    roads = ("by_simple", "by_action", "by_positioning", "by_docking")
    assert [told[it] for it in roads] == ["PREEMPTED"] * 4


def test_the_simple_go_to_ends_within_a_metre_and_a_half(told: Any) -> None:
    _, east_m = told["start_m"]
    assert told["simple_taken"] and told["simple_said"][-4:] == [RUNNING, PREEMPTED, RUNNING, DONE]
    # Controllers off since, and the water took it on: 1.5 m short of the place, and what it drifted in less than 30 s.
    assert abs(told["simple_place_m"][1] - (east_m + 6)) < 1.5 + 30 * abs(DRIFT_M_S[1])


def test_a_go_to_by_service_is_a_goal_of_the_commanders_own(told: Any) -> None:
    ((key, state),) = told["commanders"]
    assert key.startswith("/apad1/commander-") and state == 3  # SUCCEEDED


def test_a_docking_by_the_simple_service_reaches_the_amussel_that_floats_there(told: Any) -> None:
    assert told["docking_taken"] and told["docking_said"][-2:] == [RUNNING, DONE]
    assert told["docks"] == [["DockClosed", 0, 7], ["DockOpened", 0, 7]]


def test_a_mission_that_holds_lets_anothers_go_to_end_and_then_takes_the_apad_back(told: Any) -> None:
    holding = told["holding"]
    assert holding["state"] == "SUCCEEDED" and holding["distance_m"] < 0.5
    assert holding["came_back_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert "goto_status: another client sent the aPad away from its hold" in holding["dropped"]
    assert "the aPad did not hold its position, and got the hold again" in holding["dropped"]

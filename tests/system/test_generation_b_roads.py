"""Every road to the simulated aPad of generation B, over real TCPROS: services, simple services, the action below."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from graphs import somebodys_graph
from programs import done, with_helpers
from scenario_files import write_scenario

pytestmark = pytest.mark.system


def test_each_road_leads_there_says_so_and_pre_empts_the_goal_under_way(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "roads.yaml", apad={"generation": "b", "start_m": [14, 10.5]})
    with somebodys_graph(scenario, tmp_path, 5) as graph:
        words = ("-m", "tests.system.order_by_every_road", 14, 10.5)
        told = json.loads(done(sys.executable, *words, env=with_helpers(graph)).stdout.splitlines()[-1])
    assert told["by action"] == "SUCCEEDED" and told["distance_m"] < 0.5
    assert told["events"] == ["/PRIMITIVE_FINISHED"] and told["taken"] == [True, True]
    # A word of what is left comes ten times a second: 2.5 m at half a metre a second.
    assert told["feedback_m"] == sorted(told["feedback_m"], reverse=True)
    assert told["feedback_m"][0] == pytest.approx(3, abs=0.2) and len(told["feedback_m"]) > 40
    assert {it for name, it in told.items() if name.startswith("then")} == {"PREEMPTED"}
    assert told["cancelled"] == "PREEMPTED"
    # A go-to by service is a goal of the commander's own.
    ((key, state),) = told["commanders"]
    assert key.startswith("/apad1/commander-") and state == 3  # SUCCEEDED

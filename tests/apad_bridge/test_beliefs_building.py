from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs_building import fleet_beliefs, knowledge_of
from apad_bridge.building import agent_ids
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.believing import Beliefs, Estimator, TwinModel
from apad_bridge.scenario.loader import load

POOL = load(Path(__file__).parents[2] / "launch_scripts/scenarios/pool-12.yaml")
MODEL = TwinModel(
    drain_deviation=0.01,
    sensor_noise=0.002,
    bias_deviation=0.0005,
    unscheduled=0.001,
    fix_deviation_m=0.05,
)
WITH_TWINS = replace(POOL, beliefs=Beliefs(estimator=Estimator.TWIN, twin=MODEL))


def test_the_shipped_scenarios_hold_the_last_packet() -> None:
    assert isinstance(fleet_beliefs(POOL, agent_ids(POOL)), HoldLast)


def test_a_twin_is_told_the_worst_cases_equations() -> None:
    knowledge = knowledge_of(WITH_TWINS, MODEL)
    assert set(knowledge.drain.per_min[:5]) == {0.0010427134} and knowledge.drain.per_min[5] == 0.0
    assert knowledge.charger.segments == ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
    assert knowledge.water.step_variance_m2 == pytest.approx(0.005**2 / 3)
    assert knowledge.sensor.apart_ms == 600_000  # 20 s of mission time at theta 30


@pytest.mark.parametrize("settings", [{"estimator": "twin"}, {"twin": MODEL}])
def test_a_twin_and_its_model_come_together(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="twin"):
        Beliefs(**settings)  # type: ignore[arg-type]


def test_a_mission_flies_on_twins_through_silence() -> None:
    """Seven minutes of which the last three are silent: the twins say when those in the docks are full."""
    flight, recorder = open_flight(replace(WITH_TWINS, duration_s=420.0))
    receive = flight.supervisor.receive
    flight.supervisor.receive = (  # type: ignore[method-assign]
        lambda fact: None if type(fact).__name__ == "WifiHeard" and fact.at_ms > 240_000 else receive(fact)
    )
    flight.run()
    beliefs = flight.supervisor.beliefs.all()
    assert len(beliefs) == 12 and all(belief.silent_slots >= 170 for belief in beliefs)
    assert len({belief.at_ms for belief in beliefs}) == 1
    released = {data["agent"]: at_ms for at_ms, kind, data in recorder.events if kind == "released"}
    assert len(released) == 4 and min(released.values()) > 240_000

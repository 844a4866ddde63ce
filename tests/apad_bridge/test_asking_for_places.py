"""A mission on twins that pings whom it may have to look for, as its places grow uncertain: a flight in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve

TWIN = {
    "drain_deviation": 0.1,
    "sensor_noise": 0.015,
    "bias_deviation": 0.02,
    "unscheduled": 0.03,
    "fix_deviation_m": 2.0,
}


def scenario(**talk: float) -> dict[str, Any]:
    """Half an hour of the pool by sound, on batteries low enough that all have to be fetched some time."""
    data = resolve(load(Path(__file__).parents[2] / "launch_scripts/scenarios/sound-12.yaml"))
    data.update(name="asking", duration_s=900)
    data["fleet"].update(count=4, start={"charge": [0.55, 0.62]})
    data["mission"]["batch"] = 4
    data["beliefs"] = {"estimator": "twin", "twin": TWIN}
    data["water"]["localisation"] = {}
    data["water"]["talk"].update(talk)
    return dict(data)


def ranges(data: dict[str, Any]) -> list[int]:
    flight, recorder = open_flight(from_data(data, "asking"))
    flight.run()
    return [event["id"] for _, kind, event in recorder.events if kind == "range"]


def test_whom_it_may_have_to_look_for_is_pinged_and_nobody_without_need() -> None:
    assert ranges(scenario()) == []
    asked = ranges(scenario(ping_worth_m=1.0))
    assert asked and set(asked) <= {1, 2, 3, 4}
    assert len(ranges(scenario(ping_worth_m=50.0))) == 0  # no place is so uncertain


def test_it_takes_beliefs_that_know_how_sure_they_are() -> None:
    data = scenario(ping_worth_m=1.0)
    data["beliefs"] = {"estimator": "hold_last"}
    with pytest.raises(ScenarioError, match=r"water\.talk\.ping_worth_m.*estimator: twin"):
        from_data(data, "asking")

"""Beliefs that are carried past their last packet, on ROS's standard messages."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from sensor_msgs.msg import BatteryState

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import Mode
from apad_bridge.mission.state import MissionState
from apad_bridge.ros.fleet_diagnostics import Limits, diagnose
from apad_bridge.ros.standard_messages import agent_battery
from firmware_model.states import State


def carried(mode: Mode, charge: float) -> Belief:
    """Heard awake on the bottom a second after the start, and not since."""
    probabilities = tuple(float(one is mode) for one in Mode)
    cov = (0.01, 0.0, 0.0)
    return Belief(
        7, 1000, State.ACTIVE, charge, 1.0, 0.0, 0.0, 299_000, cov, mode_probabilities=probabilities
    )


@pytest.mark.parametrize(
    ("mode", "status"),
    [
        (Mode.ASLEEP, BatteryState.POWER_SUPPLY_STATUS_DISCHARGING),
        (Mode.CHARGING_PRIMARY, BatteryState.POWER_SUPPLY_STATUS_CHARGING),
        (Mode.FULL, BatteryState.POWER_SUPPLY_STATUS_FULL),
    ],
)
def test_a_battery_is_what_is_believed_now(mode: Mode, status: int) -> None:
    message = agent_battery(carried(mode, 0.6), "bay/amussel3/base_link")
    assert message.power_supply_status == status
    assert (message.header.stamp.to_sec(), message.percentage) == (300.0, 0.6)
    assert message.header.frame_id == "bay/amussel3/base_link"


def test_diagnostics_name_the_silent_and_how_sure_one_is() -> None:
    supervisor = SimpleNamespace(
        beliefs=SimpleNamespace(all=lambda: [carried(Mode.ASLEEP, 0.6)]),
        battery=None,
        pose=None,
        primitive="none",
        port=SimpleNamespace(first_failure=None),
        dropped={},
        mission=SimpleNamespace(state=MissionState(), slots=(None,) * 4),
    )
    array = diagnose(supervisor, (7, 8), Limits(silence_s=120.0, pool_threshold=0.5), 300_000)  # type: ignore[arg-type]
    told = {status.name: status for status in array.status}
    silent = told["musselbed: aMussel 7"]
    assert silent.message == "silent for 299 s"
    values = {value.key.replace(" ", "_"): value.value for value in silent.values}
    assert values["mode"] == "ASLEEP" and values["primary_95"] == "0.404 to 0.796"
    assert told["musselbed: aMussel 8"].message == "never heard"
    assert {"musselbed: aPad", "musselbed: mission"} <= told.keys()
    # One of several on a master names its own, or their lines would take turns under one name.
    array = diagnose(supervisor, (), Limits(120.0, 0.5), 300_000, "apad2")  # type: ignore[arg-type]
    assert {status.name for status in array.status} == {"musselbed: aPad apad2", "musselbed: mission apad2"}
    # And so does one of several namespaces.
    array = diagnose(supervisor, (7,), Limits(120.0, 0.5), 300_000, namespace="lab/basin")  # type: ignore[arg-type]
    assert "lab/basin/musselbed: aMussel 7" in {status.name for status in array.status}

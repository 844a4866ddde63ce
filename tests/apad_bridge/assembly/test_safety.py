"""The guards that a scenario states."""

from dataclasses import replace

import pytest
from stack_benches import GUARDS, scenario

from apad_bridge.assembly.safety import safety_of
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.commands import CloseDock, PoseReported


@pytest.mark.parametrize(("adrift_s", "room"), [(None, "9.8"), (27.0, "9.8"), (51.0, "14.6"), (0.0, "4.4")])
def test_a_visual_docking_has_room_for_the_time_without_thrust(adrift_s: float | None, room: str) -> None:
    """0.2 m/s of drift for that time, 2 m of search and 2.4 m of pulling back."""
    plain = scenario(Generation.B, guards=replace(GUARDS, adrift_s=adrift_s))
    docking = replace(plain.mission.docking, visual_ids=(7,))
    safety = safety_of(replace(plain, mission=replace(plain.mission, docking=docking)))
    safety.gate.observe([PoseReported(0, 30.0, 4.0, 0.0, 0)])
    refusal = safety.gate.refusal(CloseDock(1, 0, 7), 0)
    assert refusal is not None and f"the least is {room} m" in refusal.reason

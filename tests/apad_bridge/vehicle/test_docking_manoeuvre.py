"""A docking's own yaw rate and surge speed, from the order through the port to generation B's order."""

import pytest
from scenario_files import POOL_FILE

from apad_bridge.scenario.blocks.mission_options import Servo
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, CloseDock, DockClosed, Manoeuvre, OpenDock
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.generation_b.messages import DockingOrder
from apad_bridge.vehicle.generation_b.primitives import ServoTask

SERVO = Servo(
    search_yaw_rate_rad_s=0.3, max_yaw_rate_rad_s=0.4, max_surge_m_s=0.25, surge_stdev=0.2, search_s=100.0
)
DOCKING = load(POOL_FILE).mission.docking


@pytest.mark.parametrize(
    ("manoeuvre", "yaw_rate", "surge"),
    [
        (DEFAULT_MANOEUVRE, 0.4, 0.25),
        (Manoeuvre(yaw_rate_rad_s=0.1), 0.1, 0.25),
        (Manoeuvre(surge_m_s=0.05), 0.4, 0.05),
    ],
)
def test_what_is_not_said_is_the_scenario_s(manoeuvre: Manoeuvre, yaw_rate: float, surge: float) -> None:
    for command in (CloseDock(1, 2, 7, manoeuvre), OpenDock(1, 2, 7, manoeuvre)):
        order = ServoTask(command, SERVO, None, None, 0).first_order
        assert isinstance(order, DockingOrder)
        assert (order.search_yaw_rate_rad_s, order.max_yaw_rate_rad_s, order.max_surge_m_s) == (
            0.3,
            yaw_rate,
            surge,
        )


def test_the_port_hands_it_on() -> None:
    port, slow = DockingPort(DOCKING), Manoeuvre(0.1, 0.05)
    port.receive(CloseDock(1, 2, 7, slow), 0)
    closing = [it for it in port.advance(15_000) if isinstance(it, CloseDock)]
    assert [it.manoeuvre for it in closing] == [slow]
    port.receive(DockClosed(15_000, 2, 7), 15_000)
    port.receive(OpenDock(2, 2, 7, slow), 16_000)
    opening = [it for it in port.advance(21_000) if isinstance(it, OpenDock)]
    assert [it.manoeuvre for it in opening] == [slow]

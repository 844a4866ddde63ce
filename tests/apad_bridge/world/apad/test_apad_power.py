"""The battery against sums worked by hand, the empty battery, and the table of docks."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.scenario.schema import Home
from apad_bridge.vehicle.commands import (
    BatteryReported,
    CloseDock,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoTo,
    Hold,
    OpenDock,
    PoseReported,
)
from apad_bridge.world.apad.simulated_apad import SimulatedAPad

FULL_J = 230 * 3600


@pytest.fixture
def apad(config) -> SimulatedAPad:
    return SimulatedAPad(config)


def failures(facts):
    return [(it.at_ms, it.command_id, it.reason) for it in facts if isinstance(it, CommandFailed)]


FIGURES = {
    "used_j": lambda apad, _: apad.battery.used_fraction * FULL_J,
    "fraction": lambda apad, _: apad.battery.fraction,
    "voltage": lambda apad, _: apad.battery.voltage_v,
    "ledger_j": lambda apad, _: [
        3600 * it for it in (apad.battery.ledger.handed_wh, apad.battery.ledger.hotel_wh)
    ],
    "travel_j": lambda apad, _: 3600 * apad.battery.ledger.travel_wh,
    "ledger_share": lambda apad, _: apad.battery.ledger.used_wh / (apad.battery.used_fraction * 230),
    "docked": lambda apad, _: dict(apad.docked),
    "docks_at": lambda apad, _: [apad.dock_position(dock_index) for dock_index in range(4)],
    "facts": lambda _, facts: facts,
    "failed": lambda _, facts: failures(facts),
    "reports": lambda _, facts: [it.at_ms for it in facts if isinstance(it, BatteryReported)],
}
CLOSES = (0, CloseDock(1, 2, 9), {})
CLOSED_FOR_100_S = [(1234, CloseDock(1, 2, 9), {}), (101_235, OpenDock(2, 2, 9), {})]
BATTERIES = {
    "the hotel load alone": (1.0, [], 2400, 0, 25 * 2400),
    "a closed dock, to the millisecond": (1.0, CLOSED_FOR_100_S, 200, 10 * 100.001, 25 * 200),
    "not full at the start": (0.5, [CLOSES], 300, 10 * 300, 25 * 300),
    "until it is empty": (0.01, [CLOSES], 3600, 0.01 * FULL_J * 10 / 35, 0.01 * FULL_J * 25 / 35),
}
"""The charge at the start, orders, seconds, and what docks and hotel load take: 10 W of each closed dock, and 25 W."""
SMALL = {"capacity_wh": 0.1}
"""360 J, which last 14.4 s at 25 W; at rest the aPad notices it at the next report."""
LATER = list(range(1000, 20_001, 1000))
SCENES = {
    **{
        f"the battery and its ledger: {name}": (
            {"start_fraction": start},
            [
                *orders,
                (
                    1000 * seconds,
                    None,
                    {
                        "used_j": pytest.approx(hotel_j + docks_j, rel=1e-9),
                        "fraction": pytest.approx(start - (hotel_j + docks_j) / FULL_J, abs=1e-9),
                        "voltage": pytest.approx(16.0 - 5.5 * (1 - start + (hotel_j + docks_j) / FULL_J)),
                        "ledger_j": pytest.approx([docks_j, hotel_j], rel=1e-3, abs=1e-6),
                        "travel_j": pytest.approx(0, abs=1e-6),
                    },
                ),
            ],
        )
        for name, (start, orders, seconds, docks_j, hotel_j) in BATTERIES.items()
    },
    # 50 m against 40 * 0.5^2 N, by four thrusters at 6 W for each newton.
    "the ledger has a row for travel": (
        {},
        [
            (0, GoTo(2, 50.0, 0.0, 0.5, 0.5), {}),
            (
                300_000,
                None,
                {"travel_j": pytest.approx(8485, rel=0.03), "ledger_share": pytest.approx(1, rel=1e-12)},
            ),
        ],
    ),
    "an empty battery ends a hold": (
        SMALL,
        [
            (0, Hold(1, 0.0, 0.0), {"reports": [0]}),
            (20_000, None, {"failed": [(15_000, 1, "the aPad's battery is empty")], "reports": LATER}),
        ],
    ),
    "an empty battery ends no go-to that has ended": (
        SMALL,
        [
            (0, GoTo(1, 0.0, 0.0, 0.5, 0.5), {"reports": [0]}),
            (20_000, None, {"failed": [], "reports": LATER}),
        ],
    ),
    "docks close and open at once": (
        {},
        [
            (10, None, {}),
            (11, CloseDock(1, 3, 7), {"facts": [DockClosed(11, 3, 7)], "docked": {3: 7}}),
            (12, OpenDock(2, 3, 7), {"facts": [DockOpened(12, 3, 7)], "docked": {}}),
        ],
    ),
    "docks follow the vehicle and do not turn with it": (
        {},
        [
            (0, GoTo(1, 0.0, 5.0, 0.5, 0.5), {}),
            (60_000, None, {"docks_at": [(-0.1, 4.9), (-0.1, 5.1), (0.1, 4.9), (0.1, 5.1)]}),
        ],
    ),
}
"""How its battery differs, and orders or looks with their times and the figures then."""


@pytest.mark.parametrize(("battery", "steps"), SCENES.values(), ids=SCENES)
def test_scene(config, battery, steps):
    apad = SimulatedAPad(replace(config, battery=replace(config.battery, **battery)))
    for at_ms, order, wanted in steps:
        facts = apad.advance(at_ms) if order is None else apad.receive(order, at_ms)
        assert {name: FIGURES[name](apad, facts) for name in wanted} == wanted, at_ms


def test_the_charger_at_home_feeds_an_apad_that_rests_there_and_no_other(config):
    home = Home(charging_w=125.0, go_at=0.2)
    half = replace(config, battery=replace(config.battery, start_fraction=0.5), home=home)
    at_home, elsewhere = SimulatedAPad(half), SimulatedAPad(half, home_m=(30.0, 0.0))
    for apad, watts in ((at_home, 125 - 25), (elsewhere, -25)):
        apad.advance(360_000)
        assert apad.battery.fraction == pytest.approx(0.5 + watts * 360 / FULL_J, rel=1e-12)
    assert at_home.battery.ledger.used_wh == pytest.approx(25 * 0.1)
    elsewhere.receive(GoTo(1, 30.0, 0.0, 0.5, 0.5), 360_000)
    elsewhere.advance(500_000)
    before = elsewhere.battery.fraction
    elsewhere.advance(860_000)
    assert elsewhere.battery.fraction == pytest.approx(before + (125 - 25) * 360 / FULL_J, rel=1e-9)
    at_home.advance(36_000_000)
    assert at_home.battery.fraction == 1.0


@pytest.mark.parametrize("goal_m", [(50.0, 0.0), (0.0, 50.0), (-30.0, 40.0)])
def test_cruising_draws_the_thrust_that_drag_asks_for(apad, goal_m):
    apad.receive(GoTo(1, *goal_m, 0.5, 0.5), 0)
    apad.advance(30_000)
    assert apad.motion.forces_n == pytest.approx((3.535534,) * 4)
    power_w, before = 25 + 6 * 4 * 3.535534, apad.battery.used_fraction
    assert apad.battery.power_w == pytest.approx(power_w)
    apad.advance(40_000)
    assert apad.battery.used_fraction - before == pytest.approx(10 * power_w / FULL_J)


def test_an_empty_battery_stops_thrusters_and_mechanisms_and_says_so(small_battery):
    apad = SimulatedAPad(small_battery)
    apad.receive(CloseDock(1, 0, 5), 0)
    facts = apad.receive(GoTo(2, 100.0, 0.0, 0.5, 0.5), 0) + apad.advance(120_000)
    [(failed_ms, command_id, reason)] = failures(facts)
    assert command_id == 2 and "battery" in reason
    battery = apad.battery
    assert (battery.fraction, battery.voltage_v, apad.motion.forces_n) == (0.0, 10.5, (0.0,) * 4)
    # it coasted to a stop; the dock stays closed, and every command fails
    places = {fact.at_ms: fact.north_m for fact in facts if isinstance(fact, PoseReported)}
    assert max(places.values()) == places[max(places)] > places[failed_ms]
    assert (apad.pose.speed_m_s, dict(apad.docked)) == (0.0, {0: 5})
    commands = OpenDock(3, 0, 5), CloseDock(4, 1, 6), Hold(5, 0.0, 0.0), GoTo(6, 0.0, 0.0, 0.5, 0.5)
    told = [failure for command in commands for failure in failures(apad.receive(command, 120_000))]
    assert [command_id for _, command_id, _ in told] == [3, 4, 5, 6]
    assert len([fact for fact in apad.advance(123_000) if isinstance(fact, BatteryReported)]) == 3


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (CloseDock(9, 0, 8), "holds aMussel 7"),
        (CloseDock(9, 1, 7), "another dock"),
        (CloseDock(9, 4, 8), "no dock 5"),
        (OpenDock(9, 1, 7), "empty"),
        (OpenDock(9, 0, 8), "holds aMussel 7"),
        (OpenDock(9, -1, 7), "no dock 0"),
    ],
)
def test_what_a_dock_refuses(apad, command, word):
    apad.receive(CloseDock(1, 0, 7), 10)
    [fact] = apad.receive(command, 20)
    assert (type(fact), fact.command_id, dict(apad.docked)) == (
        CommandFailed,
        9,
        {0: 7},
    ) and word in fact.reason

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


def driven(config, *orders, until_ms):
    """The aPad after these orders, each with its time, and all that it reported."""
    apad = SimulatedAPad(config)
    facts = [fact for at_ms, order in orders for fact in apad.receive(order, at_ms)]
    return apad, facts + apad.advance(until_ms)


@pytest.mark.parametrize(
    ("start", "orders", "seconds", "docks_j"),
    [
        pytest.param(1.0, [], 2400, 0, id="the hotel load alone"),
        pytest.param(
            1.0,
            [(1234, CloseDock(1, 2, 9)), (101_235, OpenDock(2, 2, 9))],
            200,
            10 * 100.001,
            id="a closed dock, to the millisecond",
        ),
        pytest.param(0.5, [(0, CloseDock(1, 2, 9))], 300, 10 * 300, id="not full at the start"),
        pytest.param(0.01, [(0, CloseDock(1, 2, 9))], 3600, 0.01 * FULL_J * 10 / 35, id="until it is empty"),
    ],
)
def test_the_battery_and_its_ledger(config, start, orders, seconds, docks_j):
    """25 W of hotel load, and 10 W of each closed dock."""
    config = replace(config, battery=replace(config.battery, start_fraction=start))
    apad, _ = driven(config, *orders, until_ms=1000 * seconds)
    hotel_j = docks_j * 25 / 10 if start == 0.01 else 25 * seconds
    used, ledger = (hotel_j + docks_j) / FULL_J, apad.battery.ledger
    assert apad.battery.used_fraction == pytest.approx(used, rel=1e-9)
    assert apad.battery.fraction == pytest.approx(start - used, abs=1e-9)
    assert apad.battery.voltage_v == pytest.approx(16.0 - 5.5 * (1 - start + used))
    found = [it * 3600 for it in (ledger.handed_wh, ledger.hotel_wh, ledger.travel_wh)]
    assert found == pytest.approx([docks_j, hotel_j, 0.0], rel=1e-3, abs=1e-6)


def test_the_ledger_has_a_row_for_travel(config):
    apad, _ = driven(config, (0, GoTo(2, 50.0, 0.0, 0.5, 0.5)), until_ms=300_000)
    assert apad.battery.ledger.travel_wh > 0
    assert apad.battery.ledger.used_wh == pytest.approx(apad.battery.used_fraction * 230, rel=1e-12)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        # 360 J at 25 W last 14.4 s; at rest the aPad notices it at the next report.
        pytest.param(
            Hold(1, 0.0, 0.0),
            [CommandFailed(15_000, 1, "the aPad's battery is empty")],
            id="a hold fails too",
        ),
        pytest.param(GoTo(1, 0.0, 0.0, 0.5, 0.5), [], id="a go-to that has ended does not"),
    ],
)
def test_what_an_empty_battery_ends(small_battery, order, expected):
    _, facts = driven(small_battery, (0, order), until_ms=20_000)
    assert [fact for fact in facts if isinstance(fact, CommandFailed)] == expected
    told = [fact.at_ms for fact in facts if isinstance(fact, BatteryReported)]
    assert told == list(range(0, 20_001, 1000))


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
    [failure] = [fact for fact in facts if isinstance(fact, CommandFailed)]
    assert failure.command_id == 2 and "battery" in failure.reason
    battery = apad.battery
    assert (battery.fraction, battery.voltage_v, apad.motion.forces_n) == (0.0, 10.5, (0.0,) * 4)
    # it coasted to a stop; the dock stays closed, and every command fails
    places = {fact.at_ms: fact.north_m for fact in facts if isinstance(fact, PoseReported)}
    assert max(places.values()) == places[max(places)] > places[failure.at_ms]
    assert (apad.pose.speed_m_s, dict(apad.docked)) == (0.0, {0: 5})
    commands = OpenDock(3, 0, 5), CloseDock(4, 1, 6), Hold(5, 0.0, 0.0), GoTo(6, 0.0, 0.0, 0.5, 0.5)
    told = [fact for command in commands for fact in apad.receive(command, 120_000)]
    assert [(type(it), it.command_id) for it in told] == [(CommandFailed, n) for n in (3, 4, 5, 6)]
    assert len([fact for fact in apad.advance(123_000) if isinstance(fact, BatteryReported)]) == 3


def test_docks_close_and_open_at_once(apad):
    apad.advance(10)
    closed, held = apad.receive(CloseDock(1, 3, 7), 11), dict(apad.docked)
    assert (closed, held) == ([DockClosed(11, 3, 7)], {3: 7})
    assert (apad.receive(OpenDock(2, 3, 7), 12), dict(apad.docked)) == ([DockOpened(12, 3, 7)], {})


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


def test_docks_follow_the_vehicle_and_do_not_turn_with_it(apad):
    apad.receive(GoTo(1, 0.0, 5.0, 0.5, 0.5), 0)
    apad.advance(60_000)
    assert [apad.dock_position(dock_index) for dock_index in range(4)] == [
        (-0.1, 4.9),
        (-0.1, 5.1),
        (0.1, 4.9),
        (0.1, 5.1),
    ]

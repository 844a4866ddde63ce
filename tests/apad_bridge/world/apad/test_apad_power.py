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


def test_the_hotel_load_alone(apad):
    apad.advance(2_400_000)
    assert apad.battery.used_fraction == pytest.approx(25 * 2400 / FULL_J, rel=1e-12)
    assert apad.battery.voltage_v == pytest.approx(16.0 - 5.5 * 25 * 2400 / FULL_J)


def test_a_closed_dock_draws_its_charging_power_to_the_millisecond(apad):
    apad.receive(CloseDock(1, 2, 9), 1234)
    apad.receive(OpenDock(2, 2, 9), 101_235)
    apad.advance(200_000)
    assert apad.battery.used_fraction == pytest.approx((25 * 200 + 10 * 100.001) / FULL_J, rel=1e-12)


def test_the_ledger_has_a_row_for_docks_for_the_hotel_load_and_for_travel(apad):
    apad.receive(CloseDock(1, 2, 9), 0)
    apad.receive(GoTo(2, 50.0, 0.0, 0.5, 0.5), 0)
    apad.advance(300_000)
    ledger = apad.battery.ledger
    assert ledger.handed_wh == pytest.approx(10 * 300 / 3600, rel=1e-12)
    assert ledger.hotel_wh == pytest.approx(25 * 300 / 3600, rel=1e-12) and ledger.travel_wh > 0
    assert ledger.used_wh == pytest.approx(apad.battery.used_fraction * 230, rel=1e-12)


def test_the_ledger_of_an_empty_battery_is_what_was_in_it(config):
    battery = replace(config.battery, start_fraction=0.01)
    apad = SimulatedAPad(replace(config, battery=battery))
    apad.receive(CloseDock(1, 2, 9), 0)
    apad.advance(3_600_000)
    ledger = apad.battery.ledger
    assert ledger.used_wh == pytest.approx(2.3, rel=1e-9) and ledger.travel_wh == pytest.approx(0, abs=1e-9)
    assert ledger.handed_wh / ledger.hotel_wh == pytest.approx(10 / 25, rel=1e-3)


def test_the_charger_at_home_feeds_an_apad_that_rests_there_and_no_other(config):
    home = Home(charging_w=125.0, go_at=0.2)
    half = replace(config, battery=replace(config.battery, start_fraction=0.5), home=home)
    at_home, elsewhere = SimulatedAPad(half), SimulatedAPad(half, home_m=(30.0, 0.0))
    for apad in (at_home, elsewhere):
        apad.advance(360_000)
    assert at_home.battery.fraction == pytest.approx(0.5 + (125 - 25) * 360 / FULL_J, rel=1e-12)
    assert elsewhere.battery.fraction == pytest.approx(0.5 - 25 * 360 / FULL_J, rel=1e-12)
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
    assert apad.battery.power_w == pytest.approx(25 + 6 * 4 * 3.535534)
    before = apad.battery.used_fraction
    apad.advance(40_000)
    assert apad.battery.used_fraction - before == pytest.approx(10 * (25 + 84.852814) / FULL_J)


def test_a_battery_that_is_not_full_at_the_start(config):
    apad = SimulatedAPad(replace(config, battery=replace(config.battery, start_fraction=0.5)))
    assert apad.battery.voltage_v == pytest.approx(13.25)
    apad.advance(1_000_000)
    assert apad.battery.fraction == pytest.approx(0.5 - 25_000 / FULL_J)
    assert apad.battery.used_fraction == pytest.approx(25_000 / FULL_J)


def test_battery_reports_come_every_second(config):
    reports = [fact for fact in SimulatedAPad(config).advance(3999) if isinstance(fact, BatteryReported)]
    assert [report.at_ms for report in reports] == [0, 1000, 2000, 3000]
    assert reports[0] == BatteryReported(0, 16.0, 1.0)


def test_an_empty_battery_stops_thrusters_and_mechanisms_and_says_so(small_battery):
    apad = SimulatedAPad(small_battery)
    apad.receive(CloseDock(1, 0, 5), 0)
    facts = apad.receive(GoTo(2, 100.0, 0.0, 0.5, 0.5), 0) + apad.advance(120_000)
    failures = [fact for fact in facts if isinstance(fact, CommandFailed)]
    assert [failure.command_id for failure in failures] == [2]
    assert "battery" in failures[0].reason
    assert (apad.battery.fraction, apad.battery.voltage_v) == (0.0, 10.5)
    assert apad.motion.forces_n == (0.0, 0.0, 0.0, 0.0)
    # it coasted to a stop; the dock stays closed, and every command fails
    stopped = [fact for fact in facts if isinstance(fact, PoseReported)]
    assert stopped[-1].north_m > next(p.north_m for p in stopped if p.at_ms == failures[0].at_ms)
    assert (apad.pose.speed_m_s, dict(apad.docked)) == (0.0, {0: 5})
    for command in (OpenDock(3, 0, 5), CloseDock(4, 1, 6), Hold(5, 0.0, 0.0), GoTo(6, 0.0, 0.0, 0.5, 0.5)):
        [fact] = apad.receive(command, 120_000)
        assert isinstance(fact, CommandFailed) and fact.command_id == command.command_id
    assert len([fact for fact in apad.advance(123_000) if isinstance(fact, BatteryReported)]) == 3


def test_a_hold_fails_too_when_the_battery_empties_and_a_finished_go_to_does_not(small_battery):
    holding = SimulatedAPad(small_battery)
    facts = holding.receive(Hold(1, 0.0, 0.0), 0) + holding.advance(20_000)
    # 360 J at 25 W last 14.4 s; at rest the aPad notices it at the next report
    assert [fact for fact in facts if isinstance(fact, CommandFailed)] == [
        CommandFailed(15_000, 1, "the aPad's battery is empty")
    ]
    arrived = SimulatedAPad(small_battery)
    facts = arrived.receive(GoTo(1, 0.0, 0.0, 0.5, 0.5), 0) + arrived.advance(20_000)
    assert not [fact for fact in facts if isinstance(fact, CommandFailed)]


def test_docks_close_and_open_at_once(apad):
    apad.advance(10)
    assert apad.receive(CloseDock(1, 3, 7), 11) == [DockClosed(11, 3, 7)]
    assert dict(apad.docked) == {3: 7}
    assert apad.receive(OpenDock(2, 3, 7), 12) == [DockOpened(12, 3, 7)]
    assert dict(apad.docked) == {}


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
    assert isinstance(fact, CommandFailed) and fact.command_id == 9
    assert word in fact.reason
    assert dict(apad.docked) == {0: 7}


def test_docks_follow_the_vehicle_and_do_not_turn_with_it(apad):
    apad.receive(GoTo(1, 0.0, 5.0, 0.5, 0.5), 0)
    apad.advance(60_000)
    assert [apad.dock_position(dock_index) for dock_index in range(4)] == [
        (-0.1, 4.9),
        (-0.1, 5.1),
        (0.1, 4.9),
        (0.1, 5.1),
    ]

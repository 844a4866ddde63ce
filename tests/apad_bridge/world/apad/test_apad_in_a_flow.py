"""The simulated aPad in current and wind, against forces and ways worked by hand.

Its hull: 25 kg, 40 N at 1 m/s in water, 0.08 N at 1 m/s in air, four thrusters of 30 N in X at 6 W for each newton.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agents.water.water_current import STILL, CurrentConfig, TideConstituent
from apad_bridge.scenario.hull_in_flow import (
    FlowNow,
    LegForecast,
    Surface,
    SurfaceFlow,
    Vector,
    free_drift_m_s,
    holding_effort,
    made_good_m_s,
    resistance_n,
)
from apad_bridge.scenario.schema import APad
from apad_bridge.scenario.water.currents import steady_text
from apad_bridge.vehicle.commands import Arrived, CloseDock, CommandFailed, GoTo, Hold
from apad_bridge.world.apad.dock_mechanisms import MISSED, Misses
from apad_bridge.world.apad.motion import Coast
from apad_bridge.world.apad.simulated_apad import SimulatedAPad

FULL_J = 230 * 3600
X = 2 * math.sqrt(2)
"""A force along the bow is the sum of four thrusts, each of this part of it."""


def current(north_m_s: float, east_m_s: float = 0.0, wind_m_s: Vector | None = None) -> Surface:
    return Surface(CurrentConfig(steady_text(north_m_s, east_m_s)).water_current(), wind_m_s)


def thrust_n(forces_n: tuple[float, ...]) -> float:
    one, other, _, _ = forces_n
    return math.hypot(one + other, one - other) * math.sqrt(2)


FIGURES: dict[str, Callable[[SimulatedAPad], Any]] = {
    "forces": lambda it: [abs(force_n) for force_n in it.motion.forces_n],
    "thrust_n": lambda it: thrust_n(it.motion.forces_n),
    "velocity": lambda it: (it.pose.north_m_s, it.pose.east_m_s),
    "place": lambda it: (it.pose.north_m, it.pose.east_m),
    "power_w": lambda it: it.battery.power_w,
    "used_j": lambda it: it.battery.used_fraction * FULL_J,
}
TIDE = Surface(CurrentConfig(tides=(TideConstituent(400, 400_000, 0),)).water_current())
STILL_THERE = {"place": (0.0, 0.0), "velocity": (0.0, 0.0)}
SCENES: dict[str, tuple[Surface, Any, dict[int, dict[str, Any]]]] = {
    # 40 * 0.2^2 = 1.6 N towards the south
    "holding takes the drag of the water that passes": (
        current(0.2),
        Hold(1, 0.0, 0.0),
        {
            120_000: {
                **STILL_THERE,
                "forces": pytest.approx([1.6 / X] * 4),
                "used_j": pytest.approx((25 + 6 * 4 * 1.6 / X) * 120),
            }
        },
    ),
    # 0.08 * 10^2 = 8 N towards the west: across the bow two thrusters push forwards and two backwards
    "holding takes the drag of the air": (
        Surface(STILL, (0.0, 10.0)),
        Hold(1, 0.0, 0.0),
        {
            120_000: {
                **STILL_THERE,
                "forces": pytest.approx([8 / X] * 4),
                "used_j": pytest.approx((25 + 6 * 4 * 8 / X) * 120),
            }
        },
    ),
    # along the bow four thrusters give 84.85 N, enough for 1.456 m/s through the water
    "beyond its thrust it drifts at full power": (
        current(1.5),
        Hold(1, 0.0, 0.0),
        {
            120_000: {
                "forces": pytest.approx([30.0] * 4),
                "velocity": (pytest.approx(1.5 - math.sqrt(4 * 30 / math.sqrt(2) / 40), abs=0.001), 0.0),
            }
        },
    ),
    **{
        f"going takes the drag through the water at the ordered speed over ground, in {current_m_s}": (
            current(*current_m_s),
            GoTo(1, 100.0, 0.0, 0.5, 0.5),
            {
                60_000: {
                    "velocity": pytest.approx((0.5, 0.0), abs=1e-9),
                    "place": (pytest.approx(30, abs=1), pytest.approx(0.0, abs=1e-6)),
                    "thrust_n": pytest.approx(force_n, abs=1e-6),
                }
            },
        )
        for current_m_s, force_n in (
            ((0.2, 0.0), 40 * 0.3**2),
            ((-0.2, 0.0), 40 * 0.7**2),
            ((0.0, 0.2), 40 * (0.5**2 + 0.2**2)),
            ((0.5, 0.0), 0.0),
        )
    },
    # 1.0 m/s through the water leave 0.4 over ground
    "against a strong current the top speed through the water is what counts": (
        current(-0.6),
        GoTo(1, 40.0, 0.0, 0.9, 0.5),
        {
            60_000: {"velocity": (pytest.approx(0.4), 0.0)},
            200_000: {"place": (40.0, 0.0), "velocity": (0.0, 0.0)},
        },
    ),
    "the flow of a tide is felt at rest within a second": (
        TIDE,
        None,
        {
            100_500: {"power_w": pytest.approx(25 + 6 * 4 * 40 * 0.4**2 / X)},
            200_500: {"power_w": pytest.approx(25, abs=1e-6), "place": (0.0, 0.0)},
        },
    ),
}
"""What moves around it, its order, and figures by times."""


@pytest.mark.parametrize(("surface", "order", "wanted"), SCENES.values(), ids=SCENES)
def test_scene(config: APad, surface: Surface, order: Any, wanted: dict[int, dict[str, Any]]) -> None:
    apad, arrived_ms = SimulatedAPad(config, surface=surface), []
    if order is not None:
        apad.receive(order, 0)
    for at_ms, figures in wanted.items():
        arrived_ms += [it.at_ms for it in apad.advance(at_ms) if isinstance(it, Arrived)]
        assert {name: FIGURES[name](apad) for name in figures} == figures, at_ms
    far = isinstance(order, GoTo) and order.north_m == 40.0
    assert arrived_ms == [pytest.approx(1000 * 39.5 / 0.4, rel=0.03)] * far


@pytest.mark.parametrize("north_m_s", [0.0, 0.2, -0.2, 0.45, -0.45, -0.7])
def test_a_planner_foretells_the_energy_and_the_time_that_a_leg_then_takes(
    config: APad, north_m_s: float
) -> None:
    """Half a kilometre to the north at 0.5 m/s, of which the start and the end take 200 J at most."""
    surface = current(north_m_s)
    apad = SimulatedAPad(config, surface=surface)
    apad.receive(GoTo(1, 500.0, 0.0, 0.5, 0.5), 0)
    ticks = (apad.advance(second * 1000) for second in range(1, 5000))
    (there,) = next(found for facts in ticks if (found := [it for it in facts if isinstance(it, Arrived)]))
    seconds = there.at_ms / 1000
    thrust_j = apad.battery.used_fraction * FULL_J - 25 * seconds
    ahead = FlowNow(config, surface, 0, 0.5)
    calm_j_per_m = 6 * 4 * (40 * 0.5**2) / X / 0.5
    assert ahead.seconds((0.0, 0.0), (500.0, 0.0)) == pytest.approx(seconds, rel=0.01)
    assert ahead.metres((0.0, 0.0), (500.0, 0.0)) * calm_j_per_m == pytest.approx(
        thrust_j, rel=0.03, abs=200.0
    )


def test_a_free_hull_slides_through_the_water_and_then_goes_with_it(config: APad) -> None:
    """Quadratic drag from v to w takes m/k ln(v/w) metres through the water."""
    apad = SimulatedAPad(config, surface=current(0.0, 0.3))
    apad.receive(GoTo(1, 100.0, 0.0, 0.4, 0.5), 0)
    apad.advance(30_000)
    begin = apad.pose
    apad.receive(Coast(), 30_000)
    apad.advance(330_000)
    slid_m = 25 / 40 * math.log(0.5 / 0.02)  # 0.4 over ground to the north is 0.5 through the water
    assert apad.pose.north_m - begin.north_m == pytest.approx(slid_m * 0.4 / 0.5, rel=0.05)
    assert apad.pose.east_m - begin.east_m == pytest.approx(300 * 0.3 - slid_m * 0.3 / 0.5, rel=0.002)
    still = apad.pose.north_m_s, apad.pose.east_m_s, *apad.motion.forces_n
    assert still == pytest.approx((0.0, 0.3, *[0.0] * 4), abs=1e-12)


@pytest.mark.parametrize("flow", [SurfaceFlow((0.2, -0.1), (3.0, 8.0)), SurfaceFlow((0.0, 0.0), (10.0, 0.0))])
def test_the_free_drift_is_the_velocity_at_which_water_and_air_push_alike(
    config: APad, flow: SurfaceFlow
) -> None:
    assert resistance_n(config, flow, free_drift_m_s(config, flow)) == pytest.approx((0.0, 0.0), abs=1e-12)
    # 4.3 % of the wind in still water; 3 % is the usual figure for what floats awash
    assert free_drift_m_s(config, SurfaceFlow((0.0, 0.0), (10.0, 0.0)))[0] == pytest.approx(0.428, abs=0.001)


@pytest.mark.parametrize(
    ("flow", "made_good"),
    [
        (SurfaceFlow((-0.6, 0.0)), 0.4),
        (SurfaceFlow((0.6, 0.0)), 1.6),
        (SurfaceFlow((0.0, 0.6)), 0.8),
        # 60 N in every direction, of which a wind of 25 m/s takes 50: sqrt(10 / 40) m/s are left
        (SurfaceFlow((0.0, 0.0), (0.0, 25.0)), 0.5),
    ],
)
def test_the_speed_made_good_is_that_of_the_triangle_of_velocities(
    config: APad, flow: SurfaceFlow, made_good: float
) -> None:
    assert made_good_m_s(config, flow, (1.0, 0.0)) == pytest.approx(made_good)
    assert made_good_m_s(config, SurfaceFlow((0.0, 1.1)), (1.0, 0.0)) <= 0.0


def test_a_leg_that_the_current_bars_anywhere_on_the_way_is_told_with_its_place(config: APad) -> None:
    field = "north_m,east_m,north_m_s,east_m_s\n" + "".join(
        f"{north},0,{-1.2 if north == 100 else 0},0\n" for north in (0, 50, 100, 150, 200)
    )
    legs, still = (
        LegForecast(config, Surface(CurrentConfig(field).water_current())),
        LegForecast(config, None),
    )
    told = legs.obstacle((0.0, 0.0), (200.0, 0.0), 0)
    assert told is not None and "a current of 1.20 m/s at (100, 0) m" in told and "1.00 m/s" in told
    # Not as far, with the current, and without one.
    others = (legs, 0.0, 50.0), (legs, 200.0, 0.0), (still, 0.0, 200.0)
    assert [it.obstacle((begin, 0.0), (end, 0.0), 0) for it, begin, end in others] == [None] * 3


def test_a_tide_bars_a_leg_for_a_part_of_the_day_alone(config: APad) -> None:
    tide = CurrentConfig(tides=(TideConstituent(43_200, -1_200_000, 0),))
    legs = LegForecast(config, Surface(tide.water_current()))
    barred = [legs.obstacle((0.0, 0.0), (20.0, 0.0), 3_600_000 * hour) is not None for hour in range(12)]
    # -1.2 sin(2 pi t / 12 h) is below -1 from 1.9 h to 4.1 h
    assert [hour for hour, it in enumerate(barred) if it] == [2, 3, 4]


@pytest.mark.parametrize(("north_m_s", "share"), [(0.0, 0.1), (0.5, 0.1 + 0.9 / 6), (1.3, 1.0)])
def test_dockings_miss_by_the_share_of_the_thrust_that_holding_takes(
    config: APad, north_m_s: float, share: float
) -> None:
    """40 * 0.5^2 = 10 N of 60 N; five standard deviations of the binomial of 2000 tries are 80."""
    surface = current(north_m_s)
    misses = Misses(7, 0.1, lambda place_m, at_ms: holding_effort(config, surface.flow(place_m, at_ms)))
    missed = 0
    for n in range(2000):
        fact = SimulatedAPad(config, misses, surface=surface).receive(CloseDock(n, 0, n + 1), 0)[-1]
        missed += isinstance(fact, CommandFailed) and fact.reason == MISSED
    assert missed == pytest.approx(2000 * share, abs=80 if share < 1 else 0)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=30)
@given(cuts_ms=st.lists(st.integers(0, 30_000), max_size=40))
def test_cutting_time_changes_nothing_in_a_flow(config: APad, cuts_ms: list[int]) -> None:
    tide = Surface(CurrentConfig(tides=(TideConstituent(60, 500_000, 300_000),)).water_current(), (4.0, -2.0))

    def trace(cuts_ms: list[int]) -> str:
        apad = SimulatedAPad(replace(config, thruster_max_n=8), surface=tide)
        facts = apad.receive(GoTo(1, 5.0, -3.0, 0.7, 0.3), 1234)
        for at_ms in sorted(it for it in cuts_ms if it >= 1234):
            facts += apad.advance(at_ms)
        facts += apad.receive(Coast(), 30_050) + apad.advance(40_000)
        return repr((facts, apad.pose, apad.battery.fraction, apad.motion.forces_n))

    assert trace(cuts_ms) == trace([])


def test_the_apad_aims_at_where_the_float_will_be(config: APad) -> None:
    """Of an aMussel abeam that floats with 0.3 m/s, at 0.5 m/s: the ways are 3, 4 and 5; a leg takes 2.5 s more."""
    legs = LegForecast(config, current(0.0, 0.3))
    met_m = legs.meeting_m((0.0, 0.0), (4.0, 0.0), 0.5, 0)
    assert met_m is not None and met_m[0] == 4.0
    takes_s = met_m[1] / 0.3
    assert math.hypot(*met_m) == pytest.approx(0.5 * (takes_s - 2.5))
    assert legs.bar_to_float((0.0, 0.0), (4.0, 0.0), 0.5, 0) is None
    # One that floats towards it is met at once; one that goes with 0.3 m/s before 0.2 m/s never is.
    assert legs.meeting_m((0.0, 0.0), (0.0, -30.0), 0.2, 0) is not None
    assert legs.meeting_m((0.0, 0.0), (0.0, 30.0), 0.2, 0) is None
    told = legs.bar_to_float((0.0, 0.0), (0.0, 30.0), 0.2, 0)
    assert told == "it would float away with 0.30 m/s, and the aPad goes after it with 0.20 m/s"
    assert LegForecast(config, None).meeting_m((0.0, 0.0), (4.0, 0.0), 0.5, 0) == (4.0, 0.0)

"""What is foretold of a flight, against what then happened."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import median

import pytest
from flying import Flying
from hypothesis import given
from hypothesis import strategies as st
from journals import facts_of

from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState, Phase
from apad_bridge.planning.dispatch_rule import Dispatch
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.runs.parent_protocol import from_line, to_line
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.forecast import Forecast, Forecaster
from firmware_model.states import State


@pytest.fixture(scope="module")
def foretold(pool: Scenario) -> tuple[Flying, list[tuple[float, Phase, Forecast]]]:
    return foretold_of(pool)


def foretold_of(pool: Scenario) -> tuple[Flying, list[tuple[float, Phase, Forecast]]]:
    """A whole flight, with the forecast of each tick."""
    flying = Flying(pool)
    forecaster = Forecaster(pool.mission, energy_model(pool), round(1000 * pool.duration_s))
    told = []
    while flying.now_ms < 0 or flying.phase is not Phase.ENDED:
        flying.now_ms += 1000
        flying.flight.tick(flying.now_ms)
        forecast = flying.flight.supervisor.forecast(forecaster, flying.now_ms)
        told.append((flying.now_ms / 1000, flying.phase, forecast))
    return flying, told


def happened(flying: Flying, kind: str, key: str, value: object) -> list[float]:
    """Mission seconds of these events."""
    return [
        at_ms / 1000 for at_ms, name, data in facts_of(flying.records) if name == kind and data[key] == value
    ]


def misses(told: list[tuple[float, float | None]], times_s: list[float]) -> list[float]:
    """How far each forecast lay from the next of the times, in seconds."""
    found = []
    for now_s, foretold_s in told:
        following = [it - now_s for it in times_s if it > now_s]
        if following and foretold_s is not None:
            found.append(foretold_s - following[0])
    return found


ON_THE_WAY, CHARGING = {Phase.GO_COLLECT, Phase.DOCK}, {Phase.CHARGE}
DOCKED, FULL = ("dock", "closed", True), ("plan", "what", "redeploy")


@pytest.mark.parametrize(
    ("dispatch", "phases", "figure", "event", "middle_s", "most_s"),
    [
        pytest.param(Dispatch.BATCH, ON_THE_WAY, "next_pickup_s", DOCKED, 5.0, 5.0, id="on the way"),
        pytest.param(Dispatch.BATCH, CHARGING, "next_pickup_s", DOCKED, 30.0, math.inf, id="minutes before"),
        pytest.param(Dispatch.BATCH, CHARGING, "batch_full_s", FULL, 30.0, 120.0, id="the full batch"),
        # A batch is not what it waits for: it collects one as soon as a dock is free.
        pytest.param(
            Dispatch.ASYNCHRONOUS, CHARGING, "next_pickup_s", DOCKED, 10.0, math.inf, id="one by one"
        ),
    ],
)
def test_what_comes_next_is_foretold(
    pool: Scenario,
    foretold: tuple[Flying, list[tuple[float, Phase, Forecast]]],
    dispatch: Dispatch,
    phases: set[Phase],
    figure: str,
    event: tuple[str, str, object],
    middle_s: float,
    most_s: float,
) -> None:
    own = replace(pool, mission=replace(pool.mission, dispatch=dispatch))
    flying, told = foretold if dispatch is pool.mission.dispatch else foretold_of(own)
    times_s = happened(flying, *event)
    found = misses([(t, getattr(it, figure)) for t, phase, it in told if phase in phases], times_s)
    assert len(found) > 300 and len(times_s) > 2
    assert median(map(abs, found)) < middle_s and max(map(abs, found)) < most_s


def test_the_end_and_the_battery_then_are_foretold(
    pool: Scenario, foretold: tuple[Flying, list[tuple[float, Phase, Forecast]]]
) -> None:
    flying, told = foretold
    battery = flying.flight.supervisor.battery
    half = [(t, it) for t, _, it in told if pool.duration_s / 2 < t < pool.duration_s]
    for now_s, forecast in half:
        assert forecast.mission_end_s == pytest.approx(pool.duration_s - now_s)
        assert forecast.apad_fraction_at_end == pytest.approx(battery.fraction, abs=0.02)
    assert told[-1][2] == Forecast()


def test_an_empty_battery_ends_the_mission_first(pool: Scenario) -> None:
    forecaster = Forecaster(pool.mission, energy_model(pool), 10_000_000)
    for now_s in range(601):
        forecaster.take(1000 * now_s, [], 1.0 - now_s / 1000)
        found = forecaster.look(1000 * now_s, MissionState(), (0.0, 0.0))
    spare = 0.4 - pool.mission.end_at_apad_fraction
    assert found.mission_end_s == pytest.approx(1000 * spare, rel=1e-6)
    assert found.apad_fraction_at_end == pytest.approx(pool.mission.end_at_apad_fraction)
    assert found.next_pickup_s is None  # nobody was heard


@given(
    charges=st.lists(st.floats(0.0, 1.0), min_size=0, max_size=8),
    rate=st.floats(-0.01, 0.01),
    phase=st.sampled_from([it for it in Phase if it is not Phase.ENDED]),
    planned=st.integers(0, 4),
    has_place=st.booleans(),
    fraction=st.one_of(st.none(), st.floats(0.0, 1.0)),
    left_s=st.integers(0, 3000),
)
def test_nothing_is_foretold_for_the_past_or_after_the_end(
    pool: Scenario,
    charges: list[float],
    rate: float,
    phase: Phase,
    planned: int,
    has_place: bool,
    fraction: float | None,
    left_s: int,
) -> None:
    forecaster = Forecaster(pool.mission, energy_model(pool), 1000 * (90 + left_s))
    kind = StepKind.DEPLOY if phase in (Phase.GO_DEPLOY, Phase.UNDOCK) else StepKind.COLLECT
    plan = tuple(Step(kind, n + 1, n) for n in range(planned))
    docked = tuple((n, n + 1) for n in range(planned)) if kind is StepKind.DEPLOY else ()
    state = MissionState(phase=phase, since_ms=60_000, plan=plan, docked=docked)
    for now_s in range(0, 91, 5):
        beliefs = [
            Belief(
                n + 1, 1000 * now_s, State.ACTIVE, min(1.0, max(0.0, it + rate * now_s)), 1.0, 5.0 * n, 3.0
            )
            for n, it in enumerate(charges)
        ]
        place = (1.0, 2.0) if has_place else None
        forecaster.take(1000 * now_s, beliefs, fraction)
        found = forecaster.look(1000 * now_s, state, place)
    end_s = found.mission_end_s
    assert end_s is not None and 0 <= end_s <= left_s
    for time_s in (found.next_pickup_s, found.batch_full_s):
        assert time_s is None or 0 <= time_s <= end_s
    assert found.apad_fraction_at_end is None or 0 <= found.apad_fraction_at_end <= 1
    assert all(it is None or math.isfinite(it) for it in (found.next_pickup_s, found.batch_full_s))


def test_the_forecast_crosses_to_the_parent_and_stands_beside_the_progress(
    capsys: pytest.CaptureFixture[str],
) -> None:
    forecast = Forecast(200.0, 725.0, 1860.0, 0.62)
    status = RunStatus(540_000, "dock", "dock", 12, 9, (7,), 3, 41.0, 0.9, 0.0, forecast)
    assert from_line(to_line(status)) == status
    with FlightProgress("pool", 2_400_000) as progress:
        progress.show_status(status.now_ms, lambda: status)
    shown = capsys.readouterr().err
    assert "next pick-up in 03:20, batch full in 12:05, end in 31:00 at 62 %" in shown
    with FlightProgress("pool", 2_400_000) as progress:
        progress.show_status(status.now_ms, lambda: replace(status, forecast=Forecast()))
    assert "pick-up" not in capsys.readouterr().err

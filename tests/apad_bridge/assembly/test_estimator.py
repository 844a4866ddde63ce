from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from journals import facts_of
from scenario_files import POOL_FILE, WHOLE_FILE

from agents.mussel.outputs import Truth
from apad_bridge.assembly.estimator import schedules
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.flight_parts import fleet_beliefs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.twin_parameters import TwinParameters
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.firmware_config import board_config
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from firmware_model.actions import SendStatus
from firmware_model.bench import Bench
from firmware_model.packets import Kind
from firmware_model.power.charge import FULL
from firmware_model.states import State

POOL = load(POOL_FILE)
MODEL = TwinModel(
    drain_deviation=0.01,
    sensor_noise=0.002,
    bias_deviation=0.0005,
    unscheduled=0.001,
    fix_deviation_m=0.05,
)
WHOLE = load(WHOLE_FILE)


def _metered() -> Scenario:
    data = resolve(WHOLE)
    data["board"]["whole"]["power"]["metering"] = {"profile": "table-one", "noise_mv": 0.0}
    return from_data(data, "metered")


METERED = _metered()
WITH_TWINS = replace(POOL, beliefs=Beliefs(estimator=EstimatorKind.TWIN, twin=MODEL))


def parameters_of(scenario: Scenario) -> TwinParameters:
    """The parameters of the scenario's twins, with this laboratory's model."""
    twin = flight_config(replace(scenario, beliefs=Beliefs(estimator=EstimatorKind.TWIN, twin=MODEL))).twin
    return twin.parameters


def test_the_shipped_scenarios_hold_the_last_packet() -> None:
    assert isinstance(fleet_beliefs(flight_config(POOL)), HoldLast)


def test_a_twin_is_told_the_worst_cases_equations() -> None:
    parameters = parameters_of(WITH_TWINS)
    assert set(parameters.drain.per_min[:5]) == {0.0010427134} and parameters.drain.per_min[5] == 0.0
    assert parameters.charger.segments == ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
    assert parameters.water.step_variance_m2 == pytest.approx(0.005**2 / 3)
    assert parameters.sensor.apart_ms == 600_000  # 20 s of mission time at theta 30


@pytest.mark.parametrize("settings", [{"estimator": "twin"}, {"twin": MODEL}])
def test_a_twin_and_its_model_come_together(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="twin"):
        Beliefs(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("timeslot", [0, 7, 59])
def test_a_sleeper_is_told_what_its_board_will_draw(timeslot: int) -> None:
    """Compares with the firmware itself, minute by minute through a night."""
    bench = Bench(replace(board_config(WHOLE.board), agent_id=1 + timeslot, slot=timeslot))
    bench.run(hours=1)
    began, began_ms = bench.primary_fraction, bench.now_ms
    first_id = WHOLE.fleet.first_id
    agent_id = first_id + timeslot
    fleet = range(first_id, first_id + 60)
    cycle = schedules(bench.config.whole, fleet, [agent_id])[agent_id].cycle
    for _ in range(6 * 60):
        bench.run(minutes=1)
        assert began - bench.primary_fraction == pytest.approx(cycle.spent(began_ms, bench.now_ms), abs=1e-5)


def test_a_twin_is_told_what_a_metered_board_reports() -> None:
    """Compares with the firmware on the bench: at each of its own reports, and where its host asks it for one."""
    offsets = parameters_of(METERED).sensor.offsets
    bench = Bench(replace(board_config(METERED.board), agent_id=1, slot=0), primary=0.6, secondary=0.5)
    seen = []

    def compare() -> None:
        seen.append(bench.state)
        readings = (it / FULL for it in bench.board.readings(bench.now_ms))
        charges = bench.primary_fraction, bench.secondary_fraction
        apart = [reading - charge for reading, charge in zip(readings, charges, strict=True)]
        # The monitor samples each 10 s.
        assert apart == pytest.approx(offsets[bench.state], abs=0.002), bench.state

    def run(minutes: int) -> None:
        for _ in range(minutes * 60):
            for _ in (it for it in bench.run(seconds=1) if isinstance(it, SendStatus)):
                compare()

    run(61)
    bench.command(Kind.PERMISSION)
    run(12)
    compare()
    bench.charge_pin_rises()
    run(110)
    compare()
    bench.charge_pin_falls()
    run(2)
    compare()
    bench.command(Kind.SINK)
    run(70)
    compare()
    asked = [State.FLOATING, State.CHARGING, State.RELEASED, State.SLEEPING]
    assert [it for it in seen if it in asked] == asked
    assert {State.TRANSMITTING, State.REPORTING} == {it for it in seen if it not in asked}
    # By hand: 24 of 600 mV of a charger; 950 mW of radios beside an idle board are 257 mA at 3.7 V, 25.7 mV across 0.1 ohm.
    assert offsets[State.CHARGING] == pytest.approx((0.04, 0.04))
    assert offsets[State.FLOATING] == pytest.approx((-0.0257 / 0.6, 0.0), abs=1e-4)
    assert offsets[State.TRANSMITTING][0] == 0.0 and State.EMPTY not in offsets
    assert parameters_of(METERED).sensor.saturates
    assert not parameters_of(WITH_TWINS).sensor.saturates


@pytest.mark.parametrize("scenario", ["WHOLE", "METERED"])
def test_twins_of_whole_boards_cover_what_is_so(scenario: str) -> None:
    """Flies until the first four were charged and released, with a laboratory's plausible figures of its boards."""
    flown = {"WHOLE": WHOLE, "METERED": METERED}[scenario]
    model = TwinModel(
        drain_deviation=0.05, sensor_noise=0.005, bias_deviation=0.02, unscheduled=0.01, fix_deviation_m=0.5
    )
    believed = Beliefs(estimator=EstimatorKind.TWIN, twin=model)
    flight, recorder = open_flight(replace(flown, beliefs=believed, duration_s=2400.0))
    rows: list[tuple[float, bool, bool]] = []
    water, newest, take = TruthExtrapolator(flown), {}, recorder.truths

    def truths(batch: list[Truth]) -> None:
        take(batch)
        newest.update((truth.agent_id, truth) for truth in batch)

    def tick(now_ms: int, beliefs: list[Belief], *_: object, **__: object) -> None:
        for belief in beliefs if now_ms % 10_000 == 0 else ():
            truth = water.sample(newest[belief.agent_id], flown.theta * now_ms)
            low, high = belief.charge_interval()
            rows.append((belief.primary - truth.primary, low <= truth.primary <= high, truth.docked))

    recorder.truths, recorder.tick = truths, tick  # type: ignore[method-assign, assignment]
    flight.run()
    errors, covered, docked = (np.array(column) for column in zip(*rows, strict=True))
    assert len(rows) > 2500 and docked.sum() > 100
    assert covered.mean() > 0.93
    assert abs(errors[docked].mean()) < 0.006 and np.sqrt((errors**2).mean()) < 0.008


def test_a_mission_flies_on_twins_through_silence() -> None:
    """Without packets in the last three of seven minutes, the twins predict when the docked aMussels are full."""
    flight, recorder = open_flight(replace(WITH_TWINS, duration_s=420.0))
    receive = flight.supervisor.receive
    flight.supervisor.receive = (  # type: ignore[method-assign]
        lambda fact: None if type(fact).__name__ == "AMusselHeard" and fact.at_ms > 240_000 else receive(fact)
    )
    flight.run()
    beliefs = flight.supervisor.beliefs.all()
    assert len(beliefs) == 12 and all(belief.silent_timeslots >= 170 for belief in beliefs)
    assert len({belief.at_ms for belief in beliefs}) == 1
    released = {data["agent"]: at_ms for at_ms, kind, data in facts_of(recorder) if kind == "released"}
    assert len(released) == 4 and min(released.values()) > 240_000

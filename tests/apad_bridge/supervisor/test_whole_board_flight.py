"""Fleets of whole boards in flight: the trace of one docking, and aMussels that run out of both batteries."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from journals import Witness, facts_of
from scenario_files import WHOLE_FILE

from agents.mussel.outputs import Truth
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import save_starts
from apad_bridge.scenario.starts_table import Start
from apad_bridge.supervisor.loop import Flight
from firmware_model.power.charge import FULL, grains
from firmware_model.states import State


def flown(
    scenario: Scenario, starts: tuple[Start, ...] | None = None, folder: Path | None = None
) -> tuple[Witness, Flight]:
    """A flight from the scenario's starts, or from these, by a file in the folder."""
    if starts is not None and folder is not None:
        save_starts(folder / "starts.csv", starts, scenario.area.origin)
        scenario = replace(scenario, fleet=replace(scenario.fleet, start=str(folder / "starts.csv")))
    flight, witness = open_flight(scenario, recorder_of=Witness)
    assert isinstance(witness, Witness)
    flight.run()
    return witness, flight


def states_of(witness: Witness, agent_id: int) -> list[Truth]:
    """The first truth of each state that the aMussel entered."""
    of_it = [truth for truth in witness.kept if truth.agent_id == agent_id]
    return of_it[:1] + [now for before, now in pairwise(of_it) if before.state is not now.state]


def said(witness: Witness, kind: str) -> list[dict[str, Any]]:
    return [data for _, it, data in facts_of(witness) if it == kind]


def changed(**changes: Any) -> Scenario:
    data = resolve(load(WHOLE_FILE))
    data.update({key: value for key, value in changes.items() if not isinstance(value, dict)})
    for key, value in changes.items():
        if isinstance(value, dict):
            data[key].update(value)
    return from_data(data, "changed")


def clock(agent_ms: int) -> str:
    seconds, ms = divmod(agent_ms, 1000)
    return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}.{ms:03}"


LAST_RESORT = {"action": "surface", "safe_level": 0.2, "call_period_s": 600}
# Alarms at full hours: 10 s of sampling, 60 s of processing, timeslot 4 of a frame of 5 min opens at 15 s, 1 s of sending.
STORY = """\
13:00:00.000 SAMPLING
13:00:10.000 PROCESSING
13:01:10.000 AWAITING_SLOT
13:05:15.000 TRANSMITTING
13:05:16.000 SLEEPING
13:35:00.000 SURFACING
13:36:00.000 FLOATING
13:50:30.050 CHARGING
14:00:00.000 REPORTING
14:01:00.000 CHARGING
15:00:00.000 REPORTING
15:01:00.000 CHARGING
16:00:00.000 REPORTING
16:01:00.000 CHARGING
17:00:00.000 REPORTING
17:01:00.000 CHARGING
17:08:00.050 RELEASED
17:10:00.000 SINKING
17:11:00.000 ACTIVE
17:12:00.000 SLEEPING
18:00:00.000 SAMPLING"""


def test_the_story_of_a_docking() -> None:
    witness, flight = flown(changed(duration_s=2160))
    truths = [truth for truth in states_of(witness, 4) if truth.at_ms >= 13 * 3_600_000]
    assert "\n".join(f"{clock(truth.at_ms)} {truth.state.name}" for truth in truths) == STORY
    assert [note["agent"] for note in said(witness, "released")] == [6, 10, 4, 7]
    # The release packet that goes with the opened dock finds its Wi-Fi asleep; it is repeated when a packet arrives.
    assert flight.dropped == {"Wi-Fi is off": 4}
    assert {note["full"] for note in said(witness, "released")} == {True}
    # At every alarm until it surfaced, and at none in the dock.
    (fourth,) = (uptime for uptime in witness.meter.at(2_161_000) if uptime.agent_id == 4)
    assert fourth.samples == 13


def test_in_the_dock_the_primary_charges_by_two_coils_less_what_the_load_takes_on_the_way() -> None:
    scenario = changed(duration_s=1679)
    witness, flight = flown(scenario)
    docked = states_of(witness, 4)[-1]
    assert docked.state is State.CHARGING
    minutes = (1679 * 30_000 - docked.at_ms) / 60_000
    # Equation (2)'s middle segment, through two coils; the MU asleep and the modem listening, in part.
    net = 0.00223 * 1.2435 - 0.6037 * (0.0000392756 + 0.0125 / 7.4 / 60)
    (believed,) = (belief for belief in flight.supervisor.beliefs.all() if belief.agent_id == 4)
    assert believed.secondary == 1.0
    at_start = docked.physical.primary.charge / FULL
    recorded = TruthExtrapolator(scenario).sample(docked, 1679 * 30_000).primary
    assert recorded == pytest.approx(at_start + minutes * net, abs=1e-6)
    # Its last packet is the last report, at most 10 s of mission time ago.
    assert recorded - 5 * net <= believed.primary + 1e-4 and believed.primary <= recorded + 1e-4


def test_who_is_lost_is_counted_and_not_waited_for(tmp_path: Path) -> None:
    scenario = changed(duration_s=1200, fleet={"count": 4}, mission={"pool_threshold": 0.8})
    starts = (
        Start(1, 5.0, 5.0, 0.01, 0.01),
        *(Start(agent_id, 5.0 * agent_id, 10.0, 0.7, 1.0) for agent_id in (2, 3, 4)),
    )
    witness, flight = flown(scenario, starts, tmp_path)
    assert states_of(witness, 1)[-1].state is State.LOST
    assert uptime_figures(witness.meter, flight.now_ms)["amussels_lost"] == 1
    assert {note["agent"] for note in said(witness, "released")} == {2, 3, 4}


def test_one_that_came_up_for_its_life_is_left_up_there_and_fetched_alone(tmp_path: Path) -> None:
    scenario = changed(
        duration_s=2000,
        fleet={"count": 4},
        board={"whole": {**resolve(load(WHOLE_FILE))["board"]["whole"], "last_resort": LAST_RESORT}},
    )
    starts = (
        Start(1, 5.0, 5.0, 0.01, 0.201),
        *(Start(agent_id, 5.0 * agent_id, 10.0, 0.62, 1.0) for agent_id in (2, 3, 4)),
    )
    witness, _ = flown(scenario, starts, tmp_path)
    states = [truth.state for truth in states_of(witness, 1)]
    up = states.index(State.FLOATING)
    assert states[up - 2 : up + 2] == [State.EMPTY, State.SURFACING, State.FLOATING, State.CHARGING]
    assert [step["agent"] for step in said(witness, "plan")[0]["steps"]] == [1]
    docked = next(truth for truth in states_of(witness, 1) if truth.state is State.CHARGING)
    assert 0 < docked.physical.secondary.charge < grains(0.201)
    assert docked.physical.primary.charge == 0
    (released,) = (note for note in said(witness, "released") if note["agent"] == 1)
    assert released["full"]

"""The shipped scripts: the paper's listing as it is printed, the paper's mission written as a script, a behaviour."""

from dataclasses import replace
from pathlib import Path

import pytest
from journals import facts_of

from apad_bridge.events.run_events import EndReason
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import RandomStart, Scenario

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "launch_scripts/examples"

# Listing 1 of the paper, character for character.
LISTING_1 = """\
lat = api.get_location(24).lat
lon = api.get_location(24).lon
api.go_to([lat, lon])
while (api.goto_status(id_self) == 1):
    print('GoTo in progress.')
    time.sleep(1)
print("Goal reached. Docking start.")
api.docking(True, 2, 24)
"""


def test_listing_1_runs_as_the_paper_prints_it() -> None:
    text = (EXAMPLES / "listing_1.py").read_text()
    comment, _, listing = text.partition("\n")
    assert (comment[0], listing) == ("#", LISTING_1)
    flight = fly_script(load(ROOT / "launch_scripts/scenarios/bay-24.yaml"), EXAMPLES / "listing_1.py")
    assert (flight.ended_by, flight.error) == (EndReason.SCRIPT_ENDED, None)
    # The second docking mechanism is dock 1 on the wire.
    assert (flight.state.docked, flight.said[-1]) == (((1, 24),), "Goal reached. Docking start.")
    # It lies 26.6 m from (30, 20); at 0.5 m/s, with some acceleration, the script prints a line each second of the way.
    assert flight.said.count("GoTo in progress.") == pytest.approx(26.6 / 0.5, abs=4)


def test_a_script_s_flight_is_the_same_every_time(pool: Scenario) -> None:
    first = fly_script(pool, EXAMPLES / "first_in_need.py")
    again = fly_script(pool, EXAMPLES / "first_in_need.py")
    assert (first.events, first.said) == (again.events, again.said)


@pytest.mark.parametrize(
    ("shipped", "duration_s", "least"), [("pool-12", 1600.0, 5), ("sound-12", 1000.0, 4)]
)
def test_the_paper_s_mission_as_a_script_does_what_the_mission_does(
    shipped: str, duration_s: float, least: int
) -> None:
    """All need a charge soon: four are charged and released, and others docked."""

    def deeds(events: object) -> list[object]:
        assert isinstance(events, (list, tuple))
        return [it for it in events if it[1] in ("dock", "released")]

    scenario = load(ROOT / f"launch_scripts/scenarios/{shipped}.yaml")
    fleet = replace(scenario.fleet, start=RandomStart(charge=(0.5, 0.8)))
    scenario = replace(scenario, duration_s=duration_s, fleet=fleet)
    figures, recorder = fly_in_memory(scenario)
    flight = fly_script(scenario, EXAMPLES / "energy_exchange.py")
    assert flight.ended_by == "mission time"
    assert flight.state.services == figures["services"] >= least
    assert flight.state.cost_m == pytest.approx(figures["cost_m"], abs=1e-6)
    assert flight.state.planned_m == pytest.approx(figures["planned_m"], abs=1e-6)
    # Every dock closes and opens at the same second around the same aMussel.
    assert deeds(facts_of(flight.events)) == deeds(facts_of(recorder))


def test_a_behaviour_serves_those_in_need_one_by_one(pool: Scenario) -> None:
    flight = fly_script(pool, EXAMPLES / "first_in_need.py")
    assert (flight.ended_by, flight.error, flight.state.docked) == (EndReason.SCRIPT_ENDED, None, ())
    docks = [(data["agent"], data["closed"]) for _, kind, data in facts_of(flight.events) if kind == "dock"]
    first, second = docks[0][0], docks[2][0]
    assert docks == [(first, True), (first, False), (second, True), (second, False)]
    assert flight.said[0].startswith(f"aMussel {first} is at ")


def test_every_example_is_flown_here() -> None:
    tested = {"listing_1.py", "energy_exchange.py", "first_in_need.py"}
    assert {path.name for path in EXAMPLES.glob("*.py")} == tested

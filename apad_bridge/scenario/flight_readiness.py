"""The needs of a flight beyond a scenario without contradictions: code that loads, a real aPad's keys, and no doubts."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from apad_bridge.planning.registry import Trust, collection, redeployment
from apad_bridge.scenario.cross_checks import Contradiction, Rule, broken
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.hull_in_flow import doubt_about_legs
from apad_bridge.scenario.schema import DockedAtHome, HearingMode, Home, Scenario
from firmware_model.sampling.sensors import BROUGHT

_S_PER_HOUR = 3600


def check_code(scenario: Scenario, source: str, trust: Trust | None) -> None:
    """Loads the scenario's codec and strategies, those in files with `trust` alone.

    ScenarioError with a line for each that fails.
    """
    codec_of(scenario)
    if problems := [f"{source}: {key}: {why}" for key, why in problems_with_strategies(scenario, trust)]:
        raise ScenarioError(problems)


def problems_with_strategies(scenario: Scenario, trust: Trust | None) -> Iterator[tuple[str, ValueError]]:
    """Yields (path to the key, error) of each strategy that cannot be loaded; NotTrusted for one left out for that."""
    mission = scenario.mission
    strategies: tuple[tuple[str, Callable[[], object]], ...] = (
        ("mission.collection", lambda: collection(mission.collection, mission.costs, trust)),
        ("mission.redeployment", lambda: redeployment(mission.redeployment, trust)),
    )
    for key, load in strategies:
        try:
            load()
        except ValueError as error:
            yield key, error


def problems_with_real_vehicle(scenario: Scenario) -> list[str]:
    """Returns what forbids to fly a real aPad by this scenario, with the mend in each line; none if it may fly."""
    needed = {
        "area.fence": scenario.area.fence,
        "area.home_m": scenario.area.home_m,
        "guards.battery_reserve": None if scenario.guards is None else scenario.guards.battery_reserve,
    }
    problems = []
    if missing := [key for key, value in needed.items() if value is None]:
        problems.append(
            f"a real aPad needs {', '.join(missing)} in the scenario: see launch_scripts/scenarios/real-apad.yaml"
        )
    faulty = ["apad.fault"] if scenario.apad.fault is not Fault.NONE else []
    faulty += [
        f"apads[{n}].fault" for n, it in enumerate(scenario.apads) if it.fault not in (None, Fault.NONE)
    ]
    faulty += ["faults"] if scenario.faults is not None else []
    if faulty:
        problems.append(f"no fault is injected into a real aPad: leave {', '.join(faulty)} out")
    return problems


def warnings(scenario: Scenario) -> list[Contradiction]:
    """Returns (what must happen, the mend) of everything that such a scenario can be flown with, but hardly to the end."""
    water, doubt = scenario.water, doubt_about_legs(scenario)
    rules: list[Rule] = [
        (
            water is not None and water.links_file and scenario.hearing.mode is HearingMode.PAPER,
            "water.links_file cuts sound alone: with hearing.mode: paper each report comes by Wi-Fi all the same",
            "use hearing.mode: physical, as sound-12 does, or the fault link_cut",
        ),
        (
            doubt,
            str(doubt),
            "lower the current or the wind, or give the aPad more thrust (apad.thruster_max_n)",
        ),
        (
            BROUGHT and scenario.fleet.firmware and scenario.board.whole,
            f"packets of a program that has not the counts of {' and '.join(BROUGHT)} are dropped",
            "give the program that sensor and the version of such packets, or uninstall it",
        ),
    ]
    home = scenario.apad.home
    return broken(
        [*rules, *(_doubts_of_batteries(scenario) if home is None else _doubts_of_home(scenario, home))]
    )


def _doubts_of_home(scenario: Scenario, home: Home) -> list[Rule]:
    battery, charging_docks = scenario.apad.battery, 0
    if home.docked is DockedAtHome.CHARGE:
        charging_docks = scenario.apad.docks
    own_w = battery.hotel_w + charging_docks * battery.charging_w_per_dock
    return [
        (
            home.charging_w <= own_w,
            f"once at home the aPad may stay there: the charger's {home.charging_w:g} W feed its own {own_w:g} W "
            "(hotel_w, and its docks) and not its battery",
            "raise apad.home.charging_w",
        ),
        (
            home.go_at <= scenario.mission.end_at_apad_fraction,
            "the mission ends before the aPad goes home: mission.end_at_apad_fraction is no lower than apad.home.go_at",
            "raise apad.home.go_at",
        ),
    ]


def _doubts_of_batteries(scenario: Scenario) -> Iterator[Rule]:
    battery = scenario.apad.battery
    starts = {scenario.apad.name: battery.start_fraction}
    for it in scenario.apads:
        own = it.battery_start_fraction
        starts[it.name] = battery.start_fraction if own is None else own
    for name, start in starts.items():
        left_wh = max(0.0, start - scenario.mission.end_at_apad_fraction) * battery.capacity_wh
        if left_wh < battery.hotel_w * scenario.duration_s / _S_PER_HOUR:
            yield (
                True,
                f"{name}'s battery ends its mission within {left_wh / battery.hotel_w:.1f} h of "
                f"{scenario.duration_s / _S_PER_HOUR:.1f} h, whatever it does: apad.battery.hotel_w is "
                f"{battery.hotel_w:g} W, and {left_wh:.0f} Wh are there for it",
                "lower duration_s or apad.battery.hotel_w, or raise apad.battery.capacity_wh; theta makes the "
                "aMussels' days shorter",
            )

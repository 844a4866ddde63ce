"""Checks across the blocks of a scenario: values that are possible each by itself, but not together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from agents.modem.frames import PAYLOAD_BYTES, ModemGeneration, duration_ms
from agents.mussel.board_link import serial_line
from apad_bridge.planning.registry import Trust, collection, redeployment
from apad_bridge.scenario import schema
from apad_bridge.scenario.area.chart import chart_of
from apad_bridge.scenario.area.fence import Fence, fence_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.estimator_options import EstimatorKind
from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.firmware_config import can_fill, codec_of, grains_of_milliwatts
from apad_bridge.scenario.full_firmware_options import FullFirmwareOptions, SleepCycle
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.lab_interface.names import load_names
from apad_bridge.scenario.schema import DriftMode, FirmwareProgram, FullWhen, HearingMode, Scenario, Suspects
from apad_bridge.scenario.surface import doubt_about_legs
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.scenario.water.currents import problem_with_current
from apad_bridge.scenario.water.links import problem_with_links
from apad_bridge.scenario.water.options import Water
from firmware_model.power.rails import Rail

Contradiction = tuple[str, str]
_S_PER_HOUR = 3600
_LONGEST_ALARM_S = 65_000
"""Half the range of a board's counter (`firmware_model.port_frames`): 18 hours."""


def contradictions(scenario: Scenario) -> list[Contradiction]:
    """Returns (path to the key, message) of each contradiction, in the schema's order; none if the scenario can run.

    Checks that the named files exist, and reads the current's file. A scenario is data: nothing of it is executed.
    """
    return [
        *_check_area(scenario),
        *_check_fleet(scenario),
        *_check_board(scenario),
        *_check_mission(scenario),
        *_check_water(scenario),
        *_check_apad(scenario),
        *_check_further_apads(scenario),
        *_check_faults(scenario),
    ]


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


def _check_faults(scenario: Scenario) -> Iterator[Contradiction]:
    """Faults of aMussels and docks that there are not."""
    ids = frozenset(scenario.fleet.all_ids)
    for n, it in enumerate(scenario.faults.at if scenario.faults is not None else ()):
        if it.id is not None and it.id not in ids:
            yield f"faults.at[{n}].id", f"aMussel {it.id} is not of the fleet"
        if it.fault is TimedFault.DOCK_JAMMED and it.injection.value not in range(scenario.apad.docks):
            yield f"faults.at[{n}].value", f"the docks are 0 to {scenario.apad.docks - 1} (apad.docks)"


def warnings(scenario: Scenario) -> list[Contradiction]:
    """Returns (what must happen, the mend) of everything that such a scenario can be flown with, but hardly to the end."""
    mission, battery = scenario.mission, scenario.apad.battery
    starts = {scenario.apad.name: battery.start_fraction}
    for it in scenario.apads:
        starts[it.name] = (
            battery.start_fraction if it.battery_start_fraction is None else it.battery_start_fraction
        )
    found: list[Contradiction] = []
    if (
        scenario.water is not None
        and scenario.water.links_file
        and scenario.hearing.mode is HearingMode.PAPER
    ):
        found.append(
            (
                "water.links_file cuts sound alone: with hearing.mode: paper each report comes by Wi-Fi all the same",
                "use hearing.mode: physical, as sound-12 does, or the fault link_cut",
            )
        )
    if (doubt := doubt_about_legs(scenario)) is not None:
        found.append(
            (doubt, "lower the current or the wind, or give the aPad more thrust (apad.thruster_max_n)")
        )
    home = scenario.apad.home
    if home is not None:
        charging_docks = scenario.apad.docks if home.docked is schema.DockedAtHome.CHARGE else 0
        own_w = battery.hotel_w + charging_docks * battery.charging_w_per_dock
        if home.charging_w <= own_w:
            found.append(
                (
                    f"once at home the aPad may stay there: the charger's {home.charging_w:g} W feed its own {own_w:g} W "
                    "(hotel_w, and its docks) and not its battery",
                    "raise apad.home.charging_w",
                )
            )
        if home.go_at <= mission.end_at_apad_fraction:
            found.append(
                (
                    "the mission ends before the aPad goes home: mission.end_at_apad_fraction is no lower than "
                    "apad.home.go_at",
                    "raise apad.home.go_at",
                )
            )
        return found
    for name, start in starts.items():
        left_wh = max(0.0, start - mission.end_at_apad_fraction) * battery.capacity_wh
        if left_wh < battery.hotel_w * scenario.duration_s / _S_PER_HOUR:
            found.append(
                (
                    f"{name}'s battery ends its mission within {left_wh / battery.hotel_w:.1f} h of "
                    f"{scenario.duration_s / _S_PER_HOUR:.1f} h, whatever it does: apad.battery.hotel_w is "
                    f"{battery.hotel_w:g} W, and {left_wh:.0f} Wh are there for it",
                    "lower duration_s or apad.battery.hotel_w, or raise apad.battery.capacity_wh; theta makes the "
                    "aMussels' days shorter",
                )
            )
    return found


def _check_apad(scenario: Scenario) -> Iterator[Contradiction]:
    water = scenario.water
    flows = {
        "fleet.drift.current_m_s": scenario.fleet.drift.current_m_s,
        "fleet.drift.current_file": scenario.fleet.drift.current_file,
        "water.current": None if water is None else water.current,
        "water.wind": None if water is None else water.wind,
    }
    if any(scenario.apad.drift_m_s) and (given := [key for key, flow in flows.items() if flow is not None]):
        yield "apad.drift_m_s", f"{given[0]} pushes the aPad too, and there is one sea: leave one out"
    batch, docks = scenario.mission.batch, scenario.apad.docks
    if batch > docks:
        yield (
            "mission.batch",
            f"{batch} aMussels do not fit into {docks} docks (apad.docks): leave it out, or lower it",
        )
    if scenario.apad.interface is None:
        return
    path = Path(scenario.apad.interface)
    try:
        load_names(path)
    except OSError as error:
        yield "apad.interface", f"{error.strerror}: {path}"
    except ValueError as error:
        yield "apad.interface", f"{path}: {error}"


def _check_further_apads(scenario: Scenario) -> Iterator[Contradiction]:
    if not scenario.apads:
        return
    names = [scenario.apad.name, *(it.name for it in scenario.apads)]
    if len(set(names)) < len(names):
        yield "apads", f"names must differ from each other and from apad.name, and are {', '.join(names)}"
    if "/" in scenario.apad.name:
        yield "apad.name", "with `apads` it is a plain name, without slashes"
    if scenario.fleet.count < len(names):
        yield "apads", f"{len(names)} aPads have no work with {scenario.fleet.count} aMussels: leave some out"
    for n, it in enumerate(scenario.apads):
        possible = schema.LIMITS[scenario.apad.generation].faults
        if it.fault is not None and it.fault not in possible:
            yield f"apads[{n}].fault", f"of another generation; possible are: {', '.join(sorted(possible))}"
    if scenario.fleet.share:
        yield "apads", "a share of a fleet is one aPad's: leave this key out, or fleet.share"


def _check_area(scenario: Scenario) -> Iterator[Contradiction]:
    area, guards = scenario.area, scenario.guards or GuardOptions()
    fence = None
    try:
        fence = fence_of(area)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        key = "fence" if isinstance(area.fence, str) else "keep_out"
        yield f"area.{key}", f"{area.fence if key == 'fence' else area.keep_out}: {reason}"
    if area.chart is not None:
        try:
            chart_of(area.chart, area.origin)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            yield "area.chart", f"{area.chart}: {reason}"
    if fence is not None:
        yield from _check_fence(scenario, fence, guards)
    rating_m = guards.amussel_depth_m
    if rating_m is not None and area.depth_m > rating_m:
        yield (
            "area.depth_m",
            f"{area.depth_m:g} m are more than the aMussels are rated for (guards.amussel_depth_m: {rating_m:g} m)",
        )
    if guards.speed_limit_m_s is not None and scenario.mission.speed_m_s > guards.speed_limit_m_s:
        yield (
            "mission.speed_m_s",
            f"is above guards.speed_limit_m_s ({guards.speed_limit_m_s:g} m/s): every go-to would be refused",
        )


def _check_fence(scenario: Scenario, fence: Fence, guards: GuardOptions) -> Iterator[Contradiction]:
    import shapely

    clear = fence.waters().buffer(-guards.clearance_m)
    if clear.is_empty:
        yield (
            "guards.clearance_m",
            f"no place inside area.fence keeps {guards.clearance_m:g} m to it and to the keep-out zones",
        )
        return
    home_m, apad = scenario.area.home_m, scenario.apad
    places = {"apad.start_m": apad.start_m} | ({} if home_m is None else {"area.home_m": home_m})
    places |= {f"apads[{n}].start_m": it.start_m for n, it in enumerate(scenario.apads)}
    for key, place_m in places.items():
        if not clear.covers(shapely.Point(place_m)):
            yield (
                key,
                f"{list(place_m)} is no place inside area.fence that keeps guards.clearance_m ({guards.clearance_m:g} m)",
            )


def _check_fleet(scenario: Scenario) -> list[Contradiction]:
    found = []
    fleet = scenario.fleet
    if isinstance(fleet.start, str) and not Path(fleet.start).exists():
        found.append(("fleet.start", f"no such file or directory: {fleet.start}"))
    drift = fleet.drift
    if drift.current_m_s is not None and drift.current_file is not None:
        found.append(("fleet.drift.current_m_s", "with current_file there are two currents: leave one out"))
    if drift.current_file is not None:
        problem = problem_with_current(Path(drift.current_file), LocalFrame.about(scenario.area.origin))
        if problem:
            found.append(("fleet.drift.current_file", problem))
    if drift.mode is DriftMode.PHYSICAL and drift.amplitude_m:
        found.append(
            (
                "fleet.drift.amplitude_m",
                "physical drift has no random step: leave this key out, or use mode: paper",
            )
        )
    return [*found, *_check_firmware(scenario)]


def _check_firmware(scenario: Scenario) -> Iterator[Contradiction]:
    fleet, board = scenario.fleet, scenario.board
    if not fleet.firmware:
        return
    if fleet.hosting is Hosting.ONE_PROCESS:
        yield "fleet.firmware", "it needs a process for each aMussel: set fleet.hosting: processes"
    for key in ("float_timeout_s", "surfacing_timeout_s", "release_wait_s"):
        if (getattr(board, key) or 0) > _LONGEST_ALARM_S:
            yield (
                f"board.{key}",
                f"with fleet.firmware it is {_LONGEST_ALARM_S} s at most: half of the board's counter",
            )
    named: set[int] = set()
    for n, program in enumerate(fleet.firmware):
        key = f"fleet.firmware[{n}]"
        if unknown := sorted(set(program.agents) - set(fleet.all_ids)):
            yield f"{key}.agents", f"the fleet has no aMussel {unknown[0]}"
        if twice := sorted(named & set(program.agents)):
            yield f"{key}.agents", f"aMussel {twice[0]} has another firmware already"
        named |= set(program.agents)
        yield from _check_program(scenario, program, key)
    for n, _ in [it for it in enumerate(fleet.firmware) if not it[1].agents][1:]:
        yield f"fleet.firmware[{n}]", "another firmware has all aMussels that are left: name its `agents`"


def _check_program(scenario: Scenario, program: FirmwareProgram, key: str) -> Iterator[Contradiction]:
    try:
        line = serial_line(program.executable)
    except ValueError as error:
        yield f"{key}.executable", str(error)
        return
    if line is None:
        if not os.access(program.executable, os.X_OK) or not os.path.isfile(program.executable):
            yield f"{key}.executable", f"no program that can be executed: {program.executable}"
        return
    if scenario.theta != 1:
        yield (
            f"{key}.executable",
            f"a real board cannot be accelerated, and theta is {scenario.theta}: say theta: 1",
        )
    if program.arguments:
        yield f"{key}.arguments", "a real board takes none: leave them out"
    if len(program.agents or scenario.fleet.all_ids) != 1:
        yield f"{key}.agents", "a serial line has one board: name its aMussel, as agents: [3]"


def _check_board(scenario: Scenario) -> Iterator[Contradiction]:
    whole = scenario.board.whole
    if whole is None:
        return
    loads_mw = [getattr(whole.power.loads_mw, it.name.lower()) for it in Rail if it is not Rail.MOTORS]
    if not any(grains_of_milliwatts(it, whole.power.capacity_wh) for it in loads_mw):
        yield (
            "board.whole.power.capacity_wh",
            f"no module draws what could be counted of {whole.power.capacity_wh:g} Wh (the most: "
            f"{max(loads_mw):g} mW): lower the capacity, or raise board.whole.power.loads_mw",
        )
    if whole.power.motor_run_s >= whole.hover_period_s:
        yield (
            "board.whole.hover_period_s",
            f"must be longer than a motor run ({whole.power.motor_run_s:g} s), or hovering never ends one",
        )
    if whole.transmit_ms >= whole.last_resort.call_period_s * 1000:
        yield (
            "board.whole.last_resort.call_period_s",
            f"must be longer than a call takes, which is transmit_ms ({whole.transmit_ms} ms)",
        )
    if whole.cycle is not None:
        yield from _check_cycle(scenario, whole, whole.cycle)


def _check_cycle(
    scenario: Scenario, whole: FullFirmwareOptions, cycle: SleepCycle
) -> Iterator[Contradiction]:
    agents, transmit_s, timekeeping = scenario.fleet.count, whole.transmit_ms / 1000, whole.timekeeping
    awake_s, timeslots = cycle.sample_s + cycle.processing_s, cycle.slots
    if timeslots is not None:
        awake_s += timeslots.frame_s + transmit_s + (0 if timekeeping is None else timekeeping.beacon_wait_s)
        capacity = round(timeslots.frame_s * 1000) // round(timeslots.slot_s * 1000)
        if agents > capacity:
            yield (
                "board.whole.cycle.slots.frame_s",
                f"holds {capacity} slots of {timeslots.slot_s:g} s, and {agents} aMussels need one each: "
                f"make it {agents * timeslots.slot_s:g} s or more, or slot_s shorter",
            )
        needed_s = transmit_s + 2 * timeslots.guard_s
        if timeslots.slot_s < needed_s:
            yield (
                "board.whole.cycle.slots.slot_s",
                f"must be no shorter than a status and the guard on either side of it ({needed_s:g} s), "
                "or two would overlap",
            )
    if cycle.report_s <= scenario.theta:
        yield (
            "board.whole.cycle.report_s",
            f"must be longer than {scenario.theta} s, which pass for a docked aMussel before the aPad's next second: "
            "or no log is ever acknowledged",
        )
    if awake_s >= cycle.alarm_s:
        parts = "sample_s, processing_s" + (
            ", a whole frame, transmit_ms, a beacon's wait" if timeslots is not None else ""
        )
        yield (
            "board.whole.cycle.alarm_s",
            f"must be longer than a wake, which takes up to {awake_s:g} s ({parts}), or alarms pass unheard",
        )


def _check_mission(scenario: Scenario) -> list[Contradiction]:
    found = []
    mission = scenario.mission
    if mission.suspects is not Suspects.TOLD and scenario.beliefs.estimator is not EstimatorKind.TWIN:
        found.append(
            (
                "mission.suspects",
                "the last packet is believed, whatever it says: add beliefs.estimator: twin, or leave this key out",
            )
        )
    if mission.suspects is Suspects.ASKED and (scenario.water is None or scenario.board.whole is None):
        found.append(
            (
                "mission.suspects",
                "aMussels are asked by sound, and the worst case does not answer: add water and board.whole, or write told",
            )
        )
    if mission.again_threshold is not None and mission.again_threshold >= mission.pool_threshold:
        found.append(
            (
                "mission.again_threshold",
                f"must be below mission.pool_threshold ({mission.pool_threshold}), or it changes nothing: leave it out",
            )
        )
    if mission.full_threshold <= mission.pool_threshold:
        found.append(
            (
                "mission.full_threshold",
                f"must be above mission.pool_threshold ({mission.pool_threshold}), "
                "or one that was charged would be a candidate again at once",
            )
        )
    if mission.charge_to is not None and not (
        mission.pool_threshold < mission.charge_to <= mission.full_threshold
    ):
        found.append(
            (
                "mission.charge_to",
                f"must lie above mission.pool_threshold ({mission.pool_threshold}) and not above "
                f"mission.full_threshold ({mission.full_threshold})",
            )
        )
    limit = "full_threshold" if mission.charge_to is None else "charge_to"
    if mission.charge_lead is not None and mission.charge_lead >= getattr(mission, limit):
        found.append(
            (
                "mission.charge_lead",
                f"must be below mission.{limit} ({getattr(mission, limit)}), or it changes nothing: leave it out",
            )
        )
    if mission.full_when is FullWhen.BOTH and scenario.board.whole is None:
        found.append(
            (
                "mission.full_when",
                "a board without `whole` charges its primary battery only: leave this key out, or use primary",
            )
        )
    if not can_fill(scenario.board, mission.pool_threshold, mission.full_threshold):
        found.append(
            (
                "mission.full_threshold",
                "is never reached in a dock: the modules there draw more than the charger gives. Lower it, or keep less on",
            )
        )
    if mission.speed_m_s > scenario.apad.max_speed_m_s:
        found.append(
            (
                "mission.speed_m_s",
                f"the aPad cannot go faster than apad.max_speed_m_s ({scenario.apad.max_speed_m_s})",
            )
        )
    return found


def _check_water(scenario: Scenario) -> Iterator[Contradiction]:
    water = scenario.water
    if water is None:
        return
    if water.wifi is not None and scenario.hearing.mode is HearingMode.PAPER:
        yield (
            "water.wifi",
            "with hearing.mode: paper Wi-Fi always gets through: leave this block out, or use mode: physical",
        )
    if water.links_file is not None and (problem := problem_with_links(Path(water.links_file))):
        yield "water.links_file", problem
    if water.talk.ping_worth_m and (
        scenario.beliefs.estimator is not EstimatorKind.TWIN or water.localisation is None
    ):
        yield (
            "water.talk.ping_worth_m",
            "the last packet says nothing of how sure a place is, and ranges must become places: add "
            "beliefs.estimator: twin and water.localisation, or leave this key out",
        )
    if water.talk.ask_worth_answers and (
        scenario.beliefs.estimator is not EstimatorKind.TWIN or scenario.board.whole is None
    ):
        yield (
            "water.talk.ask_worth_answers",
            "the last packet says nothing of how sure a charge is, and the worst case does not answer: add "
            "beliefs.estimator: twin and board.whole, or leave this key out",
        )
    if water.modems is ModemGeneration.V2:
        yield from _check_v2_modems(scenario, water)
    current = water.current
    if current is None:
        return
    for key in ("current_file", "current_m_s"):
        if getattr(scenario.fleet.drift, key) is not None:
            yield "water.current", f"with fleet.drift.{key} there are two currents: leave one out"
    if current.steady_m_s is not None and current.file is not None:
        yield "water.current.steady_m_s", "with file there are two currents: leave one out"
    if current.file is not None:
        problem = problem_with_current(Path(current.file), LocalFrame.about(scenario.area.origin))
        if problem:
            yield "water.current.file", problem


def _check_v2_modems(scenario: Scenario, water: Water) -> Iterator[Contradiction]:
    max_bytes = PAYLOAD_BYTES[ModemGeneration.V2][1]
    for key, is_enabled in (("assigns", water.talk.assigns), ("beacon_period_s", water.talk.beacon_period_s)):
        if is_enabled:
            yield (
                f"water.talk.{key}",
                f"a v2 modem carries {max_bytes} bytes, and this takes more: leave it out, or use v3",
            )
    whole, status_ms = scenario.board.whole, duration_ms(ModemGeneration.V2, max_bytes)
    if whole is not None and whole.transmit_ms < status_ms:
        yield (
            "board.whole.transmit_ms",
            f"must be no shorter than a v2 modem's status, which lasts {status_ms} ms",
        )

"""Checks across the blocks of a scenario: values that are possible each by itself, but not together."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from agents.modem.frames import PAYLOAD_BYTES, ModemGeneration, duration_ms
from agents.mussel.port.board_link import serial_line
from agents.time_scale import TimeScale
from apad_bridge.planning.dispatch_rule import FullWhen
from apad_bridge.scenario.another_apad import ASSIGNMENT_PERIOD_S
from apad_bridge.scenario.area.chart import chart_of
from apad_bridge.scenario.area.fence import Fence, fence_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.blocks.estimator_options import EstimatorKind
from apad_bridge.scenario.blocks.full_firmware_options import FullFirmwareOptions, SleepCycle
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.blocks.mission_options import Suspects
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.firmware_config import can_fill, grains_of_milliwatts
from apad_bridge.scenario.lab_interface.lab_names import load_names
from apad_bridge.scenario.schema import (
    LIMITS,
    DriftMode,
    FirmwareProgram,
    HearingMode,
    Scenario,
)
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.scenario.water.currents import read_current
from apad_bridge.scenario.water.links import read_links
from apad_bridge.scenario.water.water_options import Current, Water
from firmware_model.power.rails import Rail

Contradiction = tuple[str, str]
Rule = tuple[object, str, str]
"""(true where the rule is broken, path to the key, message): a rule that is broken is a contradiction."""
Read = TypeVar("Read")
_LONGEST_ALARM_S = 65_000
"""Half the range of a board's counter (`firmware_model.port_frames`): 18 hours."""


def contradictions(scenario: Scenario) -> list[Contradiction]:
    """Returns (path to the key, message) of each contradiction, in the schema's order; none if the scenario can run.

    Checks that the named files exist, and reads the current's file. A scenario is data: nothing of it is executed.
    """
    rules = (
        *_rules_of_area(scenario),
        *_rules_of_fleet(scenario),
        *_rules_of_board(scenario),
        *_rules_of_mission(scenario),
        *_rules_of_water(scenario),
        *_rules_of_apad(scenario),
        *_rules_of_further_apads(scenario),
        *_rules_of_consensus(scenario),
        *_rules_of_faults(scenario),
    )
    return broken(rules)


def broken(rules: Iterable[Rule]) -> list[Contradiction]:
    """The rules that are broken, each without its truth."""
    return [(key, message) for is_broken, key, message in rules if is_broken]


def _rules_of_area(scenario: Scenario) -> Iterator[Rule]:
    area, guards = scenario.area, scenario.guards or GuardOptions()
    fence, problem = _read(lambda: fence_of(area))
    key = "fence" if isinstance(area.fence, str) else "keep_out"
    yield problem, f"area.{key}", f"{area.fence if key == 'fence' else area.keep_out}: {problem}"
    yield _rule_of_file("area.chart", area.chart, lambda it: chart_of(it, area.origin))
    if fence is not None:
        yield from _rules_of_fence(scenario, fence, guards)
    rating_m, limit_m_s = guards.amussel_depth_m or math.inf, guards.speed_limit_m_s or math.inf
    yield (
        area.depth_m > rating_m,
        "area.depth_m",
        f"{area.depth_m:g} m are more than the aMussels are rated for (guards.amussel_depth_m: {rating_m:g} m)",
    )
    yield (
        scenario.mission.speed_m_s > limit_m_s,
        "mission.speed_m_s",
        f"is above guards.speed_limit_m_s ({limit_m_s:g} m/s): every go-to would be refused",
    )


def _read(read: Callable[[], Read]) -> tuple[Read | None, str]:
    """The content of a file, and an empty text; None, and the reason for which it cannot be read."""
    try:
        return read(), ""
    except OSError as error:
        return None, str(error.strerror)
    except ValueError as error:
        return None, str(error)


def _rule_of_file(key: str, file: str | None, read: Callable[[str], object]) -> Rule:
    _, problem = ("", "") if file is None else _read(lambda: read(file))
    return problem, key, f"{file}: {problem}"


def _rule_of_current(key: str, file: str | None, scenario: Scenario) -> Rule:
    frame = LocalFrame.about(scenario.area.origin)
    return _rule_of_file(key, file, lambda it: read_current(Path(it), frame))


def _rules_of_fence(scenario: Scenario, fence: Fence, guards: GuardOptions) -> Iterator[Rule]:
    import shapely

    clear = fence.waters().buffer(-guards.clearance_m)
    yield (
        clear.is_empty,
        "guards.clearance_m",
        f"no place inside area.fence keeps {guards.clearance_m:g} m to it and to the keep-out zones",
    )
    home_m, apad = scenario.area.home_m, scenario.apad
    places = {"apad.start_m": apad.start_m} | ({} if home_m is None else {"area.home_m": home_m})
    places |= {f"apads[{n}].start_m": it.start_m for n, it in enumerate(scenario.apads)}
    for key, place_m in places.items():
        yield (
            not clear.is_empty and not clear.covers(shapely.Point(place_m)),
            key,
            f"{list(place_m)} is no place inside area.fence that keeps guards.clearance_m ({guards.clearance_m:g} m)",
        )


def _rules_of_fleet(scenario: Scenario) -> Iterator[Rule]:
    fleet, drift = scenario.fleet, scenario.fleet.drift
    yield (
        isinstance(fleet.start, str) and not Path(fleet.start).exists(),
        "fleet.start",
        f"no such file or directory: {fleet.start}",
    )
    yield (
        drift.current_m_s is not None and drift.current_file is not None,
        "fleet.drift.current_m_s",
        "with current_file there are two currents: leave one out",
    )
    yield _rule_of_current("fleet.drift.current_file", drift.current_file, scenario)
    yield (
        drift.mode is DriftMode.PHYSICAL and drift.amplitude_m,
        "fleet.drift.amplitude_m",
        "physical drift has no random step: leave this key out, or use mode: paper",
    )
    if fleet.firmware:
        yield from _rules_of_firmware(scenario)


def _rules_of_firmware(scenario: Scenario) -> Iterator[Rule]:
    fleet, board = scenario.fleet, scenario.board
    yield (
        fleet.hosting is Hosting.ONE_PROCESS,
        "fleet.firmware",
        "it needs a process for each aMussel: set fleet.hosting: processes",
    )
    for key in ("float_timeout_s", "surfacing_timeout_s", "release_wait_s"):
        yield (
            (getattr(board, key) or 0) > _LONGEST_ALARM_S,
            f"board.{key}",
            f"with fleet.firmware it is {_LONGEST_ALARM_S} s at most: half of the board's counter",
        )
    named: set[int] = set()
    for n, program in enumerate(fleet.firmware):
        key, agents = f"fleet.firmware[{n}]", set(program.agents)
        unknown, twice = sorted(agents - set(fleet.all_ids)), sorted(named & agents)
        yield unknown, f"{key}.agents", f"the fleet has no aMussel {min(unknown, default=0)}"
        yield twice, f"{key}.agents", f"aMussel {min(twice, default=0)} has another firmware already"
        named |= agents
        yield from _rules_of_program(scenario, program, key)
    for n, _ in [it for it in enumerate(fleet.firmware) if not it[1].agents][1:]:
        yield (
            True,
            f"fleet.firmware[{n}]",
            "another firmware has all aMussels that are left: name its `agents`",
        )


def _rules_of_program(scenario: Scenario, program: FirmwareProgram, key: str) -> Iterator[Rule]:
    line, problem = _read(lambda: serial_line(program.executable))
    yield problem, f"{key}.executable", problem
    if line is None:
        yield (
            not problem
            and not (os.path.isfile(program.executable) and os.access(program.executable, os.X_OK)),
            f"{key}.executable",
            f"no program that can be executed: {program.executable}",
        )
        return
    yield (
        scenario.theta != 1,
        f"{key}.executable",
        f"a real board cannot be accelerated, and theta is {scenario.theta}: say theta: 1",
    )
    yield program.arguments, f"{key}.arguments", "a real board takes none: leave them out"
    yield (
        len(program.agents or scenario.fleet.all_ids) != 1,
        f"{key}.agents",
        "a serial line has one board: name its aMussel, as agents: [3]",
    )


def _rules_of_board(scenario: Scenario) -> list[Rule]:
    if (whole := scenario.board.whole) is None:
        return []
    power = whole.power
    loads_mw = [getattr(power.loads_mw, it.name.lower()) for it in Rail if it is not Rail.MOTORS]
    return [
        (
            not any(grains_of_milliwatts(it, power.capacity_wh) for it in loads_mw),
            "board.whole.power.capacity_wh",
            f"no module draws what could be counted of {power.capacity_wh:g} Wh (the most: {max(loads_mw):g} mW): "
            "lower the capacity, or raise board.whole.power.loads_mw",
        ),
        (
            power.motor_run_s >= whole.hover_period_s,
            "board.whole.hover_period_s",
            f"must be longer than a motor run ({power.motor_run_s:g} s), or hovering never ends one",
        ),
        (
            whole.transmit_ms >= whole.last_resort.call_period_s * 1000,
            "board.whole.last_resort.call_period_s",
            f"must be longer than a call takes, which is transmit_ms ({whole.transmit_ms} ms)",
        ),
        *([] if whole.cycle is None else _rules_of_cycle(scenario, whole, whole.cycle)),
    ]


def _rules_of_cycle(scenario: Scenario, whole: FullFirmwareOptions, cycle: SleepCycle) -> Iterator[Rule]:
    agents, transmit_s, timekeeping = scenario.fleet.count, whole.transmit_ms / 1000, whole.timekeeping
    awake_s, timeslots, parts = cycle.sample_s + cycle.processing_s, cycle.slots, "sample_s, processing_s"
    if timeslots is not None:
        parts += ", a whole frame, transmit_ms, a beacon's wait"
        awake_s += timeslots.frame_s + transmit_s + (0 if timekeeping is None else timekeeping.beacon_wait_s)
        capacity = round(timeslots.frame_s * 1000) // round(timeslots.slot_s * 1000)
        needed_s = transmit_s + 2 * timeslots.guard_s
        yield (
            agents > capacity,
            "board.whole.cycle.slots.frame_s",
            f"holds {capacity} slots of {timeslots.slot_s:g} s, and {agents} aMussels need one each: "
            f"make it {agents * timeslots.slot_s:g} s or more, or slot_s shorter",
        )
        yield (
            timeslots.slot_s < needed_s,
            "board.whole.cycle.slots.slot_s",
            f"must be no shorter than a status and the guard on either side of it ({needed_s:g} s), "
            "or two would overlap",
        )
    yield (
        cycle.report_s <= scenario.theta,
        "board.whole.cycle.report_s",
        f"must be longer than {scenario.theta} s, which pass for a docked aMussel before the aPad's next second: "
        "or no log is ever acknowledged",
    )
    yield (
        awake_s >= cycle.alarm_s,
        "board.whole.cycle.alarm_s",
        f"must be longer than a wake, which takes up to {awake_s:g} s ({parts}), or alarms pass unheard",
    )


def _rules_of_mission(scenario: Scenario) -> list[Rule]:
    mission, whole = scenario.mission, scenario.board.whole
    pool, full, charge_to = mission.pool_threshold, mission.full_threshold, mission.charge_to
    limit = "full_threshold" if charge_to is None else "charge_to"
    return [
        (
            mission.suspects is not Suspects.TOLD and scenario.beliefs.estimator is not EstimatorKind.TWIN,
            "mission.suspects",
            "the last packet is believed, whatever it says: add beliefs.estimator: twin, or leave this key out",
        ),
        (
            mission.suspects is Suspects.ASKED and (scenario.water is None or whole is None),
            "mission.suspects",
            "aMussels are asked by sound, and the worst case does not answer: add water and board.whole, or write told",
        ),
        (
            mission.again_threshold is not None and mission.again_threshold >= pool,
            "mission.again_threshold",
            f"must be below mission.pool_threshold ({pool}), or it changes nothing: leave it out",
        ),
        (
            full <= pool,
            "mission.full_threshold",
            f"must be above mission.pool_threshold ({pool}), or one that was charged would be a candidate again at once",
        ),
        (
            charge_to is not None and not pool < charge_to <= full,
            "mission.charge_to",
            f"must lie above mission.pool_threshold ({pool}) and not above mission.full_threshold ({full})",
        ),
        (
            mission.charge_lead is not None and mission.charge_lead >= getattr(mission, limit),
            "mission.charge_lead",
            f"must be below mission.{limit} ({getattr(mission, limit)}), or it changes nothing: leave it out",
        ),
        (
            mission.full_when is FullWhen.BOTH and whole is None,
            "mission.full_when",
            "a board without `whole` charges its primary battery only: leave this key out, or use primary",
        ),
        (
            not can_fill(scenario.board, pool, full),
            "mission.full_threshold",
            "is never reached in a dock: the modules there draw more than the charger gives. Lower it, or keep less on",
        ),
        (
            mission.speed_m_s > scenario.apad.max_speed_m_s,
            "mission.speed_m_s",
            f"the aPad cannot go faster than apad.max_speed_m_s ({scenario.apad.max_speed_m_s})",
        ),
    ]


def _rules_of_water(scenario: Scenario) -> list[Rule]:
    water, whole = scenario.water, scenario.board.whole
    if water is None:
        return []
    has_twins, current = scenario.beliefs.estimator is EstimatorKind.TWIN, water.current
    return [
        (
            water.wifi is not None and scenario.hearing.mode is HearingMode.PAPER,
            "water.wifi",
            "with hearing.mode: paper Wi-Fi always gets through: leave this block out, or use mode: physical",
        ),
        _rule_of_file("water.links_file", water.links_file, lambda it: read_links(Path(it), TimeScale(1))),
        (
            water.talk.ping_worth_m and not (has_twins and water.localisation),
            "water.talk.ping_worth_m",
            "the last packet says nothing of how sure a place is, and ranges must become places: add "
            "beliefs.estimator: twin and water.localisation, or leave this key out",
        ),
        (
            water.talk.ask_worth_answers and not (has_twins and whole),
            "water.talk.ask_worth_answers",
            "the last packet says nothing of how sure a charge is, and the worst case does not answer: add "
            "beliefs.estimator: twin and board.whole, or leave this key out",
        ),
        *(_rules_of_v2_modems(scenario, water) if water.modems is ModemGeneration.V2 else []),
        *([] if current is None else _rules_of_current(scenario, current)),
    ]


def _rules_of_current(scenario: Scenario, current: Current) -> Iterator[Rule]:
    for key in ("current_file", "current_m_s"):
        yield (
            getattr(scenario.fleet.drift, key) is not None,
            "water.current",
            f"with fleet.drift.{key} there are two currents: leave one out",
        )
    yield (
        current.steady_m_s is not None and current.file is not None,
        "water.current.steady_m_s",
        "with file there are two currents: leave one out",
    )
    yield _rule_of_current("water.current.file", current.file, scenario)


def _rules_of_v2_modems(scenario: Scenario, water: Water) -> Iterator[Rule]:
    max_bytes = PAYLOAD_BYTES[ModemGeneration.V2][1]
    for key, is_enabled in (("assigns", water.talk.assigns), ("beacon_period_s", water.talk.beacon_period_s)):
        yield (
            is_enabled,
            f"water.talk.{key}",
            f"a v2 modem carries {max_bytes} bytes, and this takes more: leave it out, or use v3",
        )
    whole, status_ms = scenario.board.whole, duration_ms(ModemGeneration.V2, max_bytes)
    yield (
        whole is not None and whole.transmit_ms < status_ms,
        "board.whole.transmit_ms",
        f"must be no shorter than a v2 modem's status, which lasts {status_ms} ms",
    )


def _rules_of_apad(scenario: Scenario) -> Iterator[Rule]:
    water, apad, batch = scenario.water, scenario.apad, scenario.mission.batch
    flows = {
        "fleet.drift.current_m_s": scenario.fleet.drift.current_m_s,
        "fleet.drift.current_file": scenario.fleet.drift.current_file,
        "water.current": None if water is None else water.current,
        "water.wind": None if water is None else water.wind,
    }
    flow = next((key for key, flow in flows.items() if flow is not None), None)
    yield (
        any(apad.drift_m_s) and flow,
        "apad.drift_m_s",
        f"{flow} pushes the aPad too, and there is one sea: leave one out",
    )
    yield (
        batch > apad.docks,
        "mission.batch",
        f"{batch} aMussels do not fit into {apad.docks} docks (apad.docks): leave it out, or lower it",
    )
    yield _rule_of_file("apad.interface", apad.interface, lambda it: load_names(Path(it)))


def _rules_of_further_apads(scenario: Scenario) -> Iterator[Rule]:
    if not scenario.apads:
        return
    names = scenario.apad_names
    yield (
        len(set(names)) < len(names),
        "apads",
        f"names must differ from each other and from apad.name, and are {', '.join(names)}",
    )
    yield "/" in scenario.apad.name, "apad.name", "with `apads` it is a plain name, without slashes"
    yield (
        scenario.fleet.count < len(names),
        "apads",
        f"{len(names)} aPads have no work with {scenario.fleet.count} aMussels: leave some out",
    )
    possible = LIMITS[scenario.apad.generation].faults
    for n, it in enumerate(scenario.apads):
        yield (
            it.fault is not None and it.fault not in possible,
            f"apads[{n}].fault",
            f"of another generation; possible are: {', '.join(sorted(possible))}",
        )
    yield (
        scenario.fleet.share,
        "apads",
        "a share of a fleet is one aPad's: leave this key out, or fleet.share",
    )


def _rules_of_consensus(scenario: Scenario) -> Iterator[Rule]:
    if (consensus := scenario.sharing.consensus) is None:
        return
    key, names = "sharing.consensus", scenario.apad_names
    yield not scenario.apads, key, "one aPad has nobody to agree with: leave it out, or name more `apads`"
    yield not scenario.sharing.transfers, key, "nothing is agreed on without transfers: leave one of both out"
    exchanges_s = 5 * ASSIGNMENT_PERIOD_S + 4 * consensus.delay_s
    least_s = scenario.mission.docking.longest_s + exchanges_s
    yield (
        consensus.lease_s < least_s,
        f"{key}.lease_s",
        f"a docking and five exchanges of messages must fit into it: at least {least_s:g}",
    )
    for n, it in enumerate(consensus.silences):
        yield (
            it.apad not in names,
            f"{key}.silences[{n}].apad",
            f"no such aPad; there are {', '.join(names)}",
        )
        yield (
            it.to_s is not None and it.to_s <= it.from_s,
            f"{key}.silences[{n}].to_s",
            "not after from_s",
        )


def _rules_of_faults(scenario: Scenario) -> Iterator[Rule]:
    """Faults of aMussels and docks that there are not."""
    ids, docks = frozenset(scenario.fleet.all_ids), scenario.apad.docks
    for n, it in enumerate(scenario.faults.at if scenario.faults is not None else ()):
        yield (
            it.id is not None and it.id not in ids,
            f"faults.at[{n}].id",
            f"aMussel {it.id} is not of the fleet",
        )
        yield (
            it.fault is TimedFault.DOCK_JAMMED and it.injection.value not in range(docks),
            f"faults.at[{n}].value",
            f"the docks are 0 to {docks - 1} (apad.docks)",
        )

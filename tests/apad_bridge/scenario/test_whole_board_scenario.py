"""Scenarios with the whole firmware: their conversion, the keys that a profile fills in, and refused values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from scenario_files import POOL_FILE, SCENARIO_FILES, WHOLE_FILE

from agents.fleet_config import FleetConfig
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.scenario.blocks.full_firmware_options import ModuleLoads
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve, with_overrides, write_resolved
from apad_bridge.scenario.schema import Scenario
from firmware_model import table_one
from firmware_model.config import LastResort, Timekeeping, Timeslots
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits

TEXT = WHOLE_FILE.read_text()
SHIPPED = load(Path(__file__).parents[3] / "launch_scripts" / "scenarios" / "whole-board-12.yaml")
CYCLE_LINE = "cycle: field"


def changed(*changes: tuple[str, str]) -> Scenario:
    """Loads the shipped scenario with some texts replaced."""
    text = TEXT
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    data = yaml.safe_load(text)
    data["fleet"]["start"] = str(SCENARIO_FILES / "pool.csv")
    return from_data(data, "it")


def power_with(keys: str) -> tuple[str, str]:
    return "power: table-one", f"power: {{profile: table-one, {keys}}}"


def loads_of(fleet: FleetConfig, *rails: Rail) -> list[int]:
    return [fleet.board.whole.power.loads.of[it] for it in rails or Rail]


OTHERS = [it for it in Rail if it not in (Rail.PI, Rail.GSM)]
CLOCK = (
    "    timekeeping: {bound_ppm: 20, beacon_wait_s: 90}\n    clock_drift_ppm: 12.5\n    transmit_ms: 1000"
)
DOCK_LINE = "  pin_debounce_ms: 50 # assumed, as all up to `whole`"
METERED = power_with("metering: table-one, low_level: 0.3")
READ: dict[str, tuple[list[tuple[str, str]], Callable[[FleetConfig], Any], Any]] = {
    "the profiles are Table I to the grain": (
        [],
        lambda it: (it.board.whole.power, it.board.whole.cycle, it.board.charge),
        (table_one.power(LastResort.CALL), table_one.FIELD, table_one.MODEL),
    ),
    "the profile of a short wake": (
        [(CYCLE_LINE, "cycle: hourly")],
        lambda it: it.board.whole.cycle,
        replace(table_one.HOURLY, report_ms=60_000),
    ),
    # 1200.5 mW of 7.4 Wh: 1.2005 / 7.4 / 3.6e6 of a battery a millisecond.
    "modules are overridden and the others stay": (
        [power_with("loads_mw: {gsm: 0, pi: 1200.5}, kept_on: [pi]")],
        lambda it: (loads_of(it, Rail.PI, Rail.GSM), loads_of(it, *OTHERS), it.board.whole.power.kept_on),
        (
            [round(FULL * 1.2005 / 7.4 / 3_600_000), 0],
            [table_one.LOADS.of[it] for it in OTHERS],
            bits(Rail.PI),
        ),
    ),
    "twice the capacity lasts twice as long": (
        [power_with("capacity_wh: 14.8")],
        lambda it: [2 * ours - whole for ours, whole in zip(loads_of(it), table_one.LOADS.of, strict=True)],
        [pytest.approx(0, abs=1)] * len(Rail),
    ),
    "metering is Table I's to the grain with the scenario's seed": (
        [METERED],
        lambda it: (it.board.whole.power.metering, it.board.whole.power.low_level),
        (replace(table_one.METERING, seed=1), FULL * 3 // 10),
    ),
    # 250 cycles take 10 % of the capacity, two years 6 %.
    "batteries of an age fill and empty sooner": (
        [power_with("ageing: {cycles: 250, years: 2}")],
        lambda it: [*loads_of(it, Rail.PI), it.board.charge.segments[0][1]],
        [it * 10_000 // 8400 for it in (table_one.LOADS.of[Rail.PI], table_one.MODEL.segments[0][1])],
    ),
    "what lies between a dock and a charger": (
        [
            (
                DOCK_LINE,
                "  pin_debounce_ms: 50\n  pin_chatter_ms: 900\n  pin_check_s: 30\n  coil_alignment_s: 1.5",
            )
        ],
        lambda it: (it.board.pin_chatter_ms, it.board.pin_check_ms, it.body.coil_alignment_ms),
        (900, 30_000, 1500),
    ),
    "one number of a cycle is overridden": (
        [(CYCLE_LINE, "cycle: {profile: field, alarm_s: 1800, slots: null}")],
        lambda it: it.board.whole.cycle,
        replace(table_one.FIELD, alarm_ms=1_800_000, slots=None),
    ),
    "a clock that drifts and a firmware that knows it": (
        [
            ("    transmit_ms: 1000", CLOCK),
            (CYCLE_LINE, "cycle: {profile: field, slots: {frame_s: 300, slot_s: 5, guard_s: 1.5}}"),
        ],
        lambda it: (it.board.whole.timekeeping, it.board.whole.cycle.slots),
        (Timekeeping(20_000, 90_000), Timeslots(300_000, 5000, 1500)),
    ),
    "never asleep is no cycle": ([(CYCLE_LINE, "cycle: never")], lambda it: it.board.whole.cycle, None),
}
"""Changes, and what the firmware's configuration then has."""


@pytest.mark.parametrize(("changes", "what", "value"), READ.values(), ids=READ)
def test_what_a_scenario_gives_the_firmware(
    changes: list[tuple[str, str]], what: Callable[[FleetConfig], Any], value: Any
) -> None:
    assert what(fleet_parts.fleet_config(flight_config(changed(*changes)))) == value


def test_each_clock_drifts_by_a_rate_of_its_own() -> None:
    maker = fleet_parts.fleet_config(flight_config(changed(("    transmit_ms: 1000", CLOCK)))).maker()
    drifts = {maker.config(agent_id).board.drift_ppb for agent_id in range(1, 13)}
    assert len(drifts) == 12 and max(map(abs, drifts)) <= 12_500


def test_the_worst_case_has_no_whole_firmware() -> None:
    board = fleet_parts.fleet_config(flight_config(load(POOL_FILE))).board
    assert (board.whole, board.charge) == (None, table_one.WORST_CASE)


def test_the_modules_of_a_scenario_are_those_of_the_board() -> None:
    assert [field.name for field in fields(ModuleLoads)] == [rail.name.lower() for rail in Rail]


def test_a_resolved_scenario_holds_its_profile_s_numbers_and_is_the_same_again(tmp_path: Path) -> None:
    write_resolved(tmp_path / "scenario.yaml", SHIPPED)
    written = yaml.safe_load((tmp_path / "scenario.yaml").read_text())["board"]["whole"]
    assert written["power"]["loads_mw"]["wifi"] == 500.0
    assert written["cycle"]["slots"] == {"frame_s": 300.0, "slot_s": 5.0, "guard_s": 0.0}
    assert load(tmp_path / "scenario.yaml") == SHIPPED
    assert from_data(resolve(changed((CYCLE_LINE, "cycle: never"))), "again").board.whole.cycle is None  # type: ignore[union-attr]


def test_a_fleet_too_large_for_its_frame_is_refused_on_the_command_line_too() -> None:
    data = resolve(SHIPPED)
    data["fleet"]["start"] = {"charge": [0.5, 1]}
    with pytest.raises(ScenarioError) as caught:
        with_overrides(from_data(data, "x"), agents=61)
    assert caught.value.lines == (
        "command line: board.whole.cycle.slots.frame_s: holds 60 slots of 5 s, and 61 aMussels need one each: "
        "make it 305 s or more, or slot_s shorter",
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            *power_with("ageing: {cycles: 3000, years: 1}"),
            "board.whole.power.ageing: nothing is left of a battery after 3000 cycles and 1 years",
        ),
        (
            "  pin_debounce_ms: 50 ",
            "  pin_debounce_ms: 2500 ",
            "board: pin_chatter_ms must be longer than pin_debounce_ms",
        ),
        (
            "power: table-one",
            "power: table-1",
            "board.whole.power.profile: must be 'table-one', not 'table-1'",
        ),
        (CYCLE_LINE, "cycle: hurly", "board.whole.cycle.profile: must be 'hourly' or 'field', not 'hurly'"),
        (CYCLE_LINE, "cycle: 3", "board.whole.cycle: must be a mapping, not 3"),
        (
            "power: table-one",
            "power: {profile: table-one, loads_mw: {wify: 3}}",
            "board.whole.power.loads_mw.wify: unknown key: did you mean wifi?",
        ),
        (
            "power: table-one",
            "power: {profile: table-one, kept_on: [pie]}",
            "board.whole.power.kept_on[0]: must be the name of a module: mu_asleep, mu_active, oxygen, pressure, "
            "temperature, turbidity, pi, modem_listening, modem_receiving, modem_transmitting, wifi, gsm, bluetooth, "
            "motors, not 'pie'",
        ),
        (
            "power: table-one",
            "power: {profile: table-one, charge_segments: [[1.0, 0.00123456789012]]}",
            "board.whole.power.charge_segments[0][1]: must have at most ten decimals, not 0.00123456789012",
        ),
        (
            "power: table-one",
            "power: {profile: table-one, charge_segments: [[0.9, 0.001]]}",
            "board.whole.power.charge_segments: must rise and end at 1.0",
        ),
        (
            "action: call",
            "action: cry",
            "board.whole.last_resort.action: must be 'wait', 'call' or 'surface', not 'cry'",
        ),
        ("    transmit_ms: 1000 # assumed\n", "", "board.whole.transmit_ms: this key is missing"),
        (
            "  whole:",
            "  discharge_per_min: 0.001\n  whole:",
            "board: discharge_per_min must be left out where `whole` is: its numbers are in whole.power",
        ),
        (
            CYCLE_LINE,
            "cycle: {profile: field, slots: {frame_s: 30, slot_s: 5}}",
            "board.whole.cycle.slots.frame_s: holds 6 slots of 5 s, and 12 aMussels need one each: "
            "make it 60 s or more, or slot_s shorter",
        ),
        (
            "transmit_ms: 1000",
            "transmit_ms: 6000",
            "board.whole.cycle.slots.slot_s: must be no shorter than a status and the guard on either side of it (6 s), "
            "or two would overlap",
        ),
        (
            CYCLE_LINE,
            "cycle: {profile: field, alarm_s: 300}",
            "board.whole.cycle.alarm_s: must be longer than a wake, which takes up to 371 s (sample_s, processing_s, "
            "a whole frame, transmit_ms, a beacon's wait), or alarms pass unheard",
        ),
        (
            "hover_period_s: 600",
            "hover_period_s: 60",
            "board.whole.hover_period_s: must be longer than a motor run (60 s), or hovering never ends one",
        ),
        (
            "call_period_s: 600",
            "call_period_s: 1",
            "board.whole.last_resort.call_period_s: must be longer than a call takes, which is transmit_ms (1000 ms)",
        ),
        (
            "power: table-one",
            "power: {profile: table-one, kept_on: [motors]}",
            "mission.full_threshold: is never reached in a dock: the modules there draw more than the charger gives. "
            "Lower it, or keep less on",
        ),
    ],
)
def test_one_mistake_is_one_line_with_the_mend(old: str, new: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        changed((old, new))
    assert caught.value.lines == (f"it: {message}",)


@pytest.mark.parametrize(
    ("block", "change", "message"),
    [
        (
            "board",
            {"discharge_per_min": None},
            "board: discharge_per_min must be given, or `whole` for the whole",
        ),
        (
            "mission",
            {"full_when": "both"},
            "mission.full_when: a board without `whole` charges its primary",
        ),
    ],
)
def test_the_worst_case_needs_its_equations_and_charges_one_battery(
    block: str, change: dict[str, object], message: str
) -> None:
    pool = resolve(load(POOL_FILE))
    pool[block] |= change
    with pytest.raises(ScenarioError) as caught:
        from_data(pool, "it")
    assert caught.value.lines[0].startswith(f"it: {message}")


NOTHING = ", ".join(f"{it.name}: 0.000000001" for it in fields(ModuleLoads))


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (
            f"capacity_wh: 1000000, loads_mw: {{{NOTHING}}}",
            r"capacity_wh: no module draws what could be counted of 1e.06 Wh",
        ),
        ("capacity_wh: 1000000000", "capacity_wh: must be less than or equal to 1000000"),
    ],
    ids=["no load", "too large"],
)
def test_a_battery_that_nothing_can_empty_is_refused_before_the_flight(keys: str, told: str) -> None:
    with pytest.raises(ScenarioError, match=told):
        changed(power_with(keys))

"""Scenarios with the whole firmware: their conversion, the keys that a profile fills in, and refused values."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml
from scenario_files import POOL_FILE, SCENARIO_FILES, WHOLE_FILE

from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.firmware_config import board_config, charge_model
from apad_bridge.scenario.full_firmware_options import ModuleLoads
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


def test_the_profiles_are_table_one_to_the_grain() -> None:
    whole = board_config(SHIPPED.board).whole
    assert (whole.power, whole.cycle) == (table_one.power(LastResort.CALL), table_one.FIELD)
    assert charge_model(SHIPPED.board) == table_one.MODEL
    hourly = board_config(changed((CYCLE_LINE, "cycle: hourly")).board).whole
    assert hourly is not None and hourly.cycle == replace(table_one.HOURLY, report_ms=60_000)


def test_the_worst_case_has_no_whole_firmware() -> None:
    pool = load(POOL_FILE)
    assert fleet_parts.fleet_config(flight_config(pool)).board.whole is None
    assert charge_model(pool.board) == table_one.WORST_CASE


def test_one_module_is_overridden_and_the_others_stay() -> None:
    scenario = changed(
        ("power: table-one", "power: {profile: table-one, loads_mw: {gsm: 0, pi: 1200.5}, kept_on: [pi]}")
    )
    whole = board_config(scenario.board).whole
    # 1200.5 mW of 7.4 Wh: 1.2005 / 7.4 / 3.6e6 of a battery a millisecond.
    assert whole.power.loads.of[Rail.PI] == round(FULL * 1.2005 / 7.4 / 3_600_000)
    assert whole.power.loads.of[Rail.GSM] == 0
    same = [rail for rail in Rail if rail not in (Rail.PI, Rail.GSM)]
    assert all(whole.power.loads.of[rail] == table_one.LOADS.of[rail] for rail in same)
    assert whole.power.kept_on == bits(Rail.PI)


def test_twice_the_capacity_lasts_twice_as_long() -> None:
    whole = board_config(
        changed(("power: table-one", "power: {profile: table-one, capacity_wh: 14.8}")).board
    ).whole
    assert all(
        abs(2 * ours - theirs) <= 1
        for ours, theirs in zip(whole.power.loads.of, table_one.LOADS.of, strict=True)
    )


def test_metering_is_table_one_s_to_the_grain_with_the_scenario_s_seed() -> None:
    fleet = fleet_parts.fleet_config(
        flight_config(changed(power_with("metering: table-one, low_level: 0.3")))
    )
    assert fleet.board.whole.power.metering == replace(table_one.METERING, seed=1)
    assert fleet.board.whole.power.low_level == FULL * 3 // 10


def test_batteries_of_an_age_fill_and_empty_sooner() -> None:
    board = changed(power_with("ageing: {cycles: 250, years: 2}")).board
    whole = board_config(board).whole
    # 250 cycles take 10 % of the capacity, two years 6 %.
    assert whole.power.loads.of[Rail.PI] == table_one.LOADS.of[Rail.PI] * 10_000 // 8400
    assert charge_model(board).segments[0][1] == table_one.MODEL.segments[0][1] * 10_000 // 8400


def test_what_lies_between_a_dock_and_a_charger() -> None:
    scenario = changed(
        (
            "  pin_debounce_ms: 50 # assumed, as all up to `whole`",
            "  pin_debounce_ms: 50\n  pin_chatter_ms: 900\n  pin_check_s: 30\n  coil_alignment_s: 1.5",
        )
    )
    fleet = fleet_parts.fleet_config(flight_config(scenario))
    board = fleet.maker().config(1).board
    assert (board.pin_chatter_ms, board.pin_check_ms, fleet.body.coil_alignment_ms) == (900, 30_000, 1500)


def test_one_number_of_a_cycle_is_overridden() -> None:
    scenario = changed((CYCLE_LINE, "cycle: {profile: field, alarm_s: 1800, slots: null}"))
    whole = board_config(scenario.board).whole
    assert whole is not None and whole.cycle is not None
    assert (whole.cycle.alarm_ms, whole.cycle.processing_ms, whole.cycle.slots) == (1_800_000, 60_000, None)


def test_a_clock_that_drifts_and_a_firmware_that_knows_it() -> None:
    fleet = fleet_parts.fleet_config(
        flight_config(
            changed(
                (
                    "    transmit_ms: 1000",
                    "    timekeeping: {bound_ppm: 20, beacon_wait_s: 90}\n    clock_drift_ppm: 12.5\n    transmit_ms: 1000",
                ),
                (CYCLE_LINE, "cycle: {profile: field, slots: {frame_s: 300, slot_s: 5, guard_s: 1.5}}"),
            )
        )
    )
    assert fleet.board.whole is not None and fleet.board.whole.cycle is not None
    assert fleet.board.whole.timekeeping == Timekeeping(20_000, 90_000)
    assert fleet.board.whole.cycle.slots == Timeslots(300_000, 5000, 1500)
    drifts = {fleet.maker().config(agent_id).board.drift_ppb for agent_id in range(1, 13)}
    assert len(drifts) == 12 and max(map(abs, drifts)) <= 12_500


def test_never_asleep_is_no_cycle() -> None:
    assert (
        fleet_parts.fleet_config(flight_config(changed((CYCLE_LINE, "cycle: never")))).board.whole.cycle
        is None
    )  # type: ignore[union-attr]


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
    with pytest.raises(ScenarioError) as caught:
        with_overrides(
            from_data(
                {**resolve(SHIPPED), "fleet": {**resolve(SHIPPED)["fleet"], "start": {"charge": [0.5, 1]}}},
                "x",
            ),
            agents=61,
        )
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


def test_a_battery_that_nothing_can_empty_is_refused_before_the_flight() -> None:
    nothing = ", ".join(f"{it.name}: 0.000000001" for it in fields(ModuleLoads))
    with pytest.raises(
        ScenarioError, match=r"capacity_wh: no module draws what could be counted of 1e.06 Wh"
    ):
        changed(power_with(f"capacity_wh: 1000000, loads_mw: {{{nothing}}}"))
    with pytest.raises(ScenarioError, match="capacity_wh: must be less than or equal to 1000000"):
        changed(power_with("capacity_wh: 1000000000"))

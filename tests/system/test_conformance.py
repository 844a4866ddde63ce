"""`musselbed mu conform`: the C board passes, the Perl board fails what it leaves out, and mutants are caught."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from mutants import campaign as mutants
from native_boards import NATIVE, compiled, compiled_with, script

from apad_bridge.commands.main import main
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES

pytestmark = pytest.mark.system
PERL = NATIVE / "worst_case.pl"
CLAIMS_LESS = {
    "chatter-mostly-high",
    "chatter-60-percent-high",
    "chatter-51-percent-high",
    "chatter-that-turns",
    "missed-rise",
    "missed-fall",
    "a-wake-finds-it",
    "a-boot-finds-it",
    "a-way-down-finds-it",
    "a-look-after-a-reset",
    "a-look-while-it-debounces",
    "the-counter-wraps-while-it-comes-up-and-before-a-look",
    "a-level-repeated",
    "a-rise-missed-in-a-touch",
    "counts-what-it-refuses",
    "a-ping-for-all",
}
"""The cases of a pin that chatters, repeats its level or whose edge is lost, and of refused inputs: the Perl board
leaves these out."""


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory)


def all_passed(capsys: pytest.CaptureFixture[str], *arguments: str) -> int:
    """Judges a program, and asserts that it passes: the number of its cases."""
    code = main(["mu", "conform", *arguments, "--json"])
    results = json.loads(capsys.readouterr().out)
    assert {it["case"]: it["reason"] for it in results if it["verdict"] != "passed"} == {}
    assert code == 0
    return len(results)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("(void)board", "found nothing more"),
        ("mu_state((const uint8_t[]){0, 1, 2, 9, 10, 12, 13, 14, 16}[board.state])", "state SLEEPING"),
    ],
    ids=["told never", "numbered otherwise"],
)
def test_a_board_of_other_states_fails(
    tmp_path_factory: pytest.TempPathFactory, text: str, found: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Missions obey states. By hand: a board that surfaces is SURFACING, and 9 is the number of another state."""
    source, program = NATIVE / "worst_case.c", tmp_path_factory.mktemp("stateless") / "board"
    told = "mu_state((uint8_t)board.state)"
    compiled_with(tmp_path_factory, source, source.read_text().replace(told, text), program)
    assert main(["mu", "conform", str(program), "--case", "surfaces", "--json"]) == 3
    (result,) = json.loads(capsys.readouterr().out)
    assert found in result["reason"]


SLOW = {it.name for it in WHOLE_CASES[::2] if not it.is_near_tie}
"""The cases of the whole board that are played while its turns take time; the others are played as they are."""


@pytest.mark.parametrize(
    ("name", "profile", "chosen", "options"),
    [
        ("worst_case", "worst-case", {it.name for it in CASES[1::2] if not it.is_near_tie}, ("--cost", "5")),
        ("whole_board", "mu", SLOW, ("--cost", "5")),
        ("whole_board", "mu", {it.name for it in WHOLE_CASES} - SLOW, ()),
    ],
)
def test_a_c_board_passes_everything_also_while_its_turns_take_time(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    profile: str,
    chosen: set[str],
    options: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """That of the worst case passes its cases as they are by a page's own command: `test_firmware_page.py`."""
    words = [word for it in sorted(chosen) for word in ("--case", it)]
    program = str(compiled(tmp_path_factory, name))
    asked = ("--profile", profile, *options, "--seed", "2", "--random", "20")
    assert all_passed(capsys, program, *words, *asked) == 20 + len(chosen) > 80


def test_a_board_of_the_worst_case_is_no_whole_board(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It never sleeps, and it fails by Table I alone; the failed case prints both histories."""
    asleep = ["--profile", "mu", "--case", "table-1-asleep", "--case", "uploads"]
    assert main(["mu", "conform", str(board), *asleep]) == 3
    shown = capsys.readouterr().out
    assert "2 failed" in shown
    assert "expected" in shown and " ! " in shown


@pytest.mark.parametrize(("profile", "least"), [("worst-case", 30), ("mu", 10)])
def test_the_cases_for_a_serial_line_take_less_than_five_minutes_each(
    tmp_path: Path, profile: str, least: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Asked of a program that is dead: the choice is the same, and takes no time."""
    dead = script(tmp_path, "sys.exit(1)")
    assert main(["mu", "conform", str(dead), "--profile", profile, "--serial", "--json"]) == 3
    results = json.loads(capsys.readouterr().out)
    assert len(results) >= least
    assert all(not re.search(r"\d+h|[5-9]min|\d\dmin", it["script"]) for it in results)


def test_a_captured_trace_is_a_case(board: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The trace of the C board in a missed edge fails the Perl board, which leaves that out."""
    trace = tmp_path / "missed.trace"
    assert main(["mu", "conform", str(board), "--case", "missed-rise", "--capture", str(trace)]) == 0
    assert "120.050 > charges" in trace.read_text() and "120.050 > state CHARGING" in trace.read_text()
    codes = [main(["mu", "conform", str(it), "--captured", str(trace)]) for it in (board, PERL)]
    assert codes == [0, 3] and "a captured trace" in capsys.readouterr().out


def test_the_perl_board_fails_what_it_leaves_out_and_may_waive_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junit = tmp_path / "results.xml"
    assert main(["mu", "conform", str(PERL), "--junit", str(junit)]) == 3
    shown = capsys.readouterr().out
    assert "missed-rise: 3s permission 70s rises_unseen 1h" in shown
    assert " ! 120.050 s charges" in shown
    failed = {
        case.get("name")
        for case in ElementTree.parse(junit).iter("testcase")
        if case.find("failure") is not None
    }
    counted = {it.name for it in CASES if it.counts_refusals}
    assert CLAIMS_LESS <= failed <= CLAIMS_LESS | counted  # it counts nothing
    assert f"{len(CASES) - len(failed)} passed, {len(failed)} failed" in " ".join(shown.split())
    waivers = tmp_path / "waivers.yaml"
    waivers.write_text("".join(f"{name}: our contacts do not bounce\n" for name in CLAIMS_LESS))
    cases = [word for name in (*CLAIMS_LESS, "surfaces-once") for word in ("--case", name)]
    assert main(["mu", "conform", str(PERL), "--waive", str(waivers), *cases]) == 0
    assert f"1 passed, {len(CLAIMS_LESS)} waived" in capsys.readouterr().out


def test_a_failed_case_s_script_can_be_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mu", "conform", str(PERL), "--script", "3s permission 70s rises_unseen 1h"]) == 3
    assert "1 failed" in capsys.readouterr().out


def test_a_script_has_the_board_of_a_case(board: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By hand: the battery of `charges-from-empty` is at 5 %, so it is empty within an hour (a full one in 962 min)."""
    options = ["--script", "1h", "--case", "charges-from-empty", "--json"]
    assert main(["mu", "conform", str(board), *options]) == 0
    (result,) = json.loads(capsys.readouterr().out)
    assert result["expected"]["charge"] == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["/nowhere/board"], "is no program"),
        (["/bin/true", "--case", "nothing"], "--case nothing: there are measures"),
        (["/bin/true", "--script", "jump"], "--script: 'jump' is neither a wait"),
        (
            ["/bin/true", "--script", "1s", "--case", "a-ping", "--case", "a-hover"],
            "--script: name one --case",
        ),
        (["/bin/true", "--waive", "/nowhere"], "/nowhere: No such file"),
        (["/bin/true", "--captured", "/nowhere"], "/nowhere: "),
    ],
)
def test_a_mistake_is_told_before_anything_starts(
    arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mu", "conform", *arguments]) == 2
    assert told in capsys.readouterr().err


MUTANTS = {
    "an empty board takes no permission": (
        "IN(ACTIVE) | IN(EMPTY) | IN(SINKING), SURFACING",
        "IN(ACTIVE) | IN(SINKING), SURFACING",
        "empty-and-fetched",
    ),
    "a counter that never wraps": (
        "mu_reached(board.deadline)",
        "mu_now() >= board.deadline",
        "the-counter-wraps-afloat",
    ),
    "a chatter summed over its spells": (
        "        pin.high_ticks = 0;\n    }\n",
        "    }\n",
        "two-spells-of-chatter",
    ),
    "a refusal that is not counted": ('mu_refuse("for another aMussel");', ";", "counts-what-it-refuses"),
    "a release of any length": (
        "size != COMMANDS[n].size || ",
        "(size != COMMANDS[n].size && COMMANDS[n].kind != 3) || ",
        "every-layout-afloat",
    ),
    "an id of one byte": ("(uint16_t)(data[2] | data[3] << 8)", "(uint16_t)data[2]", "for-257"),
    "no check of the CRC": (
        "mu_crc(data, size - 2) != (data[size - 2] | data[size - 1] << 8)",
        "false",
        "bit-39-flipped",
    ),
    "a kind of any version": (" || data[0] != COMMANDS[n].version", "", "another-version"),
    "no look for lost edges": (
        "next_check += CHECK_TICKS;\n        check_pin();",
        "next_check += CHECK_TICKS;",
        "missed-rise",
    ),
    "a debounce of no time": ("pin.flipped + mu_ticks(mu_config()->debounce_ms)", "pin.flipped", "a-touch"),
    "a charger that stays on": (
        "mu_pin(MU_CHARGE, board.state == CHARGING)",
        "mu_pin(MU_CHARGE, true)",
        "charges-no-longer",
    ),
    "motors the wrong way": ("run_motors(MU_MOTOR_DOWN)", "run_motors(MU_MOTOR_UP)", "sinks-when-released"),
    "a release that is kept": ("board.clear_to_sink = false;", "", "a-release-is-used-once"),
    "a repeated level that is an edge": (
        "            sample_pin();\n",
        "            if (!sample_pin())\n                pin.flipped = mu_now();\n",
        "a-level-repeated",
    ),
    "looks that count from a reset on": (
        "next_check = (mu_now() / CHECK_TICKS + 1) * CHECK_TICKS;",
        "next_check = mu_now() + CHECK_TICKS;",
        "a-look-after-a-reset",
    ),
    "a boot's end without a look": (
        "board.state != CHARGING && board.state != EMPTY)",
        "board.state != CHARGING && board.state != EMPTY && board.state != ACTIVE)",
        "a-boot-finds-it",
    ),
    "a way down without a look": (
        "board.state != CHARGING && board.state != EMPTY)",
        "board.state != CHARGING && board.state != EMPTY && board.state != SINKING)",
        "a-way-down-finds-it",
    ),
    "a debounce that ends without a look": (
        "    if (check_pin())\n        return;\n    if (mu_reached(",
        "    if (mu_reached(",
        "a-rise-missed-in-a-touch",
    ),
    "a permission that prolongs a float": (
        "IN(ACTIVE) | IN(EMPTY) | IN(SINKING), SURFACING},",
        "IN(ACTIVE) | IN(EMPTY) | IN(SINKING), SURFACING}, {PERMISSION_HEARD, IN(FLOATING), FLOATING},",
        "permission-prolongs-no-float",
    ),
    "a ping to everyone that is not counted": (
        'mu_refuse("a ping for everyone: all would answer at once");',
        ";",
        "a-ping-for-all",
    ),
    "a ping on the way down that is counted": (
        "IN(SURFACING) | IN(SINKING), STAYS}",
        "IN(SURFACING), STAYS}",
        "a-ping-down",
    ),
    "a surface that is not noticed on the way down": (
        "IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(SINKING), FLOATING",
        "IN(ACTIVE) | IN(EMPTY) | IN(SURFACING), FLOATING",
        "touches-the-surface",
    ),
    **{
        f"{value} ms whatever HELLO has": (
            f"config->{time}_ms" if time != "debounce" else "mu_config()->debounce_ms",
            str(value),
            f"other-times-of-{case}",
        )
        for time, value, case in (
            ("boot", 2000, "a-boot"),
            ("surfacing_timeout", 180_000, "a-surfacing"),
            ("float_timeout", 43_200_000, "a-float"),
            ("release_wait", 120_000, "a-release"),
            ("debounce", 50, "an-edge"),
        )
    },
}
"""Hand-written changes of the C board: (text, text in its place, the case that catches it)."""


WHOLE_MUTANTS = {
    "a timeslot that is 15 ms late": (
        "state_task.c",
        "ends_at_reading(reading, SLOT_OPENED)",
        "ends_at_reading(reading + 15, SLOT_OPENED)",
        "in-slot-7",
    ),
    "an offset of the other sign": (
        "clock.c",
        "(int32_t)corrected;",
        "-(int32_t)corrected;",
        "reports-a-clock-ahead",
    ),
    "a schedule that a sleeping board does not take": (
        "command_task.c",
        "case SLEEP_SCHEDULE:",
        "case SLEEP_SCHEDULE:\n        if (board.state == SLEEPING)\n            return;",
        "each-minute-told-in-its-sleep",
    ),
    "a sample that is never marked as saturated": (
        "sample_log.c",
        "put_bytes(&at, saturated, 1);",
        "put_bytes(&at, 0, 1);",
        "beyond-a-sensor-s-range",
    ),
    "a torn record that is not counted": (
        "sample_log.c",
        "log_state.torn = torn + unwritable;",
        "log_state.torn = unwritable;",
        "torn-again-and-again",
    ),
    "a sequence that is used again": (
        "sample_log.c",
        "log_state.next = known + unwritable;",
        "log_state.next = known;",
        "torn-at-a-page-s-edge",
    ),
    "a kind of any version": (
        "command_task.c",
        " && data[0] == COMMANDS[n].version",
        "",
        "other-versions",
    ),
    "chatter in which no high time is counted": (
        "pin_task.c",
        "    pin.high_ms += pin.seen ? hal_now() - pin.counted : 0;\n",
        "",
        "chatter-mostly-high",
    ),
    "an acknowledgement that is forgotten": (
        "sample_log.c",
        "    log_state.acknowledged = next;\n",
        "",
        "an-acknowledgement-lost",
    ),
    "a repeated acknowledgement that asks for nothing": (
        "sample_log.c",
        "        log_upload();\n        return true;",
        "        return true;",
        "an-acknowledgement-twice",
    ),
    "records without a look at their check": (
        "sample_log.c",
        "    return whole ? ",
        "    return true ? ",
        "worn-cells",
    ),
    "an alarm that rings twice": (
        "clock.c",
        "    if (reading > passed || was_set_back(reading))\n        passed = reading;",
        "    passed = reading;",
        "no-alarm-twice",
    ),
    "a clock set back that goes on with the former count": (
        "clock.c",
        "    if (was_set_back(reading))\n        passed = reading;\n",
        "",
        "a-new-count-from-0",
    ),
    "a timeslot without its offset": ("clock.c", " + settings.offset_ms;", ";", "an-offset-of-300-ms"),
    "a trusted clock": (
        "clock.c",
        "config->doubts_clock && doubt > settings.guard_ms",
        "false",
        "a-clock-in-doubt",
    ),
    "settings that a reset forgets": (
        "clock.c",
        "    hal_store_settings(&settings);\n",
        "",
        "settings-outlive-a-reset",
    ),
    "a low level that wakes nobody": (
        "states.c",
        "    {LOW_LEVEL_REACHED, S(SLEEPING), SAMPLING},\n",
        "",
        "low-level",
    ),
    "a sleep in which nothing sleeps": (
        "state_task.c",
        "HAL_DEEP : HAL_AWAKE",
        "HAL_AWAKE : HAL_AWAKE",
        "table-1-asleep",
    ),
    "a last resort that does not wait": (
        "state_task.c",
        "at > board.stays_down_until ? at : board.stays_down_until",
        "at",
        "stays-down-when-told",
    ),
    "a last resort that a dock does not end": (
        "pin_task.c",
        "        board.last_resort = HAL_NEVER;\n",
        "",
        "a-last-resort-ends-in-a-dock",
    ),
    "a docked board that takes no release": (
        "command_task.c",
        "board.state == CHARGING || board.state == REPORTING",
        "false",
        "release-before-the-edge",
    ),
    "a release that ends with its report": (
        "state_task.c",
        "    clock_pass_over();\n    hal_rails",
        "    board.clear_to_sink = false;\n    clock_pass_over();\n    hal_rails",
        "release-before-the-edge",
    ),
    "a release that is kept for the next dock": (
        "pin_task.c",
        "        board.clear_to_sink = false;\n",
        "",
        "a-release-is-used-once",
    ),
    "looks that count from a reset on": (
        "pin_task.c",
        "(hal_now() / check_ms + 1) * check_ms",
        "hal_now() + check_ms",
        "a-look-after-a-reset",
    ),
    "a debounce that ends without a look": (
        "pin_task.c",
        "    bool missed = sample();",
        "    bool missed = !pin.settling && sample();",
        "a-rise-missed-in-a-touch",
    ),
    **{
        f"a begin of {state} without a look": (
            "state_task.c",
            "    if (state != SLEEPING &&",
            f"    if (state != {state} && state != SLEEPING &&",
            f"{name}-finds-it",
        )
        for state, name in (
            ("ACTIVE", "a-boot"),
            ("FLOATING", "a-surface"),
            ("SINKING", "a-way-down"),
            ("SAMPLING", "a-sampling"),
            ("PROCESSING", "the-pi"),
            ("HOVERING", "a-hover"),
        )
    },
    "a permission that prolongs a float": (
        "states.c",
        "    {SURFACE_REACHED,",
        "    {PERMISSION_HEARD, S(FLOATING), FLOATING},\n    {SURFACE_REACHED,",
        "permission-prolongs-no-float",
    ),
    "a ping to everyone that is not counted": (
        "command_task.c",
        'hal_refuse("a ping for everyone: all would answer at once");',
        ";",
        "a-ping-for-all",
    ),
    "a slot whose end has 32 bits": (
        "command_task.c",
        "(changed.slot + UINT64_C(1)) * changed.slot_ms",
        "(uint32_t)((changed.slot + UINT64_C(1)) * changed.slot_ms)",
        "a-slot-beyond-32-bits",
    ),
    "a low level that wakes a listening board": (
        "states.c",
        "{LOW_LEVEL_REACHED, S(SLEEPING), SAMPLING}",
        "{LOW_LEVEL_REACHED, S(SLEEPING) | S(ACTIVE), SAMPLING}",
        "low-level-while-it-listens",
    ),
    "a torn record before the first whole one that is not counted": (
        "sample_log.c",
        "            ++*unreadable;",
        "            *unreadable += *first != UNKNOWN;",
        "torn-before-every-whole-one",
    ),
    "an acknowledgement of one record too many": (
        "sample_log.c",
        "    if (next > log_state.next)",
        "    if (next > log_state.next + 1)",
        "never-taken-by-one",
    ),
    "an empty battery that does not end a hover": (
        "states.c",
        "    {BATTERY_EMPTIED, S(HOVERING), SINKING},\n",
        "",
        "empties-while-it-hovers",
    ),
}
"""Hand-written changes of the whole board: (file, text, text in its place, the case that catches it)."""


@pytest.mark.parametrize(
    ("profile", "name"), [*(("worst-case", it) for it in MUTANTS), *(("mu", it) for it in WHOLE_MUTANTS)]
)
def test_a_mutant_is_caught(
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
    profile: str,
    name: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, old, new, case = (
        (f"whole/{WHOLE_MUTANTS[name][0]}", *WHOLE_MUTANTS[name][1:])
        if profile == "mu"
        else ("worst_case.c", *MUTANTS[name])
    )
    source, mutant = NATIVE / file, tmp_path / "mutant"
    assert old in source.read_text()
    compiled_with(
        tmp_path_factory, source, source.read_text().replace(old, new, 1 if profile == "mu" else -1), mutant
    )
    assert main(["mu", "conform", str(mutant), "--profile", profile, "--case", case]) == 3
    assert "1 failed" in capsys.readouterr().out


def test_generated_mutants_of_both_boards_are_caught() -> None:
    """A short form of `tests/campaigns/run mutants`."""
    rows = mutants.measure(tries=2, row=["first"])["boards"]
    assert [(it["board"], it["mutants"], it["caught"]) for it in rows] == [
        ("worst case", 2, 2),
        ("whole", 2, 2),
    ]

"""`musselbed mu`: its output, its refusals, and the budgets against hand calculation."""

import json
import re
from pathlib import Path

import pytest

from apad_bridge.commands.firmware.mu_script import Budget, budget_of, play, read_script
from apad_bridge.commands.main import main
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from firmware_model.bench.state_diagram import blocks

PAGE = Path(__file__).parents[3] / "docs/mu-scripts.md"


def script(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "script.yaml"
    path.write_text(text)
    return path


def played(path: Path) -> Budget:
    told = read_script(path)
    return budget_of(told, play(told))


def test_table1_as_json_has_the_paper_s_rows_and_says_what_was_fitted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["mu", "table1", "--json"]) == Exit.DONE
    told = json.loads(capsys.readouterr().out)
    paper = {row["mode"]: row["paper_min"] for row in told["rows"]}
    assert list(paper.values()) == [962, 14057, 575, 398, 485, 180]
    for row in told["rows"][:5]:
        assert row["run_min"] == pytest.approx(row["paper_min"], rel=0.01)
        assert row["metered_min"] == pytest.approx(row["paper_min"], rel=0.01)
    assert 150 <= told["rows"][5]["run_min"] <= 180
    assert len(told["fitted"]) < len(told["rows"])
    assert all(parameter["fitted_to"] and parameter["source"] for parameter in told["fitted"])


def test_table1_for_people_names_every_row_and_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mu", "table1"]) == Exit.DONE
    told, words = capsys.readouterr().out, "14057 398 mu_asleep two_coils path motor_run equation (1)"
    assert all(word in told for word in words.split())


def test_the_script_on_the_page_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = re.search(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    path = script(tmp_path, found.group(1))
    assert main(["mu", "run", str(path)]) == Exit.DONE
    assert "mWh" in capsys.readouterr().out
    assert main(["mu", "run", str(path), "--json"]) == Exit.DONE
    told = json.loads(capsys.readouterr().out)
    # From 6.1 h to 9 h in the dock, less the debounce times and a minute for the reports at 7 and 8 h each.
    assert told["state_hours"]["CHARGING"] == pytest.approx(2.9 - 2 / 60, abs=0.001)
    assert sum(told["state_hours"].values()) == pytest.approx(20)
    assert (told["secondary"], told["dropped"]) == (1.0, 0)


def test_a_board_that_never_sleeps_lives_as_long_as_equation_1_says(tmp_path: Path) -> None:
    budget = played(script(tmp_path, "{hours: 10, sleep: never, primary: 1, secondary: 1}"))
    assert budget.life_hours == pytest.approx(1 / 0.0010427134 / 60, rel=1e-4)
    assert budget.primary == pytest.approx(1 - 600 * 0.0010427134, abs=1e-4)
    assert sum(budget.by_rail.values()) == pytest.approx(sum(budget.by_state.values()))


def test_the_pi_kept_on_draws_its_share(tmp_path: Path) -> None:
    text = "{hours: 2, sleep: hourly, primary: 1, secondary: 1, kept_on: [pi]}"
    budget = played(script(tmp_path, text))
    # 1000 mW for 2 h out of 7400 mWh.
    assert budget.by_rail["PI"] == pytest.approx(2000 / 7400, rel=1e-6)
    assert budget.samples == 1  # the wake at 2 h has only begun


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{hours: 1, sleep: often, primary: 1, secondary: 1}", "sleep"),
        ("{hours: 0, sleep: never, primary: 1, secondary: 1}", "hours"),
        ("{hours: 1, sleep: never, primary: 1.2, secondary: 1}", "primary"),
        ("{hours: 1, sleep: never, primary: 1, secondary: 1, kept_on: [laser]}", "laser"),
        (
            "{hours: 1, sleep: never, primary: 1, secondary: 1, tell: [[1, sing]]}",
            "tell[0][1]: must be 'permission'",
        ),
        ("{hours: 1, sleep: never, primary: 1, secondary: 1, colour: red}", "colour"),
        ("hours: [", "script.yaml: line 1, column 9: "),
        ("", "a script is a mapping of keys to values, not null"),
        ("[1]", "a script is a mapping of keys to values, not [1]"),
        ("{hours: 2, sleep: never}", "primary: this key is missing; secondary: this key is missing"),
        ("{hour: 2, sleep: never, primary: 1, secondary: 1}", "hour: unknown key: did you mean hours?"),
        ("{hours: x, sleep: never, primary: 1, secondary: 1}", "hours: must be a valid number, not 'x'"),
        ("{hours: 1e-300, sleep: never, primary: 1, secondary: 1}", "hours: must be greater than"),
        ("{hours: 1, sleep: never, primary: 1, secondary: 1, years: 1e308}", "years: must be less than"),
        (
            "{hours: 1, sleep: never, primary: 1, secondary: 1, cycles: 9223372036854775808}",
            "cycles: must be less",
        ),
        (
            "{hours: 1, sleep: never, primary: 1, secondary: 1, tell: [[1e308, ping]]}",
            "tell[0][0]: must be less",
        ),
    ],
)
def test_a_script_with_a_mistake_is_one_line_that_names_it(
    tmp_path: Path, text: str, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = script(tmp_path, text)
    with pytest.raises(UserError, match=re.escape(fault)):
        read_script(path)
    assert main(["mu", "run", str(path)]) == Exit.USER_MISTAKE
    assert fault in capsys.readouterr().err


def test_the_predicted_life_counts_its_samples(tmp_path: Path) -> None:
    budget = played(script(tmp_path, "{hours: 10.5, sleep: hourly, primary: 1, secondary: 1}"))
    drawn = 1 - budget.primary
    assert budget.life_hours == pytest.approx(10.5 / drawn, rel=1e-6)
    # Ten wakes in 10.5 hours.
    assert budget.life_samples == int(10 / drawn)


def test_states_prints_what_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mu", "states"]) == Exit.DONE
    assert capsys.readouterr().out == blocks()


FULL = "primary: 1, secondary: 1"
PING = f"{{hours: 1.5, sleep: hourly, {FULL}, tell: [[0.5, ping]]}}"
CLOCK = f"hours: 2.2, sleep: hourly, {FULL}, clock_drift_ppm: 1000"
CLOCK = f"{{{CLOCK}, tell: [[1.5, beacon], [2.1, permission], [2.12, sink]]}}"
LONG = f"{{hours: 475, sleep: hourly, {FULL}, secondary_use: %s, last_resort: %s}}"
"""Table I: a battery feeds 14057 minutes of hourly wakes, so 234 of them. 0.2 of the secondary is the reserve."""
RUNS = {
    "a trace is not printed": (PING, "", Exit.DONE, r"(?!.*PING_HEARD).*"),
    "a trace that is asked for": (
        PING,
        "--trace",
        Exit.DONE,
        r".*  0:00:00.000  OFF -POWER_CAME_ON-> BOOTING\n.*  0:30:00.000  SLEEPING -PING_HEARD-> SLEEPING\n.*",
    ),
    # An hour of a clock that gains a thousandth is 3596.404 s; half an hour after the beacon it has gained 1.8 s.
    "a clock drifts until a beacon sets it, and sink is obeyed": (
        CLOCK,
        "--trace",
        Exit.DONE,
        r".*0:59:56.404  SLEEPING -ALARM_RANG-> SAMPLING.*1:59:58.202  SLEEPING -ALARM_RANG-> SAMPLING"
        r".*2:07:12.000  FLOATING -SINK_ORDERED-> SINKING.*",
    ),
    "a backup": (
        LONG % ("backup", "wait"),
        "",
        Exit.DONE,
        r".*, 234 samples,.*the secondary is a backup, on which it listens\s*",
    ),
    "a secondary in use": (
        LONG % ("in_use", "wait"),
        "",
        Exit.DONE,
        r".*, 468 samples,.*with the secondary twice that\s*",
    ),
    "a secondary in use, of which a call is kept": (
        LONG % ("in_use", "call"),
        "",
        Exit.DONE,
        r".*, 421 samples,.*with the secondary 1.8 times that\s*",
    ),
    "no folder for a VCD": (PING, "--vcd no/mu.vcd", Exit.USER_MISTAKE, r".*no/mu.vcd: No such file.*"),
}
"""A script, the options, the exit code and the pattern of what is told."""


@pytest.mark.parametrize(("text", "options", "code", "told"), RUNS.values(), ids=RUNS)
def test_a_script_is_played(
    text: str, options: str, code: int, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mu", "run", str(script(tmp_path, text)), *options.split()]) == code
    assert re.fullmatch(told, "".join(capsys.readouterr()), re.DOTALL)


def test_a_trace_is_in_the_json_and_a_vcd_in_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mu", "run", str(script(tmp_path, PING)), "--trace", "--json", "--vcd", str(tmp_path / "mu.vcd")]
    assert main(words) == Exit.DONE
    trace = json.loads(capsys.readouterr().out)["trace"]
    assert trace[0] == "  0:00:00.000  OFF -POWER_CAME_ON-> BOOTING"
    assert (tmp_path / "mu.vcd").read_text().startswith("$timescale 1ms")

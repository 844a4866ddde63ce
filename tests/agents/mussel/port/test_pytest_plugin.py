"""The plugin in a pytest of its own: the page's tests pass, and a failing test shows the board's actions."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from native_boards import compiled

from firmware_model.actions import SendStatus, StateChanged
from firmware_model.bench.pytest_plugin import make_bench
from firmware_model.states import State

ROOT = Path(__file__).parents[4]
INSTALLED = ("no:musselbed", "no:musselbed_programs")


def run_pytest(folder: Path, text: str, *more: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_board.py").write_text(text)
    (folder / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\n")
    # By name, so that it does not matter whether the package is installed; an installed one is not loaded twice.
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); import pytest; sys.exit(pytest.main(sys.argv[1:]))"
    )
    plugins = (
        "firmware_model.bench.pytest_plugin",
        "agents.mussel.port.pytest_plugin",
        "no:cacheprovider",
        *INSTALLED,
    )
    options = [word for plugin in plugins for word in ("-p", plugin)]
    return subprocess.run(
        [sys.executable, "-c", code, *options, *more, "-q", str(folder)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=folder,
        # A person's options for the whole suite are none of this one's.
        env={key: value for key, value in os.environ.items() if key != "PYTEST_ADDOPTS"},
    )


def of_the_page() -> str:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/mu-scripts.md").read_text(), re.DOTALL)
    return "from hypothesis import settings\n" + "".join(blocks)


def test_the_tests_on_the_page_pass(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, of_the_page())
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout


def test_the_tests_on_the_page_pass_with_a_board_in_c(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    program = compiled(tmp_path_factory, "whole_board")
    text = of_the_page().replace("@given(", "@settings(max_examples=10, deadline=None)\n@given(") + (
        "\n\ndef test_it_has_a_process(mu):\n"
        "    mu.run(hours=1.5)\n"
        "    assert open(f'/proc/{mu.board.firmware.pid}/comm').read() == 'whole_board\\n'\n"
    )
    done = run_pytest(tmp_path, text, "--mu-firmware", str(program))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 passed" in done.stdout


def test_a_program_that_is_none_is_told(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, "def test_it(mu):\n    mu.run(hours=1)\n", "--mu-firmware", "/nowhere/board")
    assert "--mu-firmware /nowhere/board: there is no such program" in done.stdout


def test_a_failure_shows_the_trace(tmp_path: Path) -> None:
    done = run_pytest(
        tmp_path, "def test_it(mu):\n    mu.run(hours=30)\n    assert mu.primary_fraction > 0.99\n"
    )
    assert done.returncode == 1
    assert "what the MU did" in done.stdout
    assert " 30:00:00.000  SLEEPING -ALARM_RANG-> SAMPLING" in done.stdout
    assert "lines before" in done.stdout
    assert "now: SAMPLING, primary 0.8" in done.stdout


def test_each_board_of_a_property_is_fresh_and_the_newest_is_told(tmp_path: Path) -> None:
    text = (
        "from hypothesis import given, strategies as st\n\n"
        "@given(hours=st.integers(1, 30))\n"
        "def test_it(make_mu, hours):\n"
        "    board = make_mu(primary=0.5)\n"
        "    assert board.now_ms == 0\n"
        "    board.run(hours=hours)\n"
        "    assert hours < 7\n"
    )
    done = run_pytest(tmp_path, text)
    assert done.returncode == 1
    assert "FailedHealthCheck" not in done.stdout
    assert "  7:00:00.000  now: SAMPLING, primary 0.4" in done.stdout, done.stdout


def test_words_of_the_clock_the_slot_and_the_boot_make_the_board() -> None:
    """By hand: slot 3 of 5 s begins 15 s into its frame, and the guard is half a second."""
    bench = make_bench(sleep="field", timeslot=(300, 5, 0.5, 3), drift_ppm=100, boot_s=5)
    assert [it.at_ms for it in bench.run(seconds=6) if isinstance(it, StateChanged)] == [5000]
    bench.run(hours=1.2)
    (sent,) = bench.did(SendStatus)
    assert bench.board.clock_ms(sent.at_ms) == 3_915_500
    assert sent.at_ms < 3_915_500
    with pytest.raises(ValueError, match="timeslot: a board that never sleeps has none"):
        make_bench(sleep="never", timeslot=(300, 5, 0.5, 3))


@pytest.mark.parametrize(
    "wrong",
    [{"sleep": "often"}, {"kept_on": ("laser",)}, {"last_resort": "pray"}],
    ids=lambda it: next(iter(it)),
)
def test_an_unknown_name_is_refused_with_those_that_there_are(wrong: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"is none of .*(hourly|wifi|surface)"):
        make_bench(**wrong)  # type: ignore[arg-type]


def test_a_mark_s_words_make_the_board() -> None:
    bench = make_bench(sleep="never", docked=True, primary=0.25, kept_on=("gsm",), last_resort="call")
    bench.run(minutes=1)
    assert (bench.state, bench.config.whole and bench.config.whole.cycle) == (State.CHARGING, None)
    assert bench.board.rails >> 11 & 1  # GSM

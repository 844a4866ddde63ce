"""The plugin in a pytest of its own: the page's tests pass, and a failing test shows the board's actions."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_model.bench.pytest_plugin import make_bench
from firmware_model.states import State

ROOT = Path(__file__).parents[3]


def run_pytest(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_board.py").write_text(text)
    (folder / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\n")
    # By name, so that it does not matter whether the package is installed; an installed one is not loaded twice.
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); import pytest; sys.exit(pytest.main(sys.argv[1:]))"
    )
    options = ["-p", "firmware_model.bench.pytest_plugin", "-p", "no:cacheprovider", "-p", "no:musselbed"]
    return subprocess.run(
        [sys.executable, "-c", code, *options, "-q", str(folder)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=folder,
        # A person's options for the whole suite are none of this one's.
        env={key: value for key, value in os.environ.items() if key != "PYTEST_ADDOPTS"},
    )


def test_the_tests_on_the_page_pass(tmp_path: Path) -> None:
    found = re.search(r"```python\n(.*?)```", (ROOT / "docs/mu-scripts.md").read_text(), re.DOTALL)
    assert found is not None
    done = run_pytest(tmp_path, found[1])
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


def test_a_failure_shows_the_trace(tmp_path: Path) -> None:
    done = run_pytest(
        tmp_path, "def test_it(mu):\n    mu.run(hours=30)\n    assert mu.primary_fraction > 0.99\n"
    )
    assert done.returncode == 1
    assert "what the MU did" in done.stdout
    assert " 30:00:00.000  SLEEPING -ALARM_RANG-> SAMPLING" in done.stdout
    assert "lines before" in done.stdout
    assert "now: SAMPLING, primary 0.8" in done.stdout


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

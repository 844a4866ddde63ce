"""The counterpart of generation B still does what its author's own tests say: those that our bench leans on."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system
OWN_TESTS = Path(__file__).with_name("generation_b") / "tests"
LEANED_ON = "a_slow_service_delays_the_next or docks_by_camera or there_is_no_fifth_dock"
PATIENCE_S = 300


def test_its_own_tests_pass() -> None:
    own = ["-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", ".", "-q", "-k", LEANED_ON, "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *own],
        cwd=OWN_TESTS,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"

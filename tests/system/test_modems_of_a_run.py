"""A run whose modems are serial devices, as a person uses it: docs/modems.md to the letter."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import lines_in

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "modems.md").read_text()
PATIENCE_S = 180.0


def wait_for(what: Callable[[], object], why: str) -> None:
    until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not what():
        assert time.monotonic() < until_s, why
        pause.wait(0.05)


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Path]:
    """The page's command, with a directory of its own."""
    found = re.search(r"musselbed run (\S+sound-12\.yaml .*--open-modem 7)$", PAGE, re.MULTILINE)
    assert found is not None
    out = tmp_path / "run"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "apad_bridge.commands.main",
            "run",
            *found[1].split(),
            "--out",
            str(out),
            "--json",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        wait_for(
            lambda: (out / "modems" / "amussel7").exists() or process.poll() is not None,
            "no modem was opened",
        )
        assert process.poll() is None, process.communicate()[1]
        yield out
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)


def test_the_pages_program_pings_from_an_opened_modem(run: Path) -> None:
    program = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert program is not None
    script = f"RUN = {str(run)!r}\n" + program[1]
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S)
    assert said.returncode == 0, said.stderr
    status, told, metres = said.stdout.splitlines()
    assert status.startswith("b'#A007V21845R001.006.000B")
    assert told == r"b'$P003\r\n'"
    scenario = yaml.safe_load((run / "scenario.yaml").read_text())
    diagonal_m = max(max(corner) for corner in scenario["area"]["polygon_m"]) * 2**0.5
    assert 0.5 < float(metres.split()[0]) < diagonal_m

    def pings() -> list[dict[str, Any]]:
        packets = [line for line in lines_in(run / "journal.jsonl") if line["kind"] == "packet"]
        return [line for line in packets if line["from"] == 7 and line["what"] == "ping"]

    wait_for(pings, "no ping in the journal")
    assert [row[0] for row in pings()[0]["heard"]] == [3]
    assert os.path.islink(run / "modems" / "amussel7")

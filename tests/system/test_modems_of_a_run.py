"""A run whose modems are serial devices, as a person uses it: docs/modems.md to the letter."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
import yaml
from journals import Line
from programs import MUSSELBED, ROOT, Begin, done, lines_of, wait_until

pytestmark = pytest.mark.system

PAGE = (ROOT / "docs" / "modems.md").read_text()


def test_the_pages_program_pings_from_an_opened_modem(tmp_path: Path, begin: Begin) -> None:
    """The page's command, with a directory of its own."""
    found = re.search(r"musselbed run (\S+sound-12\.yaml .*--open-modem 7)$", PAGE, re.MULTILINE)
    program = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert found and program
    run = tmp_path / "run"
    flight = begin(*MUSSELBED, "run", *found[1].split(), "--out", run, "--json")
    wait_until((run / "modems" / "amussel7").exists, flight)
    said = done(sys.executable, "-c", f"RUN = {str(run)!r}\n{program[1]}")
    status, told, metres = said.stdout.splitlines()
    assert status.startswith("b'#A007V21845R001.006.000B")
    assert told == r"b'$P003\r\n'"
    scenario = yaml.safe_load((run / "scenario.yaml").read_text())
    diagonal_m = max(max(corner) for corner in scenario["area"]["polygon_m"]) * 2**0.5
    assert 0.5 < float(metres.split()[0]) < diagonal_m

    def pings() -> list[Line]:
        return [it for it in lines_of(run, "packet") if it["from"] == 7 and it["what"] == "ping"]

    assert [row[0] for row in wait_until(pings, flight)[0]["heard"]] == [3]
    assert os.path.islink(run / "modems" / "amussel7")

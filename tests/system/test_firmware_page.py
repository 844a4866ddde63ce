"""The pages of firmware as printed: from an empty folder to a fleet of C boards, and the kit that judges them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from doc_blocks import blocks, file_of
from programs import ROOT, done

from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES

pytestmark = pytest.mark.system
TUTORIAL, *REFERENCES = (
    ROOT / "docs" / it for it in ("first-firmware.md", "firmware-port.md", "conformance.md")
)


def test_the_page_of_the_kit_tells_how_many_cases_there_are() -> None:
    text = (ROOT / "docs" / "conformance.md").read_text()
    assert f"through {len(CASES)} cases" in text
    assert f"has {len(WHOLE_CASES)} cases" in text


def test_the_pages_commands_give_what_they_show(tmp_path: Path) -> None:
    (tmp_path / "my_board.c").write_text(file_of(TUTORIAL, "my_board.c"))
    # A page that repeats a command has it once here.
    tested = [it.text for page in (TUTORIAL, *REFERENCES) for it in blocks(page) if it.mark == "tested"]
    conforms = "musselbed mu conform swarm/board --random 20\n"
    assert sum(conforms in it for it in tested) == 2
    script = "\n".join(it for it in tested if it != conforms)
    failing = "--case measures --case surfaces\n"
    assert failing in script
    script = script.replace(failing, f"{failing.rstrip()} || echo exit code $?\n")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, "MUSSELBED": str(ROOT), "PATH": path}
    told = done("bash", "-eu", "-c", script, cwd=tmp_path, env=environment, timeout=600).stdout
    shown = [line for block in blocks(TUTORIAL) if block.kind == "text" for line in block.text.splitlines()]
    assert len(shown) == 12
    for line in shown:
        assert line.strip() in told
    count = len(CASES) + 20
    assert told.count(f"{count} cases: {count} passed") == 1
    assert "2 cases: 1 passed, 1 failed" in told
    assert "exit code 3\n" in told
    assert "3 cases: 3 passed" in told

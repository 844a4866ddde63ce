"""The pages of firmware as printed: from an empty folder to a fleet of C boards, and the kit that judges them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import blocks, file_of

from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
TUTORIAL, *REFERENCES = (
    ROOT / "docs" / it for it in ("first-firmware.md", "firmware-port.md", "conformance.md")
)


def test_the_page_of_the_kit_tells_how_many_cases_there_are() -> None:
    text = (ROOT / "docs" / "conformance.md").read_text()
    assert f"through {len(CASES)} cases" in text
    assert f"has {len(WHOLE_CASES)} cases" in text


def test_the_pages_commands_give_what_they_show(tmp_path: Path) -> None:
    (tmp_path / "my_board.c").write_text(file_of(TUTORIAL, "my_board.c"))
    script = "\n".join(
        block.text for page in (TUTORIAL, *REFERENCES) for block in blocks(page) if block.mark == "tested"
    )
    failing = "--case measures --case surfaces\n"
    assert failing in script
    script = script.replace(failing, f"{failing.rstrip()} || echo exit code $?\n")
    done = subprocess.run(
        ["bash", "-eu", "-c", script],
        cwd=tmp_path,
        env={
            **os.environ,
            "MUSSELBED": str(ROOT),
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        },
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    shown = [line for block in blocks(TUTORIAL) if block.kind == "text" for line in block.text.splitlines()]
    assert len(shown) == 12
    for line in shown:
        assert line.strip() in done.stdout
    count = len(CASES) + 20
    assert done.stdout.count(f"{count} cases: {count} passed") == 2
    assert "2 cases: 1 passed, 1 failed" in done.stdout
    assert "exit code 3\n" in done.stdout
    assert "3 cases: 3 passed" in done.stdout

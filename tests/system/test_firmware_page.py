"""docs/firmware-port.md as printed: from an empty folder to a fleet of C boards with the paper's row."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import blocks, file_of

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "firmware-port.md"


def test_the_page_s_commands_give_what_it_shows(tmp_path: Path) -> None:
    for folder in ("firmware_model", "launch_scripts"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / "my_board.c").write_text(file_of(PAGE, "my_board.c"))
    script = "\n".join(block.text for block in blocks(PAGE) if block.mark == "tested")
    done = subprocess.run(
        ["bash", "-eu", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    shown = [line for block in blocks(PAGE) if block.kind == "text" for line in block.text.splitlines()]
    assert len(shown) == 13
    assert "111 cases: 111 passed" in done.stdout
    for line in shown[:5]:  # the others are the Perl board's: tests/system/test_conformance.py
        assert line.strip() in done.stdout

"""Programs that tests run as firmware: our C boards, compiled once, and programs that misbehave."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from agents.mussel.port.port_firmware import PortFirmware, link_to
from firmware_model.bench import Bench
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig

NATIVE = Path(__file__).parents[2] / "firmware_model" / "native"
_COMPILE_TIMEOUT_S = 120


def compiled(factory: pytest.TempPathFactory, name: str = "worst_case") -> Path:
    """A board of `firmware_model/native`, compiled once for all tests of this process, every warning an error."""
    board = factory.getbasetemp() / "native" / name
    if not board.exists():
        board.parent.mkdir(exist_ok=True)
        subprocess.run(
            ["make", "-s", "-C", str(NATIVE), f"BUILD={board.parent}", str(board)],
            check=True,
            timeout=_COMPILE_TIMEOUT_S,
        )
    return board


def compiled_with(factory: pytest.TempPathFactory, changed: Path, text: str, program: Path) -> None:
    """Makes `program`: the board that `changed` belongs to, with this text in its place."""
    objects = factory.getbasetemp() / "native" / changed.parent.name
    whole = changed.parent != NATIVE
    sources = [*(changed.parent.glob("*.c") if whole else (changed,)), NATIVE / "musselbed.c"]
    compiler = ["cc", "-std=c99", "-D_POSIX_C_SOURCE=200809L", "-w", f"-I{NATIVE}", f"-I{changed.parent}"]
    if not objects.exists():
        objects.mkdir(parents=True)
        _run([*compiler, "-c", *map(str, sources)], objects)
    (program.parent / changed.name).write_text(text)
    others = [str(objects / f"{it.stem}.o") for it in sources if it != changed]
    _run([*compiler, "-o", str(program), changed.name, *others], program.parent)


def _run(command: list[str], directory: Path) -> None:
    subprocess.run(command, cwd=directory, check=True, timeout=_COMPILE_TIMEOUT_S)


def script(directory: Path, text: str, name: str = "board") -> Path:
    """A program of these lines of Python, after imports and a socket `port` to the bench."""
    program = directory / name
    imports = f"#!{sys.executable} -I\nimport os, socket, sys, time\n"
    program.write_text(f"{imports}port = socket.socket(fileno=int(os.environ['MUSSELBED_PORT']))\n{text}")
    program.chmod(0o755)
    return program


def maker(config: BoardConfig, *command: str, timeout_s: float = 30.0) -> MakeFirmware:
    return lambda hardware: PortFirmware(lambda: link_to(command, timeout_s), config, hardware, seed=1)


def bench(
    config: BoardConfig,
    program: Path,
    primary: float = 1.0,
    timeout_s: float = 30.0,
    secondary: float = 1.0,
) -> Bench:
    """A board with that program on it."""
    made = maker(config, str(program), timeout_s=timeout_s)
    return Bench(config, primary=primary, secondary=secondary, firmware=made)

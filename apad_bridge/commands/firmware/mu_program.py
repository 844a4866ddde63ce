"""`musselbed mu run ./board`: somebody's firmware on one board, through a dive, a dock and a reset."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.agent_rig import AgentRig
from agents.mussel.port.bench_firmware import firmware_of
from agents.mussel.port.board_link import SERIAL, serial_line
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from firmware_model.bench import Bench
from firmware_model.bench.conformance import Case, CaseReading, worst_case_of
from firmware_model.bench.costly_firmware import CostlyFirmware
from firmware_model.bench.rigs import BenchRig, Rig
from firmware_model.bench.trace import clock, line, vcd
from firmware_model.config import BoardConfig
from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.hardware.worst_case import WorstCaseHardware
from firmware_model.packets import Kind
from firmware_model.port import FirmwareLike
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, board, power, worst_case_board

WORST_CASE, WHOLE = "worst-case", "mu"
"""The profiles of a scenario's `board`."""
BOARDS: dict[str, Callable[[], BoardConfig]] = {
    WORST_CASE: worst_case_board,
    WHOLE: lambda: board(FIELD, power()),
}
"""The boards of `mu run`."""


def is_program(path: Path) -> bool:
    """True for a file that can be executed and is no script of a board, and for `serial:DEVICE`."""
    if str(path).startswith(SERIAL):
        return True
    return path.suffix not in (".yaml", ".yml") and path.is_file() and os.access(path, os.X_OK)


def run_program(path: Path, profile: str, vcd_file: Path | None = None) -> int:
    """Prints what the firmware does in a day with a permission, four hours in a dock and a brown-out; also as a VCD."""
    bench = bench_of(path, config=BOARDS[profile]())
    steps: tuple[tuple[str, Callable[[], object], float], ...] = (
        ("the power came on", lambda: None, 1.0),
        ("it is permitted to surface", lambda: bench.command(Kind.PERMISSION), 0.1),
        ("a dock closes around it", bench.charge_pin_rises, 4.0),
        ("the dock opens", bench.charge_pin_falls, 0.01),
        ("it is cleared to sink", lambda: bench.command(Kind.RELEASE), 0.5),
        ("a brown-out", lambda: bench.reset(ResetCause.BROWN_OUT), 18.0),
    )
    done = 0
    try:
        for what, act, hours in steps:
            print(f"{clock(bench.now_ms)}  -- {what}")
            act()
            bench.run(hours=hours)
            for action in bench.trace[done:]:
                print(line(action))
            done = len(bench.trace)
    except FirmwareFailed as failure:
        print(f"{clock(bench.now_ms)}  the firmware failed: {failure}")
        return Exit.PEER_FAILED
    finally:
        bench.close()
        if vcd_file is not None:
            write_vcd(vcd_file, bench)
    print(f"after {bench.now_ms / 3_600_000:g} h: {bench.state.name}, primary {bench.primary_fraction:.4f}")
    return Exit.DONE


def write_vcd(path: Path, bench: Bench) -> None:
    """Writes the board's life for GTKWave."""
    text = vcd(bench.trace, bench.courses, bench.config.charge, bench.now_ms, told=bench.told)
    path.write_text(text)


def bench_of(
    path: Path, primary: float = 1.0, cost_ms: int = 0, seed: int = 1, config: BoardConfig | None = None
) -> Bench:
    """A board with this program on it, or a real one; UserError if there is none. Without a `config`, the worst case's.

    Each turn takes up to `cost_ms` of the board's time, chosen by `seed`.
    """
    config = config or worst_case_board()
    make = firmware_of(command_of(path), config)

    def firmware(hardware: WorstCaseHardware | WholeBoardHardware) -> FirmwareLike:
        return CostlyFirmware(make(hardware), cost_ms, seed) if cost_ms else make(hardware)

    return Bench(config, primary=primary, firmware=firmware)


def rig_of(path: Path, case: Case, cost_ms: int = 0, seed: int = 1) -> Rig:
    """The rig of a conformance case with this program on its board; as `bench_of`."""
    if case.whole is None:
        return BenchRig(bench_of(path, case.primary, cost_ms, seed, worst_case_of(case)))
    return AgentRig(case, command_of(path), cost_ms, seed)


def our_rig(case: Case, release_wait_ms: int | None = None) -> Rig:
    """The rig of a conformance case with our firmware, which may wait for a release packet for another time."""
    if case.whole is not None:
        return AgentRig(case, release_wait_ms=release_wait_ms)
    config = worst_case_of(case)
    if release_wait_ms is not None:
        config = replace(config, release_wait_ms=release_wait_ms)
    return BenchRig(Bench(config, primary=case.primary))


AT_THE_EDGE = CaseReading(
    "V-A can be read so: it sinks at the falling edge, and waits for no packet",
    "3s permission 70s rises 1min falls 1s",
    lambda case: our_rig(case, release_wait_ms=0),
)


def command_of(path: Path) -> tuple[str, ...]:
    """The command of this program, or the serial line of a real board; UserError if there is none."""
    if not is_program(path):
        raise UserError(f"{path} is no program: compile it, and check that it may be executed (chmod +x)")
    try:
        line = serial_line(str(path))
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    if line is not None and not Path(line[0]).exists():
        raise UserError(f"{path}: there is no such device; is the board plugged in?")
    return (str(path.absolute() if line is None else path),)

"""Boards with firmware in C, a process each, beside as many of ours: their cost; and mutants of the C board in the kit.

`pss_mb_per_agent` is the proportional set size of agents, firmware and nursery, divided by the agents; `ready_s` lasts from
the exec of the nursery to the last agent's first reply, when each firmware has booted. `cpu_ms_per_agent_hour` is time on a
processor of agents, firmware and this process, by the kernel's account, over a flight of `MISSION_S` at theta 30 with the
paper's reports; no agent runs ahead, ours neither. `turn_us` is the cost of one interrupt's round trip to the C board,
above that of the same interrupt to ours.

A mutant is the C board with one change: an operator, a constant, or a deleted statement, at `tries` places that a hash
chooses. Places that only change texts and states for people are left out. `caught` ones fail a case of `musselbed mu
conform`, `by_chance` ones differ in a random script only. `equivalent` ones show nothing outside, for the reason in
`EQUIVALENT`; `survivors` are missed.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

from fleets import PAPER
from native_boards import NATIVE
from rich.console import Console
from rich.table import Table

from agents.coordinator import Coordinator
from agents.fleet import FirmwareConfig, resting_on_bottom
from agents.hosting.process_host import ProcessHost
from agents.mussel.firmware_failure import FirmwareFailed
from agents.nursery.launch import launch_nursery, prepare
from agents.time_scale import TimeScale
from apad_bridge.commands.mu_program import bench_of, our_rig, rig_of
from benchmarks.fleet import cost_row, kernel_kb, processor_s, serve, wait_for_merging
from benchmarks.rows import told
from firmware_model.bench import Bench
from firmware_model.bench.conformance import Case, Verdict, judged, random_cases
from firmware_model.bench.conformance_cases import CASES
from firmware_model.packets import CommandPacket, Kind
from firmware_model.stimuli import PacketHeard
from firmware_model.table_one import worst_case_board

FLEETS, SHORT_FLEETS = (100, 1000), (12,)
MISSION_S, SHORT_S = 300, 30
SHORT_TRIES = 5
THETA = 30
TURNS = 3000
RANDOM = 60
_CC = ("cc", "-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O1", "-w", f"-I{NATIVE}", "-o")
_FOR_PEOPLE = re.compile(r"STATES\[\]|TRIGGERS\[\]|mu_refuse|mu_state|snprintf|return \d|, -1}|mu_open")
_CHANGES = (
    (r"==", "!="),
    (r"!=", "=="),
    (r"&&", "||"),
    (r"\|\|", "&&"),
    (r" < ", " >= "),
    (r"\+=", "-="),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"IN\(\w+\) \| ", ""),
    (r"(?<![\w.\"])(\d+)(?=[u ;,)\]}])", None),
    (r"^    .*;$", ""),
)
"""Patterns in a line, and what replaces them; None adds 1 to a number."""


_TEXT = "only a text for people: nothing outside follows from a refused trigger"
_NO_STATE = "a state that outside equals the other one: both take the same triggers"
EQUIVALENT = {
    ("if (by == SURFACING_TIMED_OUT)", "if (by != SURFACING_TIMED_OUT)"): _TEXT,
    (
        "board.has_deadline = false;",
        "",
    ): "a deadline that is left over is refused in every state without one of its own",
    ("board.has_deadline = false;", "board.has_deadline = true;"): "likewise",
    (
        "mu_pin(MU_WATCH_BATTERY, board.state == ACTIVE);",
        "mu_pin(MU_WATCH_BATTERY, board.state != ACTIVE);",
    ): _NO_STATE,
    ("pin.high_ticks = 0;", "pin.high_ticks = 1;"): "30 us of 2 s, below every tolerance",
}
"""Changes that nothing outside of the board can show, each with its reason."""


def measure(tries: int = 60, short: bool = False) -> dict[str, Any]:
    tries, fleets, mission_s = (SHORT_TRIES, SHORT_FLEETS, SHORT_S) if short else (tries, FLEETS, MISSION_S)
    with tempfile.TemporaryDirectory(prefix="musselbed-") as folder:
        board = Path(folder) / "board"
        _compile(NATIVE / "worst_case.c", board)
        return {
            "turn_us": turn_us(board),
            "fleets": [told(fleet_row(agents, it, mission_s)) for agents in fleets for it in (None, board)],
            "mutants": mutants(Path(folder), tries),
        }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="Boards with firmware in C, and ours")
    for name in ("firmware", "agents", "PSS, MB each", "ready, s", "CPU, ms an hour", "times real time"):
        table.add_column(name, justify="left" if name == "firmware" else "right")
    for row in result["fleets"]:
        figures = (row["pss_mb_per_agent"], row["ready_s"], row["cpu_ms_per_agent_hour"], row["speed"])
        table.add_row(row["kind"], str(row["agents"]), *(f"{it:.2f}" for it in figures))
    console.print(table)
    console.print(
        f"an interrupt's round trip to the C board costs {result['turn_us']:.0f} us more than to ours"
    )
    found = result["mutants"]
    console.print(
        f"{found['mutants']} mutants: {found['caught']} caught, {found['by_chance']} more by random scripts; survivors:"
    )
    for survivor in [*found["survivors"], *found["equivalent"]]:
        console.print(f"  {survivor}", markup=False, highlight=False, soft_wrap=True)


def turn_us(board: Path) -> float:
    """The round trip of a packet for another aMussel, which neither board obeys."""
    packet = PacketHeard(CommandPacket(Kind.PERMISSION, 2).encode())
    took_s = []
    for bench in (Bench(worst_case_board()), bench_of(board)):
        bench.run(minutes=1)
        began_s = time.perf_counter()
        for _ in range(TURNS):
            bench.tell(packet)
        took_s.append(time.perf_counter() - began_s)
    return 1e6 * (took_s[1] - took_s[0]) / TURNS


def fleet_row(agents: int, board: Path | None, mission_s: int = MISSION_S) -> dict[str, Any]:
    states = {n: resting_on_bottom(n, 0.0, 3.0, 0.9, 1.0) for n in range(1, agents + 1)}
    firmware = () if board is None else (FirmwareConfig((str(board),)),)
    kind = "ours" if board is None else "C"
    with tempfile.TemporaryDirectory(prefix="musselbed-") as run_dir:
        prepare(run_dir, replace(PAPER, firmware=firmware), states)
        kernel_before_kb, began_s = kernel_kb(), time.monotonic()
        nursery = launch_nursery(run_dir)
        host = ProcessHost.adopt(run_dir, 1)
        try:
            clock = Coordinator(host, dict.fromkeys(states, 0), TimeScale(THETA))
            clock.advance(0)
            ready_s = time.monotonic() - began_s
            pids = [it for pid in host.pids.values() for it in (pid, *_children(pid))]
            cpu_s, wall_s = _flown(clock, host, agents, mission_s, [*pids, *_own()])
            wait_for_merging()
            row = cost_row(
                kind, agents, f"after_{mission_s}s", [host.nursery_pid, *pids], kernel_before_kb, ready_s
            )
        finally:
            host.close()
            nursery.wait()
    hours = agents * mission_s * THETA / 3600
    return row | {"cpu_ms_per_agent_hour": 1000 * cpu_s / hours, "speed": mission_s / wall_s}


def _flown(
    clock: Coordinator, host: ProcessHost, agents: int, mission_s: int, pids: list[int]
) -> tuple[float, float]:
    """Flies the mission, a second at a time: the processor's time of these processes, and the wall's."""
    before_s, began_s = sum(map(processor_s, pids)), time.monotonic()
    for now_s in range(1, mission_s + 1):
        serve(clock, agents, now_s, 1)
        clock.advance(1000 * now_s)
        host.take_truths()
    if len(host.pids) < agents:
        raise RuntimeError(f"{agents - len(host.pids)} of {agents} aMussels died")
    return sum(map(processor_s, pids)) - before_s, time.monotonic() - began_s


def _own() -> Iterator[int]:
    yield int(Path("/proc/self").resolve().name)


def _children(pid: int) -> list[int]:
    return [int(it) for it in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _compile(source: Path, program: Path) -> bool:
    command = [*_CC, str(program), str(source), str(NATIVE / "musselbed.c")]
    return subprocess.run(command, capture_output=True, timeout=120, check=False).returncode == 0


def mutants(folder: Path, tries: int) -> dict[str, Any]:
    source = (NATIVE / "worst_case.c").read_text().splitlines()
    count, caught, by_chance = 0, 0, 0
    survivors, equivalent = [], []
    sites = sorted(_sites(source), key=lambda it: blake2b(repr(it).encode(), digest_size=8).digest())
    for line, start, end, new in sites:
        if count == tries:
            break
        changed = source[line][:start] + new + source[line][end:]
        mutant = folder / "mutant.c"
        mutant.write_text("\n".join([*source[:line], changed, *source[line + 1 :], ""]))
        if not _compile(mutant, folder / "mutant"):
            continue
        count += 1
        print(f"\rmutant {count} of {tries} ", end="", file=sys.stderr)
        if not all(_passes(folder / "mutant", case) for case in CASES):
            caught += 1
        elif not all(_passes(folder / "mutant", case) for case in random_cases(RANDOM, 1)):
            by_chance += 1
        else:
            told = f"line {line + 1}: {source[line].strip()}  ->  {changed.strip() or 'nothing'}"
            reason = EQUIVALENT.get((source[line].strip(), changed.strip()))
            if reason is None:
                survivors.append(told)
            else:
                equivalent.append(f"{told}: {reason}")
    print("\r\033[K", end="", file=sys.stderr)
    return {
        "mutants": count,
        "caught": caught,
        "by_chance": by_chance,
        "equivalent": equivalent,
        "survivors": survivors,
    }


def _sites(source: list[str]) -> Iterator[tuple[int, int, int, str]]:
    """Every (line, from, to, replacement) in the code; tables of texts and comments apart."""
    for line, text in enumerate(source):
        code = text.partition("/*")[0].rstrip()
        if not code or text.lstrip().startswith(("*", "#include")) or _FOR_PEOPLE.search(text):
            continue
        for pattern, new in _CHANGES:
            for found in re.finditer(pattern, code):
                replaced = str(int(found[1]) + 1) if new is None else new
                yield line, *found.span(), replaced


def _passes(program: Path, case: Case) -> bool:
    result = judged(case, our_rig, lambda it: rig_of(program, it), FirmwareFailed, {})
    return result.verdict is Verdict.PASSED

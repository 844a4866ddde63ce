"""Boards with firmware in C, a process each, beside as many of ours: their cost.

`pss_mb_per_agent` is the proportional set size of agents, firmware and nursery, divided by the agents; `ready_s` lasts from
the exec of the nursery to the last agent's first reply, when each firmware has booted. `cpu_ms_per_agent_hour` is time on a
processor of agents, firmware and this process, by the kernel's account, over a flight of `MISSION_S` at theta 30 with the
paper's reports; no agent runs ahead, ours neither. `window_ms` is the wall time of one window of a mission second: the
round trip to all agents and back. `speed` is the mission's time over the wall's: a fleet with 1 or more flies in real
time. `in_real_time` is the number of agents that would fly with 1, if the time of a window grew as their number.
`turn_us` is the cost of one interrupt's round trip to the C board, above that of the same interrupt to ours.
`ratios` compare each fleet of C boards with as many of ours.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from fleets import PAPER
from native_boards import NATIVE
from rich.console import Console
from rich.table import Table

from agents.coordinator import Coordinator
from agents.fleet_config import FirmwareConfig, resting_on_bottom
from agents.hosting.process_host import ProcessHost
from agents.time_scale import MissionMs
from apad_bridge.commands.firmware.mu_program import bench_of
from benchmarks.fleet import clock_of, cost_row, in_processes, processor_s, serve, wait_for_merging
from benchmarks.rows import told
from firmware_model.bench import Bench
from firmware_model.packets import CommandPacket, Kind
from firmware_model.stimuli import PacketHeard
from firmware_model.table_one import worst_case_board

FLEETS, SHORT_FLEETS = (100, 1000), (12,)
MISSION_S, SHORT_S = 300, 30
THETA = 30
TURNS = 3000
_CC = ("cc", "-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O1", "-w", f"-I{NATIVE}", "-o")


def measure(short: bool = False) -> dict[str, Any]:
    fleets, mission_s = (SHORT_FLEETS, SHORT_S) if short else (FLEETS, MISSION_S)
    with tempfile.TemporaryDirectory(prefix="musselbed-") as folder:
        board = Path(folder) / "board"
        subprocess.run(
            [*_CC, board, NATIVE / "worst_case.c", NATIVE / "musselbed.c"], timeout=120, check=True
        )
        rows = [told(fleet_row(agents, it, mission_s)) for agents in fleets for it in (None, board)]
        return {"turn_us": turn_us(board), "fleets": rows, "ratios": list(_ratios(rows))}


def _ratios(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for ours, theirs in zip(rows[::2], rows[1::2], strict=True):
        compared = {name: theirs[name] / ours[name] for name in ("cpu_ms_per_agent_hour", "ready_s")}
        yield {"agents": ours["agents"], **compared}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="Boards with firmware in C, and ours")
    for name in (
        "firmware",
        "agents",
        "PSS, MB each",
        "ready, s",
        "CPU, ms an hour",
        "window, ms",
        "times real time",
        "in real time",
    ):
        table.add_column(name, justify="left" if name == "firmware" else "right")
    for row in result["fleets"]:
        names = ("pss_mb_per_agent", "ready_s", "cpu_ms_per_agent_hour", "window_ms", "speed")
        figures = [f"{row[name]:.2f}" for name in names]
        table.add_row(row["kind"], str(row["agents"]), *figures, str(row["in_real_time"]))
    console.print(table)
    for it in result["ratios"]:
        cpu, ready = it["cpu_ms_per_agent_hour"], it["ready_s"]
        told_ratios = f"{cpu:.2f} times the CPU of ours, and ready in {ready:.2f} times the time"
        console.print(f"{it['agents']} agents: {told_ratios}")
    console.print(
        f"an interrupt's round trip to the C board costs {result['turn_us']:.0f} us more than to ours"
    )


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
    with (
        tempfile.TemporaryDirectory(prefix="musselbed-") as run_dir,
        in_processes(run_dir, replace(PAPER, firmware=firmware), states) as (host, kernel_before_kb, began_s),
    ):
        clock, ready_s = clock_of(host, agents, began_s, THETA)
        pids = [it for pid in host.pids.values() for it in (pid, *_children(pid))]
        cpu_s, wall_s = _flown(clock, host, agents, mission_s, [*pids, os.getpid()])
        wait_for_merging()
        every = [host.nursery_pid, *pids]
        row = cost_row(kind, agents, f"after_{mission_s}s", every, kernel_before_kb, ready_s)
    hours = agents * mission_s * THETA / 3600
    return row | {
        "cpu_ms_per_agent_hour": 1000 * cpu_s / hours,
        "speed": mission_s / wall_s,
        "in_real_time": round(agents * mission_s / wall_s),
        "window_ms": 1000 * wall_s / mission_s,
    }


def _flown(
    clock: Coordinator, host: ProcessHost, agents: int, mission_s: int, pids: list[int]
) -> tuple[float, float]:
    """Flies the mission, a second at a time: the processor's time of these processes, and the wall's."""
    before_s, began_s = sum(map(processor_s, pids)), time.monotonic()
    for now_s in range(1, mission_s + 1):
        serve(clock, agents, now_s, 1)
        clock.advance(MissionMs(1000 * now_s))
        host.take_truths()
    if len(host.pids) < agents:
        raise RuntimeError(f"{agents - len(host.pids)} of {agents} aMussels died")
    return sum(map(processor_s, pids)) - before_s, time.monotonic() - began_s


def _children(pid: int) -> list[int]:
    return [int(it) for it in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]

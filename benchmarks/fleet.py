"""The cost of an aMussel as a process of its own, beside objects in one process and bare rospy nodes, up to 10 000.

`pss_mb_per_agent` is the proportional set size of all agents' processes and of their nursery, divided by the agents;
`kernel_mb_per_agent` is the rise of the machine's kernel memory (slab, page tables, stacks) since before the first of
them, divided likewise, so that a busy machine blurs it; `ready_s` is from the exec of the nursery to the last agent's first
reply. The flight is 20 hours of agent time at theta 30 with the paper's reports, one a mission second, and its drift; each
aMussel is charged once. A thousand of them are granted ten reports at once, because one at a time takes minutes. A full
log is uploaded in the dock without a receiver: it stays full.
Where the kernel merges equal pages (`merging`: /sys/kernel/mm/ksm/run is 1), each row is read after the kernel has scanned
all of them; a merged page is counted in parts, as any shared page.
A bare rospy node publishes as many statuses, without subscribers, in one go; the master is not counted.

The scale table ("hourly") has fleets at theta 1 in still water, which wake every hour, sample, process and transmit in
timeslots, and sleep without a window in between. Its rows are read after three hours; `cpu_s_per_agent_hour` is the time
on a processor of the agents' processes and of this one, by the kernel's own account (/proc/PID/schedstat). A row that
would leave less than `SPARE_MB` of memory is left out, with the reason. "objects" are the same agents in this process.
"""

from __future__ import annotations

import os
import select
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from fleets import PAPER, STILL, with_whole_boards
from rich.console import Console
from rich.table import Table

from agents.coordinator import AgentDied, Coordinator
from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.hosting.host import Host
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.physical import Physical
from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved, SoundArrived, WifiArrived
from agents.nursery.flash_file import FLASH_NAME, FlashRegion
from agents.nursery.launch import launch_nursery, prepare
from agents.time_scale import MissionMs, TimeScale
from benchmarks.gateway import NODES, Node, on_master
from benchmarks.rows import told
from firmware_model.config import FullFirmware, LastResort, Timeslots
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.flash_log import FlashLog
from firmware_model.table_one import FIELD, power

MUSSELBED_FLEETS = (
    ("worst case", 24, 1),
    ("worst case", 100, 1),
    ("whole board", 100, 1),
    ("whole board, full log", 100, 1),
    ("worst case", 1000, 10),
    ("whole board", 1000, 10),
)
"""(board, agents, seconds of mission time granted at once)"""
HOURLY_FLEETS = (24, 100, 1000, 3000, 10_000)
SHORT_AGENTS = 24
"""All fleets of the short tier."""
HOURS = 3
SPARE_MB = 1024
ROSPY_NODES = (24, 100)
THETA = PAPER.theta
MISSION_S = 20 * 3600 // THETA
SERVICE_S = (0, 10, 100, 200)
"""Permission, contact, release and the command to sink, in seconds from an aMussel's turn."""
MERGING = Path("/sys/kernel/mm/ksm/run")
MERGING_TIMEOUT_S = 120.0
FLEET = replace(PAPER, board=replace(PAPER.board, float_timeout_ms=43_200_000))
WAKES = replace(FIELD, slots=Timeslots(frame_ms=300_000, slot_ms=300))
"""Every hour: sample, process, await the timeslot and transmit; with a timeslot for each of a thousand."""
WHOLE = FullFirmware(power(LastResort.CALL), WAKES, transmit_ms=300, call_ms=600_000, hover_ms=600_000)
_WHOLE_FLEET = with_whole_boards(FLEET, WHOLE)
FULL_LOG = "whole board, full log"
FLEETS = {"worst case": FLEET, "whole board": _WHOLE_FLEET, FULL_LOG: _WHOLE_FLEET}
HOUR_MS = 3_600_000
LOGGED = 2500
"""Samples in a full log, as after 104 days of one an hour, when the ring has come round."""


def measure(short: bool = False) -> dict[str, Any]:
    """`rows`, each printed as JSON on stderr as it comes. The short tier has each kind once, with `SHORT_AGENTS`."""
    boards = [(board, SHORT_AGENTS, 1) for board in FLEETS] if short else MUSSELBED_FLEETS
    hourly, nodes_of = ((SHORT_AGENTS,),) * 2 if short else (HOURLY_FLEETS, ROSPY_NODES)
    rows: list[dict[str, Any]] = []

    def keep_all(rows_in: Callable[[str], Iterator[dict[str, Any]]]) -> None:
        with tempfile.TemporaryDirectory(prefix="musselbed-") as folder:
            for row in rows_in(folder):
                rows.append(told(row))

    for board, agents, window_s in boards:
        keep_all(partial(musselbed_rows, board=board, agents=agents, window_s=window_s))
    for agents in hourly:
        rows.append(told(in_child(partial(hourly_objects, agents))))
        keep_all(partial(hourly_processes, agents=agents, rows=rows))
    for nodes in nodes_of:
        keep_all(partial(rospy_rows, nodes=nodes))
    return {"merging": merges(), "rows": rows}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="A process per aMussel, and bare rospy nodes")
    for name in ("kind", "agents", "at", "PSS, MB each", "kernel, MB each", "ready, s", "CPU, ms an hour"):
        table.add_column(name, justify="left" if name in ("kind", "at") else "right")
    for row in result["rows"]:
        if "left_out" in row:
            table.add_row(row["kind"], str(row["agents"]), row["left_out"])
            continue
        cpu_s = row.get("cpu_s_per_agent_hour")
        table.add_row(
            row["kind"],
            str(row["agents"]),
            row["at"],
            f"{row['pss_mb_per_agent']:.2f}",
            f"{row['kernel_mb_per_agent']:.2f}",
            f"{row['ready_s']:.2f}",
            "" if cpu_s is None else f"{1000 * cpu_s:.2f}",
        )
    console.print(table)


def musselbed_rows(run_dir: str, board: str, agents: int, window_s: int) -> Iterator[dict[str, Any]]:
    samples = LOGGED if board == FULL_LOG else 0
    initial_states = {
        agent_id: replace(resting_on_bottom(agent_id, 0.0, 3.0, 0.9, 1.0), samples=samples)
        for agent_id in range(1, agents + 1)
    }
    if samples:
        fill_logs(run_dir, agents)
    with in_processes(run_dir, FLEETS[board], initial_states) as (host, kernel_before_kb, began_s):
        clock, ready_s = clock_of(host, agents, began_s, THETA)

        def row(at: str) -> dict[str, Any]:
            wait_for_merging()
            pids = [host.nursery_pid, *host.pids.values()]
            return cost_row(f"musselbed, {board}", agents, at, pids, kernel_before_kb, ready_s)

        heard = {it.agent_id for it in clock.advance(MissionMs(1000)) if not isinstance(it, AgentDied)}
        if len(heard) != agents:
            raise RuntimeError(f"{agents - len(heard)} aMussels sent no status in their first second")
        yield row("first_status")
        for now_s in range(1 + window_s, MISSION_S + 1, window_s):
            serve(clock, agents, now_s, window_s)
            clock.advance(MissionMs(now_s * 1000))
            host.take_truths()
        yield row("after_20h")


@contextmanager
def in_processes(
    run_dir: str, fleet: FleetConfig, initial_states: dict[int, Physical]
) -> Iterator[tuple[ProcessHost, int, float]]:
    """The host of a fleet, the kernel's memory before it, and the time at which its nursery began."""
    prepare(run_dir, fleet, initial_states)
    kernel_before_kb = kernel_kb()
    began_s = time.monotonic()
    nursery = launch_nursery(run_dir)
    host = ProcessHost.adopt(run_dir, 1)
    try:
        yield host, kernel_before_kb, began_s
    finally:
        host.close()
        nursery.wait()


def hourly_processes(run_dir: str, agents: int, rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """A row of the scale table; `rows` are those before, by which it judges what it needs."""
    kind = "hourly, a process each"
    before = next((row for row in reversed(rows) if row["kind"] == kind and "left_out" not in row), None)
    if before is not None:
        needed_mb = agents * (before["pss_mb_per_agent"] + before["kernel_mb_per_agent"])
        if available_mb() - needed_mb < SPARE_MB:
            why = f"it needs {needed_mb:.0f} MB, and {available_mb():.0f} MB are available"
            yield {"kind": kind, "agents": agents, "left_out": why}
            return
    fleet = hourly_fleet(agents), hourly_states(agents)
    with in_processes(run_dir, *fleet) as (host, kernel_before_kb, began_s):
        clock, ready_s = clock_of(host, agents, began_s)
        pids = [os.getpid(), *host.pids.values()]
        cpu_s = cpu_of_hours(clock, pids, f"{kind}, {agents}")
        if len(host.pids) < agents:
            raise RuntimeError(f"{agents - len(host.pids)} of {agents} aMussels died")
        wait_for_merging()
        pids = [host.nursery_pid, *host.pids.values()]
        row = cost_row(kind, agents, f"after_{HOURS}h", pids, kernel_before_kb, ready_s)
    yield row | {"cpu_s_per_agent_hour": round(cpu_s / agents / HOURS, 6)}


def hourly_objects(agents: int) -> dict[str, Any]:
    """A row of the scale table with all agents in this process; its memory is what this process alone has."""
    before_kb = fields_kb("/proc/self/smaps_rollup")["Private_Dirty"]
    kernel_before_kb = kernel_kb()
    began_s = time.monotonic()
    host = InProcessHost(hourly_fleet(agents), hourly_states(agents))
    clock, ready_s = clock_of(host, agents, began_s)
    cpu_s = cpu_of_hours(clock, [os.getpid()], f"objects, {agents}")
    row = cost_row("hourly, objects", agents, f"after_{HOURS}h", [], kernel_before_kb, ready_s)
    used_kb = fields_kb("/proc/self/smaps_rollup")["Private_Dirty"] - before_kb
    return row | {
        "pss_mb_per_agent": round(used_kb / 1024 / agents, 3),
        "cpu_s_per_agent_hour": round(cpu_s / agents / HOURS, 6),
    }


def hourly_fleet(agents: int) -> FleetConfig:
    slots = replace(FIELD, slots=Timeslots(frame_ms=300_000, slot_ms=300_000 // agents))
    whole = FullFirmware(power(), slots, transmit_ms=300, call_ms=600_000, hover_ms=600_000)
    return with_whole_boards(replace(STILL, theta=1), whole)


def hourly_states(agents: int) -> dict[int, Physical]:
    return {
        agent_id: resting_on_bottom(agent_id % 100, agent_id // 100, 3.0, 0.9, 1.0)
        for agent_id in range(1, agents + 1)
    }


def clock_of(host: Host, agents: int, began_s: float, theta: int = 1) -> tuple[Coordinator, float]:
    """The fleet's clock after everyone's first answer, and how long that took."""
    clock = Coordinator(host, dict.fromkeys(range(1, agents + 1), 0), TimeScale(theta))
    clock.advance(MissionMs(0))
    return clock, time.monotonic() - began_s


def cpu_of_hours(clock: Coordinator, pids: list[int], name: str) -> float:
    """Flies the hours, tick by tick where somebody has something to do; seconds on a processor of all these processes."""
    before_s = {pid: processor_s(pid) for pid in pids}
    heard, shown = 0, 0
    while (due_ms := clock.next_due_ms) is not None and due_ms < HOURS * HOUR_MS:
        now_ms = -(-due_ms // 1000) * 1000
        heard += sum(not isinstance(it, AgentDied) for it in clock.advance(MissionMs(now_ms)))
        if now_ms // 60_000 > shown:
            shown = now_ms // 60_000
            print(f"\r{name}: minute {shown} of {60 * HOURS}, {heard} packets ", end="", file=sys.stderr)
    print("\r\033[K", end="", file=sys.stderr)
    if heard < len(clock.agent_ids) * (HOURS - 1):
        raise RuntimeError(f"only {heard} packets came from {len(clock.agent_ids)} aMussels")
    return sum(processor_s(pid) - before_s[pid] for pid in pids)


def processor_s(pid: int) -> float:
    """Seconds that a process was on a processor; more finely than the clock ticks of /proc/PID/stat."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) / 1e9


def available_mb() -> float:
    return fields_kb("/proc/meminfo")["MemAvailable"] / 1024


def in_child(measure_row: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Measures in a forked process, so that one row's memory is not the next one's."""
    with ProcessPoolExecutor(1, get_context("fork")) as child:
        return child.submit(measure_row).result()


def merges() -> bool:
    """True if this kernel keeps equal pages once."""
    return MERGING.exists() and MERGING.read_text().strip() == "1"


def wait_for_merging() -> None:
    """Waits until the kernel has scanned every page twice: pages without a change in between are then merged."""
    if not merges():
        return
    scans = MERGING.with_name("full_scans")
    until, until_s = int(scans.read_text()) + 3, time.monotonic() + MERGING_TIMEOUT_S
    while int(scans.read_text()) < until and time.monotonic() < until_s:
        select.select([], [], [], 0.2)


def fill_logs(run_dir: str, agents: int) -> None:
    """Writes a fleet's flash file in which every log is full, without any acknowledged record."""
    descriptor = os.open(os.path.join(run_dir, FLASH_NAME), os.O_RDWR | os.O_CREAT, 0o644)
    for index in range(agents):
        log = FlashLog(FlashRegion(descriptor, index), 0, 0)
        for sequence in range(LOGGED):
            log.append(SampleRecord(sequence, sequence, (1, 2, 3, 4), 0))
    os.close(descriptor)


def serve(clock: Coordinator, agents: int, now_s: int, window_s: int) -> None:
    """The docking of every aMussel whose turn for a step of it has come; their turns are spread over the mission."""
    codec = MusselbedCodec()
    for agent_id in range(1, agents + 1):
        turn_s = 2 + (MISSION_S - 2 - max(SERVICE_S) - window_s) * agent_id // agents
        for step, after_s in enumerate(SERVICE_S):
            if not now_s - window_s < turn_s + after_s <= now_s:
                continue
            at_ms = (now_s - window_s) * 1000
            for stimulus in (
                (SoundArrived(codec.encode(CommandPacket(Kind.PERMISSION, agent_id))),),
                (ContactClosed(1_000_000, 1_000_000), DockMoved(2_000_000, 2_000_000)),
                (ContactOpened(),),
                (WifiArrived(codec.encode(CommandPacket(Kind.RELEASE, agent_id))),),
            )[step]:
                clock.receive(agent_id, stimulus, MissionMs(at_ms))


def rospy_rows(folder: str, nodes: int) -> Iterator[dict[str, Any]]:
    with ExitStack() as stack:
        environment = on_master(stack)[1]
        kernel_before_kb = kernel_kb()
        began_s = time.monotonic()
        bare = [
            Node(stack, environment, str(NODES / "bare_rospy.py"), str(number)) for number in range(nodes)
        ]
        publish(bare, 1)
        ready_s = time.monotonic() - began_s
        pids = [node.process.pid for node in bare]
        yield cost_row("rospy", nodes, "first_status", pids, kernel_before_kb, ready_s)
        publish(bare, MISSION_S)
        yield cost_row("rospy", nodes, "after_20h", pids, kernel_before_kb, ready_s)


def publish(nodes: list[Node], count: int) -> None:
    """Lets every node publish, and waits for all of them."""
    for node in nodes:
        node.write_line(f"publish {count}")
    if any(node.line() != "done" for node in nodes):
        raise RuntimeError("a rospy node did not publish")


def cost_row(
    kind: str, agents: int, at: str, pids: list[int], kernel_before_kb: int, ready_s: float
) -> dict[str, Any]:
    return {
        "kind": kind,
        "agents": agents,
        "at": at,
        "pss_mb_per_agent": round(sum(map(pss_kb, pids)) / 1024 / agents, 3),
        "kernel_mb_per_agent": round((kernel_kb() - kernel_before_kb) / 1024 / agents, 3),
        "ready_s": round(ready_s, 3),
    }


def pss_kb(pid: int) -> int:
    return fields_kb(f"/proc/{pid}/smaps_rollup")["Pss"]


def kernel_kb() -> int:
    fields = fields_kb("/proc/meminfo")
    return fields["Slab"] + fields["PageTables"] + fields["KernelStack"]


def fields_kb(path: str) -> dict[str, int]:
    lines = (line.split() for line in Path(path).read_text().splitlines())
    return {words[0].rstrip(":"): int(words[1]) for words in lines if len(words) == 3 and words[2] == "kB"}

"""Starts, adopts and ends the nursery of a run: the parent starts it, and each supervisor adopts it in turn."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from agents.hosting.interrupts import held_back
from agents.hosting.nursery_client import Fenced, NurseryDied, NurseryLink
from agents.hosting.process_host import ProcessHost
from agents.nursery import protocol
from agents.nursery.launch import NurseryFailed, StartedNursery, prepare
from agents.time_scale import MissionMs
from agents.water.sea_client import RemoteSea
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.division import Member
from apad_bridge.assembly.flight_config import FlightConfig, flight_config
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import PRIVATE, RunDirectory
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.link_errors import PeerFailed
from apad_bridge.world.simulated_fleet import FlightFleet

FOLDER = "fleet"
_LAST_EPOCH = 2**31
"""Above the epoch of any supervisor, so that the nursery does not refuse the process that ends a run."""
_END_S = 1.0
_REAP_S = 10.0
"""Time for the machine to end a process that was killed."""


def begin_nursery(config: FlightConfig, starts: Sequence[Start], run_dir: Path) -> StartedNursery:
    """Begins a nursery with its fleet prepared in the run's directory; a supervisor that adopts them starts its agents.

    ValueError for firmware that nobody trusts: ours must not fly in its place unseen.

    Signals that ask to end are to be held back, as StartedNursery says.
    """
    if config.scenario.fleet.firmware and config.trust is None:
        raise ValueError("fleet.firmware is code in a file: add --trust if you trust it")
    folder = run_dir / FOLDER
    folder.mkdir(mode=PRIVATE)
    prepare(
        str(folder),
        fleet_parts.fleet_config(config),
        fleet_parts.initial_states(config.scenario, starts),
    )
    return StartedNursery(str(folder))


def begin_nurseries(
    stack: ExitStack, members: Sequence[Member], whole: RunDirectory, trust: Trust
) -> dict[str, StartedNursery]:
    """Begins the nursery of each aPad's fleet, by the aPad's name; `stack` ends those that nobody has adopted by then.

    A fleet in one process has none.
    """
    begun: dict[str, StartedNursery] = {}
    for member in members:
        if member.scenario.fleet.hosting is Hosting.PROCESSES:
            path = whole.of_apad(member.name, len(members)).path
            begun[member.name] = begin_nursery(flight_config(member.scenario, trust), member.starts, path)
            stack.callback(begun[member.name].end)
    return begun


def start_nursery(
    scenario: Scenario, starts: Sequence[Start], run_dir: Path, trust: Trust
) -> subprocess.Popen[bytes]:
    """Begins a nursery and waits until it listens."""
    try:
        with held_back():
            return begin_nursery(flight_config(scenario, trust), starts, run_dir).ready()
    except NurseryFailed as error:
        raise PeerFailed(f"the fleet cannot start: {error}; see {run_dir / FOLDER}/nursery.log") from error


def fleet_lives(run_dir: Path) -> bool:
    """True if a nursery serves the run's fleet."""
    try:
        protocol.connect(str(run_dir / FOLDER), _END_S).close()
    except OSError:
        return False
    return True


def end_fleet(run_dir: Path, nursery: subprocess.Popen[bytes] | None = None) -> None:
    """Ends the run's fleet if a supervisor has not done so, and reaps `nursery`, the run's first, if we began it.

    The nursery that lives now may be another: when a nursery dies, a supervisor starts the next one.
    """
    with contextlib.suppress(OSError, NurseryDied, Fenced):
        link = NurseryLink(str(run_dir / FOLDER), _LAST_EPOCH)
        link.end(_END_S)
        link.close()
    if nursery is None:
        return
    if nursery.poll() is None:
        nursery.kill()
    nursery.wait(_REAP_S)


def adopt(
    config: FlightConfig,
    run_dir: Path,
    epoch: int,
    now_ms: MissionMs,
    opened_modems: tuple[int, ...] = (),
    sea: RemoteSea | None = None,
) -> FlightFleet:
    """Adopts the run's fleet for supervisor number `epoch` at mission time `now_ms`, with the `opened_modems`.

    It joins the `sea` that several flights share, if there is one.
    """
    try:
        host = ProcessHost.adopt(str(run_dir / FOLDER), epoch)
    except (NurseryFailed, NurseryDied, Fenced) as error:
        raise PeerFailed(f"the fleet cannot be taken over: {error}; see {run_dir / FOLDER}") from error
    return fleet_parts.fleet_of(config, host, host.granted_ms, now_ms, opened_modems, sea)

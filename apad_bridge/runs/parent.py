"""The thin parent of a run over ROS: starts master, aPad node, nursery and supervisor, shows progress, ends all in order.

The parent holds no state of the flight. If the supervisor dies, the fleet is suspended and whole, and another supervisor
continues with it.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, assert_never

from agents.hosting.interrupts import held_back
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import MasterFailed, start_master
from apad_bridge.ros.system.route import environment_for, free_port, somebodys_master
from apad_bridge.runs.children import (
    Child,
    EndedTooSlowly,
    Interrupts,
    not_suspended,
    read_children,
    supervisor_of,
)
from apad_bridge.runs.nurseries import end_fleet, start_nursery
from apad_bridge.runs.parent_protocol import Broken, Failed, Gave, Kept, MemberReport, Said, Seen, Summary
from apad_bridge.runs.progress import ProgressDisplay
from apad_bridge.runs.status import Status
from apad_bridge.scenario.run_options import APadKind, OnDeath, Part, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.vehicle.errors import PeerFailed

_END_S = 4.0
"""A supervisor that was asked to end in order is killed after this time; everything ends within 5 s."""
_MASTER_S = 10.0
WAIT_FOR_RESUME_S = 600.0
"""A fleet without a supervisor is kept for `musselbed resume` for this time."""


def _ignore(report: MemberReport) -> None:
    """A run of a single aPad has no parent of several."""


def fly(
    scenario: Scenario,
    starts: Sequence[Start],
    options: RunOptions,
    directory: RunDirectory,
    progress: ProgressDisplay,
    relay: Callable[[MemberReport], None] = _ignore,
) -> dict[str, Any]:
    """Flies the run with processes of its own and returns its summary. PeerFailed when something that it needs fails.

    For one of several aPads, `relay` takes the reports that its supervisor writes for the parent of all.
    """
    with held_back(), not_suspended(), ExitStack() as stack:
        options = _open_ros(stack, options, directory.path).at_port(free_port())
        if options.owns_master:
            progress.print_message(f"the run's own ROS master: ROS_MASTER_URI={options.master_uri}")
        options.save(directory.path)
        if options.part is not Part.MISSION:
            stack.callback(end_fleet, directory.path, start_nursery(scenario, starts, directory.path))
        resume = False
        while True:
            code, result = watch_supervisor(
                start_supervisor(directory.path, options, resume=resume), progress, relay
            )
            resume = True
            if result is not None:
                return result
            if code >= 0:
                raise PeerFailed(
                    f"the supervisor ended with status {code}; see {directory.path}/supervisor.log"
                )
            if options.script:
                raise PeerFailed(
                    f"the supervisor died ({signal.Signals(-code).name}), and the script with it: a script cannot go on in "
                    f"the middle; see {directory.path}"
                )
            if options.is_one_of_several and options.on_death is OnDeath.WAIT and not options.keeps:
                progress.print_message(
                    f"the supervisor died ({signal.Signals(-code).name}): another one keeps its aMussels, whom the other "
                    "aPads go on to serve, and orders nothing"
                )
                relay(Broken(f"its supervisor died ({signal.Signals(-code).name})"))
                options = replace(options, keeps=True)
                continue
            progress.print_message(
                f"the supervisor died ({signal.Signals(-code).name}); the fleet is suspended and whole. "
                f"To go on: musselbed resume {directory.path}"
            )
            if options.on_death is OnDeath.WAIT:
                return _wait_for_resume(directory.path, progress)


def start_supervisor(run_dir: Path, options: RunOptions, *, resume: bool) -> Child:
    """Starts a supervisor. One that resumes saves its epoch and `keeps` itself, once it holds the run's lock."""
    return Child(
        "supervisor",
        "apad_bridge.runs.supervisor_process",
        [str(run_dir), *(["--resume"] if resume else []), *(["--keeps"] if resume and options.keeps else [])],
        run_dir / "supervisor.log",
        environment_for(options.master_uri, options.namespace),
    )


def watch_supervisor(
    child: Child, progress: ProgressDisplay, relay: Callable[[MemberReport], None] = _ignore
) -> tuple[int, dict[str, Any] | None]:
    """Shows the supervisor's output until it ends; returns its exit code, and the summary if it wrote one.

    PeerFailed when the supervisor reports that something it needs failed. Ctrl-C, SIGTERM and SIGHUP here ask it to end in
    order; KeyboardInterrupt when it then ends without a summary.
    """
    result: dict[str, Any] | None = None
    failed: str | None = None
    try:
        with Interrupts() as interrupts:
            for _, message in read_children({child.name: child}, interrupts, _END_S):
                match message:
                    case Status():
                        progress.show_status(message)
                    case Said(text):
                        progress.print_message(text)
                    case Summary(figures):
                        result = figures
                    case Failed(reason):
                        failed = reason
                    case Seen() | Gave() | Kept() | Broken():
                        relay(message)
                    case None:
                        pass
                    case _:
                        assert_never(message)
    except EndedTooSlowly:
        child.end(1.0)
        raise PeerFailed(
            f"the supervisor did not end within {_END_S:g} s and was killed; "
            f"its records end there: {child.log.parent}"
        ) from None
    code = child.wait(_END_S)
    child.end(1.0)
    if failed is not None:
        raise PeerFailed(failed)
    if interrupts.interrupted and result is None:
        # It was just starting, or ending, and could not do so in order: do not start another one.
        progress.print_message(f"the supervisor ended without a summary; see {child.log.parent}")
        raise KeyboardInterrupt
    return (-signal.SIGKILL if code is None else code), result


def _open_ros(stack: ExitStack, options: RunOptions, run_dir: Path) -> RunOptions:
    """Starts a master of our own, and the simulated aPad on it; `stack` ends them in reverse order."""
    if options.apad is APadKind.ROS:
        return options.on_master(somebodys_master())
    try:
        master = start_master(run_dir / "ros", _MASTER_S)
        stack.callback(master.stop, 1.0)
        node = start_apad_node(
            run_dir / "scenario.yaml", master.uri, run_dir / "apad.log", namespace=options.namespace
        )
    except (MasterFailed, APadNodeFailed) as error:
        raise PeerFailed(f"{error}; see {run_dir}") from error
    stack.callback(stop_apad_node, node, 1.0)
    return options.on_own_master(master.uri)


def _wait_for_resume(run_dir: Path, progress: ProgressDisplay) -> dict[str, Any]:
    """Waits for a resumed supervisor to finish this run; at most WAIT_FOR_RESUME_S without a living one."""
    summary = run_dir / "summary.json"
    until_s = time.monotonic() + WAIT_FOR_RESUME_S
    with Interrupts() as interrupts:
        while not interrupts.interrupted and time.monotonic() < until_s:
            if summary.exists():
                found: dict[str, Any] = json.loads(summary.read_text())
                return found
            if supervisor_of(run_dir) is not None:
                until_s = time.monotonic() + WAIT_FOR_RESUME_S
            time.sleep(0.2)
    raise PeerFailed(f"the supervisor died and nobody resumed the run; its records: {run_dir}")

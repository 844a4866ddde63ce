"""Resumes a run over ROS whose supervisor died, also after a restart of the machine."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from agents.hosting.interrupts import held_back
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node
from apad_bridge.ros.system.master import MasterFailed, end_process, start_master, why_gone_of
from apad_bridge.runs.children import not_suspended
from apad_bridge.runs.display import ProgressDisplay
from apad_bridge.runs.nurseries import end_fleet, fleet_lives
from apad_bridge.runs.parent import MASTER_S, Run, SupervisorWatch
from apad_bridge.runs.several.joint_summary import Flown
from apad_bridge.runs.supervisor_lock import supervisor_of
from apad_bridge.runs.watched_services import watched_master
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.vehicle.link_errors import PeerFailed


def resume(
    name: str, run_dir: Path, options: RunOptions, progress: ProgressDisplay, trust: Trust | None
) -> Flown:
    """Starts another supervisor for a run whose supervisor died, and shows it until it ends.

    All else runs already, or has ended with the machine: of the run's own it starts all again, and ends it.
    """
    with held_back(), not_suspended(), ExitStack() as stack:
        nodes: dict[str, subprocess.Popen[bytes]] = {}
        if options.owns_master and (gone := why_gone_of(run_dir / "ros", options.master_uri)) is not None:
            progress.print_message(
                f"{gone}: the run's own master, simulated aPad and fleet are started again"
            )
            options, nodes[name] = _open_ros_again(stack, run_dir, options, progress.print_message)
        elif options.owns_master:
            stack.enter_context(watched_master(options.master_uri, run_dir, progress.print_message))
        if not fleet_lives(run_dir):
            stack.callback(_end_own_fleet, run_dir)
        run = Run(name, run_dir, options, trust)
        return SupervisorWatch([run], progress, nodes, resumes=True).read_until_all_ended()


def _end_own_fleet(run_dir: Path) -> None:
    """Ends the fleet that our supervisor has started. One that another resumed the run with meanwhile keeps it."""
    if supervisor_of(run_dir) is None:
        end_fleet(run_dir)


def _open_ros_again(
    stack: ExitStack, run_dir: Path, options: RunOptions, tell: Callable[[str], None]
) -> tuple[RunOptions, subprocess.Popen[bytes]]:
    """Another master of the run's own, and its simulated aPad as the records saw it last; `stack` ends both."""
    try:
        scenario, held = _apad_as_seen(RunDirectory(run_dir))
        master = start_master(run_dir / "ros", MASTER_S)
        stack.callback(master.stop, 1.0)
        stack.enter_context(watched_master(master.uri, run_dir, tell))
        log = run_dir / "apad.log"
        node = start_apad_node(scenario, master.uri, log, namespace=options.namespace, held=held)
    except (MasterFailed, APadNodeFailed, UserError) as error:
        raise PeerFailed(f"{error}; see {run_dir}") from error
    stack.callback(end_process, node, 1.0)
    return options.on_own_master(master.uri), node


def _apad_as_seen(directory: RunDirectory) -> tuple[Path, dict[int, int]]:
    """The file of a scenario with the aPad as the records saw it last, and the aMussels in its docks, by dock index.

    UserError for damaged records.
    """
    # Imported here, because they compute with numpy, and a run's parent needs them after a restart of the machine alone.
    from apad_bridge.records.journal import read_journal
    from apad_bridge.records.run_state import RunState
    from apad_bridge.runs.start_state import find_resume_point, with_apad_as_seen
    from apad_bridge.scenario.loader import load, write_resolved

    scenario = load(directory.scenario)
    state = RunState.of(scenario, read_journal(directory.journal))
    docked = dict(find_resume_point(state, 0, 0).state.docked)
    if (seen := with_apad_as_seen(scenario, state.apad)) is None:
        return directory.scenario, docked
    file = directory.path / "ros" / "apad_as_seen.yaml"
    write_resolved(file, seen)
    return file, docked

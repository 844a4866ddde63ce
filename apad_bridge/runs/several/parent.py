"""Several aPads' flights over ROS, side by side on one master.

Each aPad's run has a parent, a nursery and a supervisor of its own. On a master of our own, one node publishes the /clock
that simulated aPads and supervisors follow; each mission's time begins when its supervisor first receives it.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any, assert_never

from agents.hosting.interrupts import held_back
from apad_bridge.assembly.division import Member
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import MasterFailed, start_master
from apad_bridge.ros.system.route import environment_for, somebodys_master
from apad_bridge.runs.children import Child, EndedTooSlowly, Interrupts, not_suspended, read_children
from apad_bridge.runs.parent_protocol import Broken, Failed, Gave, Kept, Message, Said, Seen, Summary
from apad_bridge.runs.progress import ProgressDisplay
from apad_bridge.runs.several.reassignment import Reassigner
from apad_bridge.runs.several.summary import combined_status
from apad_bridge.runs.status import Status
from apad_bridge.scenario.another_apad import Sharing
from apad_bridge.scenario.run_options import APadKind, RunOptions, TimeSource
from apad_bridge.vehicle.errors import PeerFailed

_MASTER_S = 10.0
_END_S = 8.0
"""Members that were asked to end in order are killed after so long; each of them kills its supervisor sooner."""


def directory_of(member: Member, whole: RunDirectory) -> RunDirectory:
    return RunDirectory(whole.path / member.name)


def fly_side_by_side(
    members: Sequence[Member],
    sharing: Sharing,
    options: RunOptions,
    whole: RunDirectory,
    progress: ProgressDisplay,
) -> tuple[dict[str, dict[str, Any]], dict[str, str], int]:
    """Returns the summaries and the failures by aPad, and the number of aMussels that were handed on to another aPad.

    PeerFailed when the master or a simulated aPad does not start.
    """
    folders = {member.name: directory_of(member, whole).path for member in members}
    takes_over = sharing.transfers and not options.without_mission
    reassigner = (
        Reassigner({it.name: it.scenario.fleet.ids for it in members}, folders) if takes_over else None
    )
    with held_back(), not_suspended(), ExitStack() as stack:
        uri, time_source, nodes = _open_ros(stack, members, options, whole)
        children: dict[str, Child] = {}
        for member in members:
            directory = directory_of(member, whole)
            opened = tuple(it for it in options.open_modems if it in member.scenario.fleet.ids)
            on_master = replace(
                options,
                apad=APadKind.ROS,
                time=time_source,
                speed=1.0,
                open_modems=opened,
                is_one_of_several=takes_over,
            )
            on_master.on_master(uri).save(directory.path)
            child = Child(
                member.name,
                "apad_bridge.runs.several.member_process",
                [str(directory.path)],
                directory.path / "parent.log",
                environment_for(uri, options.namespace),
            )
            stack.callback(child.end, 1.0)
            children[member.name] = child
        summaries, failures = MemberWatch(children, nodes, progress, reassigner).read_until_all_ended()
    return summaries, failures, 0 if reassigner is None else len(reassigner.handed_on)


def _open_ros(
    stack: ExitStack, members: Sequence[Member], options: RunOptions, whole: RunDirectory
) -> tuple[str, TimeSource, dict[str, subprocess.Popen[bytes]]]:
    """The master's URI, the time source, and the nodes of our simulated aPads by name; starts their /clock too."""
    if options.apad is APadKind.ROS:
        return somebodys_master(), options.time, {}
    nodes: dict[str, subprocess.Popen[bytes]] = {}
    try:
        master = start_master(whole.path / "ros", _MASTER_S)
        stack.callback(master.stop, 1.0)
        for member in members:
            scenario = directory_of(member, whole).scenario
            log = whole.path / f"{member.name}.log"
            node = start_apad_node(scenario, master.uri, log, namespace=options.namespace)
            stack.callback(stop_apad_node, node, 1.0)
            nodes[member.name] = node
    except (MasterFailed, APadNodeFailed) as error:
        raise PeerFailed(f"{error}; see {whole.path}") from error
    clock = Child(
        "clock",
        "apad_bridge.ros.system.clock_node",
        ["--speed", str(options.speed)],
        whole.path / "clock.log",
        environment_for(master.uri, options.namespace),
    )
    stack.callback(clock.end, 1.0)
    return master.uri, TimeSource.ROS, nodes


class MemberWatch:
    """Reads the members' output until all have ended. Ctrl-C and SIGTERM here ask them to end in order."""

    def __init__(
        self,
        children: Mapping[str, Child],
        nodes: Mapping[str, subprocess.Popen[bytes]],
        progress: ProgressDisplay,
        reassigner: Reassigner | None = None,
    ) -> None:
        """With a `reassigner` the other aPads serve the aMussels of an aPad that fails."""
        self._reassigner = reassigner
        self._broken: dict[str, str] = {}
        """The members whose aPad failed while their run continues, with the reason."""
        self._children = children
        self._nodes = nodes
        self._progress = progress
        self._statuses: dict[str, Status] = {}
        self._summaries: dict[str, dict[str, Any]] = {}
        self._failures: dict[str, str] = {}

    def read_until_all_ended(self) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
        """Returns the summaries and the failures by aPad.

        KeyboardInterrupt when it was asked to end before there was a summary or a failure.
        """
        # Children that end too slowly are killed below.
        with Interrupts() as interrupts, suppress(EndedTooSlowly):
            for name, message in read_children(self._children, interrupts, _END_S, self._end_without_apad):
                self._handle(name, message)
        if interrupts.interrupted and not self._summaries and not self._failures:
            # Asked to end while all were starting: the caller, which started them, ends them.
            self._progress.print_message("ended before a mission began")
            raise KeyboardInterrupt
        for name, child in self._children.items():
            if name not in self._summaries and name not in self._failures:
                child.end(1.0)
                self._failures[name] = (
                    f"ended without a summary: {child.last_log_line()}; see {child.log.parent}"
                )
        return {
            name: self._summaries[name] for name in self._children if name in self._summaries
        }, self._broken | self._failures

    def _end_without_apad(self) -> None:
        """Handles the death of a simulated aPad of ours, which is not restarted.

        Its run ends; with a reassigner it continues, and keeps its aMussels for the other aPads.
        """
        for name, node in self._nodes.items():
            ended = self._broken | self._failures | self._summaries
            if name in ended or (status := node.poll()) is None:
                continue
            why = f"the simulated aPad's node ended with status {status}"
            self._progress.print_message(f"{name}: {why}")
            if self._reassigner is None:
                self._failures[name] = why
                self._children[name].ask_to_end()
                continue
            self._broken[name] = why
            self._reassigner.stand_down(name, why)
            if self._broken.keys() >= self._nodes.keys():
                for child in self._children.values():
                    child.ask_to_end()

    def _output_closed(self, name: str) -> None:
        """Handles the end of a member's output."""
        if self._reassigner is not None and name not in self._summaries:
            self._reassigner.member_ended(name)

    def _handle(self, name: str, message: Message | None) -> None:
        match message:
            case Status():
                self._statuses[name] = message
                combined = combined_status(list(self._statuses.values()), len(self._children))
                self._progress.show_status(combined)
            case Said(text):
                self._progress.print_message(f"{name}: {text}")
            case Summary(figures):
                self._summaries[name] = figures
            case Failed(reason):
                self._failures[name] = reason
            case Broken(reason):
                self._broken[name] = reason
            case Seen() | Gave() | Kept():
                if self._reassigner is not None:
                    self._reassigner.receive(name, message)
            case None:
                self._output_closed(name)
            case _:
                assert_never(message)

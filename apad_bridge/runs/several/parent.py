"""Several aPads' flights over ROS, side by side on one master.

Each aPad's run has a parent, a nursery and a supervisor of its own. On a master of our own, one node publishes the /clock
that simulated aPads and supervisors follow; each mission's time begins when its supervisor first hears it.
"""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from apad_bridge.assembly.division import Member
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import MasterFailed, start_master
from apad_bridge.ros.system.route import environment_for, somebodys_master
from apad_bridge.runs.children import Child
from apad_bridge.runs.parent import Interrupts
from apad_bridge.runs.progress import Shows
from apad_bridge.runs.several.reassignment import Reassigner
from apad_bridge.runs.several.summary import together
from apad_bridge.runs.status import Status
from apad_bridge.scenario.another_apad import Sharing as Rules
from apad_bridge.scenario.run_options import APadKind, RunOptions, TimeSource
from apad_bridge.vehicle.errors import PeerFailed

_MASTER_S = 10.0
_END_S = 8.0
"""Members that were asked to end in order are killed after so long; each of them kills its supervisor sooner."""


def directory_of(member: Member, whole: RunDirectory) -> RunDirectory:
    return RunDirectory(whole.path / member.name)


def fly_side_by_side(
    members: Sequence[Member], rules: Rules, options: RunOptions, whole: RunDirectory, progress: Shows
) -> tuple[dict[str, dict[str, Any]], dict[str, str], int]:
    """By aPad the summaries, and what failed of which; and how many aMussels were handed on to another one.

    PeerFailed when master or a simulated aPad do not come up.
    """
    folders = {member.name: directory_of(member, whole).path for member in members}
    takes_over = rules.transfers and not options.without_mission
    reassigner = (
        Reassigner({it.name: it.scenario.fleet.ids for it in members}, folders) if takes_over else None
    )
    with ExitStack() as stack:
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
        summaries, failures = Watch(children, nodes, progress, reassigner).until_all_ended()
    return summaries, failures, 0 if reassigner is None else len(reassigner.handed_on)


def _open_ros(
    stack: ExitStack, members: Sequence[Member], options: RunOptions, whole: RunDirectory
) -> tuple[str, TimeSource, dict[str, subprocess.Popen[bytes]]]:
    """The master, and what of the graph is ours: simulated aPads, by name, and the /clock that they follow."""
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


class Watch:
    """Reads what the members say until all have ended. Ctrl-C and SIGTERM here ask them to end in order."""

    def __init__(
        self,
        children: Mapping[str, Child],
        nodes: Mapping[str, subprocess.Popen[bytes]],
        progress: Shows,
        reassigner: Reassigner | None = None,
    ) -> None:
        """With a `reassigner` the aMussels of one that fails are served by the others."""
        self._reassigner = reassigner
        self._broken: dict[str, str] = {}
        """Whose aPad is no more, and why, while its run goes on."""
        self._children = children
        self._nodes = nodes
        self._progress = progress
        self._unread = dict.fromkeys(children, b"")
        self._now: dict[str, Status] = {}
        self._summaries: dict[str, dict[str, Any]] = {}
        self._failures: dict[str, str] = {}

    def until_all_ended(self) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
        """By aPad the summaries, and why there is none; KeyboardInterrupt when it was told to end before there was any."""
        deadline_s: float | None = None
        with Interrupts() as interrupts, selectors.DefaultSelector() as selector:
            for name, child in self._children.items():
                selector.register(child.lines, selectors.EVENT_READ, name)
            while selector.get_map():
                if interrupts.came and deadline_s is None:
                    deadline_s = time.monotonic() + _END_S
                    for child in self._children.values():
                        child.ask_to_end()
                if deadline_s is not None and time.monotonic() > deadline_s:
                    break
                self._end_without_apad()
                for key, _ in selector.select(0.2):
                    if not self._read(key.data):
                        selector.unregister(key.fileobj)
                        self._lost(key.data)
        if deadline_s is not None and not self._summaries and not self._failures:
            # Told to end while all were starting: whoever started them ends them.
            self._progress.say("ended before a mission began")
            raise KeyboardInterrupt
        for name, child in self._children.items():
            if name not in self._summaries and name not in self._failures:
                child.end(1.0)
                self._failures[name] = (
                    f"ended without a summary: {child.last_words()}; see {child.log.parent}"
                )
        return {
            name: self._summaries[name] for name in self._children if name in self._summaries
        }, self._broken | self._failures

    def _end_without_apad(self) -> None:
        """A simulated aPad of ours that died comes not back: its run ends, or keeps its aMussels for the others."""
        for name, node in self._nodes.items():
            ended = self._broken | self._failures | self._summaries
            if name in ended or (status := node.poll()) is None:
                continue
            why = f"the simulated aPad's node ended with status {status}"
            self._progress.say(f"{name}: {why}")
            if self._reassigner is None:
                self._failures[name] = why
                self._children[name].ask_to_end()
                continue
            self._broken[name] = why
            self._reassigner.stand_down(name, why)
            if self._broken.keys() >= self._nodes.keys():
                for child in self._children.values():
                    child.ask_to_end()

    def _lost(self, name: str) -> None:
        """Its run says no more."""
        if self._reassigner is not None and name not in self._summaries:
            self._reassigner.gone(name)

    def _read(self, name: str) -> bool:
        """False at the end of its words."""
        came = os.read(self._children[name].lines.fileno(), 65536)
        *lines, self._unread[name] = (self._unread[name] + came).split(b"\n")
        for line in lines:
            self._hear(name, line.decode(errors="replace"))
        return bool(came)

    def _hear(self, name: str, line: str) -> None:
        status = Status.from_line(line)
        if status is not None:
            self._now[name] = status
            self._progress.show(together(list(self._now.values()), len(self._children)))
        elif line.startswith("{"):
            said = json.loads(line)
            if "summary" in said:
                self._summaries[name] = said["summary"]
            if "failed" in said:
                self._failures[name] = said["failed"]
            if "broken" in said.get("squad", ()):
                self._broken[name] = said["squad"]["broken"]
            if "squad" in said and self._reassigner is not None:
                self._reassigner.hear(name, said["squad"])
            if "said" in said:
                self._progress.say(f"{name}: {said['said']}")
        else:
            self._progress.say(f"{name}: {line}")

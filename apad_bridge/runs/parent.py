"""The parent of a run over ROS: starts the master, the sea that several aPads share, and for each aPad its node, its
nursery and its supervisor.

It shows progress and ends all in order. The parent holds no state of a flight: if a supervisor dies, its fleet is suspended
and whole, and another supervisor continues with it.

A single aPad's supervisor publishes /clock on a master of our own, in step with its node. For several, a node publishes the
/clock that simulated aPads and supervisors follow; each mission's time begins when its supervisor first receives it.
"""

from __future__ import annotations

import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, assert_never

from agents.hosting.interrupts import held_back
from agents.hosting.link_protocol import readable
from agents.nursery.fleet_file import RestartPolicy
from agents.water.sea_link import SOCKET_NAME
from apad_bridge.assembly.division import Member
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node
from apad_bridge.ros.system.master import MasterFailed, end_process, start_master
from apad_bridge.ros.system.route import environment_for, free_port, somebodys_master
from apad_bridge.runs.children import (
    Child,
    Interrupts,
    OrderlyEnd,
    not_suspended,
    read_children,
)
from apad_bridge.runs.display import JointDisplay, ProgressDisplay
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.nurseries import end_fleet, start_nursery
from apad_bridge.runs.parent_protocol import APadView, Failed, Gave, Kept, ParentMessage, Said, Summary
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.runs.several.joint_summary import Flown
from apad_bridge.runs.supervisor_lock import signal_supervisor, supervisor_of
from apad_bridge.runs.watched_services import watched_master
from apad_bridge.scenario.another_apad import Sharing
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.vehicle.link_errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.runs.several.reassignment import Reassigner

_END_S = 10.0
"""A supervisor that was asked to end in order is killed after this time without a new record, and after six times as long
in any case. On an idle machine it takes a second."""
MASTER_S = 10.0
_SEA_S = 60.0
WAIT_FOR_RESUME_S = 600.0
"""A fleet without a supervisor is kept for `musselbed resume` for this time."""
_RESTARTS = RestartPolicy()
"""A nursery's rule for its agents holds for supervisors that are followed by others, too, from their first tick on."""

Nodes = Mapping[str, "subprocess.Popen[bytes]"]
"""The nodes of our simulated aPads, by the aPad's name."""


@dataclass(frozen=True, slots=True)
class Run:
    """One aPad's run: its directory, and how its supervisor flies it."""

    name: str
    path: Path
    options: RunOptions
    trust: Trust | None = None
    """None: its supervisor executes no code of a file that the run names."""


def fly(
    members: Sequence[Member],
    sharing: Sharing,
    options: RunOptions,
    whole: RunDirectory,
    progress: ProgressDisplay,
    trust: Trust,
) -> Flown:
    """Flies one aPad, or several side by side, with processes of their own.

    PeerFailed when the master, a fleet or a simulated aPad does not start.
    """
    takes_over = len(members) > 1 and sharing.transfers and not options.without_mission
    with held_back(), not_suspended(), ExitStack() as stack:
        options, nodes = _open_ros(stack, members, options, whole, progress.print_message)
        if nodes:
            progress.print_message(f"the run's own ROS master: ROS_MASTER_URI={options.master_uri}")
        sea = _open_sea(stack, members, whole)
        runs, names = [], tuple(it.name for it in members)
        for member in members:
            path = whole.of_apad(member.name, len(members)).path
            opened = tuple(it for it in options.open_modems if it in member.scenario.fleet.ids)
            own = replace(options, open_modems=opened, is_one_of_several=takes_over, apads=names, sea=sea)
            own = own.at_port(free_port())
            own.save(path)
            if options.part is not BenchPart.MISSION:
                stack.callback(end_fleet, path, start_nursery(member.scenario, member.starts, path, trust))
            runs.append(Run(member.name, path, own, trust))
        reassigner = None
        if takes_over:
            # Imported here, because it computes with numpy, and most runs have one aPad.
            from apad_bridge.runs.several.reassignment import Reassigner

            reassigner = Reassigner(
                {it.name: it.scenario.fleet.ids for it in members}, {it.name: it.path for it in runs}
            )
        return SupervisorWatch(runs, progress, nodes, reassigner).read_until_all_ended()


def start_supervisor(run: Run, *, resume: bool) -> Child:
    """Starts a supervisor. One that resumes saves its epoch and `keeps` itself, once it holds the run's lock."""
    return Child(
        "supervisor",
        "apad_bridge.runs.supervisor_process",
        [
            str(run.path),
            *(["--trust"] if run.trust is not None else []),
            *(["--resume"] if resume else []),
            *(["--keeps"] if resume and run.options.keeps else []),
        ],
        run.path / "supervisor.log",
        environment_for(run.options.master_uri, run.options.namespace),
    )


def _open_ros(
    stack: ExitStack,
    members: Sequence[Member],
    options: RunOptions,
    whole: RunDirectory,
    tell: Callable[[str], None],
) -> tuple[RunOptions, Nodes]:
    """The options on somebody's master, or on one of our own with the simulated aPads; `stack` ends these.

    `tell` takes the lines about a master of our own that stands still.
    """
    if options.apad is APadKind.ROS:
        return options.on_master(somebodys_master()), {}
    nodes = {}
    try:
        master = start_master(whole.path / "ros", MASTER_S)
        stack.callback(master.stop, 1.0)
        stack.enter_context(watched_master(master.uri, whole.path, tell))
        for member in members:
            directory = whole.of_apad(member.name, len(members))
            nodes[member.name] = start_apad_node(
                directory.scenario, master.uri, directory.path / "apad.log", namespace=options.namespace
            )
            stack.callback(end_process, nodes[member.name], 1.0)
    except (MasterFailed, APadNodeFailed) as error:
        raise PeerFailed(f"{error}; see {whole.path}") from error
    if len(members) == 1:
        return options.on_own_master(master.uri), nodes
    clock = Child(
        "clock",
        "apad_bridge.ros.system.clock_node",
        ["--speed", str(options.speed)],
        whole.path / "clock.log",
        environment_for(master.uri, options.namespace),
    )
    stack.callback(clock.end, 1.0)
    followed = replace(options, apad=APadKind.ROS, time=TimeSource.ROS, speed=1.0)
    return followed.on_master(master.uri), nodes


def _open_sea(stack: ExitStack, members: Sequence[Member], whole: RunDirectory) -> str:
    """Starts the process of the sea that several aPads share, which `stack` ends; returns its directory, or nothing."""
    if len(members) == 1 or members[0].scenario.water is None:
        return ""
    directory = whole.path.absolute()
    child = Child("sea", "apad_bridge.runs.several.sea_process", [str(directory)], directory / "sea.log", {})
    stack.callback((directory / SOCKET_NAME).unlink, missing_ok=True)
    stack.callback(child.end, 1.0)
    if not (readable(child.lines.fileno(), _SEA_S) and child.lines.readline()):
        raise PeerFailed(f"the sea does not start: {child.last_log_line()}; see {child.log}")
    return str(directory)


class SupervisorWatch:
    """Starts the supervisors, and reads their output until all runs have ended.

    Ctrl-C, SIGTERM and SIGHUP here ask them to end in order. One that dies is followed by another, or waited for.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        progress: ProgressDisplay,
        nodes: Nodes | None = None,
        reassigner: Reassigner | None = None,
        *,
        resumes: bool = False,
        start: Callable[..., Child] = start_supervisor,
    ) -> None:
        """With a `reassigner` the other aPads serve the aMussels of an aPad that fails.

        With `resumes` a person asked for another supervisor of a run whose supervisor died: no third one follows it.
        """
        self._runs = {run.name: run for run in runs}
        display = JointDisplay(list(self._runs), progress)
        self._displays = {name: display.of(name) for name in self._runs}
        self._nodes = nodes or {}
        self._reassigner = reassigner
        self._resumes = resumes
        self._start = start
        self._interrupts = Interrupts()
        self._children: dict[str, Child] = {}
        """The supervisors that fly."""
        self._ticking_since_s: dict[str, float] = {}
        """The monotonic time of their first tick, by the aPad's name."""
        self._deaths: Counter[str] = Counter()
        """The number of supervisors in a row that died before they had settled."""
        self._waiting: dict[str, float] = {}
        """The runs whose supervisor died and that wait for `musselbed resume`, with the monotonic time of their end."""
        self._resumed: set[str] = set()
        """Those that somebody has resumed: their supervisor is no child of ours."""
        self._ends: dict[str, OrderlyEnd] = {}
        """The runs whose supervisor was asked to end."""
        self._overdue: set[str] = set()
        """Those whose supervisor was killed because it did not."""
        self._broken: dict[str, str] = {}
        """The aPads that failed while their run continues, with the reason."""
        self._summaries: dict[str, dict[str, Any]] = {}
        self._failures: dict[str, str] = {}

    def read_until_all_ended(self) -> Flown:
        """KeyboardInterrupt when it was asked to end before there was a summary or a failure."""
        try:
            with self._interrupts:
                for run in self._runs.values():
                    self._children[run.name] = self._start(run, resume=self._resumes)
                for name, message in read_children(self._children, self._look):
                    self._handle(name, message)
        finally:
            for child in self._children.values():
                child.end(1.0)
        self._report_without_end()
        summaries = {name: self._summaries[name] for name in self._runs if name in self._summaries}
        handed_on = 0 if self._reassigner is None else len(self._reassigner.handed_on)
        return Flown(summaries, self._broken | self._failures, handed_on)

    def _handle(self, name: str, message: ParentMessage | None) -> None:
        match message:
            case RunStatus():
                self._ticking_since_s.setdefault(name, time.monotonic())
                self._displays[name].show_status(message.now_ms, lambda: message)
            case Said(text):
                self._print(name, text)
            case Summary(figures):
                self._summaries[name] = figures
            case Failed(reason):
                self._fail(name, reason)
            case APadView() | Gave() | Kept():
                if self._reassigner is not None:
                    self._reassigner.receive(name, message)
            case None:
                self._supervisor_ended(self._runs[name], self._children.pop(name))
            case _:
                assert_never(message)

    def _supervisor_ended(self, run: Run, child: Child) -> None:
        code = child.wait(_END_S)
        child.end(1.0)
        if run.name not in self._summaries | self._failures:
            self._ended_without_report(run, code)
        if run.name not in self._children.keys() | self._waiting.keys():
            self._run_ended(run.name)

    def _ended_without_report(self, run: Run, code: int | None) -> None:
        """Handles the end of a supervisor that told neither a summary nor a failure."""
        was_killed = code is None or code < 0
        if self._was_cut_off(run):
            self._fail_cut_off(run)
        elif was_killed and (summary := RunDirectory(run.path).read_summary()) is not None:
            self._summaries[run.name] = summary  # it died on its way out
        elif self._interrupts.interrupted and (was_killed or code == Exit.INTERRUPTED):
            pass  # it was only starting: `_report_without_end` says so
        elif was_killed:
            self._supervisor_died(run, signal.SIGKILL if code is None else signal.Signals(-code))
        else:
            self._fail(run.name, f"the supervisor ended with status {code}; see {run.path}/supervisor.log")

    def _supervisor_died(self, run: Run, killer: signal.Signals) -> None:
        """Starts the next supervisor of the run, or waits for a person who does."""
        died, options = f"the supervisor died ({killer.name})", run.options
        if self._resumes:
            self._fail(run.name, f"{died}; see {run.path}/supervisor.log")
            return
        if options.script:
            self._fail(
                run.name,
                f"{died}, and the script with it: a script cannot continue in the middle; see {run.path}",
            )
            return
        waits = options.on_death is OnDeath.WAIT
        if not waits and self._dies_again_and_again(run.name):
            self._fail(
                run.name,
                f"{died}, as {_RESTARTS.restarts} others had in a row, and no further one is started; "
                f"see {run.path}/supervisor.log",
            )
            return
        if waits and options.is_one_of_several and not options.keeps:
            self._print(
                run.name,
                f"{died}: another one keeps its aMussels and orders nothing; the other aPads serve them",
            )
            self._broken[run.name] = f"its supervisor died ({killer.name})"
            run = replace(run, options=replace(options, keeps=True))
            self._runs[run.name] = run
            waits = False
        else:
            self._print(
                run.name,
                f"{died}; the fleet is paused and intact. Continue: musselbed resume {run.path}",
            )
        if waits:
            self._waiting[run.name] = time.monotonic() + WAIT_FOR_RESUME_S
        else:
            self._children[run.name] = self._start(run, resume=True)

    def _dies_again_and_again(self, name: str) -> bool:
        """Counts a death, and tells whether the nursery's rule allows no other start."""
        now_s = time.monotonic()
        if now_s - self._ticking_since_s.pop(name, now_s) >= _RESTARTS.settled_s:
            del self._deaths[name]
        self._deaths[name] += 1
        return self._deaths[name] > _RESTARTS.restarts

    def _run_ended(self, name: str) -> None:
        if self._reassigner is not None and name not in self._summaries:
            self._reassigner.member_ended(name)

    def _look(self) -> bool:
        """Looks after nodes, ends, and runs that wait for `musselbed resume`; True while there is such a run."""
        self._look_at_nodes()
        if self._interrupts.interrupted:
            self._ask_to_end(self._runs)
        self._look_at_ends()
        for name in list(self._waiting):
            self._look_at_waiting(self._runs[name])
        return bool(self._waiting)

    def _look_at_waiting(self, run: Run) -> None:
        """A supervisor that somebody has resumed the run with flies it to its end, whatever ends this parent."""
        if supervisor_of(run.path) is not None:
            self._resumed.add(run.name)
            self._waiting[run.name] = time.monotonic() + WAIT_FOR_RESUME_S
            return
        is_over = self._interrupts.interrupted or time.monotonic() > self._waiting[run.name]
        if self._was_cut_off(run):
            self._fail_cut_off(run)
        elif (summary := RunDirectory(run.path).read_summary()) is not None:
            self._summaries[run.name] = summary
        elif is_over and run.name in self._resumed:
            self._fail(run.name, f"the run was resumed, and ended without a summary; its records: {run.path}")
        elif is_over:
            self._fail(run.name, f"the supervisor died and nobody resumed the run; its records: {run.path}")
        if run.name in self._summaries | self._failures:
            del self._waiting[run.name]
            self._run_ended(run.name)

    def _look_at_ends(self) -> None:
        """Kills a supervisor that was asked to end, and that comes no nearer to its end."""
        for name, end in self._ends.items():
            if name in self._overdue or not end.is_overdue():
                continue
            if (child := self._children.get(name)) is not None:
                child.kill()
            elif (
                name not in self._waiting or signal_supervisor(self._runs[name].path, signal.SIGKILL) is None
            ):
                continue
            self._overdue.add(name)

    def _look_at_nodes(self) -> None:
        """Handles the death of a simulated aPad of ours, which is not restarted.

        Its run ends; with a reassigner it continues, and keeps its aMussels for the other aPads.
        """
        for name, node in self._nodes.items():
            ended = self._broken | self._failures | self._summaries
            if name in ended or (status := node.poll()) is None:
                continue
            why = f"the simulated aPad's node ended with status {status}"
            self._print(name, why)
            if self._reassigner is None:
                self._fail(name, why)
                self._ask_to_end([name])
                continue
            self._broken[name] = why
            self._reassigner.stand_down(name, why)
            if self._broken.keys() >= self._nodes.keys():
                self._ask_to_end(self._nodes)

    def _ask_to_end(self, names: Iterable[str]) -> None:
        """Asks the supervisors of these runs to end, once each: our children, and those that others resumed runs with."""
        for name in names:
            if name in self._ends:
                continue
            if (child := self._children.get(name)) is not None:
                child.ask_to_end()
            elif name in self._waiting and (pid := signal_supervisor(self._runs[name].path, signal.SIGTERM)):
                self._resumed.add(name)
                self._print(name, f"the supervisor that resumed the run (pid {pid}) is asked to end")
            else:
                continue
            self._ends[name] = OrderlyEnd(self._runs[name].path, _END_S)

    def _report_without_end(self) -> None:
        """A run without a summary or a failure was just starting, or ending, when it was asked to end."""
        without_end = [it for it in self._runs.values() if it.name not in self._summaries | self._failures]
        why = "the supervisor ended without a summary; see"
        if len(without_end) == len(self._runs):
            for run in without_end:
                self._print(run.name, f"{why} {run.path}")
            raise KeyboardInterrupt
        for run in without_end:
            self._fail(run.name, f"{why} {run.path}")

    def _was_cut_off(self, run: Run) -> bool:
        """True if we killed its supervisor before the records were whole: the checkpoint goes when all are closed."""
        directory = RunDirectory(run.path)
        is_whole = directory.summary.exists() and not directory.checkpoint.exists()
        return run.name in self._overdue and not is_whole

    def _fail_cut_off(self, run: Run) -> None:
        self._fail(
            run.name,
            f"the supervisor was asked to end, wrote nothing for {_END_S:g} s and was killed; "
            f"its records end there: {run.path}",
        )

    def _fail(self, name: str, reason: str) -> None:
        """Keeps the first reason, which is the cause of later ones."""
        self._failures.setdefault(name, reason)

    def _print(self, name: str, text: str) -> None:
        self._displays[name].print_message(text)

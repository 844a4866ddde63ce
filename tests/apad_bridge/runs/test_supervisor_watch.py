"""The parent of one aPad or of several handles the lines that their supervisors write, their deaths and their ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from patient import PATIENCE_S

from agents.nursery.fleet_file import RestartPolicy
from apad_bridge.runs.children import Child, OrderlyEnd
from apad_bridge.runs.display import MakeStatus
from apad_bridge.runs.parent import Run, SupervisorWatch
from apad_bridge.runs.parent_protocol import Failed, ParentMessage, Said, Summary, to_line
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.runs.several.joint_summary import Flown
from apad_bridge.runs.several.reassignment import Reassigner
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource

OPTIONS = RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT)


class Supervisor:
    """It writes its lines to a real pipe and ends with `code`; with a `last` line it ends when it is asked to."""

    def __init__(
        self, *message: ParentMessage | str, last: ParentMessage | None = None, code: int = 0
    ) -> None:
        reader, self._writer = os.pipe()
        self.lines = os.fdopen(reader)
        self.log = Path("somewhere/supervisor.log")
        self._last = last
        self._code = code
        self.asked = 0
        for it in message:
            self._say(it)
        if last is None:
            os.close(self._writer)

    def ask_to_end(self) -> None:
        self.asked += 1
        if self._last is not None:
            self._say(self._last)
            os.close(self._writer)

    def kill(self) -> None:
        raise AssertionError("it ends in time")

    def wait(self, timeout_s: float) -> int:
        return self._code

    def end(self, timeout_s: float) -> None:
        self.lines.close()

    def _say(self, message: ParentMessage | str) -> None:
        text = message if isinstance(message, str) else to_line(message)
        os.write(self._writer, f"{text}\n".encode())


class ProgressLog:
    def __init__(self) -> None:
        self.messages: list[str] = []
        self.statuses: list[RunStatus] = []

    def print_message(self, text: str) -> None:
        self.messages.append(text)

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        self.statuses.append(status())


class Interrupting(ProgressLog):
    """Its terminal gets Ctrl-C at the first message."""

    def print_message(self, text: str) -> None:
        super().print_message(text)
        signal.raise_signal(signal.SIGINT)


class Starts:
    """Starts the given supervisors, of each run in their order, and keeps how they were started."""

    def __init__(self, supervisors: Mapping[str, list[Supervisor]]) -> None:
        self.left = {name: list(them) for name, them in supervisors.items()}
        self.made: list[tuple[str, bool, bool]] = []
        """(name, resume, keeps)"""

    def __call__(self, run: Run, *, resume: bool) -> Any:
        self.made.append((run.name, resume, run.options.keeps))
        return self.left[run.name].pop(0)


def status(now_ms: int, served: int, way_m: float) -> RunStatus:
    return RunStatus(now_ms, "dock", "dock", 4, 3, (7,), served, way_m, 0.9, 0.0)


def read_all(
    supervisors: Mapping[str, Supervisor], progress: ProgressLog, nodes: dict[str, Any] | None = None
) -> Flown:
    runs = [Run(name, Path("somewhere"), OPTIONS) for name in supervisors]
    starts = Starts({name: [it] for name, it in supervisors.items()})
    return SupervisorWatch(runs, progress, nodes, start=starts).read_until_all_ended()


NO_MESSAGES = [
    "a warning",
    "{",
    '{"status": {"now_ms": "x"}}',
    '{"summary": 5}',
    "[]",
    "5",
    '{"gave": [[1]]}',
]


@pytest.mark.parametrize(
    ("lines", "messages", "shown"),
    [
        pytest.param(
            {"a": (status(9000, 2, 10.0), Said("hello"), Summary({"x": 1}))},
            ["hello"],
            [(9000, "dock", 4, 2, 10.0)],
            id="one aPad's are shown as they are",
        ),
        pytest.param(
            {
                "a": (status(9000, 2, 10.0), Said("hello"), Summary({"services": 2})),
                "b": (status(7000, 1, 5.0), Summary({"services": 1})),
            },
            ["a: hello"],
            [(7000, "2 aPads", 8, 3, 15.0)],
            id="statuses are added, and words stand with their aPad",
        ),
        pytest.param({"a": (*NO_MESSAGES, Summary({}))}, NO_MESSAGES, [], id="what is no message is text"),
    ],
)
def test_statuses_and_words_are_shown(
    lines: dict[str, tuple[Any, ...]], messages: list[str], shown: list[tuple[Any, ...]]
) -> None:
    progress = ProgressLog()
    flown = read_all({name: Supervisor(*them) for name, them in lines.items()}, progress)
    assert flown == Flown({name: them[-1].figures for name, them in lines.items()})
    last = [(it.now_ms, it.phase, it.agents, it.services, it.cost_m) for it in progress.statuses[-1:]]
    assert (progress.messages, last) == (messages, shown)


def test_one_that_fails_leaves_the_others_their_summaries() -> None:
    supervisors = {
        "a": Supervisor(Summary({})),
        "b": Supervisor(Failed("no fleet"), code=3),
        "c": Supervisor(code=1),
    }
    flown = read_all(supervisors, ProgressLog())
    assert flown.summaries == {"a": {}}
    assert flown.failures == {
        "b": "no fleet",
        "c": "the supervisor ended with status 1; see somewhere/supervisor.log",
    }


@pytest.mark.parametrize("others", [[], ["a"]])
def test_a_simulated_aPad_that_died_ends_its_own_run_only(others: list[str]) -> None:
    """Run `a` has written its summary and needs no end. Run `b` would fly on without its vehicle."""
    supervisors = {name: Supervisor(Summary({})) for name in others}
    supervisors["b"] = Supervisor(last=Summary({"services": 1}))
    nodes = {name: SimpleNamespace(poll=lambda: None) for name in others}
    nodes["b"] = SimpleNamespace(poll=lambda: -9)
    flown = read_all(supervisors, ProgressLog(), nodes)
    assert flown.summaries == {**{name: {} for name in others}, "b": {"services": 1}}
    assert flown.failures == {"b": "the simulated aPad's node ended with status -9"}
    assert supervisors["b"].asked == 1 and all(supervisors[name].asked == 0 for name in others)


def died(on_death: OnDeath, run_dir: Path, progress: ProgressLog, **more: Any) -> tuple[Flown, Starts]:
    """Flies one aPad whose first supervisor is killed; the second writes a summary."""
    run = Run("a", run_dir, RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, on_death, **more))
    starts = Starts({"a": [Supervisor(code=-signal.SIGKILL), Supervisor(Summary({"services": 3}))]})
    reassigner = Reassigner({"a": [1]}, {"a": run_dir}) if run.options.is_one_of_several else None
    flown = SupervisorWatch([run], progress, reassigner=reassigner, start=starts).read_until_all_ended()
    for unused in starts.left["a"]:
        unused.end(0.0)
    return flown, starts


FIRST = ("a", False, False)


@pytest.mark.parametrize(
    ("on_death", "more", "flown", "made"),
    [
        pytest.param(
            OnDeath.RESUME,
            {},
            Flown({"a": {"services": 3}}),
            [FIRST, ("a", True, False)],
            id="resume at once",
        ),
        pytest.param(
            OnDeath.WAIT,
            {"is_one_of_several": True},
            Flown({"a": {"services": 3}}, {"a": "its supervisor died (SIGKILL)"}),
            [FIRST, ("a", True, True)],
            id="one of several is followed by one that keeps its fleet",
        ),
        pytest.param(
            OnDeath.WAIT,
            {"script": "/s.py"},
            Flown({}, {"a": "a script cannot continue in the middle"}),
            [FIRST],
            id="a script is not followed",
        ),
    ],
)
def test_one_that_died_is_followed(
    on_death: OnDeath, more: dict[str, Any], flown: Flown, made: list[tuple[str, bool, bool]], tmp_path: Path
) -> None:
    ended, starts = died(on_death, tmp_path, ProgressLog(), **more)
    assert ended.summaries == flown.summaries and starts.made == made
    assert all(why in ended.failures[name] for name, why in flown.failures.items())
    assert ended.failures.keys() == flown.failures.keys()


def test_else_the_run_waits_for_a_person_while_the_others_fly_on(tmp_path: Path) -> None:
    """The supervisor that a person starts is no child of this parent: its summary.json tells of its end."""

    class Resumed(ProgressLog):
        def print_message(self, text: str) -> None:
            super().print_message(text)
            if "musselbed resume" in text:
                (tmp_path / "summary.json").write_text(json.dumps({"services": 5}))

    runs = [Run(name, tmp_path / name if name == "b" else tmp_path, OPTIONS) for name in ("a", "b")]
    starts = Starts({"a": [Supervisor(code=-signal.SIGKILL)], "b": [Supervisor(Summary({"services": 1}))]})
    flown = SupervisorWatch(runs, Resumed(), start=starts).read_until_all_ended()
    assert flown == Flown({"a": {"services": 5}, "b": {"services": 1}})


def test_a_resumed_supervisor_that_dies_ends_the_command(tmp_path: Path) -> None:
    starts = Starts({"a": [Supervisor(code=-signal.SIGKILL)]})
    watch = SupervisorWatch([Run("a", tmp_path, OPTIONS)], ProgressLog(), resumes=True, start=starts)
    assert watch.read_until_all_ended().failures == {
        "a": f"the supervisor died (SIGKILL); see {tmp_path}/supervisor.log"
    }
    assert starts.made == [("a", True, False)]


@contextmanager
def child(folder: Path, program: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Child]:
    """A real process."""
    (folder / "spoken.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), *sys.path]))
    process = Child("supervisor", "spoken", [], folder / "log", {})
    try:
        yield process
    finally:
        process.end(5.0)


def test_a_supervisor_is_read_to_its_last_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = ["a warning", to_line(status(1, 0, 1.0)), to_line(Summary({"services": 1})), '{"torn']
    text = "\n".join(lines).encode()
    progress = ProgressLog()
    with child(tmp_path, f"import os; os.write(1, {text!r})", monkeypatch) as process:
        flown = SupervisorWatch(
            [Run("a", tmp_path, OPTIONS)], progress, start=lambda run, resume: process
        ).read_until_all_ended()
    assert flown == Flown({"a": {"services": 1}})
    assert progress.messages == ["a warning", '{"torn'] and progress.statuses == [status(1, 0, 1.0)]


DEAF = "import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\nsignal.pause()"
SLOW = (
    "import pathlib, signal\nsignal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])\n"
    "print('up', flush=True)\nsignal.sigwait([signal.SIGTERM])\n"
    "path = pathlib.Path(__file__).with_name('summary')\npath.write_text('{\"services\": 7}')\n"
    "path.rename(path.with_suffix('.json'))\nsignal.pause()"
)
KILLED = "the supervisor was asked to end, wrote nothing for 0.2 s and was killed; its records end there: "


@pytest.mark.parametrize(
    ("program", "flown"),
    [
        pytest.param(DEAF, Flown({}, {"a": KILLED}), id="it does not end"),
        pytest.param(SLOW, Flown({"a": {"services": 7}}), id="slow after its records: nothing is lost"),
    ],
)
def test_one_that_does_not_end_in_time_is_killed(
    program: str, flown: Flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("apad_bridge.runs.parent._END_S", 0.2)
    progress, run = Interrupting(), Run("a", tmp_path, OPTIONS)
    with child(tmp_path, program, monkeypatch) as process:
        ended = SupervisorWatch([run], progress, start=lambda run, resume: process).read_until_all_ended()
        assert process.wait(PATIENCE_S) == -signal.SIGKILL
    told = {name: why.removesuffix(str(tmp_path)) for name, why in ended.failures.items()}
    assert Flown(ended.summaries, told) == flown and progress.messages == ["up"]


@pytest.mark.parametrize(
    ("grows_at", "overdue_s"),
    [
        pytest.param({}, 11, id="nothing is written"),
        pytest.param({9: "run.bag"}, 20, id="records that grow put the kill off"),
        pytest.param(dict.fromkeys(range(70), "journal.jsonl"), 61, id="up to a bound"),
    ],
)
def test_a_supervisor_that_does_not_end_is_killed(
    tmp_path: Path, grows_at: dict[int, str], overdue_s: int
) -> None:
    now_s = 0
    end = OrderlyEnd(tmp_path, 10.0, lambda: float(now_s))
    while not end.is_overdue():
        now_s += 1
        if now_s in grows_at:
            (tmp_path / grows_at[now_s]).write_text("." * now_s)
    assert now_s == overdue_s


RESUMED = """
import pathlib, signal, sys
from apad_bridge.runs.supervisor_lock import supervising
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
path = pathlib.Path(sys.argv[1])
with supervising(path):
    print("flies", flush=True)
    signal.sigwait([signal.SIGTERM])
    if sys.argv[2] == "in order":
        (path / "summary.json").write_text('{"services": 9}')
"""


@pytest.mark.parametrize("how", ["in order", "without records"])
@pytest.mark.parametrize("ended_by", ["a signal", "the aPad's node"])
def test_a_supervisor_that_somebody_resumed_is_asked_and_waited_for(
    tmp_path: Path, how: str, ended_by: str
) -> None:
    """Ctrl-C in the first terminal, or the end of its aPad, while the second one flies: the run is ended in order."""
    begun: list[subprocess.Popen[str]] = []
    node = SimpleNamespace(poll=lambda: -9 if begun and ended_by != "a signal" else None)

    class Resuming(ProgressLog):
        def print_message(self, text: str) -> None:
            super().print_message(text)
            if "Continue: musselbed resume" not in text:
                return
            command = [sys.executable, "-c", RESUMED, str(tmp_path), how]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            assert process.stdout is not None and process.stdout.readline() == "flies\n"
            # Nobody else reaps it: its parent is the other command.
            threading.Thread(target=process.wait, daemon=True).start()
            begun.append(process)
            if ended_by == "a signal":
                signal.raise_signal(signal.SIGINT)

    progress = Resuming()
    starts = Starts({"a": [Supervisor(code=-signal.SIGKILL)]})
    watch = SupervisorWatch([Run("a", tmp_path, OPTIONS)], progress, {"a": node}, start=starts)
    flown = watch.read_until_all_ended()
    (resumed,) = begun
    with resumed:
        assert resumed.wait(PATIENCE_S) == 0
    assert flown.summaries == ({"a": {"services": 9}} if how == "in order" else {})
    untold = {"a": f"the run was resumed, and ended without a summary; its records: {tmp_path}"}
    if ended_by != "a signal":
        assert flown.failures == {"a": "the simulated aPad's node ended with status -9"}
    else:
        assert flown.failures == ({} if how == "in order" else untold)
    assert f"the supervisor that resumed the run (pid {resumed.pid}) is asked to end" in progress.messages


def test_one_that_was_only_starting_ends_the_command_in_silence(tmp_path: Path) -> None:
    """Asked to end while its supervisor starts: that one is ended by the signal, and no other follows it."""

    class Starting(Supervisor):
        def ask_to_end(self) -> None:
            os.close(self._writer)

    def start(run: Run, *, resume: bool) -> Any:
        signal.raise_signal(signal.SIGINT)
        return Starting(last=Said(""), code=-signal.SIGTERM)

    progress = ProgressLog()
    with pytest.raises(KeyboardInterrupt):
        SupervisorWatch([Run("a", tmp_path, OPTIONS)], progress, start=start).read_until_all_ended()
    assert progress.messages == [f"the supervisor ended without a summary; see {tmp_path}"]


@pytest.mark.parametrize(("settled_s", "flies_on"), [(1e9, False), (0.0, True)])
def test_supervisors_that_die_at_once_are_not_started_for_ever(
    monkeypatch: pytest.MonkeyPatch, settled_s: float, flies_on: bool
) -> None:
    """Each is killed, as one that the kernel ends for want of memory; one that had settled begins a new row."""
    monkeypatch.setattr("apad_bridge.runs.parent._RESTARTS", RestartPolicy(settled_s=settled_s))
    made: list[bool] = []

    def start(run: Run, *, resume: bool) -> Any:
        made.append(resume)
        if len(made) == 7:
            return Supervisor(Summary({"x": 1}))
        return Supervisor(status(9000, 2, 10.0), code=-signal.SIGKILL)

    run = Run("a", Path("somewhere"), replace(OPTIONS, on_death=OnDeath.RESUME))
    flown = SupervisorWatch([run], ProgressLog(), start=start).read_until_all_ended()
    assert (len(made), "a" in flown.summaries) == ((7, True) if flies_on else (6, False))
    assert flies_on or "no further one is started" in flown.failures["a"]

"""Runs a mission script: compiles its file, gives it its globals, and runs it in a thread of its own.

The file is compiled before anything else starts, and a failure is reported in one line. The script's `time` module sleeps
and counts in mission time.
"""

from __future__ import annotations

import builtins
import io
import sys
import threading
import time
import traceback
import types
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import Any

from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.manual import ManualMission
from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.text.text_file import text_of
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.rendezvous import (
    AS_FAST_AS_POSSIBLE,
    Aborted,
    Do,
    Rendezvous,
    ScriptFinished,
    TurnTimeouts,
    Wait,
)
from firmware_model.entry_points import in_one_line

Program = Callable[[Api], object]
"""The function that runs in the script's thread."""
_JOIN_S = 2.0


class ScriptError(UserError, ValueError):
    """The file is not a script; the message is one line."""


def read_script(path: Path) -> CodeType:
    """Compiles the file. Raises ScriptError with the number of the wrong line; ScenarioError as `text_of`."""
    text = text_of(path)
    try:
        return compile(text, str(path), "exec")
    except (SyntaxError, ValueError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        message = error.msg if isinstance(error, SyntaxError) else str(error)
        raise ScriptError(f"{path}{line}: {message}") from None


class MissionTime(types.ModuleType):
    """Replaces the module `time` in a script: its sleep and clocks follow mission time, in seconds since the flight began.

    Everything else in it is Python's.
    """

    def __init__(self, api: Api) -> None:
        super().__init__("time", "Mission time, for a script of an aPad.")
        self.sleep = api.sleep
        self.time = self.monotonic = self.perf_counter = api.now
        self.time_ns = self.monotonic_ns = self.perf_counter_ns = lambda: round(api.now() * 1e9)

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)


def as_program(path: Path, _: Trust) -> Program:
    """The file as a program: gets `api`, `id_self` and `time`, and prints through the API."""
    code = read_script(path)

    def program(api: Api) -> None:
        clock = MissionTime(api)

        def import_(name: str, *args: Any, **kwargs: Any) -> Any:
            return clock if name == "time" else builtins.__import__(name, *args, **kwargs)

        def print_(*values: object, **options: Any) -> None:
            if options.get("file") is not None:
                builtins.print(*values, **options)
                return
            text = io.StringIO()
            builtins.print(*values, **{**options, "file": text, "flush": False})
            api.say(text.getvalue())

        if (folder := str(path.parent.absolute())) not in sys.path:
            sys.path.insert(0, folder)
        script_globals = {
            "api": api,
            "id_self": api.id_self,
            "time": clock,
            "__name__": "__main__",
            "__file__": str(path),
        }
        exec(
            code,
            {**script_globals, "__builtins__": {**vars(builtins), "__import__": import_, "print": print_}},
        )

    return program


class ScriptSource:
    """Gives the orders of a script to a commanded mission. The script stands still while mission time passes."""

    def __init__(
        self,
        scenario: Scenario,
        program: Program,
        name: str,
        tell: Callable[[str], None],
        turns: TurnTimeouts = AS_FAST_AS_POSSIBLE,
    ) -> None:
        self._rendezvous = Rendezvous(turns)
        frame = LocalFrame.about(scenario.area.origin)
        self._api = Api(self._rendezvous, frame, scenario.apad.name, scenario.fleet.all_ids, tell)
        self._program = program
        self._name = name
        self._thread: threading.Thread | None = None
        self.error: BaseException | None = None
        """The exception that the script raised, for its traceback."""

    def act(self, mission: ManualMission, now_ms: int) -> None:
        if self._thread is None:
            self._api.attach(mission)
            self._thread = threading.Thread(target=self._run, name=f"script {self._name}", daemon=True)
            self._rendezvous.begin()
            self._thread.start()
        self._rendezvous.tick()
        while not self._is_over(mission):
            request = self._rendezvous.next()
            match request:
                case None:
                    if self._rendezvous.is_stuck:
                        busy_s = self._rendezvous.busy_s
                        mission.finish(_failure(f"it neither called the API nor slept for {busy_s:g} s"))
                    return
                case ScriptFinished(failure):
                    if failure is not None:
                        mission.finish(_failure(failure))
                    elif not mission.is_busy:
                        # Its last order is finished first: a script may end with a docking.
                        mission.finish(MissionEnd(EndReason.SCRIPT_ENDED))
                    return
                case Do():
                    self._rendezvous.answer(_outcome(request.act))
                case Wait(condition, until_ms):
                    holds = _outcome(condition) if condition is not None else False
                    if not holds and now_ms < until_ms:
                        return
                    self._rendezvous.answer(holds if isinstance(holds, BaseException) else bool(holds))

    def print_error(self) -> None:
        """Prints the script's exception, if there was one, to stderr with the traceback of its own lines."""
        if self.error is not None:
            report = traceback.TracebackException.from_exception(self.error)
            report.stack = _without_api_frames(report.stack)
            print("".join(report.format()), end="", file=sys.stderr)

    def close(self, reason: str) -> None:
        self._rendezvous.close(reason)

    def join(self) -> bool:
        """Waits after the flight for the script's thread, and returns True if it has ended.

        A thread that still computes is left until the process ends.
        """
        if self._thread is not None:
            self._thread.join(_JOIN_S)
        return self._thread is None or not self._thread.is_alive()

    def _is_over(self, mission: ManualMission) -> bool:
        return mission.state.ended_by is not None

    def _run(self) -> None:
        failure = None
        try:
            self._program(self._api)
        except Aborted:
            pass
        except SystemExit as ended:
            failure = None if ended.code in (None, 0) else f"it ended itself with {ended.code!r}"
        except BaseException as error:
            self.error = error
            failure = _one_line(error, self._name)
        self._rendezvous.finish(failure)


def _failure(cause: str) -> MissionEnd:
    return MissionEnd(EndReason.SCRIPT_FAILED, f"{EndReason.SCRIPT_FAILED}: {cause}")


def _outcome(act: Callable[[], Any]) -> Any:
    """The function's result or its exception, which is raised in the script and not in the supervisor."""
    try:
        return act()
    except Exception as error:
        return error


def _without_api_frames(stack: traceback.StackSummary) -> traceback.StackSummary:
    """The stack without the API's own frames, which an author of scripts cannot change."""
    api_folder = str(Path(__file__).parent)
    frames = [frame for frame in stack if str(Path(frame.filename).parent) != api_folder]
    return traceback.StackSummary.from_list(frames) if frames else stack


def _one_line(error: BaseException, name: str) -> str:
    """The error in one line, with the script's line that led to it."""
    lines = [
        frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).name == name
    ]
    where = f"{name}, line {lines[-1].lineno}: " if lines else ""
    return f"{where}{in_one_line(error)}"

"""A script's file: read and compiled before anything starts, run in a thread of its own, its failure as one line.

The `time` that a script is given: its sleep follows mission time, its clocks show mission time, the rest is Python's.
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

from apad_bridge.mission.manual import ManualMission
from apad_bridge.scenario.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.rendezvous import (
    AS_FAST_AS_POSSIBLE,
    Aborted,
    Do,
    Finished,
    Rendezvous,
    Turns,
    Wait,
)


class MissionTime(types.ModuleType):
    """Stands where a script says `time` or `import time`: seconds since the flight began."""

    def __init__(self, api: Api) -> None:
        super().__init__("time", "Mission time, for a script of an aPad.")
        self.sleep = api.sleep
        self.time = self.monotonic = self.perf_counter = api.now
        self.time_ns = self.monotonic_ns = self.perf_counter_ns = lambda: round(api.now() * 1e9)

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)


SCRIPT_FAILED = "failure of the script"
"""How a reason begins when the script raised, or was stuck."""
SCRIPT_ENDED = "the script's end"
Program = Callable[[Api], object]
"""What runs in the script's thread."""
_JOIN_S = 2.0


class ScriptError(ValueError):
    """The file cannot be a script: one line."""


def read_script(path: Path) -> CodeType:
    """Compiles the file. Raises ScriptError with the line at fault."""
    try:
        return compile(path.read_text(encoding="utf-8"), str(path), "exec")
    except OSError as error:
        raise ScriptError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ScriptError(f"{path}: is not UTF-8 text") from None
    except (SyntaxError, ValueError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        raise ScriptError(f"{path}{line}: {what}") from None


class ScriptSource:
    """Gives a commanded mission the orders of a script, and lets the script stand still while time passes."""

    def __init__(
        self,
        scenario: Scenario,
        program: Program,
        name: str,
        tell: Callable[[str], None],
        turns: Turns = AS_FAST_AS_POSSIBLE,
    ) -> None:
        self._rendezvous = Rendezvous(turns)
        ids = range(scenario.fleet.first_id, scenario.fleet.first_id + scenario.fleet.count)
        frame = LocalFrame.about(scenario.area.origin)
        self._api = Api(self._rendezvous, frame, scenario.apad.name, ids, tell)
        self._program = program
        self._name = name
        self._thread: threading.Thread | None = None
        self.error: BaseException | None = None
        """What the script raised, for whoever shows its traceback."""

    def act(self, mission: ManualMission, now_ms: int) -> None:
        if self._thread is None:
            self._api.attach(mission)
            self._thread = threading.Thread(target=self._run, name=f"script {self._name}", daemon=True)
            self._rendezvous.begin()
            self._thread.start()
        self._rendezvous.tick()
        while not self._is_over(mission):
            ask = self._rendezvous.next()
            match ask:
                case None:
                    if self._rendezvous.is_stuck:
                        mission.finish(
                            f"{SCRIPT_FAILED}: it neither called the API nor slept for {self._rendezvous.busy_s:g} s"
                        )
                    return
                case Finished(failure):
                    if failure is not None:
                        mission.finish(f"{SCRIPT_FAILED}: {failure}")
                    elif not mission.is_busy:
                        # What it ordered last is finished first: a script may end with a docking.
                        mission.finish(SCRIPT_ENDED)
                    return
                case Do():
                    self._rendezvous.answer(_outcome(ask.act))
                case Wait(condition, until_ms):
                    holds = _outcome(condition) if condition is not None else False
                    if not holds and now_ms < until_ms:
                        return
                    self._rendezvous.answer(holds if isinstance(holds, BaseException) else bool(holds))

    def print_error(self) -> None:
        """What the script raised, on stderr, with the traceback of its own lines; nothing when it raised nothing."""
        if self.error is not None:
            shown = traceback.TracebackException.from_exception(self.error)
            shown.stack = _authors(shown.stack)
            print("".join(shown.format()), end="", file=sys.stderr)

    def close(self, reason: str) -> None:
        self._rendezvous.close(reason)

    def join(self) -> bool:
        """After the flight: whether the script's thread has ended; one that still computes is left to the process's end."""
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


def as_program(path: Path) -> Program:
    """The file as a program: `api`, `id_self` and `time` are given to it, and what it prints is said through the API."""
    code = read_script(path)

    def program(api: Api) -> None:
        clock = MissionTime(api)

        def import_(name: str, *rest: Any, **named: Any) -> Any:
            return clock if name == "time" else builtins.__import__(name, *rest, **named)

        def print_(*words: object, **how: Any) -> None:
            if how.get("file") is not None:
                builtins.print(*words, **how)
                return
            text = io.StringIO()
            builtins.print(*words, **{**how, "file": text, "flush": False})
            api.say(text.getvalue())

        folder = str(path.parent.absolute())
        if folder not in sys.path:
            sys.path.insert(0, folder)
        given = {
            "api": api,
            "id_self": api.id_self,
            "time": clock,
            "__name__": "__main__",
            "__file__": str(path),
        }
        exec(code, {**given, "__builtins__": {**vars(builtins), "__import__": import_, "print": print_}})

    return program


def _outcome(act: Callable[[], Any]) -> Any:
    """What it gives, or what it raises: the script shall hear of that, not the supervisor."""
    try:
        return act()
    except Exception as error:
        return error


def _authors(stack: traceback.StackSummary) -> traceback.StackSummary:
    """Without the API's insides before and after, which an author of missions can do nothing about."""
    ours = str(Path(__file__).parent)
    theirs = [frame for frame in stack if str(Path(frame.filename).parent) != ours]
    return traceback.StackSummary.from_list(theirs) if theirs else stack


def _one_line(error: BaseException, name: str) -> str:
    """The error with the script's line that led to it."""
    lines = [
        frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).name == name
    ]
    where = f"{name}, line {lines[-1].lineno}: " if lines else ""
    told = " ".join(str(error).split())
    return f"{where}{type(error).__name__}: {told}"

"""A flight's live progress for a person at a terminal; plain lines where the output is not a terminal."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from apad_bridge.runs.display import MakeStatus, clock_text
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.runs.rich_console import Console
from apad_bridge.supervisor.forecast import Forecast

_LINE_EVERY_MS = 300_000
_REFRESH_HZ = 8
_MOST_NAMED = 8
_STOPPED = "STOPPED"
_SILENT_S = 2.0
"""The longest time without a first word."""
_AGAIN_S = 30.0
"""The time between two lines about the same work."""


class FlightProgress:
    """A context manager; `show_status` takes each status. It writes to stderr, so that stdout is for the result alone.

    A `quiet` one shows nothing, and keeps its `messages` like any other. `clock` gives seconds of real time, of which it
    tells how many are left.
    """

    def __init__(
        self, name: str, duration_ms: int, quiet: bool = False, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.messages: list[str] = []
        """The lines for people, in order, without the status lines."""
        # No markup: the text comes from others, and a script that prints "[lat, lon]" means just that.
        self._console = Console(stderr=True, quiet=quiet, markup=False)
        self._clock = clock
        self._duration_ms = duration_ms
        self._progress = Progress(
            TextColumn("{task.description}", style="bold", markup=False),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[clock]}"),
            TextColumn("{task.fields[doing]}", markup=False),
            TimeRemainingColumn(),
            console=self._console,
            refresh_per_second=_REFRESH_HZ,
            get_time=clock,
            disable=not self._console.is_terminal or quiet,
        )
        self._name = name
        self._task: TaskID | None = None
        self._last_line_ms = -_LINE_EVERY_MS
        self._last_shown_s = -math.inf
        self._unshown: MakeStatus | None = None
        """The newest status on a terminal, if the bar does not show it yet."""

    def __enter__(self) -> FlightProgress:
        self._progress.start()
        self._task = self._progress.add_task(self._name, total=self._duration_ms, clock="starting", doing="")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._unshown is not None and kind is None:
            self._show_in_bar(self._unshown())
        self._progress.stop()

    def print_message(self, text: str) -> None:
        """Prints a line of its own, above the bar."""
        self.messages.append(text)
        self._print(text)

    def was_shown(self, text: str) -> bool:
        """True if this line of its own stands on the terminal."""
        return text in self.messages and not self._console.quiet

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        if not self._progress.disable:
            if self._clock() - self._last_shown_s >= 1 / _REFRESH_HZ:
                self._show_in_bar(status())
            else:
                self._unshown = status
        elif not self._console.quiet:
            self._update(completed=now_ms)
            if now_ms - self._last_line_ms >= _LINE_EVERY_MS:
                self._last_line_ms = now_ms
                self._print(f"{self._clock_text(now_ms)}  {_doing(status())}{self._left()}")

    def _show_in_bar(self, status: RunStatus) -> None:
        self._unshown = None
        self._last_shown_s = self._clock()
        self._update(
            completed=status.now_ms,
            clock=self._clock_text(status.now_ms),
            doing=_doing(status).removeprefix(f"{_STOPPED}: "),
            description=_STOPPED if status.stopped else self._name,
        )

    def _clock_text(self, now_ms: int) -> str:
        return f"{clock_text(now_ms)} / {clock_text(self._duration_ms)}"

    def _update(self, **fields: Any) -> None:
        if self._task is not None:
            self._progress.update(self._task, **fields)

    def _left(self) -> str:
        """The real time left, once the flight's pace is known."""
        (task,) = self._progress.tasks
        left_s = task.time_remaining
        return "" if left_s is None else f"; {clock_text(round(1000 * left_s))} left"

    def _print(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True)


class WorkProgress:
    """Shows what a command works on where nothing can be counted, with the time that it takes. A context manager.

    At a terminal the text stands there with a clock, and goes when the work is done. Elsewhere a text is a line once its
    work has taken `_SILENT_S`, and another one every `_AGAIN_S`. It writes to stderr; a `quiet` one shows nothing.
    """

    def __init__(self, quiet: bool = False) -> None:
        self._console = Console(stderr=True, quiet=quiet, markup=False)
        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        self._progress = Progress(
            *columns, console=self._console, transient=True, disable=quiet or not self._console.is_terminal
        )
        self._lock = threading.Lock()
        self._step = 0
        """Counts the steps, and their ends: a line about work that is done begins no other."""
        self._timer: threading.Timer | None = None

    def __enter__(self) -> WorkProgress:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end_step()
        self._progress.stop()

    def step(self, text: str) -> None:
        """The work that begins now; the former step is done."""
        self._end_step()
        if not self._progress.disable:
            self._progress.add_task(text)
        elif not self._console.quiet:
            self._step += 1
            self._show_after(_SILENT_S, f"{text} ...", self._step)

    def _show_after(self, pause_s: float, line: str, step: int, so_far_s: float = 0.0) -> None:
        def tell() -> None:
            after_s = so_far_s + pause_s
            shown = line if so_far_s == 0 else f"{line} {after_s:.0f} s"
            self._console.print(shown, highlight=False, soft_wrap=True)
            self._show_after(_AGAIN_S, line, step, after_s)

        with self._lock:
            if step != self._step:
                return
            self._timer = threading.Timer(pause_s, tell)
            self._timer.daemon = True
            self._timer.start()

    def _end_step(self) -> None:
        for task in self._progress.tasks:
            self._progress.remove_task(task.id)
        with self._lock:
            self._step += 1
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None


def _doing(status: RunStatus) -> str:
    """The status in words, without its time. A stopped aPad's begins with what it has done: the rest may be cut off."""
    done = f"{status.services} served, {status.cost_m:.0f} m"
    reports = f"{status.active}/{status.agents} active" if status.agents else "waiting for first reports"
    doing = f"{_apad_text(status)}: {reports}, {_docked_text(status.docked)}, {done}"
    if status.stopped:
        doing = f"{_STOPPED}: {done}, {status.stopped}"
    if status.apad_fraction is not None:
        doing += f", aPad {100 * status.apad_fraction:.0f} %"
    doing += _forecast_text(status.forecast)
    if status.behind_s > 1:
        doing += f", {status.behind_s:.1f} s behind real time"
    return doing


def _apad_text(status: RunStatus) -> str:
    """The mission's phase, and the aPad's primitive where the phase does not say it."""
    known = status.primitive in ("", "none") or status.primitive in status.phase
    return status.phase if known else f"{status.phase} ({status.primitive})"


def _forecast_text(forecast: Forecast | None) -> str:
    """The forecast's known parts as text; empty without any."""
    if forecast is None:
        return ""
    times = (("next pick-up", forecast.next_pickup_s), ("batch full", forecast.batch_full_s))
    parts = [f"{name} in {clock_text(round(1000 * it))}" for name, it in times if it is not None]
    if forecast.mission_end_s is not None and forecast.apad_fraction_at_end is not None:
        end, left = clock_text(round(1000 * forecast.mission_end_s)), 100 * forecast.apad_fraction_at_end
        parts.append(f"end in {end} at {left:.0f} %")
    return f"; {', '.join(parts)}" if parts else ""


def _docked_text(docked: Sequence[int]) -> str:
    """Names the docked aMussels, as far as a line takes their ids."""
    if not docked:
        return "none docked"
    return f"{' '.join(map(str, docked)) if len(docked) <= _MOST_NAMED else len(docked)} docked"

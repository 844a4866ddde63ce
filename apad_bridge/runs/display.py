"""Displays of a flight's progress: the interface, the one that passes it on to a parent, and several aPads' as one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from agents.hosting.started import outlive_starter
from apad_bridge.events.event import Category, Event
from apad_bridge.runs.parent_protocol import say, write
from apad_bridge.runs.progress_status import RunStatus

MakeStatus = Callable[[], RunStatus]
"""Makes the newest status. It takes longer than many a tick, so a display calls it for a status that it shows."""


class ProgressDisplay(Protocol):
    """Shows a flight's progress to a person, or passes it on."""

    def print_message(self, text: str) -> None: ...

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        """Called at every tick with its mission time."""


class ParentDisplay:
    """A ProgressDisplay that writes lines for the parent process, which shows them.

    From the first status on, this process outlives that parent.
    """

    def print_message(self, text: str) -> None:
        say(text)

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        outlive_starter()
        write(status())


class JointDisplay:
    """Shows the flights of several aPads, or of one, as one. Of several, each line begins with its aPad's name."""

    def __init__(self, names: Sequence[str], progress: ProgressDisplay) -> None:
        self._names = names
        self._progress = progress
        self._newest: dict[str, tuple[int, MakeStatus]] = {}

    def of(self, name: str) -> ProgressDisplay:
        """This aPad's part of the display."""
        return _JointPart(self, name)

    def print_message(self, name: str, text: str) -> None:
        self._progress.print_message(text if len(self._names) == 1 else f"{name}: {text}")

    def show_status(self, name: str, now_ms: int, status: MakeStatus) -> None:
        self._newest[name] = now_ms, status
        self._progress.show_status(min(at_ms for at_ms, _ in self._newest.values()), self._combined)

    def _combined(self) -> RunStatus:
        return RunStatus.combined([status() for _, status in self._newest.values()], len(self._names))


@dataclass(frozen=True, slots=True)
class _JointPart:
    """One aPad's ProgressDisplay."""

    joint: JointDisplay
    name: str

    def print_message(self, text: str) -> None:
        self.joint.print_message(self.name, text)

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        self.joint.show_status(self.name, now_ms, status)


def line_of(at_ms: int, event: Event) -> str | None:
    """A line for a person about an event that a person is told at once; None for any other event."""
    is_shown = event.category is Category.ALARM or event.is_shown_at_once
    return f"{clock_text(at_ms)}  {event.text()}" if is_shown else None


def clock_text(now_ms: int) -> str:
    """Mission time as 05:00, or 1:05:00."""
    minutes, seconds = divmod(now_ms // 1000, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes:02d}:{seconds:02d}"

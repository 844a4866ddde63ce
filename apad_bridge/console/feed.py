"""Feeds a console: the page's data of a run, read from the journal while the run flies.

The journal has all that the page needs, so a console takes nothing from the supervisor's process and nothing of its time.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from agents.hosting.descriptors import SHORT_OF_FILES
from agents.time_scale import TICK_MS, MissionMs
from apad_bridge.analysis.replay.series import (
    COLUMNS,
    MAX_MEASURED,
    MAX_PACKETS,
    MAX_SAMPLES,
    Counts,
    RunView,
    sample_times,
)
from apad_bridge.events.person_events import SpeedChanged
from apad_bridge.events.run_events import RunResumed
from apad_bridge.records.journal import JournalContents, JournalTail
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.sample_file import SampleTail
from apad_bridge.scenario.run_options import BenchPart, RunOptions, TimeSource
from apad_bridge.scenario.timed_faults import TABLE
from apad_bridge.supervisor.control_protocol import listens

_FAULTS = [
    {
        "fault": fault.value,
        "does": row.does,
        "span_s": row.span_s,
        "parameter": None if row.parameter is None else asdict(row.parameter),
    }
    for fault, row in TABLE.items()
]
"""The rows of the table of faults, for the page's form."""
_MOST_SAMPLES = 2 * MAX_SAMPLES
"""With one more, every second sample is dropped, here and on each page."""


class Feed:
    """Follows one run. `poll` gives what is new for pages that are open, `page_data` all for one that opens now."""

    def __init__(self, run_dir: Path) -> None:
        """RunDirectoryError, one line, when the directory holds no run that has begun and can be shown."""
        self._directory = RunDirectory.open(run_dir)
        scenario = self._directory.load_scenario()
        try:
            options = RunOptions.load(run_dir)
            self._has_water = scenario.water is not None and options.part is not BenchPart.MISSION
            self._takes_faults = not options.has_real_vehicle
            self._is_real = options.is_beside_real_vehicle
            self._stands = scenario.time_stands_while_stopped
            own_time = options.time is TimeSource.WALL and not options.has_real_vehicle
            self._begun_speed = self._speed = options.speed if own_time else None
            self._journal = JournalTail(self._directory.journal)
            self._view = RunView(scenario, self._read_new(), scenario.duration_ms)
            self._samples = SampleTail(self._directory.samples)
            self._view.take_samples(self._samples.new_samples())
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise RunDirectoryError(f"{self._directory.journal}: cannot be shown: {error}") from error
        for now_ms in sample_times(self._view.end_ms, self._view.agent_count):
            self._view.sample(now_ms)
        self._sent: dict[str, Any] = {"supervisor": False}
        self._sent = self._state()

    def poll(self) -> dict[str, Any]:
        """The run's state now, and `sample`: the newest sample where there is a new one, else null.

        Lines may follow in the tick of the last sample, as the run's end does. Then that sample is taken again.
        """
        self._view.add(self._read_new())
        self._view.take_samples(self._samples.new_samples())
        sample = self._new_sample()
        self._sent = self._state()
        return {"sample": sample, **self._sent}

    def since(self, counts: Counts) -> dict[str, Any]:
        """The run's state at the last poll, for a page that has so much. However many ask, the supervisor is not asked."""
        return {"sample": self._view.newest(counts), **self._sent}

    def page_data(self) -> dict[str, Any]:
        """The page's data at the last poll. `live` tells the page to follow, and from where."""
        state = self._sent
        orders = {"ping": self._has_water, "faults": _FAULTS if self._takes_faults else []}
        live = {
            "orders": orders,
            "stands": self._stands,
            "counts": self._view.counts,
            "columns": COLUMNS,
            "most_samples": _MOST_SAMPLES,
            "most_packets": MAX_PACKETS,
            "most_measured": MAX_MEASURED,
            "replay": f"musselbed replay {self._directory.path}",
            **state,
        }
        return {**self._view.data(state["summary"]), "is_real": self._is_real, "live": live}

    def close(self) -> None:
        self._journal.close()
        self._samples.close()

    def _read_new(self) -> JournalContents:
        new = self._journal.read_new()
        for _, event in new.entries:
            match event:
                case SpeedChanged(times=times):
                    self._speed = times
                case RunResumed():
                    self._speed = self._begun_speed
        return new

    def _new_sample(self) -> dict[str, Any] | None:
        now_ms = MissionMs(self._view.end_ms // TICK_MS * TICK_MS)
        if now_ms <= self._view.times_ms[-1] and not self._view.has_late_lines:
            return None
        before = self._view.counts
        self._view.sample(now_ms)
        if len(self._view.times_ms) > _MOST_SAMPLES:
            self._view.thin()
        return self._view.newest(before)

    def _state(self) -> dict[str, Any]:
        """Tells whether a supervisor takes orders, why the mission ended, and its summary; null while it flies.

        `speed` is the flight's, in mission seconds a wall second; null where a person cannot change it.
        """
        summary: dict[str, Any] | None = None
        try:
            if self._view.ended_by is not None:
                summary = self._directory.read_summary()
            supervisor = listens(self._directory.path)
        except OSError as error:
            if error.errno not in SHORT_OF_FILES:
                raise
            supervisor = self._sent["supervisor"]  # cannot tell, and a stop may reach it all the same
        told = {"supervisor": supervisor, "ended_by": self._view.ended_by, "summary": summary}
        return {**told, "speed": self._speed}

"""Sleep schedules as a study: samples taken against aMussels lost, and the schedule to recommend.

The paper leaves open how long aMussels should sleep and how active they should be. Here the sleep period, the sampling and
the length of a wake vary for a fleet that one aPad can sustain with some schedules and not with others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

from rich.table import Table

from apad_bridge.assembly.capacity_bounds import bounds_of
from apad_bridge.scenario.loader import SHIPPED
from apad_bridge.studies.capacity_diagram import UNLIMITED_WH
from apad_bridge.studies.findings import Findings, table_of
from apad_bridge.studies.models import Model
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan, plan_of

AMUSSELS = 24
"""More than the law allows for the longest wakes of the most frequent schedules, and fewer than for all others."""
# The aPad's battery has no limit: one of 230 Wh ends before five days of the aMussels' time, and sooner where docks have
# more to do.
_ALARM, _SAMPLE, _PROCESSING = (f"board.whole.cycle.{key}" for key in ("alarm_s", "sample_s", "processing_s"))
_SCHEDULES: dict[str, list[float]] = {
    _ALARM: [900.0, 1800.0, 3600.0],
    _SAMPLE: [10.0, 60.0],
    _PROCESSING: [0.0, 240.0],
}


@dataclass(frozen=True, slots=True)
class ScheduleOutcome:
    """A sleep schedule's outcome: means over the configurations, of the whole fleet. Seconds and hours are agent time."""

    alarm_s: float
    """From one wake to the next."""
    sample_s: float
    """In each wake the sensors are on for so long."""
    processing_s: float
    """Then the Pi computes for so long."""
    sustained: float
    """aMussels that the docks sustain for ever, by the law of `capacity`."""
    amussels_lost: float
    samples_taken: float
    longest_gap_h: float
    dead_time_h: float
    metres: float

    @property
    def text(self) -> str:
        return (
            f"a wake every {self.alarm_s / 60:g} min, sensors on for {self.sample_s:g} s, "
            f"processing for {self.processing_s:g} s"
        )


def sleep_study(seeds: int = 5) -> StudyPlan:
    """The study of sleep: `AMUSSELS` whole boards in the pool, five days of their time, served by Cautious.

    Whole boards are flown tick by tick: twelve schedules on one configuration take some minutes of a processor.
    """
    data = {
        "name": "sleep",
        "scenarios": ["whole-board-12.yaml"],
        "strategies": ["cautious"],
        "seeds": seeds,
        "parameters": {
            "fleet.count": [AMUSSELS],
            "apad.battery.capacity_wh": [UNLIMITED_WH],
            **_SCHEDULES,
        },
        "model": Model.MISSION.value,
    }
    return plan_of(data, "sleep", SHIPPED)


def schedules_of(plan: StudyPlan, rows: Sequence[Row]) -> list[ScheduleOutcome]:
    """The schedules, the recommended one first: fewest lost, then most samples, longest sampling, fewest dead hours."""
    found = []
    for index, setting in enumerate(plan.settings):
        own = [row for row in rows if row["setting"] == index]
        values: dict[str, Any] = dict(setting.parameters)
        bounds = bounds_of([plan.scenario(index, 0, plan.seeds[0])])
        means = {
            key: fmean(row[key] for row in own)
            for key in ("amussels_lost", "samples_taken", "longest_gap_h", "dead_time_h", "metres")
        }
        found.append(
            ScheduleOutcome(values[_ALARM], values[_SAMPLE], values[_PROCESSING], bounds.sustained, **means)
        )
    return sorted(found, key=lambda it: (it.amussels_lost, -it.samples_taken, -it.sample_s, it.dead_time_h))


def reason_of(schedules: Sequence[ScheduleOutcome]) -> str:
    """Why the first of `schedules_of` is recommended, in two sentences for people."""
    best, others = schedules[0], schedules[1:]
    alike = sum(it.amussels_lost == best.amussels_lost for it in schedules)
    loses = "lose none" if best.amussels_lost == 0 else f"lose the fewest, {best.amussels_lost:.2f} aMussels"
    why = (
        f"Of the {len(schedules)} schedules {alike} {loses}; it takes the most samples of these, {best.samples_taken:.0f}, "
        f"and its docks sustain {best.sustained:.1f} aMussels."
    )
    if not (more := [it for it in others if it.samples_taken > best.samples_taken]):
        return f"{why} None takes more samples."
    most = max(more, key=lambda it: (it.samples_taken, -it.amussels_lost))
    return (
        f"{why} The most samples, {most.samples_taken:.0f}, come from {most.text}, which loses "
        f"{most.amussels_lost:.2f} aMussels and sustains {most.sustained:.1f}."
    )


def schedules_table(schedules: Sequence[ScheduleOutcome]) -> Table:
    """A line for each schedule, in their order; a screen of 80 columns cuts no number."""
    headings = (
        "wake\nevery\nmin",
        "sen-\nsors\ns",
        "pro-\ncess\ns",
        "lost",
        "samples\ntaken",
        "longest\ngap h",
        "dead\nh",
        "way\nplan-\nned m",
        "docks\nsus-\ntain",
    )
    table = table_of("schedules of sleep, the recommended one first: means over the configurations", headings)
    for it in schedules:
        table.add_row(
            *(f"{it.alarm_s / 60:g}", f"{it.sample_s:g}", f"{it.processing_s:g}"),
            *(f"{it.amussels_lost:.2f}", f"{it.samples_taken:.0f}", f"{it.longest_gap_h:.1f}"),
            *(f"{it.dead_time_h:.1f}", f"{it.metres:.0f}", f"{it.sustained:.1f}"),
        )
    return table


class SleepSchedules(Findings):
    """The schedules with the recommended one first. Their strategy is one, so there is nothing to compare."""

    def __init__(self, plan: StudyPlan, rows: Sequence[Row]) -> None:
        super().__init__(plan, rows)
        self.schedules = schedules_of(plan, rows)

    def as_data(self) -> dict[str, Any]:
        schedules = [asdict(it) for it in self.schedules]
        return {**super().as_data(), "schedules": schedules, "reason": reason_of(self.schedules)}

    def answer(self) -> Sequence[str]:
        return [f"Recommended: {self.schedules[0].text}. {reason_of(self.schedules)}"]

    def lines(self, width: int) -> Iterator[Table | str]:
        yield schedules_table(self.schedules)
        yield from self.answer()

"""The local time by which a mission has to be home, as seconds of a mission that begins now."""

from __future__ import annotations

from datetime import datetime, time

from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import Scenario


def with_end_by_in_seconds(scenario: Scenario, now: datetime, speed: float = 1.0) -> Scenario:
    """The scenario with `mission.end_by` in seconds of mission time, which passes `speed` times as fast as the clock's.

    `now` is local. ScenarioError for a time that has passed today.
    """
    end_by = scenario.mission.end_by
    if not isinstance(end_by, str):
        return scenario
    hour, minute = map(int, end_by.split(":"))
    seconds = (datetime.combine(now.date(), time(hour, minute)) - now.replace(tzinfo=None)).total_seconds()
    if seconds <= 0:
        raise ScenarioError([f"mission.end_by: it is {now:%H:%M}, and {end_by} has passed today"])
    # A fast mission's begin is not known better than to a second.
    data = resolve(scenario)
    data["mission"]["end_by"] = float(max(1, int(seconds * speed)))
    return from_data(data, "mission.end_by")

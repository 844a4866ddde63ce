"""Stops in a journal, as the page shows them: the one in force, its states with their times, a refusal and the drift."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from journals import state_of


def line(t: int, kind: str, **data: Any) -> dict[str, Any]:
    return {"t": t, "kind": kind, **data}


def stop(t: int, number: int, mode: str, state: str, by: str = "Anna", **more: Any) -> dict[str, Any]:
    return line(t, "stop", number=number, mode=mode, by=by, state=state, **more)


def shown(now: Any) -> Any:
    it = now.stops.in_force
    return it and (it.number, it.kind, it.by, it.states, it.newest_reason)


def refused(now: Any) -> Any:
    it = now.refused_stop
    return now.stops.in_force.number, it and (it.number, it.newest_reason)


def drift(now: Any) -> Any:
    return now.drift and now.drift.line


HELD = [stop(10, 1, "hold", "ordered"), stop(10, 1, "hold", "sent"), stop(20, 1, "hold", "taken")]
STATES = (("ordered", 10), ("sent", 10), ("taken", 20))
OFF = stop(30, 2, "off", "ordered", by="guard: frozen", reason="it stands still")
REFUSED = stop(30, 2, "hold", "refused", reason="the pilot has it")
DRIFT = line(31, "drift", speed_m_s=0.3, towards_rad=4.2, fence_s=None)
DRIFTS = [*HELD, stop(30, 2, "off", "taken"), DRIFT]
STORIES: dict[str, tuple[list[dict[str, Any]], Callable[[Any], Any], Any]] = {
    "a stop has its states with their times": (HELD, shown, (1, "hold", "Anna", STATES, "")),
    "until somebody continues": ([*HELD, line(30, "continued", number=1, by="Anna")], shown, None),
    "a later stop is in force": (
        [*HELD, OFF],
        shown,
        (2, "off", "guard: frozen", (("ordered", 30),), "it stands still"),
    ),
    "until it ends, too": ([*HELD, OFF, line(40, "continued", number=2, by="Anna")], shown, None),
    "a refused stop changes nothing and is shown": (
        [*HELD, REFUSED],
        refused,
        (1, (2, "the pilot has it")),
    ),
    "until another is ordered": ([*HELD, REFUSED, stop(40, 3, "hold", "ordered")], refused, (3, None)),
    "a drift lasts as long as there is no thrust": (DRIFTS, drift, DRIFT),
    "a stop with thrust ends it": ([*DRIFTS, stop(40, 3, "hold", "taken")], drift, None),
    "who continues ends it": ([*DRIFTS, line(40, "continued", number=2, by="Anna")], drift, None),
}


@pytest.mark.parametrize(("lines", "what", "value"), STORIES.values(), ids=STORIES)
def test_what_is_shown_after_these_lines(
    lines: list[dict[str, Any]], what: Callable[[Any], Any], value: Any
) -> None:
    assert what(state_of(lines)) == value

"""Stops in a journal, as the page shows them: the one in force, its states with their times, a refusal and the drift."""

from __future__ import annotations

from typing import Any

from journals import state_of


def line(t: int, kind: str, **data: Any) -> dict[str, Any]:
    return {"t": t, "kind": kind, **data}


def stop(t: int, number: int, mode: str, state: str, by: str = "Anna", **more: Any) -> dict[str, Any]:
    return line(t, "stop", number=number, mode=mode, by=by, state=state, **more)


def shown(stop: Any) -> tuple[Any, ...]:
    return stop.number, stop.kind, stop.by, stop.states, stop.newest_reason


def after(*lines: dict[str, Any]) -> Any:
    return state_of(lines)


HELD = (stop(10, 1, "hold", "ordered"), stop(10, 1, "hold", "sent"), stop(20, 1, "hold", "taken"))
DRIFT = line(31, "drift", speed_m_s=0.3, towards_rad=4.2, fence_s=None)


def test_a_stop_has_its_states_with_their_times_until_somebody_continues() -> None:
    states = (("ordered", 10), ("sent", 10), ("taken", 20))
    assert shown(after(*HELD).stops.in_force) == (1, "hold", "Anna", states, "")
    assert after(*HELD, line(30, "continued", number=1, by="Anna")).stops.in_force is None


def test_a_later_stop_is_in_force_until_it_ends() -> None:
    off = stop(30, 2, "off", "ordered", by="guard: frozen", reason="it stands still")
    wanted = (2, "off", "guard: frozen", (("ordered", 30),), "it stands still")
    assert shown(after(*HELD, off).stops.in_force) == wanted
    assert after(*HELD, off, line(40, "continued", number=2, by="Anna")).stops.in_force is None


def test_a_refused_stop_changes_nothing_and_is_shown() -> None:
    refused = stop(30, 2, "hold", "refused", reason="the pilot has it")
    now = after(*HELD, refused)
    assert now.stops.in_force.number == 1 and now.refused_stop.number == 2
    assert now.refused_stop.newest_reason == "the pilot has it"
    assert after(*HELD, refused, stop(40, 3, "hold", "ordered")).refused_stop is None


def test_a_drift_lasts_as_long_as_there_is_no_thrust() -> None:
    off = stop(30, 2, "off", "taken")
    assert after(*HELD, off, DRIFT).drift.line == DRIFT
    assert after(*HELD, off, DRIFT, stop(40, 3, "hold", "taken")).drift is None
    assert after(*HELD, off, DRIFT, line(40, "continued", number=2, by="Anna")).drift is None

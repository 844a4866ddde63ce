"""Converts a twin's state of one aMussel to plain data, and back: every number exactly, so that another twin continues.

Arrays are the base64 of their little-endian doubles, because a thousand aMussels are written between two ticks.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from dataclasses import astuple
from typing import Any

import numpy as np

from apad_bridge.beliefs.belief import ClockBelief, Suspicion
from apad_bridge.beliefs.charge_checker import ReadingTrack, StandingReading, Stated
from apad_bridge.beliefs.charge_filter import SIZES, Anchor, Array
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.place_filter import Place
from apad_bridge.beliefs.spent_charge import Load, Spent
from apad_bridge.beliefs.twin_state import Pending, TwinState
from firmware_model.packets import Reported

Plain = dict[str, Any]


def state_to_data(twin_state: TwinState) -> Plain:
    """The state in JSON's types: numbers unchanged, modes by name. Keys are the fields' names."""
    clock, unobeyed, pending = twin_state.clock, twin_state.unobeyed, twin_state.pending
    earlier = twin_state.earlier
    return {
        "at_ms": twin_state.at_ms,
        "anchors": [[weight, _packed(mean), _packed(cov)] for weight, mean, cov in twin_state.anchors],
        "anchor_ms": twin_state.anchor_ms,
        "load": _load_data(twin_state.load),
        "situation": _name(twin_state.situation),
        "since_ms": twin_state.since_ms,
        "place": [_packed(twin_state.place.mean), _packed(twin_state.place.cov)],
        "place_ms": twin_state.place_ms,
        "clock": [clock.offset_ms, clock.drift_ppm, clock.offset_var, clock.covariance, clock.drift_var],
        "clock_ms": twin_state.clock_ms,
        "packet": twin_state.packet,
        "reported": twin_state.reported.stated,
        "from_secondary": twin_state.from_secondary,
        "unobeyed": None if unobeyed is None else [_load_data(unobeyed[0]), unobeyed[1]],
        "earlier": None if earlier is None else [_load_data(earlier[0]), *earlier[1:]],
        "seen": twin_state.seen,
        "pending": None if pending is None else [*astuple(pending)[:-1], pending.mode.name],
        "day": [None if heard is None else [heard[0].name, heard[1]] for heard in twin_state.day],
        "stated_m": twin_state.stated_m,
        "measured_ms": twin_state.measured_ms,
        "measured_mode": _name(twin_state.measured_mode),
        "gated": twin_state.gated,
        "track": twin_state.track,
        "standing": twin_state.standing,
        "suspicion": twin_state.suspicion,
    }


def state_from_data(data: Plain) -> TwinState:
    """The inverse of `state_to_data`; KeyError, TypeError or ValueError for anything else."""
    (mean, cov), unobeyed, pending = data["place"], data["unobeyed"], data["pending"]
    first, second = data["from_secondary"]
    asleep, idle, high = data["seen"]
    sequence, agent_ms = data["packet"]
    stated_m, track, suspicion, earlier = data["stated_m"], data["track"], data["suspicion"], data["earlier"]
    return TwinState(
        at_ms=data["at_ms"],
        anchors=tuple(_anchor_of(*row) for row in data["anchors"]),
        anchor_ms=data["anchor_ms"],
        load=_load_of(data["load"]),
        situation=_mode(data["situation"]),
        since_ms=data["since_ms"],
        place=Place(_unpacked(mean, 4), _unpacked(cov, 4, 4)),
        place_ms=data["place_ms"],
        clock=ClockBelief(*data["clock"]),
        clock_ms=data["clock_ms"],
        packet=(sequence, agent_ms),
        reported=Reported(**data["reported"]),
        from_secondary=(first, second),
        unobeyed=None if unobeyed is None else (_load_of(unobeyed[0]), unobeyed[1]),
        earlier=None if earlier is None else (_load_of(earlier[0]), earlier[1], earlier[2]),
        pending=None if pending is None else _pending_of(pending),
        seen=(asleep, idle, high),
        day=tuple(None if heard is None else (Mode[heard[0]], heard[1]) for heard in data["day"]),
        stated_m=None if stated_m is None else (stated_m[0], stated_m[1]),
        measured_ms=data["measured_ms"],
        measured_mode=_mode(data["measured_mode"]),
        gated=data["gated"],
        track=None if track is None else ReadingTrack(Stated(*track[0]), Stated(*track[1])),
        standing=None if data["standing"] is None else _standing_of(*data["standing"]),
        suspicion=None if suspicion is None else Suspicion(*suspicion),
    )


def _anchor_of(weight: float, mean: str, cov: str) -> Anchor:
    its_mean = _unpacked(mean, -1)
    if (size := len(its_mean)) not in SIZES:
        raise ValueError(f"a power filter has {SIZES[0]} or {SIZES[1]} numbers, not {size}")
    return Anchor(weight, its_mean, _unpacked(cov, size, size))


def _standing_of(reading: float, from_ms: int, since: list[Any] | None, *rest: Any) -> StandingReading:
    return StandingReading(reading, from_ms, None if since is None else Stated(*since), *rest)


def _pending_of(data: list[Any]) -> Pending:
    from_ms, until_ms, mean, variance, mode = data
    return Pending(from_ms, until_ms, mean, variance, Mode[mode])


def _packed(array: Array) -> str:
    return b64encode(array.astype("<f8", copy=False).tobytes()).decode("ascii")


def _unpacked(text: str, *shape: int) -> Array:
    return np.frombuffer(b64decode(text, validate=True), "<f8").astype(np.float64).reshape(shape)


def _load_data(load: Load) -> list[Any]:
    return [load.by_mode, load.expected, load.expected_mode.name, load.unscheduled_decisions]


def _load_of(data: list[Any]) -> Load:
    by_mode, expected, mode, unscheduled_decisions = data
    asleep, idle, high = (Spent(*one) for one in by_mode)
    return Load((asleep, idle, high), Spent(*expected), Mode[mode], unscheduled_decisions)


def _name(mode: Mode | None) -> str | None:
    return None if mode is None else mode.name


def _mode(name: str | None) -> Mode | None:
    return None if name is None else Mode[name]

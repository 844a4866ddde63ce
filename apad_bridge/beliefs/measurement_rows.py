"""Converts a measurement to a row of plain data, and back: [kind, aMussel, mission ms, number, ...]."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

from apad_bridge.beliefs.measurement import (
    ClockSet,
    Docked,
    Fixed,
    Heard,
    HeardShort,
    Measurement,
    Permitted,
    Ranged,
    Released,
    TimeslotSilent,
)
from firmware_model.packets import StatusPacket
from firmware_model.states import State

_KINDS: dict[str, type[Any]] = {
    "silent": TimeslotSilent,
    "permitted": Permitted,
    "docked": Docked,
    "released": Released,
    "fixed": Fixed,
    "ranged": Ranged,
    "clock set": ClockSet,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}
_STATUS = "heard"
_SHORT = "short"


def measurement_row(agent_id: int, measurement: Measurement) -> list[Any]:
    """The row of a measurement: its numbers unchanged, in the order of the fields; a packet's without its id."""
    if isinstance(measurement, Heard):
        it = measurement.packet
        fields = (
            it.sequence,
            int(it.state),
            it.primary,
            it.secondary,
            it.north_m,
            it.east_m,
            it.depth_m,
            it.agent_ms,
        )
        return [_STATUS, agent_id, measurement.at_ms, *fields]
    if isinstance(measurement, HeardShort):
        return [
            _SHORT,
            agent_id,
            measurement.at_ms,
            int(measurement.state),
            measurement.primary,
            measurement.secondary,
        ]
    return [_NAMES[type(measurement)], agent_id, *astuple(measurement)]


def measurement_of(row: list[Any]) -> tuple[int, Measurement]:
    """The inverse of `measurement_row`; KeyError, TypeError or ValueError for anything else."""
    kind, agent_id, at_ms, *numbers = row
    if kind == _STATUS:
        sequence, state, *rest = numbers
        return agent_id, Heard(at_ms, StatusPacket(agent_id, sequence, State(state), *rest))
    if kind == _SHORT:
        state, primary, secondary = numbers
        return agent_id, HeardShort(at_ms, State(state), primary, secondary)
    measurement: Measurement = _KINDS[kind](at_ms, *numbers)
    return agent_id, measurement

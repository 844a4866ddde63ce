"""Converts a Truth to a line of the journal and back, in exact integers, so that a resumed run counts on exactly."""

from __future__ import annotations

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.records.journal import Line
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow
from firmware_model.states import State


def truth_data(truth: Truth) -> Line:
    """The line of a Truth. Batteries are [anchor ms, grains, flow, load, coils], `depth` is [anchor ms, micrometres].

    Times are agent time. Optional keys: `hover_um`, the depth to which a hovering aMussel moves; `pin_due`, the time when
    the coils will be aligned; `log`, [samples taken, acknowledged below].
    """
    physical = truth.physical
    optional: Line = {}
    if physical.buoyancy is Buoyancy.HOVER:
        optional["hover_um"] = physical.hover_um
    if physical.pin_due_ms:
        optional["pin_due"] = physical.pin_due_ms
    if physical.samples:
        optional["log"] = [physical.samples, physical.acknowledged]
    return {
        "id": truth.agent_id,
        "agent_ms": truth.at_ms,
        "state": truth.state.name,
        "primary": _battery_data(physical.primary),
        "secondary": _battery_data(physical.secondary),
        "north_um": physical.north_um,
        "east_um": physical.east_um,
        "depth": [physical.depth_anchor_ms, physical.depth_um],
        "buoyancy": physical.buoyancy.name,
        "docked": physical.docked,
        **optional,
    }


def truth_of(line: Line) -> Truth:
    """The inverse of `truth_data`; KeyError, TypeError or ValueError for any other line."""
    depth_anchor_ms, depth_um = line["depth"]
    samples, acknowledged = line.get("log", (0, 0))
    physical = Physical(
        _battery_of(line["primary"]),
        _battery_of(line["secondary"]),
        line["north_um"],
        line["east_um"],
        depth_anchor_ms,
        depth_um,
        Buoyancy[line["buoyancy"]],
        line["docked"],
        line.get("pin_due", 0),
        line.get("hover_um", 0),
        samples,
        acknowledged,
    )
    return Truth(line["agent_ms"], line["id"], State[line["state"]], physical)


def _battery_data(battery: Battery) -> list[int]:
    return [battery.anchor_ms, battery.charge, int(battery.flow), battery.load, battery.coils]


def _battery_of(data: list[int]) -> Battery:
    anchor_ms, charge, flow, load, coils = data
    return Battery(anchor_ms, charge, Flow(flow), load, coils)

"""Makes events of truths, and truths of lines, in exact integers, so that a resumed run counts on exactly."""

from __future__ import annotations

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.events.fleet import BatteryAnchor, TruthChanged
from apad_bridge.records.journal import Line
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow
from firmware_model.states import State


def truth_event(truth: Truth) -> TruthChanged:
    """The event of a Truth. An optional field is told where it says something: while it hovers, and so on."""
    physical = truth.physical
    return TruthChanged(
        truth.agent_id,
        truth.at_ms,
        truth.state,
        _anchor_of(physical.primary),
        _anchor_of(physical.secondary),
        physical.north_um,
        physical.east_um,
        (physical.depth_anchor_ms, physical.depth_um),
        physical.buoyancy,
        physical.docked,
        hover_um=physical.hover_um if physical.buoyancy is Buoyancy.HOVER else None,
        pin_due=physical.pin_due_ms or None,
        log=(physical.samples, physical.acknowledged) if physical.samples else None,
    )


def truth_of(line: Line) -> Truth:
    """The Truth of a journal's line; KeyError, TypeError or ValueError for any other line."""
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


def _anchor_of(battery: Battery) -> BatteryAnchor:
    return battery.anchor_ms, battery.charge, int(battery.flow), battery.load, battery.coils


def _battery_of(data: list[int]) -> Battery:
    anchor_ms, charge, flow, load, coils = data
    return Battery(anchor_ms, charge, Flow(flow), load, coils)

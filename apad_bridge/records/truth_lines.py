"""Makes events of truths, and truths of events, in exact integers, so that a resumed run counts on exactly."""

from __future__ import annotations

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.events.fleet_events import BatteryAnchor, TruthChanged
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow


def truth_event(truth: Truth) -> TruthChanged:
    """The event of a Truth. An optional field is told where it says something: while it hovers, and so on."""
    physical = truth.physical
    return TruthChanged(
        id=truth.agent_id,
        agent_ms=truth.at_ms,
        state=truth.state,
        primary=_anchor_of(physical.primary),
        secondary=_anchor_of(physical.secondary),
        north_um=physical.north_um,
        east_um=physical.east_um,
        depth=(physical.depth_anchor_ms, physical.depth_um),
        buoyancy=physical.buoyancy,
        docked=physical.docked,
        hover_um=physical.hover_um if physical.buoyancy is Buoyancy.HOVER else None,
        pin_due=physical.pin_due_ms or None,
        log=(physical.samples, physical.acknowledged) if physical.samples else None,
    )


def truth_of(event: TruthChanged) -> Truth:
    """The Truth of an event."""
    samples, acknowledged = event.log or (0, 0)
    physical = Physical(
        _battery_of(event.primary),
        _battery_of(event.secondary),
        event.north_um,
        event.east_um,
        *event.depth,
        buoyancy=event.buoyancy,
        docked=event.docked,
        pin_due_ms=event.pin_due or 0,
        hover_um=event.hover_um or 0,
        samples=samples,
        acknowledged=acknowledged,
    )
    return Truth(event.agent_ms, event.id, event.state, physical)


def _anchor_of(battery: Battery) -> BatteryAnchor:
    return battery.anchor_ms, battery.charge, int(battery.flow), battery.load, battery.coils


def _battery_of(anchor: BatteryAnchor) -> Battery:
    anchor_ms, charge, flow, load, coils = anchor
    return Battery(anchor_ms, charge, Flow(flow), load, coils)

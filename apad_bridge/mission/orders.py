"""The mission's orders besides primitives."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.events.event import Event
from apad_bridge.vehicle.commands import Primitive
from apad_bridge.vehicle.guards.stops import StopsEnded


@dataclass(frozen=True, slots=True)
class PermitSurfacing:
    """Tell the aMussel, by sound, that it may surface because an aPad comes for it."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class PingAgent:
    """A person wants the aMussel's range, once; the ping waits until the aPad may use its modem."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class TellClear:
    """Tell the aMussel, by Wi-Fi, that it is clear to sink."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class StopVehicle:
    """A person, named `by`, stops the vehicle: it holds its place where it may, else its controllers go off."""

    by: str
    off: bool = False
    """Controllers off, wherever it is."""
    hands: bool = False
    """Controllers off, and no arm moves: somebody has hands at the docks."""


@dataclass(frozen=True, slots=True)
class AllowMotion:
    """A person lets the vehicle move again, whatever stopped it."""

    by: str
    pilot_left: bool = False
    """The person says that no pilot steers any more, whatever the pilot's flag says."""
    ends: StopsEnded = StopsEnded.ANY


@dataclass(frozen=True, slots=True)
class GoBackIn:
    """A person sends a vehicle that lies just outside the fence straight back in, while `lookout` watches the water."""

    by: str
    lookout: str


VehicleOrder = StopVehicle | AllowMotion | GoBackIn
"""A person's words to the vehicle itself, past the docking port."""
Order = Primitive | PermitSurfacing | PingAgent | TellClear | VehicleOrder
MissionAction = Order | Event
"""An order, or an event for the journal."""

"""The mission's orders besides primitives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

from apad_bridge.events.event import Event
from apad_bridge.vehicle.commands import Primitive
from apad_bridge.vehicle.guards.stops import StopsEnded
from firmware_model.packets import Kind

if TYPE_CHECKING:
    from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle


@dataclass(frozen=True, slots=True)
class PermitSurfacing:
    """Tell the aMussel, by sound, that it may surface because an aPad comes for it."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class PingAgent:
    """A person wants the aMussel's range, once; the ping waits until the aPad may use its modem."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class SendCommand:
    """Send the aMussel a command without arguments, by the medium of its kind: a release tells it that it may sink."""

    kind: Kind
    agent_id: int


class VehicleOrder(ABC):
    """A person's word to the vehicle itself, past the docking port."""

    __slots__ = ()

    @abstractmethod
    def give(self, vehicle: GuardedVehicle, now_ms: int) -> None:
        """Gives it to the vehicle."""


@dataclass(frozen=True, slots=True)
class StopVehicle(VehicleOrder):
    """A person, named `by`, stops the vehicle: it holds its place where it may, else its controllers go off."""

    by: str
    off: bool = False
    """Controllers off, wherever it is."""
    hands: bool = False
    """Controllers off, and no arm moves: somebody has hands at the docks."""

    def give(self, vehicle: GuardedVehicle, now_ms: int) -> None:
        vehicle.stop(self.by, now_ms, off=self.off, hands=self.hands)


@dataclass(frozen=True, slots=True)
class AllowMotion(VehicleOrder):
    """A person lets the vehicle move again, whatever stopped it."""

    by: str
    stop: int | None
    """The number of the stop that was in force when the person said so, the only one that may end; None for none."""
    pilot_left: bool = False
    """The person says that no pilot steers any more, whatever the pilot's flag says."""
    ends: StopsEnded = StopsEnded.ANY

    def give(self, vehicle: GuardedVehicle, now_ms: int) -> None:
        vehicle.allow_motion(self.by, self.stop, now_ms, pilot_left=self.pilot_left, ends=self.ends)


@dataclass(frozen=True, slots=True)
class GoBackIn(VehicleOrder):
    """A person sends a vehicle that lies just outside the fence straight back in, while `lookout` watches the water."""

    by: str
    lookout: str

    def give(self, vehicle: GuardedVehicle, now_ms: int) -> None:
        vehicle.go_back_in(self.by, self.lookout, now_ms)


Order = Primitive | PermitSurfacing | PingAgent | SendCommand | VehicleOrder
MissionAction = Order | Event
"""An order, or an event for the journal."""

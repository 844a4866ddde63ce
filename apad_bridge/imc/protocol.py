"""The one door to imcpy: the messages of IMC 5.4 that a gateway sends or understands, and their packets.

imcpy takes values out of their range and text that is not ASCII; whoever makes a message checks them.
"""

from __future__ import annotations

from imcpy import (
    Abort,
    Announce,
    DissolvedOxygen,
    EntityList,
    EntityState,
    EstimatedState,
    FuelLevel,
    Goto,
    Heartbeat,
    LogBookEntry,
    LoggingControl,
    Message,
    Packet,
    PlanControl,
    PlanControlState,
    PlanDB,
    PlanDBInformation,
    PlanDBState,
    PlanSpecification,
    Pressure,
    RemoteSensorInfo,
    ReportedState,
    SpeedUnits,
    StationKeeping,
    SystemType,
    Temperature,
    Turbidity,
    VehicleState,
    Voltage,
    ZUnits,
)

__all__ = [
    "Abort",
    "Announce",
    "DissolvedOxygen",
    "EntityList",
    "EntityState",
    "EstimatedState",
    "FuelLevel",
    "Goto",
    "Heartbeat",
    "LogBookEntry",
    "LoggingControl",
    "Message",
    "PlanControl",
    "PlanControlState",
    "PlanDB",
    "PlanDBInformation",
    "PlanDBState",
    "PlanSpecification",
    "Pressure",
    "RemoteSensorInfo",
    "ReportedState",
    "SpeedUnits",
    "StationKeeping",
    "SystemType",
    "Temperature",
    "Turbidity",
    "Unreadable",
    "VehicleState",
    "Voltage",
    "ZUnits",
    "packed",
    "unpacked",
]


class Unreadable(ValueError):
    """Bytes that are no packet of IMC: too short, of another protocol, or with a wrong check sum."""


def packed(message: Message) -> bytes:
    """The message's packet, little-endian, with header and check sum."""
    data: bytes = Packet.serialize(message)
    return data


def unpacked(data: bytes) -> Message:
    """The message of one packet in either byte order. Unreadable for anything else."""
    try:
        return Packet.deserialize(data)
    except (RuntimeError, ValueError, MemoryError) as error:
        raise Unreadable(str(error)) from error

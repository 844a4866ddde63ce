"""The packets between a board and an aPad, and their bytes."""

from firmware_model.packets.command_packets import (
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.log_packets import LogRecords
from firmware_model.packets.packets import Packet, decode
from firmware_model.packets.status_packets import (
    NOTHING_REPORTED,
    QUANTITIES,
    AcousticStatus,
    Reported,
    ShortStatus,
    ShownQuantity,
    StatusPacket,
    WifiStatus,
)
from firmware_model.packets.wire import EVERYONE, PLAIN, Kind

__all__ = [
    "EVERYONE",
    "NOTHING_REPORTED",
    "PLAIN",
    "QUANTITIES",
    "AcousticStatus",
    "Beacon",
    "Command",
    "CommandPacket",
    "HoverAt",
    "Kind",
    "LogAck",
    "LogRecords",
    "Packet",
    "Reported",
    "SetThreshold",
    "ShortStatus",
    "ShownQuantity",
    "SleepSchedule",
    "SlotAssignment",
    "StatusPacket",
    "Threshold",
    "WifiStatus",
    "decode",
]

"""The packets between a board and an aPad, and their bytes."""

from firmware_model.packets.command_packets import (
    PLAIN_KINDS,
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
    AcousticStatus,
    ShortStatus,
    StatusPacket,
    WifiStatus,
)
from firmware_model.packets.wire import EVERYONE, Kind

__all__ = [
    "EVERYONE",
    "PLAIN_KINDS",
    "AcousticStatus",
    "Beacon",
    "Command",
    "CommandPacket",
    "HoverAt",
    "Kind",
    "LogAck",
    "LogRecords",
    "Packet",
    "SetThreshold",
    "ShortStatus",
    "SleepSchedule",
    "SlotAssignment",
    "StatusPacket",
    "Threshold",
    "WifiStatus",
    "decode",
]

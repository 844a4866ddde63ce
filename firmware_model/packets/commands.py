"""Parses the commands for a board."""

from __future__ import annotations

from firmware_model.config import BoardConfig
from firmware_model.packets.codec import Codec
from firmware_model.packets.command_packets import Beacon, Command, CommandPacket, HoverAt
from firmware_model.packets.wire import EVERYONE, PLAIN, Kind

LATEST_MS = 1 << 53
"""A beacon that names a later time (285 000 years) is nonsense."""
WORST_CASE = frozenset(kind for kind, it in PLAIN.items() if it.in_worst_case)
"""The commands that a board of the worst case knows."""


def parse_command(data: bytes, codec: Codec, config: BoardConfig) -> Command | str:
    """The command, or the reason why a board of `config` cannot execute it in any state."""
    packet = codec.decode(data)
    if not isinstance(packet, Command):
        return "not a command"
    if packet.agent_id not in (config.agent_id, EVERYONE):
        return "for another aMussel"
    if config.whole is None and packet.kind not in WORST_CASE:
        return f"the worst case knows no {packet.kind.name}"
    match packet:
        case CommandPacket(Kind.PING, agent_id) if agent_id == EVERYONE:
            return "a ping for everyone: all would answer at once"
        case Beacon(_, agent_ms) if agent_ms > LATEST_MS:
            return "a beacon of a time that cannot be"
        case HoverAt(_, depth_m) if depth_m <= 0:
            return "a depth at the surface: it surfaces by permission only"
    return packet

from functools import reduce
from operator import xor

from firmware_model import packets
from firmware_model.packets import CommandPacket, Kind, Packet, StatusPacket
from firmware_model.states import State


class Lines:
    """$STATUS,id,sequence,state,primary,secondary,north,east,depth,agent_ms*hh and $COMMAND,kind,id*hh"""

    def encode(self, packet: Packet) -> bytes:
        match packet:
            case StatusPacket():
                charges = f"{packet.primary:.5f},{packet.secondary:.5f}"
                place = f"{packet.north_m:.2f},{packet.east_m:.2f},{packet.depth_m:.2f}"
                head = f"STATUS,{packet.agent_id},{packet.sequence % 65536},{packet.state.name}"
                body = f"{head},{charges},{place},{packet.agent_ms}"
            case CommandPacket(kind, agent_id):
                body = f"COMMAND,{kind.name},{agent_id}"
            case _:
                return packet.encode()
        return f"${body}*{checksum(body):02X}".encode()

    def decode(self, data: bytes) -> Packet | None:
        """Never raises: what comes from the water may be anything."""
        if not data.startswith(b"$"):
            return packets.decode(data)
        try:
            body, stated = data.decode("ascii").removeprefix("$").split("*")
            if checksum(body) != int(stated, 16):
                return None
            match body.split(","):
                case ["STATUS", agent_id, sequence, state, *charges_and_place, agent_ms]:
                    primary, secondary, north_m, east_m, depth_m = map(float, charges_and_place)
                    return StatusPacket(
                        int(agent_id),
                        int(sequence),
                        State[state],
                        primary,
                        secondary,
                        north_m,
                        east_m,
                        depth_m,
                        int(agent_ms),
                    )
                case ["COMMAND", kind, agent_id]:
                    return CommandPacket(Kind[kind], int(agent_id))
        except (ValueError, KeyError):
            pass
        return None


def checksum(body: str) -> int:
    return reduce(xor, body.encode("ascii"), 0)

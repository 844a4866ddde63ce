"""A physical nanomodem on a serial port, which carries the acoustic packets between a fleet and an aPad.

Its host calls `poll` every few tens of milliseconds of real time. A modem does not receive its own packets, so a packet
counts as received by the simulated side when its last sound has left.
"""

from __future__ import annotations

from agents.serial_port import BytesRead, Lost, Opened, SerialPort
from apad_bridge.acoustics.serial.nanomodem import (
    Framing,
    ModemNotice,
    ModemQueue,
    ModemRanged,
    NanomodemAction,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
    Priority,
    RoutedPacket,
    WriteLine,
)

NanomodemResult = PacketSent | PacketReceived | ModemRanged | PacketDropped | ModemNotice


class AttachedModem:
    """The modem with its port and queue. Times are mission milliseconds, which must run as fast as real ones."""

    def __init__(self, port: SerialPort, now_ms: int = 0, framing: Framing = Framing.HEADER) -> None:
        self.port = port
        self.queue = ModemQueue(now_ms, framing)
        self._has_reported_closed = False

    def poll(self, now_ms: int) -> list[NanomodemResult]:
        """Reads the port and advances the queue; returns all results up to `now_ms`."""
        actions: list[NanomodemAction] = []
        for event in self.port.poll():
            match event:
                case Opened():
                    actions += self.queue.port_opened(now_ms)
                case Lost(why):
                    self._has_reported_closed = True
                    actions += self.queue.port_lost(why, now_ms)
                case BytesRead(data):
                    actions += self.queue.read(data, now_ms)
        actions += self.queue.advance(now_ms)
        if not self.port.is_open and not self._has_reported_closed:
            self._has_reported_closed = True
            message = f"{self.port.path} cannot be opened, and is tried again: {self.port.why_closed}"
            actions.append(ModemNotice(now_ms, message))
        return self._write_out(actions)

    def report(self, agent_id: int, data: bytes, now_ms: int) -> list[NanomodemResult]:
        """Queues an aMussel's packet to the aPad."""
        packet = RoutedPacket(PacketDirection.FROM_AMUSSEL, agent_id, data)
        return self._write_out(self.queue.send(packet, Priority.REPORT, now_ms))

    def command(self, agent_id: int, data: bytes, now_ms: int) -> list[NanomodemResult]:
        """Queues the aPad's packet to an aMussel, which has priority over all reports."""
        packet = RoutedPacket(PacketDirection.TO_AMUSSEL, agent_id, data)
        return self._write_out(self.queue.send(packet, Priority.COMMAND, now_ms))

    def ping(self, agent_id: int, now_ms: int) -> list[NanomodemResult]:
        """Queues a ping of the modem whose address is `agent_id`, after the commands that wait."""
        return self._write_out(self.queue.ping(agent_id, now_ms))

    def close(self) -> None:
        self.port.close()

    def _write_out(self, actions: list[NanomodemAction]) -> list[NanomodemResult]:
        results: list[NanomodemResult] = []
        for action in actions:
            if isinstance(action, WriteLine):
                self.port.write(action.data)
            else:
                results.append(action)
        return results

"""A physical nanomodem on a serial port, which carries what a fleet and an aPad say to each other by sound.

Who hosts it calls `poll` every few tens of milliseconds of real time. What it sends cannot reach the simulated ones by
itself, because a modem does not hear itself: so a packet counts as heard by them when its last sound has left.
"""

from __future__ import annotations

from apad_bridge.acoustics.serial.nanomodem import (
    Action,
    Addressed,
    Carried,
    Dropped,
    Heard,
    ModemQueue,
    Priority,
    Reported,
    Way,
    Write,
)
from apad_bridge.acoustics.serial.serial_port import Came, Lost, Opened, SerialPort

Result = Carried | Heard | Dropped | Reported


class AttachedModem:
    """Times are mission milliseconds; they must run as fast as real ones."""

    def __init__(self, port: SerialPort, now_ms: int = 0) -> None:
        self.port = port
        self.queue = ModemQueue(now_ms)
        self._told_closed = False

    def poll(self, now_ms: int) -> list[Result]:
        """All that came of it up to `now_ms`."""
        actions: list[Action] = []
        for event in self.port.poll():
            match event:
                case Opened():
                    actions += self.queue.port_came(now_ms)
                case Lost(why):
                    self._told_closed = True
                    actions += self.queue.port_went(why, now_ms)
                case Came(data):
                    actions += self.queue.read(data, now_ms)
        actions += self.queue.advance(now_ms)
        if not self.port.is_open and not self._told_closed:
            self._told_closed = True
            what = f"{self.port.path} cannot be opened, and is tried again: {self.port.why_closed}"
            actions.append(Reported(now_ms, what))
        return self._written(actions)

    def report(self, agent_id: int, data: bytes, now_ms: int) -> list[Result]:
        """An aMussel's word about itself."""
        packet = Addressed(Way.FROM_AMUSSEL, agent_id, data)
        return self._written(self.queue.ask(packet, Priority.REPORT, now_ms))

    def command(self, agent_id: int, data: bytes, now_ms: int) -> list[Result]:
        """The aPad's word to an aMussel, which goes before all reports."""
        packet = Addressed(Way.TO_AMUSSEL, agent_id, data)
        return self._written(self.queue.ask(packet, Priority.COMMAND, now_ms))

    def close(self) -> None:
        self.port.close()

    def _written(self, actions: list[Action]) -> list[Result]:
        rest: list[Result] = []
        for action in actions:
            if isinstance(action, Write):
                self.port.write(action.data)
            else:
                rest.append(action)
        return rest

"""A flight's serial lines: opened modems of its aMussels, and a physical modem that carries all acoustic packets.

A flight polls them at each tick and, in real time, every few tens of milliseconds in between. Results of a physical modem
are kept for the tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from agents.mussel.outputs import SoundSent
from agents.packet_medium import Medium
from agents.serial_port import SerialPort
from agents.time_scale import MissionMs
from agents.water.sea_events import Printed, SeaResult
from apad_bridge.acoustics.serial.attached import AttachedModem, NanomodemResult
from apad_bridge.acoustics.serial.nanomodem import (
    ModemNotice,
    ModemRanged,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
)
from apad_bridge.acoustics.serial.pty import FOLDER, Burst, OpenedModems
from apad_bridge.events.sound_events import ModemReported
from apad_bridge.mission.facts import AMusselHeard, Send


@dataclass
class SerialLines:
    """The serial lines of a flight; the default has none, and carries nothing.

    `tell` gets a line for a person when a physical modem comes or goes.
    """

    opened: OpenedModems | None = None
    attached: AttachedModem | None = None
    tell: Callable[[str], None] = lambda line: None
    _results: list[NanomodemResult] = field(default_factory=list)

    @property
    def any_open(self) -> bool:
        """True if there is a line to poll between ticks."""
        return self.opened is not None or self.attached is not None

    def poll(self, now_ms: int) -> list[Burst]:
        """Reads all lines at mission time `now_ms`; returns the bytes written to opened modems."""
        if self.attached is not None:
            self._store(self.attached.poll(now_ms))
        return [] if self.opened is None else self.opened.take()

    def route(self, result: SeaResult, now_ms: int) -> bool:
        """Passes a result of the fleet to a serial line; False if it is not for one."""
        match result:
            case Printed(_, agent_id, data):
                self.printed(agent_id, data)
                return True
            case SoundSent(_, agent_id, data):
                return self.report(agent_id, data, now_ms)
        return False

    def printed(self, agent_id: int, data: bytes) -> None:
        """Writes an opened modem's output to the host that opened it."""
        if self.opened is not None:
            self.opened.write(agent_id, data)

    def report(self, agent_id: int, data: bytes, now_ms: int) -> bool:
        """Sends an aMussel's packet by the physical modem; False if there is none."""
        if self.attached is None:
            return False
        self._store(self.attached.report(agent_id, data, now_ms))
        return True

    def command(self, agent_id: int, data: bytes, now_ms: int) -> bool:
        """Sends a packet to an aMussel by the physical modem; False if there is none."""
        if self.attached is None:
            return False
        self._store(self.attached.command(agent_id, data, now_ms))
        return True

    def take(self) -> list[AMusselHeard | Send | ModemReported]:
        """The physical modem's results since the last call: packets from and to aMussels, and events for the journal.

        Packets that it has sent are included: it does not receive its own packets, and here all are within its reach.
        """
        results, self._results = self._results, []
        return [_action_of(it) for it in results]

    def _store(self, results: list[NanomodemResult]) -> None:
        self._results += results
        for result in results:
            if isinstance(result, ModemNotice):
                self.tell(result.what)


def _action_of(result: NanomodemResult) -> AMusselHeard | Send | ModemReported:
    match result:
        case PacketReceived(at_ms, packet) | PacketSent(at_ms, packet):
            if packet.direction is PacketDirection.FROM_AMUSSEL:
                return AMusselHeard(Medium.SOUND, MissionMs(at_ms), packet.data)
            return Send(Medium.SOUND, packet.agent_id, packet.data)
        case ModemRanged(_, agent_id):
            return ModemReported("sound: a range to where the modem hangs", agent_id)
        case PacketDropped(_, reason, of):
            return ModemReported(reason, None if of is None else of.agent_id)
        case ModemNotice(_, what):
            return ModemReported(what=what)


@contextmanager
def open_serial_lines(
    run_dir: Path, opened: tuple[int, ...], port: str, now_ms: int, tell: Callable[[str], None]
) -> Iterator[SerialLines]:
    """Opens a run's serial lines while it is entered.

    `opened` are the aMussels whose modems to open, `port` is a physical modem's port or "". The devices' names are in the
    folder `modems` of the run's directory.
    """
    serial_lines = SerialLines(
        OpenedModems(run_dir / FOLDER, opened) if opened else None,
        AttachedModem(SerialPort(port), now_ms) if port else None,
        tell,
    )
    try:
        yield serial_lines
    finally:
        if serial_lines.opened is not None:
            serial_lines.opened.close()
        if serial_lines.attached is not None:
            serial_lines.attached.close()

"""A flight's serial lines: opened modems of its aMussels, and a physical modem that carries all sound.

A flight looks at them at each tick and, where real time passes, every few tens of milliseconds in between. What a physical
modem brings is kept for the tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from agents import coordinator
from agents.mussel.outputs import SoundSent
from agents.packet_medium import Medium
from agents.water.sea_events import Printed, SeaResult
from apad_bridge.acoustics.serial.attached import AttachedModem, Result
from apad_bridge.acoustics.serial.nanomodem import Carried, Dropped, Heard, Reported, Way
from apad_bridge.acoustics.serial.pty import FOLDER, Burst, OpenedModems
from apad_bridge.acoustics.serial.serial_port import SerialPort
from apad_bridge.mission.events import Send, SoundHeard
from apad_bridge.mission.orders import Note


@dataclass
class SerialLines:
    """`tell` hears, in a line for a person, how a physical modem comes and goes."""

    opened: OpenedModems | None = None
    attached: AttachedModem | None = None
    tell: Callable[[str], None] = lambda words: None
    _came: list[Result] = field(default_factory=list)

    def poll(self, now_ms: int) -> list[Burst]:
        """Reads all lines at mission time `now_ms`; what was written to opened modems."""
        if self.attached is not None:
            self._keep(self.attached.poll(now_ms))
        return [] if self.opened is None else self.opened.take()

    def took(self, came: SeaResult, now_ms: int) -> bool:
        """Whether what came of the fleet was for a serial line, and went there."""
        match came:
            case Printed(_, agent_id, data):
                self.printed(agent_id, data)
                return True
            case coordinator.Heard(_, agent_id, SoundSent(_, data)):
                return self.report(agent_id, data, now_ms)
        return False

    def printed(self, agent_id: int, data: bytes) -> None:
        """An opened modem's answer, for whoever opened it."""
        if self.opened is not None:
            self.opened.write(agent_id, data)

    def report(self, agent_id: int, data: bytes, now_ms: int) -> bool:
        """Sends an aMussel's packet by the physical modem; False without one."""
        if self.attached is None:
            return False
        self._keep(self.attached.report(agent_id, data, now_ms))
        return True

    def command(self, agent_id: int, data: bytes, now_ms: int) -> bool:
        """Sends a word to an aMussel by the physical modem; False without one."""
        if self.attached is None:
            return False
        self._keep(self.attached.command(agent_id, data, now_ms))
        return True

    def take(self) -> list[SoundHeard | Send | Note]:
        """What came of the physical modem since the last call: words of aMussels, words to them, and what to record.

        What it has sent is among the words: it does not hear itself, and here all are within its hearing.
        """
        came, self._came = self._came, []
        return [_meant(it) for it in came]

    def _keep(self, came: list[Result]) -> None:
        self._came += came
        for result in came:
            if isinstance(result, Reported):
                self.tell(result.what)


def _meant(came: Result) -> SoundHeard | Send | Note:
    match came:
        case Heard(at_ms, packet) | Carried(at_ms, packet):
            if packet.way is Way.FROM_AMUSSEL:
                return SoundHeard(at_ms, packet.data)
            return Send(Medium.SOUND, packet.agent_id, packet.data)
        case Dropped(_, reason, of):
            return Note("modem", {"dropped": reason, "id": None if of is None else of.agent_id})
        case Reported(_, what):
            return Note("modem", {"what": what})


@contextmanager
def open_serial_lines(
    run_dir: Path, opened: tuple[int, ...], port: str, now_ms: int, tell: Callable[[str], None]
) -> Iterator[SerialLines | None]:
    """The lines that a run asks for while it is entered: modems to open, and a physical one's port (or ""); None for none.

    The devices' names are in the folder `modems` of the run's directory.
    """
    if not opened and not port:
        yield None
        return
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

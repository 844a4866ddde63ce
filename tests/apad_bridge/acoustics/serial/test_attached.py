"""Tests a physical modem (our model behind a real pty) through pyserial: carrying packets, unplugging, plugging in."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, TypeVar

from agents.modem.frames import FrameKind
from agents.serial_port import SerialPort
from apad_bridge.acoustics.serial.attached import AttachedModem, NanomodemResult
from apad_bridge.acoustics.serial.nanomodem import (
    ModemNotice,
    ModemStage,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
    RoutedPacket,
)

Make = Callable[..., Any]
Result = TypeVar("Result")


class Host:
    """Polls attached modems on the wall clock until a result has come."""

    def __init__(self, now_ms: Callable[[], int], **modems: AttachedModem) -> None:
        self.now_ms = now_ms
        self.modems = modems
        self._pause = threading.Event()
        self.results: list[tuple[str, NanomodemResult]] = []

    def next(self, kind: type[Result], name: str = "", words: str = "", timeout_s: float = 60.0) -> Result:
        """The first result of its kind, of a modem and with these words."""
        deadline_s, seen = time.monotonic() + timeout_s, 0
        while time.monotonic() < deadline_s:
            for it, modem in self.modems.items():
                self.results += [(it, result) for result in modem.poll(self.now_ms())]
            for it, result in self.results[seen:]:
                if isinstance(result, kind) and name in ("", it) and words in str(result):
                    return result
            seen = len(self.results)
            self._pause.wait(0.002)
        raise AssertionError(f"it did not come within {timeout_s} s; results: {self.results}")

    def ready(self) -> None:
        for name, modem in self.modems.items():
            if modem.queue.stage is not ModemStage.READY:
                self.next(ModemNotice, name, "address")

    def close(self) -> None:
        for it in self.modems.values():
            it.close()


def attached(modems: Any, **numbers: int) -> Host:
    """Modems of these numbers, by name."""
    return Host(modems.now_ms, **{it: AttachedModem(SerialPort(modems.path(n))) for it, n in numbers.items()})


def test_packets_go_both_ways_with_their_ids(physical: Make) -> None:
    modems = physical()
    with closing(attached(modems, fleet=1, apad=2)) as host:
        host.ready()
        fleet, apad = host.modems.values()
        host.results += [("fleet", it) for it in fleet.report(300, b"a report", modems.now_ms())]
        heard = host.next(PacketReceived)
        assert heard.packet == RoutedPacket(PacketDirection.FROM_AMUSSEL, 300, b"a report")
        host.next(PacketSent)
        apad.command(7, b"come up", modems.now_ms())
        answer = host.next(PacketReceived, "fleet")
        assert answer.packet == RoutedPacket(PacketDirection.TO_AMUSSEL, 7, b"come up")
        # The modem was given broadcasts only, and its address did not change.
        assert {frame.kind for frame in modems.sent} == {FrameKind.BROADCAST}
        assert [modem.address for modem in modems.modems.values()] == [1, 2]


def test_a_modem_that_is_not_there_is_told_once_and_found_when_it_comes(
    physical: Make, tmp_path: Path
) -> None:
    path, began_s = tmp_path / "late" / "modem1", time.monotonic()
    late = AttachedModem(SerialPort(str(path)))
    with closing(Host(lambda: int((time.monotonic() - began_s) * 1000), fleet=late)) as host:
        assert str(path) in host.next(ModemNotice).what
        late.report(7, b"a report", host.now_ms())
        physical(folder="late")
        assert host.next(PacketSent).packet.agent_id == 7
        assert sum("cannot be opened" in str(it) for _, it in host.results) == 1


def test_it_is_unplugged_and_plugged_in_again(physical: Make) -> None:
    first = physical(count=1, folder="usb")
    with closing(attached(first, fleet=1)) as host:
        host.ready()
        first.close()
        host.next(ModemNotice, words="gone")
        host.modems["fleet"].report(9, b"while it was away", host.now_ms())
        physical(count=1, folder="usb")
        assert host.next(PacketSent).packet.data == b"while it was away"


def test_a_modem_that_says_nothing_loses_packets_loudly(physical: Make) -> None:
    modems = physical(count=1, speed=30)
    with closing(attached(modems, fleet=1)) as host:
        host.ready()
        modems.mute = True
        host.modems["fleet"].report(7, b"unheard", host.now_ms())
        assert "waited too long" in host.next(PacketDropped, words="RoutedPacket").reason


def test_a_sleeping_modem_is_woken(physical: Make) -> None:
    modems = physical(count=1)
    port = SerialPort(modems.path(1))
    deadline_s = time.monotonic() + 60
    while not port.is_open and time.monotonic() < deadline_s:
        port.poll()
    port.write(b"$Z")
    while modems.modems[1].state.name != "SLEEPING" and time.monotonic() < deadline_s:
        threading.Event().wait(0.001)
    port.close()
    assert modems.modems[1].state.name == "SLEEPING"
    with closing(attached(modems, fleet=1)) as host:
        host.ready()

"""Tests a physical modem (our model behind a real pty) through pyserial: carrying packets, unplugging, plugging in."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


class Host:
    """Polls attached modems on the wall clock until a result has come."""

    def __init__(self, now_ms: Callable[[], int], **modems: AttachedModem) -> None:
        self.now_ms = now_ms
        self.modems = modems
        self._pause = threading.Event()
        self.results: list[tuple[str, NanomodemResult]] = []

    def until(
        self, predicate: Callable[[str, NanomodemResult], bool], timeout_s: float = 60.0
    ) -> NanomodemResult:
        deadline_s = time.monotonic() + timeout_s
        for name, result in self.results:
            if predicate(name, result):
                return result
        while time.monotonic() < deadline_s:
            for name, modem in self.modems.items():
                for result in modem.poll(self.now_ms()):
                    self.results.append((name, result))
            for name, result in self.results:
                if predicate(name, result):
                    return result
            self._pause.wait(0.002)
        raise AssertionError(f"it did not come within {timeout_s} s; results: {self.results}")


def ready(host: Host) -> None:
    for modem in host.modems:
        if host.modems[modem].queue.stage is not ModemStage.READY:
            host.until(
                lambda name, it, modem=modem: (
                    name == modem and isinstance(it, ModemNotice) and "address" in it.what
                )
            )


def test_packets_go_both_ways_with_their_ids(physical: Make) -> None:
    modems = physical()
    fleet, apad = AttachedModem(SerialPort(modems.path(1))), AttachedModem(SerialPort(modems.path(2)))
    host = Host(modems.now_ms, fleet=fleet, apad=apad)
    ready(host)
    host.results += [("fleet", it) for it in fleet.report(300, b"a report", modems.now_ms())]
    heard = host.until(lambda name, it: isinstance(it, PacketReceived))
    assert isinstance(heard, PacketReceived)
    assert heard.packet == RoutedPacket(PacketDirection.FROM_AMUSSEL, 300, b"a report")
    host.until(lambda name, it: isinstance(it, PacketSent))
    apad.command(7, b"come up", modems.now_ms())
    answer = host.until(lambda name, it: name == "fleet" and isinstance(it, PacketReceived))
    assert isinstance(answer, PacketReceived) and answer.packet == RoutedPacket(
        PacketDirection.TO_AMUSSEL, 7, b"come up"
    )
    # The modem was given broadcasts only, and its address did not change.
    assert {frame.kind for frame in modems.sent} == {FrameKind.BROADCAST}
    assert [modem.address for modem in modems.modems.values()] == [1, 2]
    fleet.close()
    apad.close()


def test_a_modem_that_is_not_there_is_told_once_and_found_when_it_comes(
    physical: Make, tmp_path: Path
) -> None:
    path = tmp_path / "late" / "modem1"
    attached = AttachedModem(SerialPort(str(path)))
    began_s = time.monotonic()
    host = Host(lambda: int((time.monotonic() - began_s) * 1000), fleet=attached)
    reported = host.until(lambda name, it: isinstance(it, ModemNotice))
    assert isinstance(reported, ModemNotice) and str(path) in reported.what
    attached.report(7, b"a report", host.now_ms())
    physical(folder="late")
    sent = host.until(lambda name, it: isinstance(it, PacketSent))
    assert isinstance(sent, PacketSent) and sent.packet.agent_id == 7
    assert sum("cannot be opened" in it.what for _, it in host.results if isinstance(it, ModemNotice)) == 1
    attached.close()


def test_it_is_unplugged_and_plugged_in_again(physical: Make) -> None:
    first = physical(count=1, folder="usb")
    attached = AttachedModem(SerialPort(first.path(1)))
    host = Host(first.now_ms, fleet=attached)
    ready(host)
    first.close()
    lost = host.until(lambda name, it: isinstance(it, ModemNotice) and "gone" in it.what)
    assert isinstance(lost, ModemNotice)
    attached.report(9, b"while it was away", host.now_ms())
    physical(count=1, folder="usb")
    sent = host.until(lambda name, it: isinstance(it, PacketSent))
    assert isinstance(sent, PacketSent) and sent.packet.data == b"while it was away"
    attached.close()


def test_a_modem_that_says_nothing_loses_packets_loudly(physical: Make) -> None:
    modems = physical(count=1, speed=30)
    attached = AttachedModem(SerialPort(modems.path(1)))
    host = Host(modems.now_ms, fleet=attached)
    ready(host)
    modems.mute = True
    attached.report(7, b"unheard", host.now_ms())
    dropped = host.until(lambda name, it: isinstance(it, PacketDropped) and it.packet is not None)
    assert isinstance(dropped, PacketDropped) and "waited too long" in dropped.reason
    attached.close()


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
    attached = AttachedModem(SerialPort(modems.path(1)))
    ready(Host(modems.now_ms, fleet=attached))
    attached.close()

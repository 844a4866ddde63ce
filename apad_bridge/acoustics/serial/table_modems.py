"""Modems on a table: our modem models behind real ptys, in water of their own, on the wall clock."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from agents.modem.facts import EmitFrame, FrameArrived, ModemAction, SerialBytes, SerialOut
from agents.modem.frames import ModemFrame
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig
from apad_bridge.acoustics.serial.pty import OpenedModems

PROPAGATION_US = 20_000


class TableModems:
    """Modems with addresses 1, 2, ... that receive each other, each behind a device that pyserial opens.

    Their time runs at `speed` times the wall clock, and so must the time of their hosts. Faster than real, a tenth of a
    second without a processor is longer than a modem takes to answer.
    """

    def __init__(self, folder: Path, count: int, speed: int = 1) -> None:
        self.speed = speed
        self.modems = {address: Modem(ModemConfig(), address) for address in range(1, count + 1)}
        self.sent: list[ModemFrame] = []
        self.mute = False
        """When True, no modem answers, as if their supply were off."""
        self._devices = OpenedModems(folder, self.modems, "modem")
        self._began_s = time.monotonic()
        self._in_flight: list[tuple[int, int, ModemFrame]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def path(self, address: int) -> str:
        return str(self._devices.path(address))

    def now_ms(self) -> int:
        return int((time.monotonic() - self._began_s) * 1000 * self.speed)

    def close(self) -> None:
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join(5)
            self._devices.close()

    def _run(self) -> None:
        while not self._stop.wait(0.001):
            now_ms = self.now_ms()
            for burst in self._devices.take():
                self._deliver(burst.agent_id, SerialBytes(burst.data, 0, paused=True), now_ms)
            for due in sorted(it for it in self._in_flight if it[0] <= now_ms):
                self._in_flight.remove(due)
                for address in self.modems:
                    if address != due[1]:
                        self._deliver(address, FrameArrived(due[2], PROPAGATION_US), now_ms)
            for address, modem in self.modems.items():
                self._apply(address, modem.advance(now_ms))

    def _deliver(self, address: int, stimulus: SerialBytes | FrameArrived, now_ms: int) -> None:
        self._apply(address, self.modems[address].receive(stimulus, now_ms))

    def _apply(self, address: int, actions: list[ModemAction]) -> None:
        for action in actions:
            if isinstance(action, SerialOut) and not self.mute:
                self._devices.write(address, action.data)
            elif isinstance(action, EmitFrame):
                self.sent.append(action.frame)
                arrives_ms = action.at_ms + action.frame.duration_ms + PROPAGATION_US // 1000
                self._in_flight.append((arrives_ms, address, action.frame))

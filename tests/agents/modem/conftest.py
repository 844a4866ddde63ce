"""Modems in water where every frame reaches every other modem, after a propagation that the test sets."""

from __future__ import annotations

import heapq
from collections.abc import Callable

import pytest

from agents.modem.facts import (
    EmitFrame,
    FrameArrived,
    ModemAction,
    ModemStimulus,
    SerialBytes,
    SerialOut,
    SoundBegan,
)
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig, ModemFirmware


class Water:
    """`air` takes away frames; `seen` is everything that every modem did, in order of time."""

    def __init__(self, modems: dict[str, Modem], propagation_us: int) -> None:
        self.modems = modems
        self.propagation_us = propagation_us
        self.air = False
        self.seen: list[tuple[str, ModemAction]] = []
        self.now_ms = 0
        self._coming: list[tuple[int, int, str, ModemStimulus]] = []
        self._count = 0

    def write(self, name: str, data: bytes, line: int = 0, until_ms: int | None = None) -> None:
        self.tell(name, SerialBytes(data, line), until_ms)

    def tell(self, name: str, stimulus: ModemStimulus, until_ms: int | None = None) -> None:
        """Tells a modem something now, and lets time run until then."""
        self._note(name, self.modems[name].receive(stimulus, self.now_ms))
        if until_ms is not None:
            self.run(until_ms)

    def run(self, until_ms: int) -> None:
        while True:
            dues = [(modem.next_due_ms, name) for name, modem in self.modems.items()]
            own = min(((due, name) for due, name in dues if due is not None), default=(until_ms + 1, ""))
            if self._coming and self._coming[0][0] <= min(own[0], until_ms):
                self.now_ms, _, name, stimulus = heapq.heappop(self._coming)
                self._note(name, self.modems[name].receive(stimulus, self.now_ms))
            elif own[0] <= until_ms:
                self.now_ms = own[0]
                self._note(own[1], self.modems[own[1]].advance(self.now_ms))
            else:
                break
        self.now_ms = until_ms
        for name, modem in self.modems.items():
            self._note(name, modem.advance(until_ms))

    def printed(self, name: str, line: int = 0) -> bytes:
        """The modem's output since the last call."""
        outs = [
            it.data for who, it in self.seen if who == name and isinstance(it, SerialOut) and it.line == line
        ]
        self.seen = [
            (who, it)
            for who, it in self.seen
            if who != name or not isinstance(it, SerialOut) or it.line != line
        ]
        return b"".join(outs)

    def of(self, name: str, kind: type[ModemAction]) -> list[ModemAction]:
        return [it for who, it in self.seen if who == name and isinstance(it, kind)]

    def _note(self, name: str, actions: list[ModemAction]) -> None:
        for action in actions:
            self.seen.append((name, action))
            if isinstance(action, EmitFrame) and not self.air:
                began_ms = action.at_ms - (-self.propagation_us // 1000)
                for other in self.modems:
                    if other != name:
                        frame = action.frame
                        self._put(began_ms, other, SoundBegan(frame.duration_ms))
                        self._put(
                            began_ms + frame.duration_ms, other, FrameArrived(frame, self.propagation_us)
                        )

    def _put(self, at_ms: int, name: str, stimulus: ModemStimulus) -> None:
        self._count += 1
        heapq.heappush(self._coming, (at_ms, self._count, name, stimulus))


Pair = Callable[..., Water]


@pytest.fixture
def pair() -> Pair:
    """Two modems, `near` with address 1 and `far` with address 2, 150 m apart by default."""

    def make(
        firmware: ModemFirmware = ModemFirmware.V3, propagation_us: int = 100_000, **config: int
    ) -> Water:
        of = ModemConfig(firmware, **config)
        return Water({"near": Modem(of, 1), "far": Modem(of, 2)}, propagation_us)

    return make

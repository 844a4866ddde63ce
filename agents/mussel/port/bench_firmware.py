"""Somebody's firmware on the boards of a `firmware_model.bench.Bench`."""

from __future__ import annotations

from collections.abc import Sequence

from agents.mussel.port.board_link import BENCH_TIMEOUT_S
from agents.mussel.port.others_firmware import OthersFirmware
from agents.mussel.port.peripherals import MeasuredWorld
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig
from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.port import FirmwareLike
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.sampling.sensors import SENSORS

_DEPTH_CM = 300


class _Body:
    """A body at the bench's place, at the surface or at one depth."""

    hardware: WholeBoardHardware

    def known_place_cm(self, now_ms: int) -> tuple[int, int, int]:
        return 0, 0, 0 if self.hardware.at_surface else _DEPTH_CM


def firmware_of(command: Sequence[str], config: BoardConfig) -> MakeFirmware:
    """Makes a program, or a real board, the firmware of a board on the bench.

    A whole board there measures constants, and its flash and its registers outlive its resets.
    """
    others = OthersFirmware(command, config, seed=1, timeout_s=BENCH_TIMEOUT_S)
    if config.whole is None:
        return others.maker(None)
    counts = (1 << 15,) * len(SENSORS)
    body = _Body()
    make_program = others.maker(MeasuredWorld(MemoryFlash(), body, lambda now_ms, sequence: (counts, 0)))

    def make(hardware: WholeBoardHardware) -> FirmwareLike:
        body.hardware = hardware
        return make_program(hardware)

    return make

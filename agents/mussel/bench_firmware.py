"""Somebody's firmware on the boards of a `firmware_model.bench.Bench`."""

from __future__ import annotations

from collections.abc import Sequence

from agents.mussel.board_link import BENCH_TIMEOUT_S
from agents.mussel.peripherals import MeasuredWorld
from agents.mussel.port_firmware import PortFirmware, link_to
from agents.mussel.whole_port_firmware import WholePortFirmware
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig
from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.sampling.sensors import SENSORS

_DEPTH_CM = 300


def firmware_of(command: Sequence[str], config: BoardConfig) -> MakeFirmware:
    """Makes a program, or a real board, the firmware of a board on the bench.

    A whole board there measures constants, and its flash and its registers outlive its resets.
    """
    if config.whole is None:
        return lambda hardware: PortFirmware(
            lambda: link_to(command, BENCH_TIMEOUT_S), config, hardware, seed=1
        )
    counts = (1 << 15,) * len(SENSORS)
    world = MeasuredWorld(MemoryFlash(), lambda now_ms: (0, 0, 0), lambda now_ms, sequence: (counts, 0))

    def make(hardware: WholeBoardHardware) -> PortFirmware:
        world.place_cm = lambda now_ms: (0, 0, 0 if hardware.at_surface else _DEPTH_CM)
        return WholePortFirmware(lambda: link_to(command, BENCH_TIMEOUT_S), config, hardware, 1, world)

    return make

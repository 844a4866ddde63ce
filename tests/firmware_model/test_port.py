"""The port of a board: its firmware runs on the port's calls alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from firmware_model.actions import Action
from firmware_model.bench import Bench
from firmware_model.config import BoardConfig, LastResort
from firmware_model.packets import Beacon, SetThreshold, SlotAssignment, Threshold
from firmware_model.port import ClockChip, Hardware, WholeHardware
from firmware_model.table_one import FIELD, HOURLY, METERING, WORST_CASE, board, power
from tests.firmware_model.conftest import lives

BOARDS = {
    "worst case": BoardConfig(
        1,
        replace(WORST_CASE, segments_by_two=WORST_CASE.segments),
        50,
        2000,
        43_200_000,
        120_000,
        motor_run=10**12,
    ),
    "hourly": board(HOURLY, power()),
    "field, metered": board(FIELD, power(LastResort.SURFACE, metering=METERING, low_level=10**13)),
    "never asleep": board(None, power(LastResort.CALL)),
}


class Narrowed:
    """Shows no more of an object than a protocol has."""

    def __init__(self, it: Any, protocol: type) -> None:
        self._it = it
        self._names = {name for base in protocol.__mro__ for name in vars(base) if not name.startswith("_")}

    def __getattr__(self, name: str) -> Any:
        if name not in self._names:
            raise AttributeError(f"the port has no {name}")
        found = getattr(self._it, name)
        return Narrowed(found, ClockChip) if name == "clock" else found


def _live(config: BoardConfig, narrowed: bool) -> list[Action]:
    bench = Bench(replace(config, drift_ppb=20_000), primary=0.3, secondary=0.25)

    def narrow() -> None:
        if narrowed:
            firmware: Any = bench.board.firmware
            protocol = Hardware if config.whole is None else WholeHardware
            firmware._hardware = Narrowed(firmware._hardware, protocol)
            if config.whole is not None:
                firmware._store._hardware = firmware._hardware
                firmware._store.clock.clock = firmware._hardware.clock

    narrow()
    bench.run(hours=3.2)
    for packet in (Beacon(1, 9 * 3_600_000), SetThreshold(1, Threshold.SAFE_LEVEL, 0.2)):
        bench.hear(packet)
    bench.hear(SlotAssignment(1, 300_000, 3000, 500, 7, -12))
    lives(bench, "ping 4h permission 5min")
    bench.charge_pin_rises(noticed=False)
    lives(bench, "2h watchdog")
    narrow()
    lives(bench, "falls 1h hover 30h")
    return bench.trace


@pytest.mark.parametrize("name", BOARDS)
def test_the_firmware_needs_nothing_of_the_hardware_but_the_port(name: str) -> None:
    """Charges, drift and place are not on the port, so firmware that reached for one would raise."""
    assert _live(BOARDS[name], narrowed=True) == _live(BOARDS[name], narrowed=False)


def test_the_port_carries_no_charge_and_no_place() -> None:
    names = {
        name for it in (Hardware, WholeHardware, ClockChip) for name in vars(it) if not name.startswith("_")
    }
    assert not names & {"primary", "secondary", "kept", "anchor", "drift_ppb", "readings", "rails"}

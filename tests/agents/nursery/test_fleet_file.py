"""The file of a run's fleet comes back whole, and that of another version or a damaged one is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from fleets import PAPER, with_whole_boards

from agents.fleet_config import resting_on_bottom
from agents.nursery.fleet_file import FLEET_NAME, FleetFile, RestartPolicy
from firmware_model.config import FullFirmware, LastResort
from firmware_model.table_one import FIELD, METERING, power

POWER = power(LastResort.CALL, 0, METERING)
FILE = FleetFile(
    with_whole_boards(replace(PAPER, agent_ids=(3, 7)), FullFirmware(POWER, FIELD, 1000, 60_000, 600_000)),
    {3: resting_on_bottom(1.0, 2.0, 8.0, 0.5, 1.0), 7: resting_on_bottom(-1.0, 0.0, 8.0, 0.25, 1.0)},
    RestartPolicy(orphan_s=5.0),
)


def test_it_comes_back_whole_and_is_never_written_over(tmp_path: Path) -> None:
    FILE.write(str(tmp_path))
    assert FleetFile.read(str(tmp_path)) == FILE
    with pytest.raises(FileExistsError):
        FILE.write(str(tmp_path))


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data[:-1],
        lambda data: bytes(8) + data[8:],
        lambda data: b"",
        lambda data: data[:8] + b"\x93\x01",
    ],
)
def test_one_of_another_version_or_a_damaged_one_is_refused(
    tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    FILE.write(str(tmp_path))
    path = tmp_path / FLEET_NAME
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(ValueError):
        FleetFile.read(str(tmp_path))

"""A pytest plugin: `pytest --mu-firmware ./board` puts somebody's firmware on the boards of the fixture `mu`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from agents.mussel.port.bench_firmware import firmware_of
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig

_OPTION = "--mu-firmware"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        _OPTION,
        metavar="PROGRAM",
        help="put this program on the boards of the fixture `mu`, in place of our firmware",
    )


def pytest_mu_firmware(config: pytest.Config, board: BoardConfig) -> MakeFirmware | None:
    if (program := config.getoption(_OPTION)) is None:
        return None
    path = Path(program).absolute()
    if not (path.is_file() and os.access(path, os.X_OK)):
        raise pytest.UsageError(f"{_OPTION} {program}: there is no such program")
    return firmware_of((str(path),), board)

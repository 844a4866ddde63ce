"""Physical modems for the tests of serial lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from apad_bridge.acoustics.serial.table_modems import TableModems

Make = Callable[..., TableModems]


@pytest.fixture
def physical(tmp_path: Path) -> Iterator[Make]:
    made: list[TableModems] = []

    def make(count: int = 2, speed: int = 1, folder: str = "dev") -> TableModems:
        made.append(TableModems(tmp_path / folder, count, speed))
        return made[-1]

    yield make
    for it in made:
        it.close()

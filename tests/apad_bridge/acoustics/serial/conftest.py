"""Physical modems for the tests of serial lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from physical_modems import PhysicalModems

Make = Callable[..., PhysicalModems]


@pytest.fixture
def physical(tmp_path: Path) -> Iterator[Make]:
    made: list[PhysicalModems] = []

    def make(count: int = 2, speed: int = 1, folder: str = "dev") -> PhysicalModems:
        made.append(PhysicalModems(tmp_path / folder, count, speed))
        return made[-1]

    yield make
    for it in made:
        it.close()

"""Lean dataclasses do what agents use of the ordinary ones."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

from agents.lean import lean_dataclasses
from agents.nursery.memory_layout import gather_code

with lean_dataclasses():

    @dataclasses.dataclass(frozen=True, slots=True)
    class Lean:
        """Weighs less."""

        first: int
        second: str = "two"

    @dataclasses.dataclass(frozen=True, slots=True)
    class Bare:
        pass


@dataclasses.dataclass(frozen=True, slots=True)
class Ordinary:
    first: int
    second: str = "two"


def test_it_is_made_compared_hashed_and_matched_like_an_ordinary_one() -> None:
    assert (Lean(1).first, Lean(1).second, Lean(1, second="x").second) == (1, "two", "x")
    assert Lean(1) == Lean(1, "two") != Lean(2)
    assert Lean(1) != Ordinary(1)
    assert hash(Lean(1)) == hash(Ordinary(1))
    assert Bare() == Bare()
    match Lean(3, "x"):
        case Lean(first, second):
            assert (first, second) == (3, "x")
    with pytest.raises(TypeError):
        Lean()  # type: ignore[call-arg]
    assert not hasattr(Lean(1), "__dict__")


def test_outside_of_the_block_dataclasses_are_ordinary() -> None:
    assert dataclasses.is_dataclass(Ordinary)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Ordinary(1).first = 2  # type: ignore[misc]


def test_holes_are_filled_once() -> None:
    """In a fresh interpreter: what is made after lies past what fills them."""
    code = (
        "from agents.nursery.memory_layout import fill_holes\n"
        "first = fill_holes(); second = fill_holes()\n"
        "assert len(first) > 100, len(first)\n"
        "assert len(second) < len(first) / 2, (len(first), len(second))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def counted(names: list[str]) -> dict[str, int]:
    def length(name: str) -> int:
        return len(name) + extra

    extra = 1
    return {name: sum(length(it) for it in names if it == name) for name in names}


def idle() -> None:
    raise AssertionError("it never runs")


def test_code_that_runs_is_moved_and_does_the_same() -> None:
    before, idle_before = counted.__code__, idle.__code__
    expected = counted(["a", "bb", "a"])
    gather_code(lambda: counted(["a"]) and None)
    assert counted.__code__ == before and counted.__code__ is not before
    assert idle.__code__ is idle_before
    assert counted(["a", "bb", "a"]) == expected == {"a": 4, "bb": 3}

"""Tests opened modems with an independent driver, through pyserial on a real pty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from apad_bridge.acoustics.serial.pty import OpenedModems

Make = Callable[..., Any]


def driver(path: str) -> serial.Serial:
    return serial.Serial(path, 9600, timeout=60)


DATA = bytes(range(64))


@pytest.mark.parametrize(
    ("speed", "talk"),
    [
        pytest.param(
            1,
            [
                (b"$?", b"#A001V21845R001.006.000B2024-02-15T00:00:00\r\n"),
                (b"$P002", b"$P002\r\n#R002T00640\r\n"),  # 20 ms of 31.25 us
                (b"$U00264" + DATA, b"$U00264\r\n"),
            ],
            id="a driver pings and talks",
        ),
        pytest.param(
            8,
            [(b"$P0", b"E\r\n"), (b"02", b"E\r\n"), (b"$A001", b"#A001\r\n")],
            id="slow bytes are an error however fast time runs",
        ),
    ],
)
def test_a_driver_talks_through_pyserial(physical: Make, speed: int, talk: list[tuple[bytes, bytes]]) -> None:
    modems = physical(speed=speed)
    with driver(modems.path(1)) as near, driver(modems.path(2)) as far:
        for written, answer in talk:
            near.write(written)
            assert near.read(len(answer)) == answer
        assert speed != 1 or far.read(4 + 64 + 2) == b"#U64" + DATA + b"\r\n"


def test_a_driver_may_come_back(physical: Make) -> None:
    modems = physical()
    for _ in range(3):
        with driver(modems.path(1)) as near:
            near.write(b"$A001")
            assert near.read_until(b"\r\n") == b"#A001\r\n"


def test_names_are_stable_and_go_with_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "modems"
    first = OpenedModems(folder, [7, 12])
    assert sorted(it.name for it in folder.iterdir()) == ["amussel12", "amussel7"]
    assert first.path(7).resolve().is_char_device()
    # A supervisor that died left its names: the next one replaces them.
    second = OpenedModems(folder, [7])
    assert second.path(7) == first.path(7)
    with driver(str(second.path(7))) as host:
        second.write(7, b"#TO\r\n")
        assert host.read(5) == b"#TO\r\n"
    second.close()
    assert [it.name for it in folder.iterdir()] == ["amussel12"]
    first.close()
    assert list(folder.iterdir()) == []


@pytest.fixture
def modems(tmp_path: Path) -> Iterator[OpenedModems]:
    opened = OpenedModems(tmp_path / "modems", [7])
    yield opened
    opened.close()


def test_what_nobody_reads_is_lost_and_does_not_wait(modems: OpenedModems) -> None:
    """All the rest is there, and what is written next follows it."""
    modems.write(7, b"before anybody came\r\n")
    with driver(str(modems.path(7))) as host:
        modems.write(7, b"#A007\r\n")
        assert host.read(7) == b"#A007\r\n"
        for _ in range(2000):
            modems.write(7, bytes(64))
        lost_bytes = modems.lost_bytes
        assert 0 < lost_bytes < 2000 * 64
        assert host.read(2000 * 64 - lost_bytes) == bytes(2000 * 64 - lost_bytes)
        modems.write(7, b"#A007\r\n")
        assert (host.read(7), modems.lost_bytes) == (b"#A007\r\n", lost_bytes)


@pytest.mark.parametrize("data", [b"\x03\x04\x11\x13\x1a\r\n\x7f\xff", bytes(range(256))])
def test_the_device_is_raw(modems: OpenedModems, data: bytes) -> None:
    with driver(str(modems.path(7))) as host:
        modems.write(7, data)
        assert host.read(len(data)) == data
        host.write(data)
        taken = b""
        while len(taken) < len(data):
            taken += b"".join(burst.data for burst in modems.take())
        assert taken == data

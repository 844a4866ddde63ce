"""Tests the bytes of a main window of Qt 5 against the bytes that Qt wrote for the same docks."""

from __future__ import annotations

from struct import Struct, unpack_from
from typing import Any

from apad_bridge.analysis.layouts.qt_window import Column, Dock, Tabs, geometry, state

# Qt 5.15 (PyQt5 5.15.11, 1600 x 900, dock nesting enabled, all docks added at the bottom, one hidden tool bar) was given
# `state(COLUMNS, 1600, 900)`, restored it, showed the docks accordingly, and saved these bytes.
COLUMNS = (
    (Column(((Tabs((Dock("p"), Dock("q"), Dock("r"))), 1.0),)), 0.6),
    (Column(((Dock("m"), 0.5), (Tabs((Dock("t"), Dock("c"))), 0.5))), 0.4),
)
OF_QT = bytes.fromhex(
    "000000ff00000000fd00000001000000030000064000000384fc0100000002fc00000000000003bc0000007b00fffffffc0200000001fc0000000000"
    "0003840000004d01000020fa000000000100000003fb0000000200700100000000000003c00000003e00fffffffb0000000200710100000000000003"
    "c00000003e00fffffffb0000000200720100000000000003c00000003e00fffffffc000003c20000027e0000007b00fffffffc0200000002fb000000"
    "02006d0100000000000001bf0000002c00fffffffc000001c5000001bf0000004d01000020fa000000000100000002fb000000020074010000000000"
    "0002800000003e00fffffffb0000000200630100000000000002800000003e00ffffff00000640000000000000000400000004000000080000000"
    "8fc00000001000000030000000100000036004d0069006e0069006d0069007a006500640044006f0063006b0057006900640067006500740073"
    "0054006f006f006c0062006100720000000000ffffffff0000000000000000"
)
# The geometry of a window of 1604 x 904 with its frame, at the corner of a screen that is 800 pixels wide.
GEOMETRY_OF_QT = bytes.fromhex(
    "01d9d0cb0003000000000000000000000000064300000387000000020000000200000641000003850000000000000000032000000002000000020000"
    "064100000385"
)


class Reader:
    """Reads the bytes as QMainWindow.restoreState does, into nested lists: ("row" | "column", [(size, part), ...])."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def window(self) -> tuple[Any, bytes]:
        """Reads the docks and the tool bars after them."""
        assert self._take(">iiB") == (0xFF, 0, 0xFD)
        areas, area, _, _ = self._take(">iiii")
        assert (areas, area) == (1, 3)
        docks = self._part()
        self._take(">ii")  # the central widget's size
        assert self._take(">4i") == (4, 4, 8, 8)
        return docks, self._data[self._at :]

    def _part(self) -> Any:
        (marker,) = self._take(">B")
        if marker == 0xFA:
            on_top, _, count = self._take(">iBi")
            return ("tabs", on_top, [self._item() for _ in range(count)])
        assert marker == 0xFC
        orientation, count = self._take(">Bi")
        return ({1: "row", 2: "column"}[orientation], [self._item() for _ in range(count)])

    def _item(self) -> Any:
        (marker,) = self._take(">B")
        if marker == 0xFB:
            (length,) = self._take(">i")
            name = self._data[self._at : self._at + length].decode("utf-16-be")
            self._at += length
            (flags,) = self._take(">B")
            assert flags == 1, "visible and not floating"
            return (self._size(), name)
        assert marker == 0xFC
        return (self._size(), self._part())

    def _size(self) -> int:
        _, size, _, _ = self._take(">iiii")
        return int(size)

    def _take(self, form: str) -> tuple[Any, ...]:
        values = unpack_from(form, self._data, self._at)
        self._at += Struct(form).size
        return values


def without_sizes(part: Any) -> Any:
    if isinstance(part, str):
        return part
    *kind, items = part
    return (*kind, [without_sizes(inner) for _, inner in items])


def test_docks_are_where_qt_writes_them() -> None:
    ours, after_ours = Reader(state(COLUMNS, 1600, 900)).window()
    of_qt, after_qt = Reader(OF_QT).window()
    assert without_sizes(ours) == without_sizes(of_qt)
    assert without_sizes(ours) == (
        "row",
        [
            ("column", [("tabs", 0, ["p", "q", "r"])]),
            ("column", ["m", ("tabs", 0, ["t", "c"])]),
        ],
    )
    # Qt puts handles of some pixels between docks.
    for (size, _), (qts, _) in zip(ours[1], of_qt[1], strict=True):
        assert abs(size - qts) <= 4
    assert after_ours == b"\xfc\0\0\0\0", "no tool bars"
    assert after_qt.startswith(b"\xfc\0\0\0\1"), "one"


def test_shares_become_sizes() -> None:
    (_, columns), _ = Reader(state(COLUMNS, 1000, 400)).window()
    assert [size for size, _ in columns] == [600, 400]
    (_, right) = columns[1][1]
    assert [size for size, _ in right] == [200, 200]


def test_a_windows_geometry() -> None:
    assert Struct(">IHH").unpack(GEOMETRY_OF_QT[:8]) == (0x01D9D0CB, 3, 0)
    ours = geometry(1604, 904)
    # The oldest form, which every Qt 5 reads, ends before the screen's width.
    assert Struct(">IHH").unpack(ours[:8]) == (0x01D9D0CB, 1, 0)
    assert ours[8:24] == GEOMETRY_OF_QT[8:24], "the frame"
    assert len(ours) == 8 + 16 + 16 + 4 + 1 + 1

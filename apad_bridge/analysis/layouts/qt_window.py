"""A main window of Qt 5 with docks side by side, as the bytes that `QMainWindow.saveState` and `saveGeometry` return.

rqt keeps both in a perspective. Numbers are big-endian (QDataStream, version Qt_5_0); sizes are pixels. Qt reads sizes as
shares of the window's real size.
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import pack

_MARKER, _VERSION = 0xFF, 0
_DOCKS, _TABS, _SPLIT, _WIDGET, _TOOL_BARS = 0xFD, 0xFA, 0xFC, 0xFB, 0xFC
_BOTTOM = 3
_HORIZONTAL, _VERTICAL = 1, 2
_CORNERS = (4, 4, 8, 8)
"""Upper corners belong to the top dock area, lower ones to the bottom one: Qt's default."""
_VISIBLE = 1
_SMALLEST, _LARGEST = 50, 0xFFFFFF
_GEOMETRY_MAGIC = 0x01D9D0CB


@dataclass(frozen=True, slots=True)
class Dock:
    """A dock, by the object name of its QDockWidget."""

    name: str


@dataclass(frozen=True, slots=True)
class Tabs:
    """Docks on top of each other; the first one is visible."""

    docks: tuple[Dock, ...]


@dataclass(frozen=True, slots=True)
class Column:
    """Parts from top to bottom, each with its share of the height; the shares' sum is 1."""

    parts: tuple[tuple[Dock | Tabs, float], ...]


def state(columns: tuple[tuple[Column, float], ...], width_px: int, height_px: int) -> bytes:
    """The state of a window with only these columns, from left to right, each with its share of the width."""
    row = bytes([_SPLIT, _HORIZONTAL]) + pack(">i", len(columns))
    left_px = 0
    for column, share in columns:
        across_px = round(share * width_px)
        row += bytes([_SPLIT]) + _place(left_px, across_px) + _column(column, across_px, height_px)
        left_px += across_px
    return (
        pack(">iiBii", _MARKER, _VERSION, _DOCKS, 1, _BOTTOM)
        + pack(">ii", width_px, height_px)
        + row
        + pack(">ii", width_px, 0)  # the central widget's size
        + pack(">4i", *_CORNERS)
        + pack(">Bi", _TOOL_BARS, 0)
    )


def geometry(width_px: int, height_px: int) -> bytes:
    """The geometry of a window at the screen's upper left corner."""
    corners = pack(">4i", 0, 0, width_px - 1, height_px - 1)
    return pack(">IHH", _GEOMETRY_MAGIC, 1, 0) + 2 * corners + pack(">iBB", 0, 0, 0)


def _column(column: Column, width_px: int, height_px: int) -> bytes:
    written = bytes([_SPLIT, _VERTICAL]) + pack(">i", len(column.parts))
    top_px = 0
    for part, share in column.parts:
        high_px = round(share * height_px)
        if isinstance(part, Dock):
            written += _dock(part, top_px, high_px)
        else:
            written += bytes([_SPLIT]) + _place(top_px, high_px) + _tabs(part, width_px)
        top_px += high_px
    return written


def _tabs(tabs: Tabs, width_px: int) -> bytes:
    on_top = 0
    written = pack(">BiBi", _TABS, on_top, _HORIZONTAL, len(tabs.docks))
    return written + b"".join(_dock(dock, 0, width_px) for dock in tabs.docks)


def _dock(dock: Dock, at_px: int, size_px: int) -> bytes:
    name = dock.name.encode("utf-16-be")
    return bytes([_WIDGET]) + pack(">i", len(name)) + name + bytes([_VISIBLE]) + _place(at_px, size_px)


def _place(at_px: int, size_px: int) -> bytes:
    return pack(">iiii", at_px, size_px, _SMALLEST, _LARGEST)

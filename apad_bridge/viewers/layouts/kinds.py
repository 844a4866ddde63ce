"""The programs for which a layout can be written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from apad_bridge.viewers.layouts import foxglove_layout, rqt_layout, rviz_layout
from apad_bridge.viewers.layouts.layout_content import LayoutFleet


@dataclass(frozen=True, slots=True)
class LayoutKind:
    """A program's layouts: the `ending` of their files' names, and how to open one, with FILE for its name."""

    ending: str
    opened: str
    write: Callable[[LayoutFleet], str]


KINDS = {
    "rviz": LayoutKind(".rviz", "rviz -d FILE", rviz_layout.layout),
    "rqt": LayoutKind(".perspective", "rqt --perspective-file FILE", rqt_layout.layout),
    "foxglove": LayoutKind(
        ".foxglove.json", "import FILE from Foxglove's menu of layouts", foxglove_layout.layout
    ),
}

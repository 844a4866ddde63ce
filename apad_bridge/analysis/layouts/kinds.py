"""The programs that a layout is written for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from apad_bridge.analysis.layouts import foxglove, plotjuggler, rqt, rviz
from apad_bridge.analysis.layouts.fleet import FleetShown


@dataclass(frozen=True, slots=True)
class Kind:
    """`ending` is what the program expects a file's name to end in, `opened` how it is opened, with FILE for its name."""

    ending: str
    opened: str
    write: Callable[[FleetShown], str]


KINDS = {
    "rviz": Kind(".rviz", "rviz -d FILE", rviz.layout),
    "rqt": Kind(".perspective", "rqt --perspective-file FILE", rqt.layout),
    "plotjuggler": Kind(".plotjuggler.xml", "plotjuggler --layout FILE", plotjuggler.layout),
    "foxglove": Kind(".foxglove.json", "import FILE from Foxglove's menu of layouts", foxglove.layout),
}

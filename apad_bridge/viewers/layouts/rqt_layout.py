"""The layout for rqt: batteries in rqt_plot, /diagnostics in rqt_runtime_monitor, and rqt_topic and rqt_console.

A perspective is JSON: groups of keys, whose values are Python's repr of rqt's settings. It names no arrangement of the
docks, which rqt keeps as bytes of Qt's: rqt restores one only where there is one (qt_gui's `main_window.py`), and otherwise
puts the docks side by side.
"""

from __future__ import annotations

import json
from typing import Any

from apad_bridge.viewers.layouts.layout_content import LayoutAPad, LayoutFleet

_PLOT, _MONITOR = "rqt_plot/Plot", "rqt_runtime_monitor/RuntimeMonitor"
_TOPICS, _CONSOLE = "rqt_topic/TopicPlugin", "rqt_console/Console"
Group = dict[str, Any]


def layout(fleet: LayoutFleet) -> str:
    plots = range(1, 1 + len(fleet.apads))
    plugins = {
        _name(_PLOT, number): _plot(fleet, apad) for number, apad in zip(plots, fleet.apads, strict=True)
    }
    for single in (_MONITOR, _TOPICS, _CONSOLE):
        plugins[_name(single, 1)] = _group({})
    running = {_PLOT: list(plots), _MONITOR: [1], _TOPICS: [1], _CONSOLE: [1]}
    perspective = _group(
        {},
        pluginmanager=_group({"running-plugins": _value(running)}, **plugins),
    )
    return json.dumps(perspective, indent=2) + "\n"


def _plot(fleet: LayoutFleet, apad: LayoutAPad) -> Group:
    # rqt takes the first topic that begins such a name: one with `apad/battery_state` is a field of `apad` to it.
    names = [
        f"{apad.topic('apad')}/battery_fraction",
        *(f"{topic}/percentage" for topic in fleet.batteries(apad).values()),
    ]
    settings = {
        "autoscroll": _value(True),
        "topics": _value(names),
        "y_limits": _value([0.0, 1.0]),
    }
    title = {"dock_widget_title": _value(f"{apad.name}: batteries")}
    return _group({}, dock_widget__DataPlotWidget=_group(title), plugin=_group(settings))


def _name(plugin: str, number: int) -> str:
    """The name of the group with the settings of this instance of a plugin."""
    return f"plugin__{plugin.replace('/', '__')}__{number}"


def _group(keys: dict[str, Any], **groups: Group) -> Group:
    return {"keys": keys, "groups": groups}


def _value(value: Any) -> dict[str, str]:
    return {"type": "repr", "repr": repr(value)}

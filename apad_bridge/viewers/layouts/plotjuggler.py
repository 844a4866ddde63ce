"""The layout for PlotJuggler 3: a tab for each aPad with batteries and the track from above, and a tab for a run's bag.

Curves have the names of its ROS plugins: the topic, then the fields, with [n] for an index in a list.
"""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from apad_bridge.viewers.layouts.fleet import LayoutAPad, LayoutFleet, hexadecimal, in_bag

_OF_BAG = ("truth", "beliefs", "apad")


def layout(fleet: LayoutFleet) -> str:
    root = Element("root")
    tabs = SubElement(root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"})
    for apad in fleet.apads:
        _tab_of(tabs, fleet, apad)
    _tab_of_bag(tabs, fleet)
    SubElement(tabs, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    plugins = SubElement(root, "Plugins")
    streamed = [topic for apad in fleet.apads for topic in _streamed(fleet, apad)]
    _plugin(plugins, "DataLoad ROS bags", dict.fromkeys([*streamed, *map(in_bag, _OF_BAG)]), len(fleet.ids))
    _plugin(plugins, "ROS Topic Subscriber", streamed, len(fleet.ids))
    SubElement(root, "previouslyLoaded_Streamer", name="ROS Topic Subscriber")
    indent(root, " ")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{tostring(root, encoding='unicode')}\n"


def _streamed(fleet: LayoutFleet, apad: LayoutAPad) -> list[str]:
    return [apad.topic("apad"), apad.topic("apad/battery_state"), *fleet.batteries(apad).values()]


def _tab_of(tabs: Element, fleet: LayoutFleet, apad: LayoutAPad) -> None:
    splitter = _tab(tabs, apad.name, "-", (0.6, 0.4))
    charges = _time_plot(splitter, f"{apad.name}: aMussels", fleet.duration_s)
    for number, topic in enumerate(fleet.batteries(apad).values()):
        SubElement(charges, "curve", name=f"{topic}/percentage", color=hexadecimal(number))
    below = SubElement(splitter, "DockSplitter", orientation="|", count="2", sizes="0.5;0.5")
    battery = _time_plot(below, f"{apad.name}: battery", fleet.duration_s)
    SubElement(battery, "curve", name=f"{apad.topic('apad/battery_state')}/percentage", color="#1ac938")
    _seen_from_above(below, fleet, apad)


def _tab_of_bag(tabs: Element, fleet: LayoutFleet) -> None:
    """The tab for a bag, whose lists are in the order of ids. Each of several aPads has a bag of its own aMussels."""
    splitter = _tab(tabs, "run.bag", "-", (0.7, 0.3))
    charges = _time_plot(splitter, "true charges, by rising id", fleet.duration_s)
    for number in range(max((len(apad.ids) for apad in fleet.apads), default=0)):
        name = f"{in_bag('truth')}/agents[{number}]/primary"
        SubElement(charges, "curve", name=name, color=hexadecimal(number))
    battery = _time_plot(splitter, "the aPad's battery", fleet.duration_s)
    SubElement(battery, "curve", name=f"{in_bag('apad')}/battery_fraction", color="#1ac938")


def _tab(tabs: Element, title: str, orientation: str, sizes: tuple[float, ...]) -> Element:
    tab = SubElement(tabs, "Tab", tab_name=title, containers="1")
    container = SubElement(tab, "Container")
    return SubElement(
        container,
        "DockSplitter",
        orientation=orientation,
        count=str(len(sizes)),
        sizes=";".join(map(str, sizes)),
    )


def _time_plot(parent: Element, title: str, duration_s: float) -> Element:
    """A plot of fractions over mission time."""
    plot = SubElement(SubElement(parent, "DockArea", name=title), "plot", mode="TimeSeries", style="Lines")
    SubElement(plot, "range", left="0", right=f"{duration_s:g}", bottom="0", top="1")
    SubElement(plot, "limitY", min="0", max="1")
    return plot


def _seen_from_above(parent: Element, fleet: LayoutFleet, apad: LayoutAPad) -> None:
    (south, west), (north, east) = fleet.south_west_m, fleet.north_east_m
    area = SubElement(parent, "DockArea", name=f"{apad.name}: way, east and north in m")
    plot = SubElement(area, "plot", mode="XYPlot", style="Lines")
    SubElement(plot, "range", left=f"{west:g}", right=f"{east:g}", bottom=f"{south:g}", top=f"{north:g}")
    SubElement(plot, "limitY")
    topic = apad.topic("apad")
    SubElement(
        plot,
        "curve",
        name=f"{topic}/[east;north]",
        curve_x=f"{topic}/east",
        curve_y=f"{topic}/north",
        color="#f14cc1",
    )


def _plugin(plugins: Element, name: str, topics: Iterable[str], longest: int) -> None:
    plugin = SubElement(plugins, "plugin", ID=name)
    # A message's arrival has mission time, on /clock and in a bag; its header has the time of the report.
    SubElement(plugin, "use_header_stamp", value="false")
    SubElement(plugin, "discard_large_arrays", value="true")
    SubElement(plugin, "max_array_size", value=str(max(100, longest)))
    SubElement(plugin, "selected_topics", value=";".join(topics))

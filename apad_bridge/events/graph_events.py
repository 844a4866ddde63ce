"""Events of the ROS graph that the run takes part in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import Category, Event, Meaning, Uncounted


@dataclass(frozen=True)
class MasterGone(Event):
    kind = "master_gone"
    when = "another party's ROS master does not answer"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.ALARM

    uri: Annotated[str, Meaning("its address")]
    why: Annotated[str, Meaning("the symptom")]

    def text(self) -> str:
        return f"the ROS master does not answer, and connections go on without it: {self.why}"


@dataclass(frozen=True)
class MasterBack(Event):
    kind = "master_back"
    when = "that master answers again, and the run has registered everything"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.RELIEF

    uri: Annotated[str, Meaning("its address")]
    gone_s: Annotated[float, Meaning("the length of its absence, by the wall clock", "s")]
    registered: Annotated[int, Meaning("topics and services")]

    def text(self) -> str:
        return f"the ROS master answers again after {self.gone_s:.0f} s"


@dataclass(frozen=True)
class GraphDeaf(Event):
    kind = "graph_deaf"
    when = "no node can connect to the run's own node: its services and its new subscribers get no answer"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.ALARM

    why: Annotated[str, Meaning("the symptom")]

    def text(self) -> str:
        return f"no ROS node can connect to this run: {self.why}"


@dataclass(frozen=True)
class GraphHears(Event):
    kind = "graph_hears"
    when = "nodes can connect again"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.RELIEF

    deaf_s: Annotated[float, Meaning("the length of that, by the wall clock", "s")]

    def text(self) -> str:
        return "ROS nodes can connect to this run again"


@dataclass(frozen=True)
class MessagesDropped(Event):
    kind = "unreadable"
    when = "a node publishes messages that the run cannot use, for the first time; the summary counts them under `dropped`"
    counted = Uncounted("a foreign node on the machine's network")
    category = Category.ALARM

    topic: Annotated[str, Meaning("the topic")]
    node: Annotated[str, Meaning("the node")]
    why: Annotated[str, Meaning("why they are dropped")]

    def text(self) -> str:
        return f"messages of {self.node} on {self.topic} are dropped: {self.why}"

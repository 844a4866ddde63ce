"""Compares a live vehicle's definitions with ours. rospy reports a mismatch only to its log, again and again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rosgraph

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.live_apad import NotAnnounced
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.types.any_message import AnyMessages, why_unfit
from apad_bridge.ros.types.wire_probe import service_md5, topic_definition
from apad_bridge.ros.types.workspace_services import service_by_text

Needed = Mapping[str, tuple[Any, tuple[str, ...]]]
"""By topic: our message class, and the paths of the fields read."""


def unreadable_topics(published: Needed) -> list[str]:
    """A line for each topic whose publisher's definition differs from ours and has another field than those that we read.

    The line names both definitions by type and md5. A topic that only differs is read by its own definition.
    """
    if (graph := _graph()) is None:
        return []
    lines = []
    for topic, (ours, fields) in published.items():
        try:
            theirs = topic_definition(graph, topic)
        except NotAnnounced:
            continue
        if theirs.md5 == ours._md5sum:
            continue
        try:
            why = why_unfit(AnyMessages().class_of(theirs.kind, theirs.md5, theirs.text), ours, fields)
        except ValueError as error:
            why = str(error)
        if why:
            lines.append(f"{topic} is {theirs.kind} (md5 {theirs.md5}) there, and {_named(ours)} here: {why}")
    return lines


def differing_listeners(listened_to: Mapping[str, Any]) -> list[str]:
    """A line for each topic to which the vehicle subscribes by another type than ours. The graph shows no more."""
    if (graph := _graph()) is None:
        return []
    lines = []
    for topic, ours in listened_to.items():
        their_type = graph.types.get(topic, ours._type)
        if graph.subscribers.get(topic) and their_type not in (ours._type, "*"):
            lines.append(f"{topic} is {their_type} there, and {_named(ours)} here")
    return lines


def live_services(services: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The class to call each service by, and a line for each whose definition is neither here nor in a workspace.

    The server announces its md5: our definition is used where it agrees, else a text of that md5 on ROS_PACKAGE_PATH.
    """
    chosen: dict[str, Any] = dict(services)
    lines: list[str] = []
    if (graph := _graph()) is None:
        return chosen, lines
    for name, ours in services.items():
        try:
            md5 = service_md5(graph, name)
        except NotAnnounced:
            continue
        if md5 == ours._md5sum:
            continue
        if (theirs := service_by_text(ours._type, md5)) is None:
            lines.append(
                f"{name} has md5 {md5} there, which no text of {ours._type} on ROS_PACKAGE_PATH has, "
                f"and {_named(ours)} here"
            )
            continue
        chosen[name] = theirs
    return chosen, lines


def _graph() -> Graph | None:
    try:
        return Graph.read(rosgraph.get_master_uri())
    except Unreachable:
        return None


def _named(ours: Any) -> str:
    return f"{ours._type} (md5 {ours._md5sum})"

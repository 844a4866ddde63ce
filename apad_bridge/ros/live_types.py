"""Whether a live vehicle speaks the definitions that we speak. Of a mismatch rospy tells only its log, again and again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rosgraph

from apad_bridge.diagnosis.graph import Graph
from apad_bridge.diagnosis.network import Unreachable
from apad_bridge.ros.wire_probe import NotTold, service_md5, topic_md5


def differing_types(published: Mapping[str, Any], listened_to: Mapping[str, Any]) -> list[str]:
    """A line for each topic whose type or md5 is not that of our message class: both definitions, by type and md5.

    `published` are topics that the vehicle publishes: their md5 is asked of the publisher itself. Of those that it listens
    to, only the type's name on the master can be known.
    """
    try:
        graph = Graph.read(rosgraph.get_master_uri())
    except Unreachable:
        return []
    lines = []
    for topic, ours in published.items():
        try:
            md5 = topic_md5(graph, topic)
        except NotTold:
            continue
        if md5 != ours._md5sum:
            theirs = f"{graph.types.get(topic, 'a type unknown')} (md5 {md5})"
            lines.append(f"{topic} is {theirs} there, and {_named(ours)} here")
    for topic, ours in listened_to.items():
        there = graph.types.get(topic, ours._type)
        if graph.subscribers.get(topic) and there != ours._type:
            lines.append(f"{topic} is {there} there, and {_named(ours)} here")
    return lines


def differing_services(services: Mapping[str, Any]) -> list[str]:
    """A line for each service whose md5, asked of its server, is not that of our class."""
    try:
        graph = Graph.read(rosgraph.get_master_uri())
    except Unreachable:
        return []
    lines = []
    for name, ours in services.items():
        try:
            md5 = service_md5(graph, name)
        except NotTold:
            continue
        if md5 != ours._md5sum:
            lines.append(f"{name} has md5 {md5} there, and {_named(ours)} here")
    return lines


def _named(ours: Any) -> str:
    return f"{ours._type} (md5 {ours._md5sum})"

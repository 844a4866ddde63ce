"""The generations of aPad software that can be flown: one entry each. ROS is imported only when a part is loaded.

Another generation costs `vehicle/NAME`, `ros/links/NAME`, `ros/simulated_node/NAME` and an entry here.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

from apad_bridge.scenario.schema import Generation


@dataclass(frozen=True, slots=True)
class Stack:
    generation: Generation
    known_by: str
    """Names, for a person, the interface by which it is recognised."""
    link: str
    """MODULE:FUNCTION that opens the link, as `apad_bridge.ros.links.legacy_link.OpenLink`."""
    server: str
    """MODULE:CLASS of the simulated node's server, a `LegacyServer`."""
    publishes_contacts: bool
    """The vehicle itself publishes, on `position_static`, which aMussels its docks hold."""
    actions: tuple[str, ...] = ()
    """Names below the aPad's namespace of actions that it offers: a node subscribes to their `goal` ..."""
    services: tuple[str, ...] = ()
    """... and of services. The generation is recognised where the graph has all of both."""


STACKS = (
    Stack(
        Generation.A,
        "an action_server",
        link="apad_bridge.ros.links.generation_a:open_link",
        server="apad_bridge.ros.simulated_node.generation_a:GenerationAServer",
        publishes_contacts=True,
        actions=("action_server",),
    ),
    Stack(
        Generation.B,
        "commander/primitive services",
        link="apad_bridge.ros.links.generation_b:open_link",
        server="apad_bridge.ros.simulated_node.generation_b:GenerationBServer",
        publishes_contacts=False,
        services=("commander/primitive/go2point",),
    ),
)
_BY_GENERATION = {stack.generation: stack for stack in STACKS}


def stack_of(generation: Generation) -> Stack:
    """The entry of a generation. AUTO gives A, the simulated aPad's default."""
    return _BY_GENERATION[Generation.A if generation is Generation.AUTO else generation]


def load(dotted: str) -> Any:
    """Imports the object called MODULE:NAME."""
    module, _, name = dotted.partition(":")
    return getattr(importlib.import_module(module), name)

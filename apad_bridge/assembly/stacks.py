"""The stacks of aPad software that can be flown: one line each. ROS is imported only when a part is loaded.

Another stack costs `vehicle/NAME`, `ros/links/NAME`, `ros/simulated_node/NAME` and a line here. Its
name, the docks that it can name and its faults stand in `scenario/schema.py`.
"""

from __future__ import annotations

import importlib
from typing import Any

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.generation_a.stack import STACK as GENERATION_A
from apad_bridge.vehicle.generation_b.stack import STACK as GENERATION_B
from apad_bridge.vehicle.stack import Stack

STACKS = (GENERATION_A, GENERATION_B)
_BY_GENERATION = {stack.generation: stack for stack in STACKS}


def stack_of(generation: Generation) -> Stack:
    """The stack of a generation. AUTO gives A, the simulated aPad's default."""
    return _BY_GENERATION[Generation.A if generation is Generation.AUTO else generation]


def load(dotted: str) -> Any:
    """Imports the object called MODULE:NAME."""
    module, _, name = dotted.partition(":")
    return getattr(importlib.import_module(module), name)

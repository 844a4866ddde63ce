"""The stacks of aPad software, each in `vehicle/generation_NAME/stack.py` for a NAME of `Generation`.

That name and that folder make another stack, which the doctor recognises. Its `link` and its `server` make it fly; its
faults, and the docks that its messages can name, stand in `scenario/schema.py`. A part is imported when it is loaded.
"""

from __future__ import annotations

import importlib
from typing import Any

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


def load(dotted: str) -> Any:
    """Imports the object called MODULE:NAME. VehicleNotReady for "", a part that a stack does not have."""
    if not dotted:
        raise VehicleNotReady(
            "this aPad software is recognised, and cannot be flown: its stack has no such part"
        )
    module, _, name = dotted.partition(":")
    return getattr(importlib.import_module(module), name)


STACKS: tuple[Stack, ...] = tuple(
    load(f"apad_bridge.vehicle.generation_{it.value}.stack:STACK")
    for it in Generation
    if it is not Generation.AUTO
)
_BY_GENERATION = {stack.generation: stack for stack in STACKS}


def stack_of(generation: Generation) -> Stack:
    """The stack of a generation. AUTO gives A, the simulated aPad's default."""
    return _BY_GENERATION[Generation.A if generation is Generation.AUTO else generation]

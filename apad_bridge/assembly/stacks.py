"""The stacks of aPad software: for each NAME of `Generation`, the folders called `generation_NAME`.

`vehicle/` has the folder that makes a stack, which the doctor recognises. The one in `ros/` makes it fly, by its `link` and
its simulated node's `server`, and the one in `world/` has the vehicle that this node simulates. A stack's faults, and the
docks that its messages can name, stand in `scenario/schema.py`. A part is imported when it is loaded.
"""

from __future__ import annotations

import importlib
from typing import Any

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


def part_of(generation: Generation, module: str, name: str) -> Any:
    """Imports an object of a generation's folder, as `ros.link`. VehicleNotReady if the stack has no such part."""
    room, _, leaf = module.partition(".")
    dotted = f"apad_bridge.{room}.generation_{generation.value}.{leaf}"
    try:
        return getattr(importlib.import_module(dotted), name)
    except ModuleNotFoundError as missing:
        if missing.name is None or not dotted.startswith(missing.name):
            raise
    raise VehicleNotReady("this aPad software is recognised, and cannot be flown: its stack has no such part")


STACKS: tuple[Stack, ...] = tuple(
    part_of(it, "vehicle.stack", "STACK") for it in Generation if it is not Generation.AUTO
)
_BY_GENERATION = {stack.generation: stack for stack in STACKS}
ADRIFT_MS = max(it.adrift_in_docking_ms for it in STACKS)
"""The longest span in which a stack lets its vehicle drift before it docks or undocks."""


def stack_of(generation: Generation) -> Stack:
    """The stack of a generation. AUTO gives A, the simulated aPad's default."""
    return _BY_GENERATION[Generation.A if generation is Generation.AUTO else generation]

"""The stacks of aPad software: for each NAME of `Generation`, the folders called `generation_NAME`, or a package's module.

`vehicle/` has the folder that makes a stack, which the doctor recognises. The one in `ros/` makes it fly, by its `link` and
its simulated node's `server`, and the one in `world/` has the vehicle that this node simulates. A stack's faults, and the
docks that its messages can name, stand in `scenario/schema.py`. A part is imported when it is loaded.

An installed package names one module under the entry points `musselbed.stacks`. The module has `STACK` and `open_link`
(docs/extending.md).
"""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any, cast

from apad_bridge.planning.registry import A_USERS_ERROR
from apad_bridge.scenario.choices import OWN_GENERATIONS, STACKS_GROUP, Generation
from apad_bridge.scenario.errors import UserError
from apad_bridge.vehicle.link_errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack
from firmware_model.entry_points import entry_points, in_one_line


class StackNotLoaded(VehicleNotReady, UserError):
    """A package's stack cannot be loaded. The one line names the package; a command that only looks ends with it, too."""


def part_of(generation: Generation, module: str, name: str) -> Any:
    """Imports an object of a generation's folder, as `ros.link`, or of its package's module.

    VehicleNotReady, in one line, if the stack has no such part; StackNotLoaded if its package cannot be loaded.
    """
    if generation not in OWN_GENERATIONS:
        return _of_package(generation, name)
    room, _, leaf = module.partition(".")
    dotted = f"apad_bridge.{room}.generation_{generation.value}.{leaf}"
    try:
        return getattr(importlib.import_module(dotted), name)
    except ModuleNotFoundError as missing:
        if missing.name is None or not dotted.startswith(missing.name):
            raise
    raise VehicleNotReady("this aPad software is recognised, and cannot be flown: its stack has no such part")


def _of_package(generation: Generation, name: str) -> Any:
    entries = [it for it in entry_points(STACKS_GROUP) if it.name == generation.value]
    packages = " and ".join(sorted({it.brought_by for it in entries}))
    if len(entries) > 1:
        raise StackNotLoaded(f"stack {generation.value!r} is in {packages}: uninstall one of them")
    try:
        return getattr(entries[0].load(), name)
    except A_USERS_ERROR as error:
        raise StackNotLoaded(
            f"stack {generation.value!r} (from {packages}) has no {name} that can be loaded: {in_one_line(error)}"
        ) from error


@cache
def stack_of(generation: Generation) -> Stack:
    """The stack of a generation. AUTO gives A, the simulated aPad's default. StackNotLoaded for a broken package's."""
    known = Generation.A if generation is Generation.AUTO else generation
    return cast(Stack, part_of(known, "vehicle.stack", "STACK"))


@cache
def stacks() -> tuple[Stack, ...]:
    """All stacks, but for those of packages that cannot be loaded (`unloadable`)."""
    return tuple(stack_of(it) for it in Generation if it is not Generation.AUTO and it not in unloadable())


@cache
def unloadable() -> dict[Generation, str]:
    """The stacks of packages that cannot be loaded, with a line for a person."""
    lines = {}
    for generation in (it for it in Generation if it not in OWN_GENERATIONS):
        try:
            stack_of(generation)
        except StackNotLoaded as error:
            lines[generation] = str(error)
    return lines


def adrift_ms() -> int:
    """The longest span in which a stack lets its vehicle drift before it docks or undocks."""
    return max(it.adrift_in_docking_ms for it in stacks())

"""The registry of aPad software generations: complete, and its parts can be loaded."""

from __future__ import annotations

import pytest

from apad_bridge.assembly.stacks import STACKS, load, stack_of
from apad_bridge.ros_names.names import of_apad
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


def test_every_generation_has_one_entry() -> None:
    assert sorted(stack.generation for stack in STACKS) == sorted(set(Generation) - {Generation.AUTO})
    assert all(stack_of(stack.generation) is stack for stack in STACKS)


def test_a_scenario_that_names_no_generation_simulates_generation_a() -> None:
    assert stack_of(Generation.AUTO).generation is Generation.A


@pytest.mark.parametrize("stack", STACKS, ids=lambda it: it.generation)
def test_every_entry_names_parts_that_exist(stack: Stack) -> None:
    from apad_bridge.ros.simulated_node.legacy_server import LegacyServer

    assert callable(load(stack.link))
    assert issubclass(load(stack.server), LegacyServer)


def test_a_part_that_a_stack_does_not_have_is_told() -> None:
    with pytest.raises(VehicleNotReady, match="cannot be flown"):
        load(Stack(Generation.B, "nothing", stack_of(Generation.B).capabilities).link)


@pytest.mark.parametrize("stack", STACKS, ids=lambda it: it.generation)
def test_every_generation_is_recognised_by_names_in_the_table(stack: Stack) -> None:
    assert stack.recognised_actions or stack.recognised_services
    for leaf in (*stack.recognised_actions, *stack.recognised_services):
        assert of_apad("apad1", leaf) == f"apad1/{leaf}"

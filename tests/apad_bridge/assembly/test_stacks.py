"""The registry of aPad software generations: complete, and its parts can be loaded."""

from __future__ import annotations

import pytest

from apad_bridge.assembly.stacks import STACKS, part_of, stack_of
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
def test_every_stack_has_the_parts_that_fly_it(stack: Stack) -> None:
    from apad_bridge.ros.simulated_node.legacy_server import LegacyServer

    assert callable(part_of(stack.generation, "ros.link", "open_link"))
    assert issubclass(part_of(stack.generation, "ros.server", "Server"), LegacyServer)


def test_a_part_that_a_stack_does_not_have_is_told() -> None:
    with pytest.raises(VehicleNotReady, match="cannot be flown"):
        part_of(Generation.AUTO, "ros.link", "open_link")


@pytest.mark.parametrize("stack", STACKS, ids=lambda it: it.generation)
def test_every_generation_is_recognised_by_names_in_the_table(stack: Stack) -> None:
    assert stack.recognised_actions or stack.recognised_services
    for leaf in (*stack.recognised_actions, *stack.recognised_services):
        assert of_apad("apad1", leaf) == f"apad1/{leaf}"

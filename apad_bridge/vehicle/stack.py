"""A stack: the aPad software of one generation, as one value that everybody reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.capabilities import Capabilities


@dataclass(frozen=True, slots=True)
class Stack:
    """One generation of the aPad's software: its names on the graph, its abilities and its definitions.

    Names of topics, services and actions are below the aPad's namespace.
    """

    generation: Generation
    known_by: str
    """Names, for a person, the interface by which it is recognised."""
    capabilities: Callable[[int], Capabilities]
    """Its capabilities with this number of docks."""
    recognised_actions: Mapping[str, str] = field(default_factory=dict)
    """Actions with their types: the stack is recognised where a node subscribes to the goals of all ..."""
    recognised_services: tuple[str, ...] = ()
    """... and where all these services are offered."""
    topic_types: Mapping[str, str] = field(default_factory=dict)
    """The types of the topics that its link subscribes to. The md5s of those that we have definitions of are checked."""
    service_types: Mapping[str, str] = field(default_factory=dict)
    off_services: tuple[str, ...] = ()
    """The services that together cut its thrust, whatever its position."""
    unused_types: Mapping[str, str] = field(default_factory=dict)
    """The types of topics and services that we do not use: where one differs, only the simulated aPad differs."""
    hears_pilot: bool = False
    """The topic `manual` tells of a pilot."""
    drifts_between_orders: bool = True
    """Its controllers go off at the end of an order, also where it is not known."""
    adrift_in_docking_ms: int = 0
    """Before it docks or undocks it stands still for so long, while the vehicle drifts."""
    pulls_back_m: float = 0.0
    """It backs off so far in a docking."""

    def __post_init__(self) -> None:
        if not self.recognised_actions and not self.recognised_services:
            raise ValueError("a stack has recognised_actions or recognised_services")

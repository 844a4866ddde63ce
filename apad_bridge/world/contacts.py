"""The contacts of the aPad's docks with the aMussels' bodies, in the simulated world."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from agents.mussel.outputs import Truth
from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, DockMoved
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.telemetry import FAR_M
from apad_bridge.vehicle.vehicle_link import Carried, LetGo
from firmware_model.actions import Buoyancy

FloatingPlaces = Callable[[int], Mapping[int, tuple[float, float]]]
"""Places of floating simulated aMussels at a mission time: (north, east) in metres by id; empty when unknown."""


class Contacts:
    """Turns the docks' contacts into stimuli of the bodies: closing, being carried, opening; and knows who is within reach.

    Contacts belong to the simulated world, not to the mission. The last place of each docked aMussel is kept, so that
    only changes become stimuli.
    """

    def __init__(self, held: Iterable[int] = ()) -> None:
        self._places: dict[int, tuple[int, int] | None] = dict.fromkeys(held)
        """The last place by agent; None for an aMussel that was docked before the first stimulus here."""
        self._bodies: dict[int, Truth] = {}
        """The newest truth of each aMussel."""

    def see(self, truths: Iterable[Truth]) -> None:
        """Takes new truths, in the order of time."""
        self._bodies.update((truth.agent_id, truth) for truth in truths)

    def distance_m(self, agent_id: int, north_m: float, east_m: float) -> float | None:
        """The distance from a place to an aMussel that floats; infinite for one that does not, None for an unknown one."""
        if (truth := self._bodies.get(agent_id)) is None:
            return None
        body = truth.physical
        # An arrival at the surface is a truth of its own, so a body that still rises has a depth.
        if body.docked or body.buoyancy is not Buoyancy.FLOAT or body.depth_um > 0:
            return math.inf
        return math.hypot(body.north_um / 1e6 - north_m, body.east_um / 1e6 - east_m)

    def take(self, fact: Carried | LetGo) -> AgentStimulus | None:
        """The stimulus for the aMussel's body; None when nothing changed for it."""
        if isinstance(fact, LetGo):
            if fact.agent_id not in self._places:
                return None
            del self._places[fact.agent_id]
            return ContactOpened()
        place = (round(fact.north_m * 1e6), round(fact.east_m * 1e6))
        if fact.agent_id not in self._places:
            self._places[fact.agent_id] = place
            return ContactClosed(*place)
        before, self._places[fact.agent_id] = self._places[fact.agent_id], place
        return DockMoved(*place) if place != before else None


def why_out_of_reach(
    sight: FloatingPlaces, agent_id: int, pose: PoseReported | None, now_ms: int
) -> str | None:
    """The reason to refuse a docking from afar; None when the aMussel is near or its place is unknown.

    No stack checks it: a perch of generation A succeeds from a hundred metres away, and nothing in generation B looks for a
    simulated aMussel.
    """
    if pose is None or (there_m := sight(now_ms).get(agent_id)) is None:
        return None
    distance_m = math.dist((pose.north_m, pose.east_m), there_m)
    if distance_m <= FAR_M:
        return None
    return f"aMussel {agent_id} floats {distance_m:.1f} m away: go nearer than {FAR_M:g} m before docking it"

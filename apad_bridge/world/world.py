"""The world of a flight in one value: its aMussels in their water, who of them is simulated, contacts and faults."""

from __future__ import annotations

from dataclasses import dataclass, field

from apad_bridge.world.contacts import Contacts
from apad_bridge.world.fault_injection import FaultInjection, NoFaults
from apad_bridge.world.roster import NoRoster, Roster
from apad_bridge.world.simulated_fleet import FlightFleet, NoFleet


@dataclass(frozen=True, slots=True)
class World:
    """The truth of a flight. The defaults are parts that do nothing."""

    fleet: FlightFleet | NoFleet
    faults: FaultInjection | NoFaults = field(default_factory=NoFaults)
    """Carries out the faults of the scenario, and those that the roster's callers ask for."""
    contacts: Contacts = field(default_factory=Contacts)
    """Those of the docks with the simulated bodies; it knows which aMussels docks hold already."""
    roster: Roster | NoRoster = field(default_factory=NoRoster)
    """Changes which aMussels of the fleet are simulated."""

    def distance_m(self, agent_id: int, north_m: float, east_m: float) -> float | None:
        """The true distance from a place to an aMussel that is simulated now; infinite for one that does not float.

        None for any other.
        """
        if not self.roster.is_simulated(agent_id):
            return None
        return self.contacts.distance_m(agent_id, north_m, east_m)

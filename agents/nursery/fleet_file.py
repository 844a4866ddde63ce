"""The file of a run's fleet, so that a new nursery needs nothing but the run directory."""

from __future__ import annotations

import os
from dataclasses import dataclass

import msgpack

from agents.fleet import FleetConfig
from agents.mussel.physical import Physical

FLEET_NAME = "fleet.msgpack"
PHYSICAL_NAME = "physical.slots"
MAX_AGENT_ID = 65535


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """The nursery's rules for restarts and endings."""

    orphan_s: float = 600.0
    """The fleet and the nursery end after so many real seconds without a supervisor."""
    restarts: int = 5
    """An agent that dies once more after so many restarts in a row stays dead. One that settled begins a new row."""
    settled_s: float = 10.0
    """The agent seconds after its boot for which an agent must live to have settled."""
    ending_s: float = 2.0
    """The real seconds that agents have to end after SIGTERM, before the nursery kills them."""


@dataclass(frozen=True, slots=True)
class FleetFile:
    fleet: FleetConfig
    initial_states: dict[int, Physical]
    restart_policy: RestartPolicy

    def write(self, run_dir: str) -> None:
        """Writes the file into an existing directory. FileExistsError if there is a fleet already."""
        restart_policy = self.restart_policy
        data: bytes = msgpack.packb(
            [
                self.fleet.to_wire(),
                {agent_id: physical.pack() for agent_id, physical in self.initial_states.items()},
                [
                    restart_policy.orphan_s,
                    restart_policy.restarts,
                    restart_policy.settled_s,
                    restart_policy.ending_s,
                ],
            ]
        )
        with open(os.path.join(run_dir, FLEET_NAME), "xb") as file:
            file.write(data)

    @classmethod
    def read(cls, run_dir: str) -> FleetFile:
        """The inverse of `write`; OSError if there is no file."""
        with open(os.path.join(run_dir, FLEET_NAME), "rb") as file:
            fleet, initial_states, restart_policy = msgpack.unpackb(file.read(), strict_map_key=False)
        return cls(
            FleetConfig.from_wire(fleet),
            {agent_id: Physical.unpack(data) for agent_id, data in initial_states.items()},
            RestartPolicy(*restart_policy),
        )

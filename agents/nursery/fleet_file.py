"""The file of a run's fleet, so that a new nursery needs nothing but the run directory."""

from __future__ import annotations

import os
from dataclasses import dataclass

from agents.fleet_config import FleetConfig
from agents.link_codec import FORM_BYTES, LinkCodec
from agents.mussel.physical import Physical

FLEET_NAME = "fleet.msgpack"
PHYSICAL_NAME = "physical.slots"


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
        with open(os.path.join(run_dir, FLEET_NAME), "xb") as file:
            codec = _codec()
            file.write(codec.form + codec.encode(self))

    @classmethod
    def read(cls, run_dir: str) -> FleetFile:
        """The inverse of `write`. OSError if there is no file, ValueError for one of another version."""
        path = os.path.join(run_dir, FLEET_NAME)
        codec = _codec()
        with open(path, "rb") as file:
            if file.read(FORM_BYTES) != codec.form:
                raise ValueError(f"{path} was written by another version, or is damaged")
            found: FleetFile = codec.decode(file.read())
        return found


def _codec() -> LinkCodec:
    # Made when it is needed, so that no agent carries it.
    return LinkCodec([FleetFile])

"""How a run is flown, as said on the command line and kept in the run's directory, so that a resumed run goes on alike."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from apad_bridge.scenario.loader import write_atomically

OPTIONS_NAME = "run.json"


class APadKind(StrEnum):
    """`sim`: the simulated aPad. `ros`: one on the master at ROS_MASTER_URI."""

    SIM = "sim"
    ROS = "ros"


class TimeSource(StrEnum):
    """`asap`: virtual time, in this process. `wall`: the wall clock. `ros`: the /clock of somebody else's master."""

    ASAP = "asap"
    WALL = "wall"
    ROS = "ros"


class OnDeath(StrEnum):
    """What the parent does when the supervisor dies: start another, or wait for `musselbed resume`."""

    RESUME = "resume"
    WAIT = "wait"


class Part(StrEnum):
    """Which part of the bench this process is."""

    WHOLE = "whole"
    FLEET = "fleet"
    MISSION = "mission"


@dataclass(frozen=True, slots=True)
class RunOptions:
    """`master_uri` is empty for a run that needs no ROS; `epoch` counts the supervisors of the run."""

    part: Part
    apad: APadKind
    time: TimeSource
    speed: float
    on_death: OnDeath
    dry_run: bool = False
    manual: bool = False
    """No mission of ours: the aPad does what is called."""
    script: str = ""
    """The file that flies it instead of the paper's mission, absolute; empty without one."""
    master_uri: str = ""
    owns_master: bool = False
    xmlrpc_port: int = 0
    epoch: int = 1
    open_modems: tuple[int, ...] = ()
    """aMussels whose modems are opened as serial devices."""
    modem: str = ""
    """The serial port of a physical modem."""
    remappings: tuple[str, ...] = ()
    """ROS's, FROM:=TO, for all that the supervisor's node names."""
    is_one_of_several: bool = False
    """One of several aPads that take over from each other."""
    keeps: bool = False
    """Of these: its supervisor died, and this one keeps the fleet and orders nothing."""
    namespace: str = ""
    """Of all its nodes on ROS, without slashes at its ends; empty for none."""

    @property
    def without_mission(self) -> bool:
        """Whether a script or a person gives the orders from the start."""
        return self.manual or bool(self.script)

    @property
    def is_resumed(self) -> bool:
        """Whether a former supervisor of the run died."""
        return self.epoch > 1

    def save(self, directory: Path) -> None:
        write_atomically(directory / OPTIONS_NAME, json.dumps(asdict(self), indent=2) + "\n")

    @classmethod
    def load(cls, directory: Path) -> RunOptions:
        """FileNotFoundError where no run was started; ValueError for a file of another version."""
        data: dict[str, Any] = json.loads((directory / OPTIONS_NAME).read_text())
        try:
            return cls(
                **{
                    **data,
                    "part": Part(data["part"]),
                    "apad": APadKind(data["apad"]),
                    "time": TimeSource(data["time"]),
                    "on_death": OnDeath(data["on_death"]),
                    "open_modems": tuple(data["open_modems"]),
                    "remappings": tuple(data["remappings"]),
                }
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"{directory / OPTIONS_NAME} was written by another version: {error}") from error

    def on_own_master(self, uri: str) -> RunOptions:
        return replace(self, master_uri=uri, owns_master=True)

    def on_master(self, uri: str) -> RunOptions:
        """The same on a master that somebody else runs."""
        return replace(self, master_uri=uri)

    def at_port(self, xmlrpc_port: int) -> RunOptions:
        """Every supervisor of the run puts its node at this port.

        A master takes a node that comes back at another port, while its old one is another node's by now, for a reason to
        shut that healthy node down (ros_comm issue 2241).
        """
        return replace(self, xmlrpc_port=xmlrpc_port)

    def next_epoch(self) -> RunOptions:
        return replace(self, epoch=self.epoch + 1)

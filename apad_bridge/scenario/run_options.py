"""The options of a run: given on the command line and saved in the run's directory, so that a resumed run goes on alike."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.text.text_file import write_atomically

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
    """The parent's action when the supervisor dies: start another, or wait for `musselbed resume`."""

    RESUME = "resume"
    WAIT = "wait"


class BenchPart(StrEnum):
    """The part of the bench that this process runs."""

    WHOLE = "whole"
    FLEET = "fleet"
    MISSION = "mission"


@dataclass(frozen=True, slots=True)
class RunOptions:
    """`master_uri` is empty for a run that needs no ROS; `epoch` counts the supervisors of the run."""

    part: BenchPart
    apad: APadKind
    time: TimeSource
    speed: float
    on_death: OnDeath
    dry_run: bool = False
    manual: bool = False
    """No mission of ours: the aPad executes calls."""
    script: str = ""
    """Absolute path of the script that flies the run instead of the paper's mission; empty for none."""
    master_uri: str = ""
    owns_master: bool = False
    xmlrpc_port: int = 0
    epoch: int = 1
    open_modems: tuple[int, ...] = ()
    """aMussels whose modems are opened as serial devices."""
    modem: str = ""
    """The serial port of a physical modem."""
    remappings: tuple[str, ...] = ()
    """ROS remappings, FROM:=TO, for all names of the supervisor's node."""
    is_one_of_several: bool = False
    """The aPad is one of several that take over from each other."""
    despite: tuple[str, ...] = ()
    """The checks of a preflight that a person overrides."""
    accept: tuple[str, ...] = ()
    """CHECK or CHECK:PERSON: the checks of a preflight that cannot tell, and who accepts that."""
    apads: tuple[str, ...] = ()
    """The names of all aPads that the run flies."""
    sea: str = ""
    """The directory in which a process serves the sea that all aPads of the run share; empty for none."""
    keeps: bool = False
    """The former supervisor of one of several aPads died; this supervisor keeps the fleet and orders nothing."""
    namespace: str = ""
    """The ROS namespace of all the run's nodes, without slashes at its ends; empty for none."""

    @property
    def without_mission(self) -> bool:
        """True if a script or a person gives the orders from the start."""
        return self.manual or bool(self.script)

    @property
    def is_beside_real_vehicle(self) -> bool:
        """True for an aPad that we did not start, whoever commands it.

        A simulated aPad of ours or of a launch file flies by a /clock, which a real one does not.
        """
        return self.apad is APadKind.ROS and self.time is TimeSource.WALL

    @property
    def has_real_vehicle(self) -> bool:
        """True for such an aPad that this part of the bench commands."""
        return self.is_beside_real_vehicle and self.part is not BenchPart.FLEET

    @property
    def is_resumed(self) -> bool:
        """True if a former supervisor of the run died."""
        return self.epoch > 1

    def save(self, directory: Path) -> None:
        write_atomically(directory / OPTIONS_NAME, json.dumps(asdict(self), indent=2) + "\n")

    @classmethod
    def load(cls, directory: Path) -> RunOptions:
        """FileNotFoundError if no run was started; ScenarioError for a file that is damaged or of another version."""
        path = directory / OPTIONS_NAME
        try:
            data: dict[str, Any] = json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            raise ScenarioError([f"{path} is damaged: {error}"]) from error
        try:
            return cls(
                **{
                    **data,
                    "part": BenchPart(data["part"]),
                    "apad": APadKind(data["apad"]),
                    "time": TimeSource(data["time"]),
                    "on_death": OnDeath(data["on_death"]),
                    "open_modems": tuple(data["open_modems"]),
                    "remappings": tuple(data["remappings"]),
                    "despite": tuple(data["despite"]),
                    "accept": tuple(data["accept"]),
                    "apads": tuple(data["apads"]),
                }
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ScenarioError([f"{path} was written by another version, or is damaged: {error}"]) from error

    def on_own_master(self, uri: str) -> RunOptions:
        return replace(self, master_uri=uri, owns_master=True)

    def on_master(self, uri: str) -> RunOptions:
        """Returns the same options on a master that somebody else runs."""
        return replace(self, master_uri=uri)

    def at_port(self, xmlrpc_port: int) -> RunOptions:
        """Returns the same options with the port that the node of each supervisor of the run uses.

        A node may come back at another port after another node has taken its old port. A master then shuts that other,
        healthy node down (ros_comm issue 2241).
        """
        return replace(self, xmlrpc_port=xmlrpc_port)

    def next_epoch(self) -> RunOptions:
        return replace(self, epoch=self.epoch + 1)

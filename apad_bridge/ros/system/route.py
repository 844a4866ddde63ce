"""Finds the master, and the address of ours by which its nodes reach us: ROS 1 needs both directions by name."""

from __future__ import annotations

import errno
import os
import random
import socket
from collections.abc import Callable, Mapping
from pathlib import Path

from apad_bridge.doctor.network import Unreachable, address_towards, connect
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.scenario.run_options import OPTIONS_NAME, RunOptions, TimeSource
from apad_bridge.vehicle.link_errors import PeerFailed

_DEFAULT_URI = "http://localhost:11311"
_WAIT_S = 0.1
_NOBODYS_PORTS = range(20_000, 32_000)
"""Below those that Linux gives to connections: one of those that is free now may be taken before a node binds it."""


def somebodys_master(environment: Mapping[str, str] = os.environ) -> str:
    """The URI in ROS_MASTER_URI, or ROS's default; PeerFailed when nothing listens there."""
    uri = environment.get("ROS_MASTER_URI") or _DEFAULT_URI
    if (why := why_silent(uri)) is not None:
        raise PeerFailed(
            f"no ROS master answers at {uri}: {why}; start it, or set ROS_MASTER_URI to its address"
        )
    return uri


def why_silent(master_uri: str) -> str | None:
    """The reason why nothing listens at the URI; None when something does."""
    try:
        connect(master_uri).close()
    except Unreachable as error:
        return str(error)
    return None


def why_gone(master_uri: str) -> str | None:
    """One line for a master at which nothing listens any more; None when something does."""
    why = why_silent(master_uri)
    return None if why is None else f"the ROS master at {master_uri} is gone: {why}"


def environment_for(
    master_uri: str, namespace: str = "", environment: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """The variables of a node on this master: ROS_MASTER_URI, its namespace, and ROS_IP as our address on the way to it.

    A ROS_IP or ROS_HOSTNAME of the user stays as it is. PeerFailed without a way to it.
    """
    needed = {"ROS_MASTER_URI": master_uri, "ROS_NAMESPACE": f"/{namespace}"}
    if environment.get("ROS_IP") or environment.get("ROS_HOSTNAME"):
        return needed
    try:
        return {**needed, "ROS_IP": address_towards(master_uri)}
    except Unreachable as error:
        raise PeerFailed(f"ROS_MASTER_URI={master_uri}: {error}") from error


def free_port() -> int:
    """A free TCP port, for a program that needs its number before it binds it. PeerFailed when a hundred are in use."""
    for port in random.sample(_NOBODYS_PORTS, 100):
        try:
            with socket.create_server(("", port)):
                return port
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
    raise PeerFailed(f"a hundred ports from {_NOBODYS_PORTS[0]} to {_NOBODYS_PORTS[-1]} are all in use")


def enter_graph_of(run_dir: Path, asked_to_end: Callable[[float], bool]) -> bool:
    """Waits until the run has a master, and sets this process's environment for it; False when asked to end before.

    `asked_to_end` waits for so many wall seconds, and returns True when a person ends the program.
    RunDirectoryError for a directory without a run, or with one that flies without ROS.
    ScenarioError as `RunOptions.load`.
    """
    RunDirectory.created(run_dir)
    while True:
        # A run of several aPads has its options in a directory for each.
        for path in (run_dir, *(it.parent for it in sorted(run_dir.glob(f"*/{OPTIONS_NAME}")))):
            if not (path / OPTIONS_NAME).is_file():
                continue
            options = RunOptions.load(path)
            if options.time is TimeSource.ASAP:
                raise RunDirectoryError(
                    f"{run_dir} flies in virtual time, without ROS: fly it with --speed, or see it by `musselbed replay`"
                )
            if options.master_uri:
                home = run_dir / "ros"
                os.environ |= (
                    loopback_environment(home, options.master_uri)
                    if options.owns_master
                    else environment_for(options.master_uri)
                )
                return True
        if asked_to_end(_WAIT_S):
            return False

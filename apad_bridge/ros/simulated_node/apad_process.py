"""Starts and stops the simulated aPad's node, a child in a session of its own: neither dies with the other."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import time
import xmlrpc.client
from collections.abc import Mapping
from http.client import HTTPException
from pathlib import Path
from types import MappingProxyType

from agents.hosting import started
from agents.hosting.interrupts import held_back, let_in
from apad_bridge.doctor.network import Timed
from apad_bridge.ros.system.master import end_process, loopback_environment
from apad_bridge.ros_names.names import USE_SIM_TIME


class APadNodeFailed(Exception):
    """The node did not come up. The text is one line with the last line of its log."""


def start_apad_node(
    scenario: Path,
    master_uri: str,
    log: Path,
    *,
    namespace: str = "",
    xmlrpc_port: int = 0,
    held: Mapping[int, int] = MappingProxyType({}),
    ready_s: float = 60.0,
) -> subprocess.Popen[bytes]:
    """Returns the child when it reports that it is on the graph of OUR master at `master_uri`. Its errors go to `log`.
    `held` are the aMussels that its docks hold already, by dock index.

    Sets /use_sim_time there, because the node and the gateway follow our /clock. Raises APadNodeFailed after `ready_s` wall
    seconds, or when the node ended before; nothing is left running then.
    """
    try:
        with xmlrpc.client.ServerProxy(master_uri, transport=Timed(ready_s)) as master:
            master.setParam("/musselbed", USE_SIM_TIME, True)
    except (OSError, HTTPException, xmlrpc.client.Error) as error:
        raise APadNodeFailed(f"no ROS master answers at {master_uri} ({error})") from None
    command = [
        *(
            *started.PYTHON,
            "-m",
            started.__name__,
            "apad_bridge.ros.simulated_node.apad_node",
            "--scenario",
            str(scenario),
        ),
        *("--xmlrpc-port", str(xmlrpc_port)),
        *("--held", ",".join(f"{dock}:{agent_id}" for dock, agent_id in held.items())),
    ]
    environment = loopback_environment(log.parent / "ros", master_uri) | started.environment()
    with held_back():
        with log.open("ab") as errors:
            child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=environment | {"ROS_NAMESPACE": f"/{namespace}"},
                start_new_session=True,
            )
        is_ready, status = False, None
        try:
            with let_in():
                is_ready = _is_ready(child, ready_s)
            status = child.poll()
        finally:
            if not is_ready:
                end_process(child, patience_s=1.0)
    if is_ready:
        return child
    lines = log.read_text(errors="replace").strip().splitlines()
    how = f"ended with status {status}" if status is not None else f"was not ready within {ready_s:g} s"
    raise APadNodeFailed(f"the simulated aPad's node {how}: {lines[-1] if lines else 'it said nothing'}")


def _is_ready(child: subprocess.Popen[bytes], ready_s: float) -> bool:
    assert child.stdout is not None
    until_s = time.monotonic() + ready_s
    printed = b""
    while b"ready\n" not in printed:
        readable, _, _ = select.select([child.stdout], [], [], max(0.0, until_s - time.monotonic()))
        if not readable:
            return False
        if not (piece := os.read(child.stdout.fileno(), 4096)):
            # The end of its output comes a moment before its status.
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(1.0)
            return False
        printed += piece
    return True

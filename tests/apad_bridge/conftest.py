from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scenario_files import POOL_FILE

from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from firmware_model.states import State

MEANS_ONLY = {
    "musselbed_msgs/msg/AgentBelief": "uint16 id\nuint8 state\nfloat32 charge\nfloat32 secondary\n"
    "float64 north\nfloat64 east\nfloat32 age_s",
    "musselbed_msgs/msg/AgentTruth": "uint16 id\nuint8 state\nfloat32 primary\nfloat32 secondary\n"
    "float64 north\nfloat64 east\nfloat32 depth\nbool docked\nuint64 agent_time_ms",
    "musselbed_msgs/msg/FleetBeliefs": "std_msgs/Header header\nuint64 mission_time_ms\n"
    "uint64 agent_time_ms\nmusselbed_msgs/AgentBelief[] agents",
    "musselbed_msgs/msg/FleetTruth": "std_msgs/Header header\nuint64 mission_time_ms\n"
    "uint64 agent_time_ms\nmusselbed_msgs/AgentTruth[] agents",
}
"""The message definitions in a bag of 0.1.0, from before deviations were recorded."""
THETA = 30


@pytest.fixture(scope="session")
def pool() -> Scenario:
    """12 aMussels in the paper's pool, with the simulated aPad among them."""
    return load(POOL_FILE)


@pytest.fixture(scope="session")
def files_of_at_most() -> Callable[[int], AbstractContextManager[None]]:
    """Files of this process grow no further within it, as on a full disk (EFBIG in the place of ENOSPC)."""
    return _files_of_at_most


@contextmanager
def _files_of_at_most(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def bag_of_means() -> Callable[..., Path]:
    """Writes an uncompressed bag as a version without deviations did, with a sample a second.

    It has one aMussel, ACTIVE at 1.5 m north with a charge of 0.5, believed at 1 m with 0.75.
    """
    return _written


def _written(path: Path, seconds: int, closed: bool = True) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in MEANS_ONLY.items():
        store.register(get_types_from_msg(text, name))
    types: Any = store.types
    writer = Writer(path)
    writer.open()
    truths, beliefs = (
        writer.add_connection(f"/musselbed/{topic}", f"musselbed_msgs/msg/{name}", typestore=store)
        for topic, name in (("truth", "FleetTruth"), ("beliefs", "FleetBeliefs"))
    )
    for second in range(seconds):
        at_ms = 1000 * second
        header = types["std_msgs/msg/Header"](
            0, types["builtin_interfaces/msg/Time"](second, 0), "musselbed/ned"
        )
        truth = types["musselbed_msgs/msg/AgentTruth"](
            7, int(State.ACTIVE), 0.5, 1.0, 1.5, -2.5, 3.0, False, 0
        )
        belief = types["musselbed_msgs/msg/AgentBelief"](7, int(State.ACTIVE), 0.75, 1.0, 1.0, -2.5, 4.5)
        for connection, name, row in (
            (truths, "FleetTruth", truth),
            (beliefs, "FleetBeliefs", belief),
        ):
            name = f"musselbed_msgs/msg/{name}"
            message = types[name](header, at_ms, THETA * at_ms, [row])
            writer.write(connection, max(1, at_ms * 1_000_000), store.serialize_ros1(message, name))
    if closed:
        writer.close()
    else:
        writer.write_chunk(writer.chunks[-1])
        writer.bio.close()
    return path

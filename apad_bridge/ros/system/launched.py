"""Starts a module as a node of roslaunch: its private parameters become options of the command.

    python -m apad_bridge.ros.system.launched NAME MODULE [arguments]

NAME's parameter `theta: 60` becomes --theta 60, `open_modem: [3, 7]` the option twice, and `manual: true` the bare option.
They come after the arguments, so that they win. The command itself refuses a name that is no option.
"""

from __future__ import annotations

import os
import runpy
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import rosgraph

from apad_bridge.doctor.network import Unreachable, call


def options(parameters: Mapping[str, Any]) -> Iterator[str]:
    """Sorted by name, so that the same parameters make the same command line."""
    for name, value in sorted(parameters.items()):
        option = f"--{name.replace('_', '-')}"
        for item in value if isinstance(value, list) else [value]:
            if item is True:
                yield option
            elif item is not False:
                yield from (option, str(item))


def private_parameters(name: str) -> dict[str, Any]:
    """The parameters of the node of this name, in roslaunch's namespace; empty if it has none, or no master answers."""
    node = rosgraph.names.ns_join(os.environ.get("ROS_NAMESPACE", "/"), name)
    try:
        found = call(rosgraph.get_master_uri(), "getParam", rosgraph.names.ns_join("/", node))
    except Unreachable:
        return {}
    return found if isinstance(found, dict) else {}


def main() -> None:
    name, module, *arguments = sys.argv[1:]
    sys.argv = [module, *arguments, *options(private_parameters(name))]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()

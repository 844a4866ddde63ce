"""Finds a free port for a program that needs its number before it binds it."""

from __future__ import annotations

import random
import socket
from contextlib import suppress

_BELOW_THE_KERNELS_OWN = range(20_000, 32_000)
"""Below the ports that the kernel gives to connections: a free port above may be taken before it is used."""


def free_port() -> int:
    for port in random.sample(_BELOW_THE_KERNELS_OWN, 100):
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise AssertionError("a hundred ports are all in use")

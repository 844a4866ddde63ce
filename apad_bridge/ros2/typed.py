"""Makes and serializes messages of ROS 2's standard types, without ROS 2: by the definitions that rosbags brings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

_STORE = get_typestore(Stores.ROS2_JAZZY)
"""From Humble to Lyrical the types that this room publishes have the same hash."""


def make(kind: str, **fields: Any) -> Any:
    """A message of a type, as `sensor_msgs/BatteryState`; fields that are not given are 0, empty or false."""
    return replace(_zero(_full(kind)), **fields)


def serialized(kind: str, message: Any) -> bytes:
    """The message's CDR, little-endian, with its header of four bytes."""
    return bytes(_STORE.serialize_cdr(message, _full(kind)))


@cache
def hash_of(kind: str) -> str:
    """The type's hash in hexadecimal (REP 2016, version 1)."""
    return _STORE.hash_rihs01(_full(kind)).removeprefix("RIHS01_")


def _full(kind: str) -> str:
    return kind.replace("/", "/msg/")


@cache
def _zero(name: str) -> Any:
    fields = _STORE.fielddefs[name][1]
    return _STORE.types[name](**{field: _zero_of(*of) for field, of in fields})


def _zero_of(node: Any, inner: Any) -> Any:
    if node is Nodetype.NAME:
        return _zero(inner)
    if node is Nodetype.BASE:
        return {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}.get(inner[0], 0)
    (of, name), length = inner
    if of is Nodetype.NAME or name[0] == "string":
        return []
    return np.zeros(length if node is Nodetype.ARRAY else 0, np.dtype(name[0]))

"""Publishes on ROS 2 what comes on its standard input: the program of the other environment, .venv-ros2.

It imports nothing of ours, because ROS 1 and ROS 2 have packages of the same names. Messages come as CDR: of a type that
the wheels lack, as those of `tf2_msgs`, it needs the name and the hash alone. The input is records of a topic's number, a
length and so many bytes.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import import_module
from typing import Any, BinaryIO

import rclpy
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

RECORD = struct.Struct("<II")
"""The number of the topic and the number of bytes."""
NEW_TOPIC = 0xFFFFFFFF
"""The number of a record that announces a topic, as JSON: number, topic, kind, hexadecimal, kept."""
_DEPTH = 1
"""A publisher keeps so many messages: a reader that stands still gets the newest, and holds nobody up."""

_Pointer = ctypes.c_void_p
_FAST_DDS = b"rosidl_typesupport_fastrtps_c"


class _TypeSupport(ctypes.Structure):
    """rosidl_message_type_support_t of rosidl_runtime_c."""

    _fields_ = (
        ("identifier", ctypes.c_char_p),
        ("data", _Pointer),
        ("handle", _Pointer),
        ("hash", _Pointer),
        ("description", _Pointer),
        ("sources", _Pointer),
    )


class _Callbacks(ctypes.Structure):
    """message_type_support_callbacks_t of rosidl_typesupport_fastrtps_cpp: the type's names, and how it is serialized."""

    _fields_ = (("namespace", ctypes.c_char_p), ("name", ctypes.c_char_p), ("functions", _Pointer * 5))


class _Hash(ctypes.Structure):
    """rosidl_type_hash_t."""

    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


_HandleOf = ctypes.CFUNCTYPE(_Pointer, ctypes.POINTER(_TypeSupport), ctypes.c_char_p)
_HashOf = ctypes.CFUNCTYPE(_Pointer, _Pointer)


class _NamedType:
    """A type of any name for messages that come serialized.

    It has the support of another type of no fixed size, with its own name and hash. The functions of that one are never
    called: they serialize, and here nothing is left to serialize.
    """

    def __init__(self, kind: str, hexadecimal: str) -> None:
        package, _, name = kind.partition("/")
        model = _fast_dds_support_of(ParameterEvent)
        functions = ctypes.cast(model.data, ctypes.POINTER(_Callbacks)).contents.functions
        self._callbacks = _Callbacks(f"{package}::msg".encode(), name.encode(), functions)
        self._hash = _Hash(1, (ctypes.c_uint8 * 32)(*bytes.fromhex(hexadecimal)))
        self._hash_of = _HashOf(lambda _: ctypes.addressof(self._hash))
        self._handle_of = _HandleOf(self._handle)
        self._support = _TypeSupport(
            _FAST_DDS,
            ctypes.cast(ctypes.pointer(self._callbacks), _Pointer),
            ctypes.cast(self._handle_of, _Pointer),
            ctypes.cast(self._hash_of, _Pointer),
            model.description,
            model.sources,
        )

    def _handle(self, _: Any, identifier: bytes) -> int | None:
        return ctypes.addressof(self._support) if identifier == _FAST_DDS else None

    def message_class(self) -> type:
        """The class by which rclpy knows a type; it is never instantiated."""
        new = ctypes.pythonapi.PyCapsule_New
        new.restype, new.argtypes = ctypes.py_object, (_Pointer, ctypes.c_char_p, _Pointer)
        names = ("_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY", "_DESTROY_ROS_MESSAGE")
        capsule = new(ctypes.addressof(self._support), None, None)
        of_type = type("OfType", (type,), {**dict.fromkeys(names, True), "_TYPE_SUPPORT": capsule})
        made: type = of_type("Serialized", (), {})
        return made


def _fast_dds_support_of(known: Any) -> _TypeSupport:
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = _Pointer, (ctypes.py_object, ctypes.c_char_p)
    known.__class__.__import_type_support__()
    pointer = ctypes.cast(get(known.__class__._TYPE_SUPPORT, None), ctypes.POINTER(_TypeSupport))
    found = _HandleOf(pointer.contents.handle)(pointer, _FAST_DDS)
    return ctypes.cast(found, ctypes.POINTER(_TypeSupport)).contents


class _Topics:
    """The publishers by the numbers of their topics."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self._named: dict[str, _NamedType] = {}
        self._publishers: dict[int, Any] = {}

    def take(self, number: int, data: bytes) -> None:
        if number == NEW_TOPIC:
            self._announce(**json.loads(data))
        else:
            self._publishers[number].publish(data)

    def _announce(self, number: int, topic: str, kind: str, hexadecimal: str, kept: int) -> None:
        durability = QoSDurabilityPolicy.TRANSIENT_LOCAL if kept else QoSDurabilityPolicy.VOLATILE
        profile = QoSProfile(
            depth=kept or _DEPTH, reliability=QoSReliabilityPolicy.RELIABLE, durability=durability
        )
        known = self._class_of(kind, hexadecimal)
        with _quiet() if kind in self._named else nullcontext():
            self._publishers[number] = self._node.create_publisher(known, topic, profile)

    def _class_of(self, kind: str, hexadecimal: str) -> Any:
        package, _, name = kind.partition("/")
        try:
            return getattr(import_module(f"{package}.msg"), name)
        except ModuleNotFoundError:
            if kind not in self._named:
                self._named[kind] = _NamedType(kind, hexadecimal)
            return self._named[kind].message_class()


@contextmanager
def _quiet() -> Iterator[None]:
    """Fast DDS looks for the fields of a named type, which are not there, and complains on standard error."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def _run(source: BinaryIO, name: str) -> None:
    """Until the input's end."""
    # The node would describe a type of ours by the fields of the one that it borrows from.
    silent = [Parameter("start_type_description_service", value=False)]
    node = rclpy.create_node(
        name, parameter_overrides=silent, start_parameter_services=False, enable_rosout=False
    )
    topics = _Topics(node)
    print("ready", flush=True)
    while len(head := source.read(RECORD.size)) == RECORD.size:
        number, length = RECORD.unpack(head)
        if len(data := source.read(length)) < length:
            break
        topics.take(number, data)


if __name__ == "__main__":
    # The process that started this one takes the signals, and closes the input.
    for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.SIG_IGN)
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    _run(sys.stdin.buffer, sys.argv[1])

"""The program of the other environment, without rclpy: its input's records, and the publishers that it makes of them."""

from __future__ import annotations

import ctypes
import importlib.util
import io
import json
import os
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from apad_bridge.ros2 import ros2_process


class Node:
    """Keeps its publishers, with what they published."""

    def __init__(self, name: str, **options: Any) -> None:
        self.name, self.options = name, options
        self.made: list[Any] = []

    def create_publisher(self, kind: Any, topic: str, profile: Any) -> Any:
        published: list[bytes] = []
        made = SimpleNamespace(
            kind=kind, topic=topic, profile=profile, published=published, publish=published.append
        )
        self.made.append(made)
        return made


@pytest.fixture
def nodes() -> list[Node]:
    return []


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, nodes: list[Node]) -> Iterator[Any]:
    """The module, for which stand-ins of rclpy's names are there."""

    def create_node(name: str, **options: Any) -> Node:
        nodes.append(Node(name, **options))
        return nodes[-1]

    policies = SimpleNamespace(TRANSIENT_LOCAL="kept", VOLATILE="volatile", RELIABLE="reliable")
    stands_in = {
        "rclpy": {"create_node": create_node},
        "rclpy.parameter": {"Parameter": lambda name, value: (name, value)},
        "rclpy.qos": {
            "QoSDurabilityPolicy": policies,
            "QoSReliabilityPolicy": policies,
            "QoSProfile": lambda **values: values,
        },
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"ParameterEvent": object},
        "std_msgs": {},
        "std_msgs.msg": {"String": str},
    }
    for name, values in stands_in.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    path = Path(ros2_process.__file__).with_name("publisher.py")
    spec = importlib.util.spec_from_file_location("publisher_of_ros2", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module


def record(number: int, data: bytes) -> bytes:
    return struct.pack("<II", number, len(data)) + data


def announced(number: int, topic: str, kept: int, kind: str = "std_msgs/String") -> bytes:
    told = {"number": number, "topic": topic, "kind": kind, "hexadecimal": "00" * 32, "kept": kept}
    return record(0xFFFFFFFF, json.dumps(told).encode())


def test_both_ends_of_its_input_have_one_form(program: Any) -> None:
    assert program.RECORD.format == ros2_process.RECORD.format
    assert program.NEW_TOPIC == ros2_process.NEW_TOPIC


def test_each_record_goes_to_its_topic_until_the_input_ends(
    program: Any, nodes: list[Node], capsys: pytest.CaptureFixture[str]
) -> None:
    torn = record(0, b"torn")
    for tail in (b"", torn[:3], torn[:-1]):
        given = [
            announced(0, "/a", 100),
            record(0, b"1"),
            announced(1, "/b", 0),
            record(1, b"2"),
            record(0, b""),
        ]
        program._run(io.BytesIO(b"".join(given) + tail), "musselbed_apad1")
        assert capsys.readouterr().out == "ready\n"
        first, second = nodes[-1].made
        assert (first.topic, first.kind, first.published) == ("/a", str, [b"1", b""])
        assert (second.topic, second.published) == ("/b", [b"2"])
        assert first.profile == {"depth": 100, "reliability": "reliable", "durability": "kept"}
        assert second.profile == {"depth": 1, "reliability": "reliable", "durability": "volatile"}


def test_its_node_offers_no_service_and_no_log(program: Any, nodes: list[Node]) -> None:
    program._run(io.BytesIO(), "musselbed_apad1")
    assert nodes[0].name == "musselbed_apad1"
    assert nodes[0].options == {
        "parameter_overrides": [("start_type_description_service", False)],
        "start_parameter_services": False,
        "enable_rosout": False,
    }


def test_a_type_that_the_wheels_lack_is_made_once_by_its_name(
    program: Any, nodes: list[Node], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[str, str]] = []

    def named(kind: str, hexadecimal: str) -> Any:
        made.append((kind, hexadecimal))
        return SimpleNamespace(message_class=lambda: bytes)

    monkeypatch.setattr(program, "_NamedType", named)
    kind = "lacking_msgs/Frames"
    program._run(io.BytesIO(announced(0, "/tf", 0, kind) + announced(1, "/tf_static", 1, kind)), "node")
    assert [it.kind for it in nodes[0].made] == [bytes, bytes]
    assert made == [(kind, "00" * 32)]


FAST_DDS = b"rosidl_typesupport_fastrtps_c"
FIND = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
SIX, SEVEN = ctypes.c_void_p * 6, ctypes.c_void_p * 7


def test_a_named_type_has_its_name_and_hash_and_all_else_of_another_one(
    program: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read as rosidl's C structs: six pointers, of which the second leads to two names and five functions."""
    texts = [ctypes.create_string_buffer(it) for it in (FAST_DDS, b"rcl_interfaces::msg", b"ParameterEvent")]
    identifier, package, name = map(ctypes.addressof, texts)
    callbacks = SEVEN(package, name, *range(101, 106))
    support = SIX(identifier, ctypes.addressof(callbacks), None, None, 111, 112)
    find = FIND(lambda _, wanted: ctypes.addressof(support) if wanted == FAST_DDS else None)
    support[2] = ctypes.cast(find, ctypes.c_void_p)  # type: ignore[call-overload]
    new, pointer_of = ctypes.pythonapi.PyCapsule_New, ctypes.pythonapi.PyCapsule_GetPointer
    new.restype, new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    methods = {
        "__import_type_support__": lambda: None,
        "_TYPE_SUPPORT": new(ctypes.addressof(support), None, None),
    }
    monkeypatch.setattr(program, "ParameterEvent", type("Known", (type,), methods)("ParameterEvent", (), {}))

    hexadecimal = bytes(range(32)).hex()
    named = program._NamedType("tf2_msgs/TFMessage", hexadecimal)
    known = type(named.message_class())
    assert all(getattr(known, it) for it in ("_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY"))
    assert known._DESTROY_ROS_MESSAGE
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    at = pointer_of(known._TYPE_SUPPORT, None)
    own = SIX.from_address(at)
    assert ctypes.string_at(own[0]) == FAST_DDS and own[4:] == [111, 112]
    parts = SEVEN.from_address(own[1])
    assert (ctypes.string_at(parts[0]), ctypes.string_at(parts[1])) == (b"tf2_msgs::msg", b"TFMessage")
    assert parts[2:] == list(range(101, 106))
    assert FIND(own[2])(at, FAST_DDS) == at
    assert FIND(own[2])(at, b"rosidl_typesupport_introspection_c") is None
    hash_at = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(own[3])(at)
    assert ctypes.string_at(hash_at, 33) == b"\x01" + bytes(range(32))


def test_complaints_are_kept_back_for_a_while(program: Any, capfd: pytest.CaptureFixture[str]) -> None:
    with program._quiet():
        os.write(2, b"about fields\n")
    os.write(2, b"about all else\n")
    assert capfd.readouterr().err == "about all else\n"

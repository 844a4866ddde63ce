"""Writes a run's bags as MCAP: with ROS 1's messages as they are, or in ROS 2's form. Times are mission time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.convert.converter import generate_message_converter
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from apad_bridge.analysis.export.tables import closed_bags
from apad_bridge.records.bag_samples import add_definition, messages_in, open_bag, refused
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.sample_file import read_samples
from apad_bridge.scenario.text.text_file import replacing

SAMPLES_TOPIC = "/musselbed/samples"


def write_mcap(directory: RunDirectory, path: Path) -> dict[str, int]:
    """The bags' messages as they are, with their definitions, and the uploaded samples; returns the messages by topic.

    The profile is `ros1`: Foxglove shows it as it shows the bag, with the same layout.
    """
    with _open(path, "ros1") as file, closed_bags(directory) as bags:
        for bag in bags:
            with open_bag(bag) as reader:
                for connection, at_ns, data in messages_in(bag, reader, reader.connections):
                    name = connection.msgtype.replace("/msg/", "/")
                    file.add(connection.topic, (name, "ros1msg", connection.msgdef.data, "ros1"), at_ns, data)
        if directory.samples.is_file():
            samples = [it.columns for it in read_samples(directory.samples)]
            schema = ("musselbed.Sample", "jsonschema", json.dumps(_schema_of(samples)), "json")
            for sample in samples:
                file.add(SAMPLES_TOPIC, schema, sample["mission_ms"] * 1_000_000, json.dumps(sample).encode())
        file.attach(directory.scenario, directory.summary)
        return file.counts


def write_ros2_mcap(directory: RunDirectory, path: Path) -> dict[str, int]:
    """The bags' messages in ROS 2's form (CDR), with ROS 2's definitions; returns the messages by topic.

    The profile is `ros2`: ROS 2's bag player, Rerun and Lichtblick read it. The uploaded samples are an attachment, because
    a player of ROS 2 takes nothing else for messages. A field that ROS 2 added to a standard message has its default.
    """
    with _open(path, "ros2") as file, closed_bags(directory) as bags:
        for bag in bags:
            converters: dict[int, tuple[_Schema, Callable[[bytes], memoryview]]] = {}
            with open_bag(bag) as reader:
                for connection, at_ns, data in messages_in(bag, reader, reader.connections):
                    if connection.id not in converters:
                        converters[connection.id] = _ros2_of(bag, connection)
                    schema, convert = converters[connection.id]
                    with refused(f"{bag}: a message of {connection.topic} is not of its own definition"):
                        converted = bytes(convert(data))
                    file.add(connection.topic, schema, at_ns, converted)
        file.attach(directory.scenario, directory.summary, directory.samples)
        return file.counts


_Schema = tuple[str, str, str, str]
"""A message type: its name, its definition's encoding and text, and the messages' encoding."""


def _ros2_of(bag: Path, connection: Connection) -> tuple[_Schema, Callable[[bytes], memoryview]]:
    """The type of a connection's messages in ROS 2, and their conversion. A standard type is ROS 2's own."""
    name = connection.msgtype
    ros1, ros2 = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_HUMBLE)
    for store in ros1, ros2:
        add_definition(store, bag, connection.msgdef.data, name)
    with refused(f"{bag}: its definition of {name} makes no sense in ROS 2"):
        convert = generate_message_converter(ros1, ros2, name, name, {}, src_is2=False, dst_is2=True)
        text, _ = ros2.generate_msgdef(name, ros_version=2)
    return (name, "ros2msg", text, "cdr"), convert


class _McapFile:
    """An MCAP that is being written; `counts` has the messages by topic."""

    def __init__(self, writer: Any) -> None:
        self.counts: dict[str, int] = {}
        self._writer = writer
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[tuple[str, int], int] = {}

    def add(self, topic: str, schema: _Schema, at_ns: int, data: bytes) -> None:
        name, encoding, text, messages = schema
        if (name, text) not in self._schemas:
            self._schemas[name, text] = self._writer.register_schema(name, encoding, text.encode())
        schema_id = self._schemas[name, text]
        if (topic, schema_id) not in self._channels:
            self._channels[topic, schema_id] = self._writer.register_channel(topic, messages, schema_id)
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self._writer.add_message(self._channels[topic, schema_id], at_ns, data, at_ns)

    def attach(self, *files: Path) -> None:
        kinds = {".json": "application/json", ".jsonl": "application/jsonl", ".yaml": "application/yaml"}
        for file in files:
            if file.is_file():
                self._writer.add_attachment(0, 0, file.name, kinds[file.suffix], file.read_bytes())


@contextmanager
def _open(path: Path, profile: str) -> Iterator[_McapFile]:
    from mcap.writer import CompressionType, Writer

    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile=profile, library="musselbed")
        yield _McapFile(writer)
        writer.finish()  # type: ignore[no-untyped-call]


def _schema_of(samples: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """A JSON schema with the fields of these objects, as Foxglove plots them."""
    kinds = {int: "number", float: "number", str: "string", list: "array", bool: "boolean"}
    fields = {
        name: {"type": kinds[type(value)]}
        for sample in samples
        for name, value in sample.items()
        if type(value) in kinds
    }
    return {"type": "object", "properties": fields}

"""Writes run.bag, a ROS 1 bag with the samples of a run, without ROS; and repairs a bag that was never closed.

The bag's own times are mission time. The headers' stamps are those that the same messages have on the graph: on somebody
else's master that master's time, and else mission time too. So the bag keeps both, and maps one to the other.

A bag is written in chunks, each compressed by LZ4, which ROS's tools can read, and flushed to the file: a kill loses only
the chunk that was being filled.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1.reader import Header, ReaderError, RecordType, decompressors, read_bytes, read_uint32
from rosbags.rosbag1.writer import MAXSIZE, WriteChunk, Writer, WriterError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.events.run_events import RepairedBag
from apad_bridge.records.bag_messages import APAD, BELIEFS, EVENT, SOUND, TRUTH, Messages, definition
from apad_bridge.records.bag_samples import add_definition, refused
from apad_bridge.records.packet_lines import SoundRow
from apad_bridge.records.samples import APadSample, BeliefSample, TruthSample
from apad_bridge.ros_names.names import in_full, ours

CHUNK_BYTES = 256 * 1024
CHUNK_MS = 10_000
"""A chunk ends with the first sample after so much mission time, however little it holds. A kill loses no more than that,
unless samples are rarer. At 60 s the bag of pool-12 would be 11 % smaller. Mission time and not wall time decides, so that
the same flight writes the same bag."""
_LARGE_BYTES = 1 << 24
_DAMAGED = (ReaderError, WriterError, KeyError, ValueError)
"""The errors of reading and copying a damaged record."""
_PADDING_AT = 13 + 4 + 69
"""The offset of the file header's padding length: after the magic line, a length, and fields of fixed size."""
_PADDING_BYTES = 4096 - 69
_TOPICS = {
    TRUTH: ours("truth"),
    BELIEFS: ours("beliefs"),
    APAD: ours("apad"),
    EVENT: ours("mission"),
    SOUND: ours("sound"),
}
"""The topics of every run's bag. They depend neither on the namespace on the graph nor on the aPad: a bag is of one run."""


class _Chunks(list[WriteChunk]):
    """The chunks of a bag: iterating gives all of them, and the list's one element is the chunk that is being filled.

    The library lists every chunk until the bag is closed, with the place of each message in it. This list keeps what the
    index at the end of the bag needs of a written chunk: packed, some 60 bytes.
    """

    _SPAN = Struct("<QQQI")
    """Place in the file, first and last time, and the number of the connections with messages in the chunk."""
    _COUNT = Struct("<II")
    """A connection, and its number of messages in the chunk."""

    def __init__(self) -> None:
        super().__init__([_empty_chunk()])
        self._written = bytearray()

    def __iter__(self) -> Iterator[WriteChunk]:
        for _, chunk in self._unpacked():
            yield chunk
        yield self[-1]

    def append(self, chunk: WriteChunk) -> None:
        """Packs the last chunk, which has been written; `chunk` is filled from now on."""
        done = self[-1]
        self._written += self._SPAN.pack(done.pos, done.start, done.end, len(done.connections))
        for connection_id, entries in done.connections.items():
            self._written += self._COUNT.pack(connection_id, len(entries))
        self[-1] = chunk

    def cut(self, end: int) -> None:
        """Forgets the chunks from byte `end` of the file on, and the messages in the chunk that is being filled."""
        kept = next((at for at, chunk in self._unpacked() if chunk.pos >= end), len(self._written))
        del self._written[kept:]
        self[-1] = _empty_chunk()

    def _unpacked(self) -> Iterator[tuple[int, WriteChunk]]:
        """Each written chunk and where it is packed. Of its messages' places only the number is right."""
        at = 0
        while at < len(self._written):
            pos, first_ns, last_ns, connections = self._SPAN.unpack_from(self._written, at)
            end = at + self._SPAN.size + self._COUNT.size * connections
            counts = self._COUNT.iter_unpack(self._written[at + self._SPAN.size : end])
            places: dict[int, Any] = {connection_id: range(messages) for connection_id, messages in counts}
            yield at, WriteChunk(BytesIO(), pos, first_ns, last_ns, places)
            at = end


def _empty_chunk() -> WriteChunk:
    return WriteChunk(BytesIO(), -1, MAXSIZE, 0, defaultdict(list))


class _ChunkedWriter(Writer):
    """A bag writer with little memory for a written chunk, and ROS's header size.

    When the disk takes no more, the file is cut to its last whole chunk, and `close` drops chunks until the index has room.

    The file header's padding is as long as ROS's own, 8 bytes more than the library's: `rosbag reindex` rewrites a header
    of ROS's size, and would overwrite the beginning of the first chunk.
    """

    chunks: _Chunks

    def open(self) -> None:
        super().open()
        self.chunks = _Chunks()
        assert self.bio is not None
        _pad(self.bio)
        self.bio.flush()
        self._end = self.bio.tell()

    def close(self) -> None:
        """OSError if not everything could be written; the bag is valid all the same, without its end."""
        assert self.bio is not None
        # The descriptor leads to the file even if somebody has moved it.
        with os.fdopen(os.dup(self.bio.fileno()), "wb") as same_file:
            failure = self._end_and_close()
            _pad(same_file)
        if failure is not None:
            raise failure

    def _end_and_close(self) -> OSError | None:
        """Writes the last chunk and the index, and drops chunks until they have room; returns the last failure."""
        failure: OSError | None = None
        try:
            self.end_chunk()
        except OSError as error:
            failure = error
        while self.bio is not None and not self.bio.closed:
            try:
                super().close()
            except OSError as error:
                failure = error
                if not (written := [chunk.pos for chunk in self.chunks if chunk.pos >= 0]):
                    raise
                self._cut(written[-1])
        return failure

    def write_chunk(self, chunk: WriteChunk) -> None:
        assert self.bio is not None
        try:
            super().write_chunk(chunk)
            self.bio.flush()
        except OSError:
            self._cut(self._end)
            raise
        self._end = self.bio.tell()

    def _cut(self, end: int) -> None:
        """Cuts the file to its first `end` bytes, and forgets the chunks after them and what is still in memory."""
        assert self.bio is not None
        # A buffered file keeps what it could not write, and writes it when it is closed; not if its raw file is closed.
        self.bio.raw.close()  # type: ignore[attr-defined]
        os.truncate(self.path, end)
        self.bio = self.path.open("r+b")
        self.bio.seek(end)
        self._end = end
        self.chunks.cut(end)

    def end_chunk(self) -> None:
        self.write_chunk(self.chunks[-1])


class BagWriter:
    """Writes a new bag; `path` must not exist. `close` makes the bag valid; after a kill `repair_bag` does."""

    def __init__(self, path: Path, scale: TimeScale, stamp_ms: Callable[[int], int] = int) -> None:
        """`stamp_ms` returns the stamp of a message about a mission time; by default the same."""
        self.path = path
        self._messages = Messages(scale, stamp_ms)
        self._writer = new_bag(path)
        self._connections = {}
        for name, topic in _TOPICS.items():
            text, md5 = definition(name)
            self._connections[name] = self._writer.add_connection(
                in_full("", topic), name, msgdef=text, md5sum=md5
            )
        self._chunk_ms = 0

    def sample(
        self,
        now_ms: MissionMs,
        truths: list[TruthSample],
        beliefs: list[BeliefSample],
        apad: APadSample | None,
    ) -> None:
        """Writes the samples of one instant; nothing for empty lists and None."""
        if truths:
            self._write(TRUTH, now_ms, self._messages.truth(now_ms, truths))
        if beliefs:
            self._write(BELIEFS, now_ms, self._messages.beliefs(now_ms, beliefs))
        if apad is not None:
            self._write(APAD, now_ms, self._messages.apad(now_ms, apad))
        if now_ms >= self._chunk_ms + CHUNK_MS:
            self._chunk_ms = now_ms
            self._writer.end_chunk()

    def event(self, now_ms: int, kind: str, data: str) -> None:
        self._write(EVENT, now_ms, self._messages.event(now_ms, kind, data))

    def sound(self, now_ms: int, row: SoundRow) -> None:
        """Writes a packet as one listener received it."""
        self._write(SOUND, now_ms, self._messages.sound(now_ms, row))

    def close(self) -> None:
        """Ends the bag with its index; a second call does nothing."""
        if self._writer.bio is not None and not self._writer.bio.closed:
            self._writer.close()

    def _write(self, name: str, now_ms: int, data: bytes) -> None:
        # ROS reads a stamp of 0 as "no time", so the earliest stamp is one nanosecond.
        self._writer.write(self._connections[name], max(1, now_ms * 1_000_000), data)


def repair_bag(path: Path) -> RepairedBag | None:
    """Repairs an unclosed bag in place: writes its index and keeps every whole message. None when the bag was closed.

    `last_ms` is the newest saved mission time, 0 if there is none.
    The new bag is written beside the old one and renamed over it, so that a second kill loses nothing more.
    """
    if is_closed(path):
        return None
    fresh = path.with_name(f".{path.name}.repaired")
    fresh.unlink(missing_ok=True)
    writer = new_bag(fresh)
    connections: dict[int, Connection] = {}
    messages = last_ns = whole_bytes = 0
    for record in _whole_records(path):
        whole_bytes = record.end
        with suppress(*_DAMAGED):
            if record.header.get("op") == bytes([RecordType.CONNECTION]):
                if record.header.get_uint32("conn") in connections:
                    continue  # the kill came while the index was written, which repeats the connections
                it = _connection_of(record)
                connections[record.header.get_uint32("conn")] = writer.add_connection(
                    it.topic, it.kind, msgdef=it.definition, md5sum=it.md5
                )
            elif record.header.get("op") == bytes([RecordType.MSGDATA]):
                stamp_ns = record.header.get_time("time")
                writer.write(connections[record.header.get_uint32("conn")], stamp_ns, record.data)
                messages, last_ns = messages + 1, max(last_ns, stamp_ns)
    writer.close()
    torn_bytes = path.stat().st_size - whole_bytes
    with fresh.open("rb") as file:
        os.fsync(file.fileno())  # else a power cut after the renaming may leave neither bag
    os.replace(fresh, path)
    return RepairedBag(name=path.name, messages=messages, last_ms=last_ns // 1_000_000, torn_bytes=torn_bytes)


@dataclass(frozen=True, slots=True)
class RecordedConnection:
    """A connection of a bag, as ROS names it; several publishers of a topic have one each."""

    topic: str
    kind: str
    """`package/msg/Name`."""
    definition: str
    md5: str


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    connection: RecordedConnection
    stamp_ns: int
    """When it was recorded, by the recorder's clock."""
    data: bytes


def recorded_messages(path: Path) -> Iterator[RecordedMessage]:
    """Every whole message in the order in which it was recorded, whatever the clock did; also of an unclosed bag.

    OSError for no file; nothing for a file that is no bag. A damaged record is left out.
    """
    connections: dict[int, RecordedConnection] = {}
    for record in _whole_records(path):
        message = None
        with suppress(*_DAMAGED):
            if record.header.get("op") == bytes([RecordType.CONNECTION]):
                connections[record.header.get_uint32("conn")] = _connection_of(record)
            elif record.header.get("op") == bytes([RecordType.MSGDATA]):
                connection = connections[record.header.get_uint32("conn")]
                message = RecordedMessage(connection, record.header.get_time("time"), record.data)
        if message is not None:
            yield message


def _connection_of(record: _Record) -> RecordedConnection:
    """The connection that a record states; one of `_DAMAGED` for a damaged one."""
    fields = Header.read(BytesIO(len(record.data).to_bytes(4, "little") + record.data))
    return RecordedConnection(
        record.header.get_string("topic"),
        fields.get_string("type").replace("/", "/msg/", 1),
        fields.get_string("message_definition"),
        fields.get_string("md5sum"),
    )


@dataclass(frozen=True, slots=True)
class _Record:
    header: Header
    data: bytes
    end: int
    """The offset of the next record in the file."""


def new_bag(path: Path) -> _ChunkedWriter:
    """Opens a new bag for writing, compressed in chunks; `path` must not exist."""
    writer = _ChunkedWriter(path)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    writer.compressor = _compressed
    writer.chunk_threshold = CHUNK_BYTES
    writer.open()
    return writer


def _pad(file: BinaryIO) -> None:
    file.seek(_PADDING_AT)
    file.write(_PADDING_BYTES.to_bytes(4, "little") + b" " * _PADDING_BYTES)


def _compressed(chunk: bytes) -> bytes:
    """Compresses a chunk as roslz4 needs it: independent blocks, a checksum at the end, and no size at the beginning."""
    packed: bytes = lz4.frame.compress(chunk, block_linked=False, content_checksum=True, store_size=False)
    return packed


def is_closed(path: Path) -> bool:
    """True for a bag with its index; False for one that was never closed."""
    with path.open("rb") as file:
        try:
            file.readline()
            return Header.read(file, RecordType.BAGHEADER).get_uint64("index_pos") != 0
        except _DAMAGED:
            return False


def _whole_records(path: Path) -> Iterator[_Record]:
    """Every record before the first torn one, including the records in chunks."""
    with path.open("rb") as file:
        file.readline()
        try:
            while True:
                record = _read_record(file)
                yield from _in_chunk(record) if _is_chunk(record.header) else (record,)
        except _DAMAGED:
            return


def _read_record(file: BinaryIO) -> _Record:
    header = Header.read(file)
    size = read_uint32(file)
    if _is_chunk(header) and header.get_string("compression") == "none":
        size = 0  # its records are read one by one, so that the whole messages of a torn chunk are found too
    if size > _LARGE_BYTES:  # room would be made for it before anything is read
        here = file.tell()
        if size > file.seek(0, os.SEEK_END) - here:
            raise ReaderError("a record beyond the end")
        file.seek(here)
    return _Record(header, read_bytes(file, size), file.tell())


def _is_chunk(header: Header) -> bool:
    return header.get("op") == bytes([RecordType.CHUNK])


def _in_chunk(chunk: _Record) -> Iterator[_Record]:
    """The records in a compressed chunk; none for an uncompressed chunk, whose records come next in the file."""
    compression = chunk.header.get_string("compression")
    if compression == "none":
        return
    try:
        unpacked = BytesIO(decompressors[compression](chunk.data))
    except (
        Exception
    ) as error:  # the decompressors' errors have no common base, and any of them is the file's fault
        raise ReaderError(f"a chunk that is not {compression}") from error
    while unpacked.tell() < chunk.header.get_uint32("size"):
        yield replace(_read_record(unpacked), end=chunk.end)


# Reads recorded messages by the definitions that came with them, whatever their md5.
class RecordedTypes:
    """The message types of one bag, or of one graph: `source` names it in errors."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._stores: dict[tuple[str, str], Typestore] = {}

    def read(self, message: RecordedMessage) -> Any:
        """The message with the fields of its own definition. BagUnreadable if that, or the bytes, make no sense."""
        connection = message.connection
        key = connection.kind, connection.md5
        if key not in self._stores:
            store = get_typestore(Stores.EMPTY)  # a standard name may have another text there, too
            add_definition(store, self._source, connection.definition, connection.kind)
            self._stores[key] = store
        with refused(f"{self._source}: a message of {connection.topic} is not of its own definition"):
            return self._stores[key].deserialize_ros1(message.data, connection.kind)

"""Reads beliefs and truths from a run's bags, by the message definitions in each bag.

So bags of other versions can be read: a field that their definition did not have is NaN.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from apad_bridge.records.bag_messages import BELIEFS, TRUTH
from apad_bridge.records.samples import BeliefSample, TruthSample
from apad_bridge.scenario.errors import UserError

_MESSAGE_NAMES = {
    "agent_id": "id",
    "north_m": "north",
    "east_m": "east",
    "north_deviation_m": "north_deviation",
    "east_deviation_m": "east_deviation",
    "place_covariance_m2": "place_covariance",
}
"""AgentBelief's names of the fields that have another name in a BeliefSample."""
_FIELDS = tuple((name, _MESSAGE_NAMES.get(name, name)) for name in BeliefSample._fields)


class BagUnreadable(UserError):
    """A bag cannot be read; the message is one line with its path and the reason."""


@dataclass(frozen=True, slots=True)
class Instant:
    """One sample of the fleet, at mission time `at_ms` and agent time `agent_ms`."""

    at_ms: int
    agent_ms: int
    truths: tuple[TruthSample, ...]
    beliefs: tuple[BeliefSample, ...]


def instants(paths: list[Path], period_ms: int) -> Iterator[Instant]:
    """Yields samples with truths and beliefs from a run's bags in their order, about `period_ms` of mission time apart.

    They are the first such samples at or after each whole multiple of `period_ms`; none are from before the first one.
    BagUnreadable when a bag was never closed, or is no bag.
    """
    grid = _Grid(period_ms)
    for path in paths:
        yield from _instants_in(path, grid)


def why_no_deviations(path: Path) -> str | None:
    """Why a bag gives no beliefs with deviations, in one line with its path; None if it does."""
    try:
        with open_bag(path) as reader:
            definitions = [it.msgdef.data for it in reader.connections if it.msgtype == BELIEFS]
    except BagUnreadable as error:
        return str(error)
    if not definitions:
        return f"{path}: it has no beliefs"
    return (
        None
        if any("charge_deviation" in it for it in definitions)
        else f"{path}: its beliefs have no deviations"
    )


@dataclass(slots=True)
class _Grid:
    """The time at which the next sample is due; None before the first sample."""

    period_ms: int
    due_ms: int | None = None

    def is_due(self, at_ms: int) -> bool:
        return self.due_ms is None or at_ms >= self.due_ms

    def accept(self, at_ms: int) -> bool:
        """True if a sample with truths and beliefs is due; the next multiple is then due next."""
        if self.due_ms is None:
            self.due_ms = -(-at_ms // self.period_ms) * self.period_ms
        if at_ms < self.due_ms:
            return False
        self.due_ms = (at_ms // self.period_ms + 1) * self.period_ms
        return True


def _instants_in(path: Path, grid: _Grid) -> Iterator[Instant]:
    with open_bag(path) as reader:
        wanted = [it for it in reader.connections if it.msgtype in (TRUTH, BELIEFS)]
        store = definitions_in(path, wanted)
        truths: tuple[int, tuple[TruthSample, ...]] | None = None
        with refused(f"{path}: damaged"):
            for connection, stamp_ns, data in messages_in(path, reader, wanted):
                # The earliest stamp is a nanosecond, as ROS reads 0 as no time. A message that is not due is not unpacked.
                if not grid.is_due(stamp_ns // 1_000_000):
                    continue
                message: Any = store.deserialize_ros1(data, connection.msgtype)
                at_ms = message.mission_time_ms
                if connection.msgtype == TRUTH:
                    truths = at_ms, tuple(_truth(row) for row in message.agents)
                elif truths is not None and truths[0] == at_ms and grid.accept(at_ms):
                    beliefs = tuple(_belief(row) for row in message.agents)
                    yield Instant(at_ms, message.agent_time_ms, truths[1], beliefs)


def messages_in(
    path: Path, reader: Reader, wanted: list[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yields (connection, stamp in ns, bytes) of the messages of these connections. BagUnreadable at a damaged chunk."""
    with refused(f"{path}: damaged"):
        yield from reader.messages(wanted) if wanted else ()


@contextmanager
def refused(what: str) -> Iterator[None]:
    """BagUnreadable, of `what` and the reason, for an error within: of random bytes the library may raise anything."""
    try:
        yield
    except BagUnreadable:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())
        raise BagUnreadable(f"{what}: {reason or type(error).__name__}") from error


@contextmanager
def open_bag(path: Path) -> Iterator[Reader]:
    """A reader of a bag that was closed; BagUnreadable for any other file."""
    reader = Reader(path)
    with refused(f"{path}: not a bag that can be read"):
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


def definitions_in(path: Path, connections: list[Connection]) -> Typestore:
    """The message types as the bag itself defines them. BagUnreadable for definitions that make no sense."""
    store = get_typestore(Stores.ROS1_NOETIC)
    for connection in connections:
        add_definition(store, path, connection.msgdef.data, connection.msgtype)
    return store


def add_definition(store: Typestore, source: object, text: str, kind: str) -> None:
    """Adds the types of a definition that the store lacks. BagUnreadable, with the source, where it makes no sense."""
    with refused(f"{source}: its definition of {kind} makes no sense"):
        types = get_types_from_msg(text, kind)
        store.register({name: fields for name, fields in types.items() if name not in store.types})


def _truth(row: Any) -> TruthSample:
    return TruthSample(
        agent_id=row.id,
        state=row.state,
        primary=row.primary,
        secondary=row.secondary,
        north_m=row.north,
        east_m=row.east,
        depth_m=row.depth,
        docked=row.docked,
        agent_time_ms=row.agent_time_ms,
    )


def _belief(row: Any) -> BeliefSample:
    values = {name: getattr(row, field) for name, field in _FIELDS if hasattr(row, field)}
    if hasattr(row, "silent_slots"):  # the field's name up to version 0.1
        values["silent_timeslots"] = row.silent_slots
    for name in ("mode_probabilities", "reported", "charge_parts"):
        values[name] = tuple(map(float, values.get(name, ())))
    return BeliefSample(**values)

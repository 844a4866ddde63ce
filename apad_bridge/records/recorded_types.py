"""Reads recorded messages by the definitions that came with them, whatever their md5."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from apad_bridge.records.bag import RecordedConnection, RecordedMessage
from apad_bridge.records.bag_samples import BagUnreadable


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
            self._stores[key] = self._store(connection)
        try:
            return self._stores[key].deserialize_ros1(message.data, connection.kind)
        except Exception as error:
            raise BagUnreadable(
                f"{self._source}: a message of {connection.topic} is not of its own definition"
            ) from error

    def _store(self, connection: RecordedConnection) -> Typestore:
        store = get_typestore(Stores.EMPTY)  # a standard name may have another text there, too
        try:
            types = get_types_from_msg(connection.definition, connection.kind)
            store.register({name: fields for name, fields in types.items() if name not in store.types})
        except Exception as error:
            raise BagUnreadable(
                f"{self._source}: its definition of {connection.kind} makes no sense"
            ) from error
        return store

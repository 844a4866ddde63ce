"""The bytes of values that cross a link or stand in a file: msgpack, of the classes that they are made of and no others."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, get_args, get_origin, get_type_hints

import msgpack

from firmware_model.keyed_hash import blake2b

FORM_BYTES = 8


class LinkCodec:
    """Encodes values of `roots`, and of the classes of their fields. A class is a number, the same at both ends of a link.

    A class is a dataclass, an enumeration, a Counter, or one that is made of what its only attribute holds (`holders`). One
    that has bytes of its own (`pack` and `unpack`) crosses as these.
    """

    def __init__(self, roots: Iterable[type], holders: dict[type, str] | None = None) -> None:
        self._holders = holders or {}
        kinds = {it for root in roots for it in self._reached(root, set())}
        self._kinds = sorted(kinds, key=lambda it: f"{it.__module__}.{it.__qualname__}")
        self._codes = {kind: code for code, kind in enumerate(self._kinds)}
        self._names = {kind: self._names_of(kind) for kind in self._kinds}
        classes = [(kind.__qualname__, names) for kind, names in self._names.items()]
        self.form = blake2b(repr(classes).encode(), digest_size=FORM_BYTES).digest()
        """The same where the classes and their fields are the same: a file of another version has another form."""

    def encode(self, value: Any) -> bytes:
        data: bytes = msgpack.packb(value, default=self._extended, strict_types=True)
        return data

    def decode(self, data: bytes) -> Any:
        """The inverse of `encode`; ValueError for anything else."""
        try:
            return self._unpacked(data)
        except (ValueError, TypeError, LookupError, RecursionError, struct.error) as error:
            raise ValueError(str(error)) from None

    def _extended(self, value: Any) -> Any:
        """msgpack hands over what it does not know. Tuples are its arrays: no message has a list."""
        if (kind := type(value)) is tuple:
            return list(value)
        if kind not in self._codes:
            raise TypeError(f"a {kind.__name__} crosses no link")
        content: Any
        if hasattr(value, "pack"):
            content = value.pack()
        elif isinstance(value, Enum):
            content = value.value
        elif isinstance(value, Counter):
            content = dict(value)
        else:
            content = [getattr(value, name) for name in self._names[kind]]
        return msgpack.ExtType(
            self._codes[kind], msgpack.packb(content, default=self._extended, strict_types=True)
        )

    def _unpacked(self, data: bytes) -> Any:
        return msgpack.unpackb(data, ext_hook=self._made, strict_map_key=False, use_list=False)

    def _made(self, code: int, data: bytes) -> Any:
        kind, content = self._kinds[code], self._unpacked(data)
        if hasattr(kind, "unpack"):
            return kind.unpack(content)
        if issubclass(kind, Enum | Counter):
            return kind(content)
        if len(content) != len(self._names[kind]):
            raise ValueError(f"a {kind.__name__} has other fields")
        return kind(*content)

    def _names_of(self, kind: Any) -> tuple[str, ...]:
        if kind in self._holders:
            return (self._holders[kind],)
        return tuple(it.name for it in fields(kind)) if is_dataclass(kind) else ()

    def _reached(self, kind: Any, found: set[type]) -> Iterator[type]:
        if (origin := get_origin(kind)) is not None:
            for part in (origin, *get_args(kind)):
                yield from self._reached(part, found)
            return
        if not isinstance(kind, type) or kind in found:
            return
        found.add(kind)
        if is_dataclass(kind) or kind in self._holders:
            yield kind
            if hasattr(kind, "pack"):
                return
            for hint in get_type_hints(kind).values():
                yield from self._reached(hint, found)
        elif issubclass(kind, Enum | Counter):
            yield kind

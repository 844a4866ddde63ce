"""Dataclasses for a process that is one of a thousand: those of `dataclass(frozen=True, slots=True)`, without what weighs.

A dataclass of the standard library carries nine functions of its own and a record for each field; spread over memory
between what an agent really runs, they double the pages that it copies. Inside the nursery the classes that agents use
are built by this instead. They take the same arguments, compare, hash and match alike; they have no repr of their own,
`dataclasses.fields` does not know them, and nothing stops an assignment, which the tests of the ordinary ones do.
"""

from __future__ import annotations

import dataclasses
import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import get_annotations
from operator import attrgetter
from typing import Any


@contextmanager
def lean_dataclasses() -> Iterator[None]:
    """While it lasts, modules that are imported get lean classes for `dataclass(frozen=True, slots=True)`."""
    ordinary = dataclasses.dataclass
    gc.freeze()
    dataclasses.dataclass = _lean_or(ordinary)
    try:
        yield
    finally:
        dataclasses.dataclass = ordinary


def _lean_or(ordinary: Callable[..., Any]) -> Any:
    def dataclass(cls: type | None = None, **options: bool) -> Any:
        if cls is None and options == {"frozen": True, "slots": True}:
            return _lean
        return ordinary(cls, **options)

    return dataclass


def _lean(cls: type) -> type:
    gc.collect()  # the class that the last call replaced makes room, so that none lies between
    names = tuple(name for name, kind in get_annotations(cls).items() if not kind.startswith("ClassVar"))
    body = {name: value for name, value in cls.__dict__.items() if name not in _DROPPED and name not in names}
    given = tuple(cls.__dict__[name] for name in names if name in cls.__dict__)
    made: dict[str, Any] = {}
    sets = "; ".join(f"self.{name} = {name}" for name in names) or "pass"
    exec(f"def __init__({', '.join(('self', *names))}): {sets}", _NO_GLOBALS, made)
    if given:
        made["__init__"].__defaults__ = given
    body |= made
    body["__slots__"] = body["__match_args__"] = names
    body["__eq__"], body["__hash__"] = _equal, _hash
    body["_values"] = staticmethod(attrgetter(*names)) if names else staticmethod(_no_values)
    return type(cls.__name__, cls.__bases__, body)


_NO_GLOBALS: dict[str, Any] = {}
"""Of all that is built here: each would have a dictionary of its own."""
_DROPPED = ("__dict__", "__weakref__", "__doc__", "__annotations__")


def _no_values(_: object) -> tuple[()]:
    return ()


def _equal(self: Any, other: Any) -> Any:
    return self._values(self) == self._values(other) if other.__class__ is self.__class__ else NotImplemented


def _hash(self: Any) -> int:
    return hash(self._values(self))

"""A dataclass decorator for values that every aMussel makes in every window."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform

_Value = TypeVar("_Value")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def value(cls: type[_Value]) -> type[_Value]:
    """Makes a dataclass with slots and a hash, whose fields the type checker alone keeps from being set.

    A class that is frozen at run time takes up to seven times as long to make: it sets each field by a call.
    """
    return dataclass(slots=True, unsafe_hash=True)(cls)

"""Reads and writes fields of messages of any type by their paths: `header.frame_id`, `msg[0]`."""

from __future__ import annotations

import re
from typing import Any

_STEP = re.compile(r"([A-Za-z_]\w*)|\[(\d+)\]", re.ASCII)
_PATH = re.compile(r"[A-Za-z_]\w*(?:\[\d+\]|\.[A-Za-z_]\w*)*", re.ASCII)


def path_steps(path: str) -> tuple[str | int, ...]:
    """Splits a path into its steps. Raises ValueError for an invalid path."""
    if not _PATH.fullmatch(path):
        raise ValueError(f"{path!r} is no path to a field: names with dots between, and [n] for elements")
    return tuple(name or int(number) for name, number in _STEP.findall(path))


def read(message: Any, path: str) -> Any:
    """Raises AttributeError, IndexError or TypeError if the message has no such field."""
    value = message
    for step in path_steps(path):
        value = getattr(value, step) if isinstance(step, str) else value[step]
    return value


def has(message: Any, path: str) -> bool:
    try:
        read(message, path)
    except (AttributeError, IndexError, TypeError):
        return False
    return True


def write(message: Any, path: str, value: Any) -> None:
    """Writes in the field's own kind: text, boolean, number or bytes. Raises AttributeError or TypeError if it cannot."""
    *parents, last = path_steps(path)
    if not isinstance(last, str):
        raise TypeError(f"{path!r}: cannot send elements of a list: name the list")
    for step in parents:
        message = getattr(message, step) if isinstance(step, str) else message[step]
    setattr(message, last, _as_kind(value, getattr(message, last)))


def _as_kind(value: Any, present: Any) -> Any:
    if isinstance(value, bytes) or isinstance(present, bytes | list | tuple):
        return value
    return str(value) if isinstance(present, str) else type(present)(value)

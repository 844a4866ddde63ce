"""Checks the arguments of a script's API calls before anything is done.

A wrong argument gives one line that names the argument, in place of an error from deep inside the API.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Sequence
from functools import wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, TypeVar

from apad_bridge.mission.values import Refused

C = TypeVar("C", bound=type)
_KIND_NAMES: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    str: "a text",
    bool: "True or False",
    Sequence: "[latitude, longitude] in degrees",
    Callable: "a function",
}


def checks_arguments(cls: C) -> C:
    """Decorates a class: its public methods raise Refused for arguments of a kind that their annotations do not allow."""
    for name, method in list(vars(cls).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            setattr(cls, name, _checked(method))
    return cls


def _checked(method: Callable[..., Any]) -> Callable[..., Any]:
    signature = inspect.signature(method)
    allowed: dict[str, tuple[Any, ...]] = {}

    @wraps(method)
    def checked(*args: Any, **kwargs: Any) -> Any:
        if not allowed:  # Resolved at the first call, when every module that an annotation names is imported.
            allowed.update((name, _kinds(hint)) for name, hint in typing.get_type_hints(method).items())
        try:
            bound = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise Refused(f"{method.__name__}: {error}") from None
        for name, value in bound.items():
            kinds = allowed.get(name, (object,))
            if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD or any(
                _is_of(value, kind) for kind in kinds
            ):
                continue
            kind_names = " or ".join(
                _KIND_NAMES.get(kind, f"a {kind.__name__}") for kind in kinds if kind is not NoneType
            )
            raise Refused(f"{method.__name__}: {name} must be {kind_names}, not {value!r}")
        return method(*args, **kwargs)

    return checked


def _kinds(hint: Any) -> tuple[Any, ...]:
    """The members of a union, each without its type arguments."""
    parts = typing.get_args(hint) if typing.get_origin(hint) in (UnionType, typing.Union) else (hint,)
    origins = [typing.get_origin(part) or part for part in parts]
    return tuple(Callable if it is typing.get_origin(Callable[[], None]) else it for it in origins)


def _is_of(value: Any, kind: Any) -> bool:
    if kind is float:
        return isinstance(value, Real) and not isinstance(value, bool)
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if kind is bool:
        return isinstance(value, bool) or value in (0, 1)
    if kind is Callable:
        return callable(value)
    if kind is Sequence:
        return _is_place(value)
    return not inspect.isclass(kind) or isinstance(value, kind)


def _is_place(value: Any) -> bool:
    """True for two numbers in any iterable with a length, such as an array."""
    try:
        return len(value) == 2 and all(_is_of(it, float) for it in value)
    except TypeError:
        return False

"""What a script gives the API is looked at before anything is done: one line that names the argument, in place of an error
from somewhere within.
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
_WORDS: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    str: "a text",
    bool: "True or False",
    Sequence: "[latitude, longitude] in degrees",
    Callable: "a function",
}


def looks_at_arguments(of: C) -> C:
    """A class whose public methods raise Refused for arguments of a kind that their annotations do not allow."""
    for name, method in list(vars(of).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            setattr(of, name, _looking(method))
    return of


def _looking(method: Callable[..., Any]) -> Callable[..., Any]:
    signature = inspect.signature(method)
    allowed: dict[str, tuple[Any, ...]] = {}

    @wraps(method)
    def looking(*given: Any, **named: Any) -> Any:
        if not allowed:  # At the first call: by then every module that an annotation names is there.
            allowed.update((name, _kinds(hint)) for name, hint in typing.get_type_hints(method).items())
        try:
            bound = signature.bind(*given, **named).arguments
        except TypeError as error:
            raise Refused(f"{method.__name__}: {error}") from None
        for name, value in bound.items():
            kinds = allowed.get(name, (object,))
            if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD or any(
                _is_of(value, kind) for kind in kinds
            ):
                continue
            words = " or ".join(
                _WORDS.get(kind, f"a {kind.__name__}") for kind in kinds if kind is not NoneType
            )
            raise Refused(f"{method.__name__}: {name} must be {words}, not {value!r}")
        return method(*given, **named)

    return looking


def _kinds(hint: Any) -> tuple[Any, ...]:
    """The kinds of a union, each without what is in its brackets."""
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
    """Two numbers in whatever can be gone through, as an array is."""
    try:
        return len(value) == 2 and all(_is_of(it, float) for it in value)
    except TypeError:
        return False

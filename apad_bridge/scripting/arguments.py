"""Checks the arguments of a script's API calls before anything is done, by their annotations.

A wrong argument gives one line that names the argument, in place of an error from deep inside the API.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Annotated, Any, TypeVar

import numpy as np
from annotated_types import Len
from pydantic import (
    ConfigDict,
    Strict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    validate_call,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from apad_bridge.mission.values import Location, Refused

C = TypeVar("C", bound=type)


def _point(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    try:
        return check(value)
    except ValidationError:
        raise PydanticCustomError("point", "must be [latitude, longitude] in degrees") from None


Point = Annotated[Sequence[float], Len(2, 2), WrapValidator(_point)]
"""[latitude, longitude] in degrees, or a `Location`."""
Flag = Annotated[bool, Strict(False)]
"""True or False, or 1 or 0 for them."""
_OF_APAD = ": battery(id_self), get_location(id_self), docks() and cost() tell of the aPad"
_STRICT = ConfigDict(strict=True, arbitrary_types_allowed=True)


def checks_arguments(cls: C) -> C:
    """Decorates a class: its public methods raise Refused for arguments that their annotations do not allow."""
    for name, method in list(vars(cls).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            setattr(cls, name, _checked(method))
    return cls


def _checked(method: Callable[..., Any]) -> Callable[..., Any]:
    checked: list[Callable[..., Any]] = []
    names = list(inspect.signature(method).parameters)

    # Validated apart from the call, so that an error of pydantic's from inside the method is not taken for the caller's.
    @wraps(method)
    def arguments(*args: Any, **kwargs: Any) -> Any:
        return args, kwargs

    @wraps(method)
    def call(*args: Any, **kwargs: Any) -> Any:
        if not checked:  # Made at the first call, when every module that an annotation names is imported.
            checked.append(validate_call(config=_STRICT)(arguments))
        try:
            args, kwargs = checked[0](*map(_plain, args), **{name: _plain(it) for name, it in kwargs.items()})
        except ValidationError as error:
            own = _OF_APAD if vars(args[0]).get("id_self") in (*args[1:], *kwargs.values()) else ""
            raise Refused(f"{method.__name__}: {_line(error.errors(), names)}{own}") from None
        return method(*args, **kwargs)

    return call


def _plain(value: Any) -> Any:
    """A number or point of numpy's as Python's, and a place that the API gave as the point that it is."""
    if isinstance(value, Location):
        return [value.lat, value.lon]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _line(errors: list[ErrorDetails], names: list[str]) -> str:
    """The first mistake. pydantic names a positional argument by its index, and has an error for each member of a union."""
    at = errors[0]["loc"][0]
    name = dict(enumerate(names)).get(at, f"argument {at}") if isinstance(at, int) else at
    messages = dict.fromkeys(
        it["msg"].replace("Input should be", "must be").removesuffix(", unable to interpret input")
        for it in errors
        if it["loc"][0] == at
    )
    told = " or ".join(messages).replace(" or must be", " or")
    return f"{name} {told}, not {errors[0]['input']!r}" if told.startswith("must be") else f"{name}: {told}"

"""The types of fields of the journal's lines and of the summary: for the check of a value, and as the docs name them.

A line is `{"t": mission ms, "kind": kind, ...}`. An aMussel is named by `id`, or by `agent` in what the mission did. The
fields of a line follow from the class of its event.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import Enum, StrEnum
from functools import cache
from types import GenericAlias, NoneType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    NotRequired,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

from pydantic import ConfigDict, StrictBool, StrictInt, StrictStr, ValidationError, create_model
from pydantic import Field as Constraint
from pydantic_core import SchemaValidator

from apad_bridge.events.all_events import EVENTS
from apad_bridge.events.event import Event, EventField, fields_of


class Type(NamedTuple):
    """A field's type: for the check of a value, and as the page names it."""

    annotation: Any
    text: str


class LineField(NamedTuple):
    name: str
    type: Type
    meaning: str
    unit: str = ""
    optional: bool = False
    """True for a field that a line has only where it says something."""


INTEGER = Type(StrictInt, "integer")
NUMBER = Type(Annotated[float, Constraint(strict=True, allow_inf_nan=False)], "number")
TEXT = Type(StrictStr, "text")
BOOLEAN = Type(StrictBool, "true or false")
_PLAIN = {int: INTEGER, float: NUMBER, str: TEXT, bool: BOOLEAN}


def line_fields(kind: type[Event]) -> tuple[LineField, ...]:
    """The fields of the lines of a kind, in order."""
    return tuple(_field_of(it) for it in fields_of(kind))


def _field_of(field: EventField) -> LineField:
    """An optional field of a line is absent rather than null."""
    annotation = _without_none(field.annotation) if field.is_optional else field.annotation
    return LineField(field.name, _type_of(annotation), *field.meaning, field.is_optional)


def _type_of(annotation: Any) -> Type:
    """The type of a value in a line, from that of the event's class."""
    origin, members = get_origin(annotation), get_args(annotation)
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    if is_typeddict(annotation) or is_dataclass(annotation):
        fields = _members_of(annotation)
        return Type(_model(annotation.__name__, fields), "{" + ", ".join(it.name for it in fields) + "}")
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        values = [it.value if isinstance(it, StrEnum) else it.name for it in annotation]
        return Type(Literal[*values], "text")
    if origin is tuple and members[1:] == (...,):
        return _type_of(GenericAlias(list, (members[0],)))
    if isinstance(annotation, type) and issubclass(annotation, tuple):
        return _type_of(GenericAlias(tuple, tuple(get_type_hints(annotation).values())))
    if origin is Annotated:
        plain = _type_of(members[0])
        return Type(Annotated[plain.annotation, *members[1:]], plain.text)
    types = [_type_of(it) for it in members if it is not NoneType]
    if origin is list:
        return Type(GenericAlias(list, (types[0].annotation,)), f"list of {types[0].text}")
    if origin is tuple:
        row = GenericAlias(tuple, tuple(it.annotation for it in types))
        return Type(row, f"[{', '.join(it.text for it in types)}]")
    if origin is dict:
        return Type(GenericAlias(dict, tuple(it.annotation for it in types)), f"{{name: {types[1].text}}}")
    nulls = [Type(None, "null")] if NoneType in members else []
    return Type(
        Union[*(it.annotation for it in (*types, *nulls))],
        " or ".join(it.text for it in (*types, *nulls)),
    )


def _without_none(annotation: Any) -> Any:
    return Union[*(it for it in get_args(annotation) if it is not NoneType)]


def _members_of(kind: type) -> list[LineField]:
    """The fields of an object within a line."""
    hints = get_type_hints(kind, include_extras=True).items()
    return [
        LineField(name, _type_of(get_args(hint)[0] if is_optional else hint), "", optional=is_optional)
        for name, hint in hints
        for is_optional in (get_origin(hint) is NotRequired,)
    ]


def _model(name: str, fields: Iterable[LineField]) -> Any:
    """Names of fields may be keywords of Python, so each is an alias."""
    members: dict[str, Any] = {
        f"field_{n}": (it.type.annotation, Constraint(None if it.optional else ..., alias=it.name))
        for n, it in enumerate(fields)
    }
    return create_model(name, __config__=ConfigDict(defer_build=True), **members)


@cache
def _check_of(kind: str) -> SchemaValidator | None:
    """Made when the first line of its kind comes: most runs have few kinds. None for a line without fields."""
    found = EVENTS.get(kind)
    fields: Sequence[LineField] = () if found is None else line_fields(found)
    if not fields:
        return None
    model = _model(kind, fields)
    model.model_rebuild()
    check: SchemaValidator = model.__pydantic_validator__
    return check


def fault_of(kind: str, data: Mapping[str, Any]) -> str | None:
    """The fault of a line that was read; None for a line without fault, and for one of a kind unknown here."""
    if (check := _check_of(kind)) is None:
        return None
    try:
        check.validate_python(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        is_missing = first["type"] == "missing" and len(first["loc"]) == 1
        return f"a line `{kind}` {'without' if is_missing else 'with a wrong'} `{first['loc'][0]}`"
    return None

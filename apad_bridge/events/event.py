"""The base of all events.

The journal's line, the check of a line that is read, the text for people, the lists of the page, the report and the
consoles, and the table in docs/reference/journal.md follow from an event's class.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum, StrEnum
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

from annotated_types import Ge, Lt
from pydantic import TypeAdapter

from apad_bridge.planning.dispatch_rule import MAX_DOCKS


class Meaning(NamedTuple):
    """A field's meaning and unit, for the table in the docs."""

    text: str
    unit: str = ""


AMussel = Annotated[int, Meaning("the aMussel")]
Reason = Annotated[str, Meaning("why")]
North = Annotated[float, Meaning("place, north of the scenario's origin", "m")]
East = Annotated[float, Meaning("place, east of the scenario's origin", "m")]
AgentTime = Annotated[int, Meaning("when, by the aMussel's time", "agent ms")]
DockIndex = Annotated[int, Ge(0), Lt(MAX_DOCKS)]


class Category(StrEnum):
    """The use of an event for people. The terminal, the page, the report and the consoles choose by it."""

    ALARM = "alarm"
    """Something failed, and a person is told at once."""
    TROUBLE = "trouble"
    """Something went wrong, and the run copes with it."""
    RELIEF = "relief"
    """A trouble is over."""
    PLAN = "plan"
    """The next work, and its results."""
    WORD = "word"
    """A person or a script said something."""
    NEWS = "news"

    @property
    def is_trouble(self) -> bool:
        return self in (Category.ALARM, Category.TROUBLE)


class Uncounted(NamedTuple):
    reason: str


class Event:
    """The base of all kinds. A subclass is a frozen dataclass of plain values and enums, with the journal's names.

    An underscore at a name's end, where Python or this class has the name itself, is not in the journal. A field with a
    default stands in a line only where it says something.
    """

    kind: ClassVar[str]
    when: ClassVar[str]
    """The occasion, for the docs."""

    counted: ClassVar[tuple[str, ...] | Uncounted]
    """The fields by which two runs compare (`records/digest.py`), or why it tells nothing about that."""

    is_for_journal_alone: ClassVar[bool] = False
    """True for a kind with too many lines for the bag and for `/musselbed/mission`, where nobody looks for them."""

    is_shown_at_once: ClassVar[bool] = False
    """True for a kind whose lines a person who watches the terminal, or its file, has to see, as those of each alarm."""

    @property
    def category(self) -> Category:
        """Its use for people; most classes set it as a constant."""
        return Category.NEWS

    @property
    def data(self) -> dict[str, Any]:
        """The journal's fields, in order: an IntEnum by its name, a StrEnum by its value."""
        told = {}
        for it in fields_of(type(self)):
            if (value := getattr(self, it.attribute)) is not None or not it.is_optional:
                told[it.name] = value if value is None or it.plain is None else it.plain(value)
        return told

    @property
    def amussel(self) -> int | None:
        """The id of the aMussel that it is about; None for an event of none."""
        own = vars(self)
        return own.get("agent", own.get("id"))

    def text(self) -> str | None:
        """One sentence for people; None for a step of routine."""
        return None

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """The event of a journal's line; further fields are left out. TypeError for a line without a field."""
        values = {}
        for it in fields_of(cls):
            if it.name in data:
                value = data[it.name]
                values[it.attribute] = value if value is None or it.read is None else it.read(value)
        return cls(**values)


class EventField(NamedTuple):
    """A field of a kind, as its class declares it."""

    attribute: str
    name: str
    """The name in the journal."""
    annotation: Any
    meaning: Meaning
    is_optional: bool
    plain: Callable[[Any], Any] | None
    """Gives the journal's form of a value; None where both are the same. The line's check refuses what it does not know."""
    read: Callable[[Any], Any] | None
    """Gives the value of the class from that of the journal; None where both are the same."""


_FIELDS: dict[type[Event], tuple[EventField, ...]] = {}
"""The fields of each kind that was asked for."""


def fields_of(kind: type[Event]) -> tuple[EventField, ...]:
    """The fields of a kind that have a meaning, in the order of the journal's line."""
    if kind not in _FIELDS:
        hints = get_type_hints(kind, include_extras=True)
        declared = (_field_of(it, hints[it.name]) for it in fields(kind))  # type: ignore[arg-type]  # each is a dataclass
        _FIELDS[kind] = tuple(it for it in declared if it is not None)
    return _FIELDS[kind]


def _field_of(declared: Field[Any], hint: Any) -> EventField | None:
    """None for a field without a meaning, which the class puts into the line itself."""
    annotation, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if (meaning := next((it for it in extras if isinstance(it, Meaning)), None)) is None:
        return None
    bounds = tuple(it for it in extras if it is not meaning)
    return EventField(
        declared.name,
        declared.name.removesuffix("_"),
        Annotated[annotation, *bounds] if bounds else annotation,
        meaning,
        declared.default is not MISSING,
        *_forms_of(annotation),
    )


_Form = Callable[[Any], Any]


def _forms_of(annotation: Any) -> tuple[_Form | None, _Form | None]:
    """The functions `plain` and `read` of a field. JSON has lists for tuples, and for those of a list."""
    members = (annotation, *get_args(annotation))
    if is_dataclass(annotation):
        adapter: TypeAdapter[Any] = TypeAdapter(annotation)
        return partial(adapter.dump_python, mode="json"), adapter.validate_python
    for it in members:
        if isinstance(it, type) and issubclass(it, Enum):
            return _plain, {_plain(member): member for member in it}.__getitem__
    rows = (of for it in members if get_origin(it) is list for of in get_args(it))
    if any(get_origin(of) is tuple for of in rows):
        return None, lambda values: [tuple(row) for row in values]
    return None, tuple if any(get_origin(it) is tuple for it in members) else None


def _plain(value: Any) -> Any:
    """The value of an enum in the journal."""
    if not isinstance(value, Enum):
        return value
    return value.value if isinstance(value, StrEnum) else value.name

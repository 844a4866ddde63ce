"""Maps a laboratory's own topics, types and fields to messages of the bench, from a YAML file checked as a whole.

    hear:
      - {what: docked, topic: /base/docked, id: {field: data, pattern: 'amussel(\\d+)'}, slot: {field: arm, offset: -1}}
    tell:
      - {what: clear, topic: '/amussel{id}/release', type: std_msgs/Bool, fields: {data: true}}

`{apad}` in a topic is the aPad's namespace, `{id}` an aMussel's id. The bench subscribes to such a topic for each aMussel,
or publishes on the topic of the aMussel concerned. In the values of `fields`, `{id}`, `{slot}` (the dock's index), `{on}`
and `{bytes}` stand for the published values.
"""

from __future__ import annotations

import json
import re
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, StringConstraints, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from agents.packet_medium import Medium
from apad_bridge.scenario.lab_interface.fields import path_steps, read
from apad_bridge.scenario.lab_interface.lab_messages import MessageKind
from apad_bridge.scenario.text.key_mistakes import explain
from apad_bridge.scenario.text.text_file import read_text
from apad_bridge.scenario.text.yaml_text import parse_yaml

frozen = dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
Topic = Annotated[str, StringConstraints(pattern=r"^/?[A-Za-z{][A-Za-z0-9_{}/]*$")]
TypeName = Annotated[str, StringConstraints(pattern=r"^[a-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*$")]
DEFAULT = Path(__file__).with_name("default.yaml")


@frozen
class Number:
    """Reads an integer from a field: the number itself or the match of `pattern`'s group in a text, plus `offset`."""

    field: str
    pattern: str | None = None
    offset: int = 0

    def __post_init__(self) -> None:
        path_steps(self.field)
        if self.pattern is not None and re.compile(self.pattern).groups != 1:
            raise ValueError("pattern must have one group, which finds the number")

    def of(self, message: Any) -> int | None:
        """Returns None if the field holds no integer. Raises AttributeError and the like if there is no such field."""
        value = read(message, self.field)
        if self.pattern is not None:
            found = re.search(self.pattern, str(value))
            value = found[1] if found else None
        try:
            return None if value is None else int(value) + self.offset
        except (ValueError, OverflowError):  # OverflowError of an infinite one
            return None


NumberOf = Annotated[
    Number, BeforeValidator(lambda given: {"field": given} if isinstance(given, str) else given)
]
"""A `Number`, or a field's name alone as its short form."""


@frozen
class Condition:
    """Selects the messages in which the field holds this value."""

    field: str
    holds: bool | int | str

    def __post_init__(self) -> None:
        path_steps(self.field)

    def is_met(self, message: Any) -> bool:
        return bool(read(message, self.field) == self.holds)


@frozen
class Subscription:
    what: MessageKind
    topic: Topic
    id: NumberOf | None = None
    """The aMussel's id; None if the topic names the aMussel, or if nothing does."""
    slot: NumberOf | None = None
    when: Condition | None = None
    everyone: Condition | None = None
    """Selects messages that are for all aMussels."""
    bytes: str | None = None
    """The field with a packet's bytes."""
    medium: Medium = Medium.SOUND

    def __post_init__(self) -> None:
        if self.what is MessageKind.WIFI:
            raise ValueError("the bench sends wifi and does not receive it: it knows its own aMussels' Wi-Fi")
        if (self.what is MessageKind.PACKET) != (self.bytes is not None):
            raise ValueError("a packet needs bytes, the field that holds them; nothing else has any")
        if self.bytes is not None:
            path_steps(self.bytes)
        has_addressee = self.id is not None or "{id}" in self.topic or self.everyone is not None
        if not has_addressee and self.what not in (
            MessageKind.DOCKED,
            MessageKind.RELEASED,
            MessageKind.PACKET,
        ):
            raise ValueError("needs an addressee: an id, {id} in the topic, or everyone")

    def id_of(self, message: Any) -> int | None:
        return None if self.id is None else self.id.of(message)

    def dock_index_of(self, message: Any) -> int | None:
        return None if self.slot is None else self.slot.of(message)


@frozen
class Publication:
    what: MessageKind
    topic: Topic
    type: TypeName
    fields: dict[str, bool | int | float | str] = field(default_factory=dict)
    medium: Medium = Medium.SOUND
    """The medium of the published packets."""

    def __post_init__(self) -> None:
        for path in self.fields:
            path_steps(path)


@frozen
class Names:
    hear: tuple[Subscription, ...] = ()
    tell: tuple[Publication, ...] = ()


_NAMES = TypeAdapter(Names)


def load_names(path: Path = DEFAULT) -> Names:
    """Loads a laboratory's names. Raises ValueError with every mistake, OSError if there is no such file."""
    try:
        data = parse_yaml(read_text(path))
        return _NAMES.validate_json(json.dumps(data if data is not None else {}))
    except ValidationError as error:
        lines = [explain(Names, details, details["loc"]) for details in error.errors()]
        raise ValueError("; ".join(dict.fromkeys(lines))) from error
    except (UnicodeDecodeError, TypeError, re.error) as error:
        raise ValueError(" ".join(str(error).split())) from error

"""A laboratory's own names: which topics, types and fields say what, read from a YAML file and checked as a whole.

    hear:
      - {what: docked, topic: /base/docked, id: {field: data, pattern: 'amussel(\\d+)'}, slot: {field: arm, offset: -1}}
    tell:
      - {what: clear, topic: '/amussel{id}/release', type: std_msgs/Bool, fields: {data: true}}

`{apad}` in a topic is the aPad's namespace, `{id}` an aMussel's id: the topic is then listened to for each, or told for the
one that is meant. In the values of `fields`, `{id}`, `{slot}`, `{on}` and `{bytes}` stand for what is told.
"""

from __future__ import annotations

import json
import re
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BeforeValidator, ConfigDict, StringConstraints, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from agents.packet_medium import Medium
from apad_bridge.scenario.lab_interface.fields import read, steps
from apad_bridge.scenario.lab_interface.messages import What

frozen = dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
Topic = Annotated[str, StringConstraints(pattern=r"^/?[A-Za-z{][A-Za-z0-9_{}/]*$")]
TypeName = Annotated[str, StringConstraints(pattern=r"^[a-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*$")]
DEFAULT = Path(__file__).with_name("default.yaml")


@frozen
class Number:
    """A whole number out of a field: a number plus `offset`, or what the first group of `pattern` finds in a text."""

    field: str
    pattern: str | None = None
    offset: int = 0

    def __post_init__(self) -> None:
        steps(self.field)
        if self.pattern is not None and re.compile(self.pattern).groups != 1:
            raise ValueError("pattern must have one group, which finds the number")

    def of(self, message: Any) -> int | None:
        """None for a field that does not hold one. AttributeError and the like where there is no such field."""
        value = read(message, self.field)
        if self.pattern is not None:
            found = re.search(self.pattern, str(value))
            value = found[1] if found else None
        try:
            return None if value is None else int(value) + self.offset
        except ValueError:
            return None


NumberOf = Annotated[Number, BeforeValidator(lambda said: {"field": said} if isinstance(said, str) else said)]
"""A field's name alone is short for a `Number` without more."""


@frozen
class Condition:
    """Only messages in which the field holds this are meant."""

    field: str
    holds: bool | int | str

    def __post_init__(self) -> None:
        steps(self.field)

    def is_met(self, message: Any) -> bool:
        return bool(read(message, self.field) == self.holds)


@frozen
class Subscription:
    what: What
    topic: Topic
    id: NumberOf | None = None
    """Of the aMussel; None where the topic names it, or where nothing does."""
    slot: NumberOf | None = None
    when: Condition | None = None
    everyone: Condition | None = None
    """Messages that are for all aMussels."""
    bytes: str | None = None
    """The field with a packet's bytes."""
    medium: Medium = Medium.SOUND

    def __post_init__(self) -> None:
        if self.what is What.WIFI:
            raise ValueError("wifi can be told and not heard: the bench knows its own aMussels' Wi-Fi")
        if (self.what is What.PACKET) != (self.bytes is not None):
            raise ValueError("a packet needs bytes, the field that holds them; nothing else has any")
        if self.bytes is not None:
            steps(self.bytes)
        named = self.id is not None or "{id}" in self.topic or self.everyone is not None
        if not named and self.what not in (What.DOCKED, What.RELEASED, What.PACKET):
            raise ValueError("whom it is for must be said: an id, {id} in the topic, or everyone")

    def id_of(self, message: Any) -> int | None:
        return None if self.id is None else self.id.of(message)

    def slot_of(self, message: Any) -> int | None:
        return None if self.slot is None else self.slot.of(message)


@frozen
class Publication:
    what: What
    topic: Topic
    type: TypeName
    fields: dict[str, bool | int | float | str] = field(default_factory=dict)
    medium: Medium = Medium.SOUND
    """Of the packets that are told."""

    def __post_init__(self) -> None:
        for path in self.fields:
            steps(path)


@frozen
class Names:
    hear: tuple[Subscription, ...] = ()
    tell: tuple[Publication, ...] = ()


_NAMES = TypeAdapter(Names)


def load_names(path: Path = DEFAULT) -> Names:
    """ValueError with every mistake, a line each; OSError if there is no such file."""
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        return _NAMES.validate_json(json.dumps(data if data is not None else {}))
    except ValidationError as error:
        lines = [
            f"{'.'.join(str(it) for it in details['loc'])}: {details['msg'].removeprefix('Value error, ')}"
            for details in error.errors()
        ]
        raise ValueError("; ".join(dict.fromkeys(lines))) from error
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, re.error) as error:
        raise ValueError(" ".join(str(error).split())) from error

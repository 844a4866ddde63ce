"""Decodes messages of any type by the definition that their publisher sends: nothing has to be installed for them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import genmsg
import genpy
import genpy.dynamic
import roslib.message
import rospy
from genmsg.gentools import compute_full_text
from genmsg.msg_loader import load_depends, load_msg_by_type

_NUMBERS = frozenset(
    {
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "float32",
        "float64",
        "byte",
        "char",
    }
)
_KINDS = dict.fromkeys(_NUMBERS, "a number") | {"bool": "a boolean", "string": "a text", "time": "a time"}
_READ_AS_BOOLEAN = frozenset({"a boolean", "a number"})


class UnknownType(Exception):
    """One line: the type that is known neither here nor to the user's workspace."""


class AnyMessages:
    """Makes classes from definitions and keeps them by md5."""

    def __init__(self) -> None:
        self._classes: dict[str, Any] = {}

    def decode(self, message: Any) -> Any:
        """Decodes a rospy.AnyMsg by its publisher's definition. ValueError when the definition or the bytes are wrong.

        A message of a class is returned as it is: rospy has one reader a topic, which decodes by the class of the first
        subscriber in the process.
        """
        if not isinstance(message, rospy.AnyMsg):
            return message
        made = self.class_of_sender(message)
        try:
            return made().deserialize(message._buff)
        except genpy.DeserializationError as error:
            raise ValueError(f"{made._type}: bytes that are not of its definition") from error

    def class_of_sender(self, message: Any) -> Any:
        """The class of a rospy.AnyMsg by its publisher's definition. ValueError as `class_of`."""
        header = message._connection_header
        return self.class_of(header["type"], header["md5sum"], header.get("message_definition", ""))

    def class_of(self, kind: str, md5: str, text: str) -> Any:
        """The class of a publisher's own text. ValueError when the text is not of this md5, or no definition."""
        if md5 in self._classes:
            return self._classes[md5]
        try:
            made = genpy.dynamic.generate_dynamic(kind, text)[kind]
        except (genmsg.MsgGenerationException, genmsg.InvalidMsgSpec, KeyError) as error:
            raise ValueError(f"{kind}: {error}") from error
        if made._md5sum != md5:
            raise ValueError(f"{kind}: its publisher sends md5 {md5} and a text of md5 {made._md5sum}")
        return self._classes.setdefault(md5, made)


def class_of(kind: str, search_path: dict[str, list[str]]) -> Any:
    """Our class of a type, an installed one, or one made from the text in `search_path` (folders by package).

    Raises UnknownType when there is none.
    """
    if (found := roslib.message.get_message_class(kind)) is not None:
        return found
    context = genmsg.MsgContext.create_default()
    try:
        specification = load_msg_by_type(context, kind, search_path)
        load_depends(context, specification, search_path)
        return genpy.dynamic.generate_dynamic(kind, compute_full_text(context, specification))[kind]
    except (genmsg.MsgNotFound, genmsg.InvalidMsgSpec, genmsg.MsgGenerationException, OSError) as error:
        raise UnknownType(
            f"{kind} is neither installed nor among the texts on ROS_PACKAGE_PATH: {error}"
        ) from error


def why_unfit(theirs: Any, ours: Any, paths: Iterable[str]) -> str | None:
    """Says why a reader of `paths` of `ours` cannot read messages of the class `theirs`; None when it can.

    Numbers of every width are of one kind. A boolean may be read from a number, as C has it, and from nothing else.
    """
    for path in paths:
        needed = _kind(ours, path)
        try:
            found = _kind(theirs, path)
        except AttributeError:
            return f"{theirs._type} has no {path}"
        if found != needed and not (needed == "a boolean" and found in _READ_AS_BOOLEAN):
            return f"{theirs._type} has {found} in {path}, where {ours._type} has {needed}"
    return None


def _kind(message_class: Any, path: str) -> str:
    """The kind of a field by its declared type. AttributeError for a path that the class does not have."""
    *parents, last = path.split(".")
    message = message_class()
    for step in parents:
        message = getattr(message, step)
    declared = dict(zip(getattr(message, "__slots__", ()), getattr(message, "_slot_types", ()), strict=False))
    if last not in declared:
        raise AttributeError(last)
    element, bracket, _ = declared[last].partition("[")
    kind = _KINDS.get(element, element)
    return f"a list of {kind.removeprefix('a ')}s" if bracket else kind

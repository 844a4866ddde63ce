"""Decodes messages of any type by the definition that their publisher sends: nothing has to be installed for them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import genmsg
import genpy.dynamic
import roslib.message
import rospy
from genmsg.gentools import compute_full_text
from genmsg.msg_loader import load_depends, load_msg_by_type

from firmware_model.entry_points import in_one_line

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


_TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)
_TYPE_INSIDE = re.compile(r"^MSG: (.*)$", re.MULTILINE)


class UnknownType(Exception):
    """One line: the type that is known neither here nor to the user's workspace."""


def class_by_text(kind: str, text: str) -> Any:
    """The class of a type by its definition with those of all types in it. genmsg.InvalidMsgSpec when it is none.

    genpy writes Python from it, the names unlooked at, and raises whatever comes of that: RecursionError of a type that
    holds itself, AssertionError of an empty name, SyntaxError of a constant.
    """
    for name in (kind, *(it.strip() for it in _TYPE_INSIDE.findall(text))):
        if not _TYPE.fullmatch(name):
            raise genmsg.InvalidMsgSpec(f"{name!r} is no name of a type")
    try:
        return genpy.dynamic.generate_dynamic(kind, text)[kind]
    except (genmsg.MsgGenerationException, genmsg.InvalidMsgSpec):
        raise
    except Exception as error:
        raise genmsg.InvalidMsgSpec(f"no definition: {in_one_line(error)}") from error


class AnyMessages:
    """Makes classes from definitions and keeps them by md5."""

    def __init__(self) -> None:
        self._classes: dict[str, Any] = {}
        self._refused: dict[tuple[str, str, str], str] = {}
        """Why a type's text is no definition of its md5. To find that out for each message would leave a file each time."""

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
        except Exception as error:  # as in `class_by_text`
            raise ValueError(f"{made._type}: bytes that are not of its definition") from error

    def class_of_sender(self, message: Any) -> Any:
        """The class of a rospy.AnyMsg by its publisher's definition. ValueError as `class_of`."""
        header = message._connection_header
        return self.class_of(header["type"], header["md5sum"], header.get("message_definition", ""))

    def class_of(self, kind: str, md5: str, text: str) -> Any:
        """The class of a publisher's own text. ValueError when the text is not of this md5, or no definition."""
        if md5 in self._classes:
            return self._classes[md5]
        if (why := self._refused.get((kind, md5, text))) is None:
            try:
                made = class_by_text(kind, text)
                if made._md5sum == md5:
                    return self._classes.setdefault(md5, made)
                why = f"{kind}: its publisher sends md5 {md5} and a text of md5 {made._md5sum}"
            except (genmsg.MsgGenerationException, genmsg.InvalidMsgSpec) as error:
                why = f"{kind}: {error}"
            self._refused[kind, md5, text] = why
        raise ValueError(why)


def class_of(kind: str, search_path: dict[str, list[str]]) -> Any:
    """Our class of a type, an installed one, or one made from the text in `search_path` (folders by package).

    Raises UnknownType when there is none.
    """
    if not _TYPE.fullmatch(kind):
        raise UnknownType(f"{kind!r} is no name of a type")
    if (found := roslib.message.get_message_class(kind)) is not None:
        return found
    context = genmsg.MsgContext.create_default()
    try:
        specification = load_msg_by_type(context, kind, search_path)
        load_depends(context, specification, search_path)
        return class_by_text(kind, compute_full_text(context, specification))
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

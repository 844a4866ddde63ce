"""Parses YAML text to plain data: duplicate keys are refused, and `no`, `1:30` and `012` mean what they look like.

PyYAML follows YAML 1.1, where `no` is false, `1:30` is 90, `012` is ten and `1e-3` is a text. This module reads by the
core schema of YAML 1.2 instead: true, false, null, integers and floating-point numbers in decimal, and text. A tag as
`!!int` states one of these and changes none: its value is of the same form as one without a tag.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.text.text_file import text_of

MOST_VALUES = 100_000
"""A scenario with twenty thousand listed ids has fewer."""
_TAG = "tag:yaml.org,2002:"
_NUMBER_STARTS = list("-+.0123456789")


class _CoreLoader(yaml.SafeLoader):
    """SafeLoader with the core schema's scalars only, without merge keys and duplicate keys."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own name and form)
    yaml_constructors = {  # noqa: RUF012
        tag: constructor
        for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
        if tag is None or tag.removeprefix(_TAG) in {"str", "seq", "map"}
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        if not isinstance(node, yaml.MappingNode):
            raise yaml.constructor.ConstructorError(
                None, None, "`!!map` is not before a mapping", node.start_mark
            )
        seen: set[str] = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a key must be a text", key_node.start_mark
                )
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key_node.value!r} is given twice", key_node.start_mark
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


def _resolve(name: str, pattern: str, starts: list[str], value_of: Callable[[str], Any]) -> None:
    """Reads texts of this form as `value_of`, with the tag `name` or without."""
    form = re.compile(rf"^(?:{pattern})$")

    def construct(_: _CoreLoader, node: yaml.Node) -> Any:
        text = node.value if isinstance(node, yaml.ScalarNode) else None
        try:
            if text is not None and form.match(text):
                return value_of(text)
        except ValueError:  # more digits than Python reads
            pass
        raise yaml.constructor.ConstructorError(
            None, None, f"not of the form of `!!{name}`: {_shown(node)}", node.start_mark
        )

    _CoreLoader.add_implicit_resolver(_TAG + name, form, starts)
    _CoreLoader.add_constructor(_TAG + name, construct)


def _shown(node: yaml.Node) -> str:
    return repr(node.value[:40]) if isinstance(node, yaml.ScalarNode) else "a list or a mapping"


_resolve("null", r"~|null|Null|NULL|", ["~", "n", "N", ""], lambda text: None)
_resolve("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF"), lambda text: text.lower() == "true")
_resolve("int", r"[-+]?(?:0|[1-9][0-9]*)", _NUMBER_STARTS, int)
_resolve(
    "float",
    r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
    _NUMBER_STARTS,
    lambda text: float(re.sub(r"\.(?=[iInN])", "", text)),
)


def _count(data: Any, known: dict[int, int]) -> int:
    """Counts the values of data, an alias with all that it stands for, without walking anything twice."""
    if not isinstance(data, dict | list):
        return 1
    if id(data) not in known:
        known[id(data)] = 1  # for one that holds itself, which `loader` refuses
        known[id(data)] = 1 + sum(
            _count(it, known) for it in (data.values() if isinstance(data, dict) else data)
        )
    return known[id(data)]


def parse_yaml(text: str) -> Any:
    """Returns the plain data of one YAML document. Raises a one-line ValueError, `line 3, column 5: ...`, if it is none."""
    try:
        data = yaml.load(text, Loader=_CoreLoader)
        if _count(data, {}) > MOST_VALUES:
            raise ValueError(f"holds more than {MOST_VALUES} values: aliases (*name) repeat others too often")
        return data
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = " ".join(part for part in (error.context, error.problem) if part)
        raise ValueError(f"{where}{problem}") from error
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def yaml_of(path: Path) -> Any:
    """The plain data of a user's file; ScenarioError, one line, for one that cannot be read or is no YAML."""
    text = text_of(path)
    try:
        return parse_yaml(text)
    except ValueError as error:
        raise ScenarioError([f"{path}: {error}"]) from error

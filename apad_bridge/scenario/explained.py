"""Explains an error of pydantic in the words of the file that a person wrote."""

from __future__ import annotations

import json
from typing import Any

from pydantic_core import ErrorDetails

from apad_bridge.scenario.unknown_keys import Path, explain_unknown_key


def explain(schema: type, details: ErrorDetails, path: Path) -> str:
    """Returns `path.to.key: what is wrong there` for a mapping of the dataclass `schema`; `path` is where in it."""
    where = "".join(f"[{item}]" if isinstance(item, int) else f".{item}" for item in path).lstrip(".")
    where = f"{where}: " if where else ""
    if details["type"] == "unexpected_keyword_argument":
        return f"{where}{explain_unknown_key(schema, path)}"
    if details["type"] == "missing":
        return f"{where}this key is missing"
    message = details["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    message = message.replace("must be an object", "must be a mapping").replace("String should", "must")
    if isinstance(details["input"], dict | list):
        return f"{where}{message}"
    return f"{where}{message}, not {abbreviated(details['input'])}"


def abbreviated(value: Any) -> str:
    text = repr(value) if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."

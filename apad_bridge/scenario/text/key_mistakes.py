"""Explains an error of pydantic in the words of the file that a person wrote, and suggests the key that was meant."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic_core import ErrorDetails

Path = Sequence[str | int]

# Endings that name a unit, longest first, so that `_m_s` is not read as `_s`: the schema's own and common others.
_UNITS = {
    "n_per_m2_s2": "newtons at 1 m/s",
    "db_per_hz": "dB re 1 uPa^2/Hz",
    "w_per_dock": "watts a dock",
    "db_per_km": "dB a kilometre",
    "w_per_n": "watts a newton",
    "m_s2": "m/s2",
    "rad_s": "rad/s",
    "deg_s": "degrees/s",
    "km_h": "km/h",
    "mm_s": "mm/s",
    "cm_s": "cm/s",
    "m_min": "m/min",
    "m_s": "m/s",
    "mg_l": "mg/l",
    "per_min": "a minute",
    "per_hour": "an hour",
    "per_h": "an hour",
    "per_s": "a second",
    "per_m": "a metre",
    "per_km": "a kilometre",
    "fraction": "a fraction of 1",
    "percent": "percent",
    "pct": "percent",
    "knots": "knots",
    "minutes": "minutes",
    "seconds": "seconds",
    "hours": "hours",
    "degrees": "degrees",
    "kmh": "km/h",
    "kph": "km/h",
    "khz": "kHz",
    "mhz": "MHz",
    "mps": "m/s",
    "deg": "degrees",
    "rad": "radians",
    "min": "minutes",
    "sec": "seconds",
    "dbm": "dBm",
    "ntu": "NTU",
    "ohm": "ohms",
    "ppm": "parts of a million",
    "psu": "parts of a thousand",
    "hz": "Hz",
    "db": "dB",
    "mw": "milliwatts",
    "kn": "knots",
    "wh": "Wh",
    "mah": "mAh",
    "ms": "milliseconds",
    "us": "microseconds",
    "mm": "millimetres",
    "cm": "centimetres",
    "km": "kilometres",
    "kg": "kg",
    "mv": "mV",
    "c": "degrees Celsius",
    "h": "hours",
    "s": "seconds",
    "m": "metres",
    "g": "grams",
    "n": "newtons",
    "v": "volts",
    "w": "watts",
}


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


def keys_at(schema: type, path: Path) -> list[str]:
    """Returns the keys of the dataclass at `path` of `schema`; none if there is no dataclass."""
    place: Any = schema
    for item in path:
        if isinstance(item, int):
            continue  # of a list, whose items `place` is
        if not is_dataclass(place):
            return []
        place = _dataclass_in(get_type_hints(place, include_extras=True).get(item))
    return [field.name for field in fields(place)] if is_dataclass(place) else []


def explain_unknown_key(schema: type, path: Path) -> str:
    """Explains the unknown key at the end of `path` in a sentence: another unit, a slip, the wrong block, or unknown."""
    key, known = str(path[-1]), keys_at(schema, path[:-1])
    stem, unit = _split_unit(key)
    for name in known:
        if _split_unit(name)[0] == stem:
            expected = _UNITS[_split_unit(name)[1]] if _split_unit(name)[1] else "no unit"
            given = f", not {_UNITS[unit]}" if unit else ""
            return f"unknown key: did you mean {name}? (it is in {expected}{given})"
    if elsewhere := [dotted for dotted in all_keys(schema) if dotted.rsplit(".", 1)[-1] == key]:
        return f"unknown key here: did you mean {' or '.join(elsewhere)}?"
    near = get_close_matches(key, known, n=1)
    return f"unknown key: did you mean {near[0]}?" if near else f"unknown key; known here: {', '.join(known)}"


def all_keys(schema: type, prefix: str = "") -> Iterator[str]:
    """Yields every key of the schema, dotted, depth first."""
    for name, hint in get_type_hints(schema, include_extras=True).items():
        yield prefix + name
        if (inner := _dataclass_in(hint)) is not None:
            yield from all_keys(inner, f"{prefix}{name}.")


def _dataclass_in(hint: Any) -> Any:
    """Returns the dataclass that a field of this type may hold, by itself or in a list, or None."""
    if get_origin(hint) is Annotated:
        return _dataclass_in(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType, tuple):
        return next((found for found in map(_dataclass_in, get_args(hint)) if found is not None), None)
    return hint if isinstance(hint, type) and is_dataclass(hint) else None


def unit_of(key: str) -> str:
    """The unit that the ending of a key names, in words; empty for a key without one."""
    return _UNITS.get(_split_unit(key)[1], "")


def _split_unit(key: str) -> tuple[str, str]:
    for unit in _UNITS:
        if key.endswith(f"_{unit}"):
            return key.removesuffix(f"_{unit}"), unit
    return key, ""

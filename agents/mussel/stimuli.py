"""Facts from the world for an aMussel, and their form on a link. Positions are local NED in micrometres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args, get_type_hints


@dataclass(frozen=True, slots=True)
class ContactClosed:
    """A docking mechanism closed around the aMussel and now holds it at this place."""

    north_um: int
    east_um: int


@dataclass(frozen=True, slots=True)
class DockMoved:
    """The aPad carried the docked aMussel to this place."""

    north_um: int
    east_um: int


@dataclass(frozen=True, slots=True)
class ContactOpened:
    """The docking mechanism released the aMussel."""


@dataclass(frozen=True, slots=True)
class SoundArrived:
    data: bytes


@dataclass(frozen=True, slots=True)
class WifiArrived:
    data: bytes


@dataclass(frozen=True, slots=True)
class CoilSlipped:
    """The coils slipped apart in a closed dock: the charger stops until they are aligned again."""


@dataclass(frozen=True, slots=True)
class PingArrived:
    """A ping for this modem, whose sound travelled for `travelled_us`. The modem answers it without its board."""

    travelled_us: int


@dataclass(frozen=True, slots=True)
class ModemSent:
    """The modem sent for `lasting_ms` without a request of its board, because somebody has opened the modem."""

    lasting_ms: int


@dataclass(frozen=True, slots=True)
class Placed:
    """An aMussel, new or returned, was put here, undocked, with these charges (grains), and switched on."""

    north_um: int
    east_um: int
    depth_um: int
    primary: int
    secondary: int


@dataclass(frozen=True, slots=True)
class WasReset:
    """Its MU was reset by `cause` (a ResetCause); its physical state stayed."""

    cause: int


@dataclass(frozen=True, slots=True)
class ChargeLost:
    """A defect: the batteries lost these charges at once (grains), at most what they held."""

    primary: int
    secondary: int


@dataclass(frozen=True, slots=True)
class ClockShifted:
    """A defect: the clock's reading jumped by `by_ms`."""

    by_ms: int


@dataclass(frozen=True, slots=True)
class CrystalSkewed:
    """A defect: the clock's crystal runs faster by these parts of 10^9 than as delivered; 0 heals it."""

    skew_ppb: int


@dataclass(frozen=True, slots=True)
class BuoyancyJammed:
    """A defect: the motors do not move the buoyancy. A healed one (`jammed` 0) carries out the last motor run."""

    jammed: int


@dataclass(frozen=True, slots=True)
class PinDisturbed:
    """A defect of the charger's pin: its level is the opposite one, or its edges cause no interrupt; 0, 0 heals it."""

    inverted: int
    unseen: int


@dataclass(frozen=True, slots=True)
class ContactBounced:
    """A defect of a dock's contact: it opens and closes so often, one after the other, unless its dock opens."""

    times: int


@dataclass(frozen=True, slots=True)
class PartFailed:
    """A defect of a part of the board (a `BoardPart`), with a value of its own; the value 0 heals it."""

    part: int
    value: int


Defect = (
    ChargeLost | ClockShifted | CrystalSkewed | BuoyancyJammed | PinDisturbed | ContactBounced | PartFailed
)
AgentStimulus = (
    ContactClosed
    | DockMoved
    | ContactOpened
    | SoundArrived
    | WifiArrived
    | CoilSlipped
    | PingArrived
    | Placed
    | WasReset
    | ModemSent
    | Defect
)
"""The order gives the kinds their codes on links and in journals: a new one comes last."""

_KINDS: tuple[type[Any], ...] = get_args(AgentStimulus)
"""By code."""
_CODES: dict[type[Any], int] = {kind: code for code, kind in enumerate(_KINDS)}
_FIELDS: tuple[tuple[tuple[str, type], ...], ...] = tuple(tuple(get_type_hints(it).items()) for it in _KINDS)
"""The names and types of a kind's fields, by code."""


def to_wire(stimulus: AgentStimulus) -> list[Any]:
    """[code, field, ...]: plain values that msgpack carries."""
    code = _CODES[type(stimulus)]
    return [code, *(getattr(stimulus, name) for name, _ in _FIELDS[code])]


def to_json(stimulus: AgentStimulus) -> list[int | str]:
    """Its form in a journal: `to_wire` with bytes in hexadecimal."""
    return [field.hex() if isinstance(field, bytes) else field for field in to_wire(stimulus)]


def from_json(fields: list[int | str]) -> AgentStimulus:
    """The inverse of `to_json`; ValueError for anything else."""
    return from_wire([bytes.fromhex(field) if isinstance(field, str) else field for field in fields])


def from_wire(wire: Any) -> AgentStimulus:
    """The inverse of `to_wire`; ValueError for anything else."""
    if not isinstance(wire, list) or not wire or type(wire[0]) is not int or not 0 <= wire[0] < len(_KINDS):
        raise ValueError("not a stimulus")
    fields = _FIELDS[wire[0]]
    if len(wire) != len(fields) + 1 or any(
        type(v) is not t for v, (_, t) in zip(wire[1:], fields, strict=True)
    ):
        raise ValueError(f"a {_KINDS[wire[0]].__name__} has other fields")
    stimulus: AgentStimulus = _KINDS[wire[0]](*wire[1:])
    return stimulus

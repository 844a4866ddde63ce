"""The mission's orders besides primitives, and its notes for the journal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from apad_bridge.vehicle.primitives import Primitive


@dataclass(frozen=True, slots=True)
class PermitSurfacing:
    """Tell the aMussel, by sound, that it may surface because an aPad comes for it."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class PingAgent:
    """A person wants the aMussel's range, once; the ping waits until the aPad may use its modem."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class TellClear:
    """Tell the aMussel, by Wi-Fi, that it is clear to sink."""

    agent_id: int


@dataclass(frozen=True, slots=True)
class AllowMotion:
    """A person lets the vehicle move again, whatever stopped it."""


@dataclass(frozen=True, slots=True)
class SwitchMotorsOff:
    """A person, named `by`, wants the vehicle's controllers off."""

    by: str


@dataclass(frozen=True, slots=True)
class Note:
    """An event of the mission, for the journal and the bag."""

    kind: str
    data: dict[str, Any]


Order = Primitive | PermitSurfacing | PingAgent | TellClear | AllowMotion | SwitchMotorsOff | Note

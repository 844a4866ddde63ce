"""The physical state of an aMussel, which a reset of its MU does not touch.

The nursery keeps one of these for every agent, and restarts a dead agent from it.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow
from firmware_model.value import value

if TYPE_CHECKING:
    from firmware_model.settings import StoredSettings

# Look-ups, because an enum's call takes longer than all the rest of a truth.
_FLOWS = {int(flow): flow for flow in Flow}
_BUOYANCIES = {int(buoyancy): buoyancy for buoyancy in Buoyancy}

_BATTERY = struct.Struct("<QQBQB")
_BODY, _KEPT = "qqQqB?QqIIqq?", struct.Struct("<QQIIIIIHiQQQ")
_WITH_PACKED_BATTERIES = struct.Struct(f"<{_BATTERY.size}s{_BATTERY.size}s{_BODY}")
_REMEMBERED = 4096
"""Batteries of which a receiver keeps the objects: two for each aMussel, which change far less often than its place."""


@value
class Physical:
    """Anchors in agent milliseconds and micrometres; `depth_um` is the depth at `depth_anchor_ms`, positive down."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct(f"<QQBQBQQBQB{_BODY}QQIIIIIHiQQQ")

    primary: Battery
    secondary: Battery
    north_um: int
    east_um: int
    depth_anchor_ms: int
    depth_um: int
    buoyancy: Buoyancy
    docked: bool
    pin_due_ms: int = 0
    """When its dock's coils will be aligned; 0 if they are, or if no dock holds it."""
    hover_um: int = 0
    """The depth at which it hovers, or to which it moves; 0 if its buoyancy is not HOVER."""
    samples: int = 0
    """The number of samples ever taken; like `acknowledged`, in a register that outlives a reset."""
    acknowledged: int = 0
    """The log's records below this sequence were acknowledged."""
    fix_um: tuple[int, int] = (0, 0)
    """The last GPS fix (north, east), kept in flash: a reset on the bottom leaves it. Unused without a receiver."""
    kept: StoredSettings | None = None
    """Its clock and its settings; None until a command changes them."""

    def pack(self) -> bytes:
        return self.FORMAT.pack(
            self.primary.anchor_ms,
            self.primary.charge,
            self.primary.flow,
            self.primary.load,
            self.primary.coils,
            self.secondary.anchor_ms,
            self.secondary.charge,
            self.secondary.flow,
            self.secondary.load,
            self.secondary.coils,
            self.north_um,
            self.east_um,
            self.depth_anchor_ms,
            self.depth_um,
            self.buoyancy,
            self.docked,
            self.pin_due_ms,
            self.hover_um,
            self.samples,
            self.acknowledged,
            *self.fix_um,
            *_packed(self.kept),
        )

    @classmethod
    def unpack(cls, data: bytes | memoryview, offset: int = 0) -> Physical:
        """The inverse of `pack`, from `offset` on; struct.error or ValueError for other bytes.

        Batteries that are alike are one object, so that comparing them takes no time.
        """
        (
            primary,
            secondary,
            north_um,
            east_um,
            depth_anchor_ms,
            depth_um,
            buoyancy,
            docked,
            pin_due_ms,
            hover_um,
            samples,
            acknowledged,
            fix_north_um,
            fix_east_um,
            is_kept,
        ) = _WITH_PACKED_BATTERIES.unpack_from(data, offset)
        if buoyancy not in _BUOYANCIES:
            raise ValueError(f"no buoyancy {buoyancy}")
        return cls(
            _battery(primary),
            _battery(secondary),
            north_um,
            east_um,
            depth_anchor_ms,
            depth_um,
            _BUOYANCIES[buoyancy],
            docked,
            pin_due_ms,
            hover_um,
            samples,
            acknowledged,
            (fix_north_um, fix_east_um),
            _unpacked(data, offset + _WITH_PACKED_BATTERIES.size) if is_kept else None,
        )


@lru_cache(_REMEMBERED)
def _battery(data: bytes) -> Battery:
    anchor_ms, charge, flow, load, coils = _BATTERY.unpack(data)
    if flow not in _FLOWS:
        raise ValueError(f"no flow {flow}")
    return Battery(anchor_ms, charge, _FLOWS[flow], load, coils)


def _packed(kept: StoredSettings | None) -> tuple[int, ...]:
    if kept is None:
        return (False, *(0,) * 12)
    settings = kept.settings
    return (
        True,
        kept.anchor_ms,
        kept.reading_ms,
        settings.alarm_ms,
        settings.sample_ms,
        settings.frame_ms,
        settings.slot_ms,
        settings.guard_ms,
        settings.slot,
        settings.offset_ms,
        settings.safe_level,
        settings.switch_back,
        settings.low_level,
    )


def _unpacked(data: bytes | memoryview, offset: int) -> StoredSettings:
    # Imported here, because agents of the paper's worst case keep nothing and do not need the module.
    from firmware_model.settings import Settings, StoredSettings

    anchor_ms, reading_ms, *settings = _KEPT.unpack_from(data, offset)
    return StoredSettings(anchor_ms, reading_ms, Settings(*settings))

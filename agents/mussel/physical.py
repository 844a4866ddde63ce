"""The physical state of an aMussel, which a reset of its MU does not touch.

The nursery keeps one of these for every agent, and restarts a dead agent from it.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, ClassVar

from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow
from firmware_model.value import value

if TYPE_CHECKING:
    from firmware_model.settings import StoredSettings

# Look-ups, because an enum's call takes longer than all the rest of a truth.
_FLOWS = {int(flow): flow for flow in Flow}
_BUOYANCIES = {int(buoyancy): buoyancy for buoyancy in Buoyancy}


@value
class Physical:
    """Anchors in agent milliseconds and micrometres; `depth_um` is the depth at `depth_anchor_ms`, positive down."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct("<QQBQBQQBQBqqQqB?QqIIqq?QQIIIIIHiQQQ")

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
    def unpack(cls, data: bytes | memoryview) -> Physical:
        """The inverse of `pack`; struct.error or ValueError for other bytes."""
        fields = cls.FORMAT.unpack(data)
        a_ms, a, a_flow, a_load, a_coils, b_ms, b, b_flow, b_load, b_coils, *body = fields
        north, east, depth_ms, depth, buoyancy, docked, pin_due_ms, hover_um, *registers = body
        samples, acknowledged, fix_north, fix_east, *kept = registers
        try:
            flows, buoyancy = (_FLOWS[a_flow], _FLOWS[b_flow]), _BUOYANCIES[buoyancy]
        except KeyError as unknown:
            raise ValueError(f"no flow or buoyancy {unknown}") from None
        return cls(
            Battery(a_ms, a, flows[0], a_load, a_coils),
            Battery(b_ms, b, flows[1], b_load, b_coils),
            north,
            east,
            depth_ms,
            depth,
            buoyancy,
            docked,
            pin_due_ms,
            hover_um,
            samples,
            acknowledged,
            (fix_north, fix_east),
            _unpacked(*kept),
        )


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


def _unpacked(is_kept: bool, anchor_ms: int, reading_ms: int, *settings: int) -> StoredSettings | None:
    if not is_kept:
        return None
    # Imported here, because agents of the paper's worst case keep nothing and do not need the module.
    from firmware_model.settings import Settings, StoredSettings

    return StoredSettings(anchor_ms, reading_ms, Settings(*settings))

"""What is physical of an aMussel: what a reset of its MU does not touch.

The nursery keeps one of these for every agent; an agent that died is started again from it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow

if TYPE_CHECKING:
    from firmware_model.settings import StoredSettings


@dataclass(frozen=True, slots=True)
class Physical:
    """Anchors in agent milliseconds and micrometres; `depth_um` is the depth at `depth_anchor_ms`, positive down."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct("<QQBQBQQBQBqqQqB?QqII?QQIIIIIHiQQQ")

    primary: Battery
    secondary: Battery
    north_um: int
    east_um: int
    depth_anchor_ms: int
    depth_um: int
    buoyancy: Buoyancy
    docked: bool
    pin_due_ms: int = 0
    """When the coils of its dock will be aligned; 0 when they are, or when no dock holds it."""
    hover_um: int = 0
    """The depth that it hovers at, or moves to; 0 when its buoyancy is another."""
    samples: int = 0
    """How many samples its log has ever taken; with `acknowledged`, in registers that outlive a reset."""
    acknowledged: int = 0
    """Its log's records below this sequence were acknowledged."""
    kept: StoredSettings | None = None
    """Its clock and its settings; None while nobody has told it anything."""

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
            *_packed(self.kept),
        )

    @classmethod
    def unpack(cls, data: bytes) -> Physical:
        """The inverse of `pack`; struct.error or ValueError for other bytes."""
        fields = cls.FORMAT.unpack(data)
        a_ms, a, a_flow, a_load, a_coils, b_ms, b, b_flow, b_load, b_coils, *body = fields
        north, east, depth_ms, depth, buoyancy, docked, pin_due_ms, hover_um, samples, acknowledged, *kept = (
            body
        )
        return cls(
            Battery(a_ms, a, Flow(a_flow), a_load, a_coils),
            Battery(b_ms, b, Flow(b_flow), b_load, b_coils),
            north,
            east,
            depth_ms,
            depth,
            Buoyancy(buoyancy),
            docked,
            pin_due_ms,
            hover_um,
            samples,
            acknowledged,
            _unpacked(*kept),
        )


def _packed(kept: StoredSettings | None) -> tuple[int, ...]:
    if kept is None:
        return (False, *(0,) * 12)
    it = kept.settings
    return (
        True,
        kept.anchor_ms,
        kept.reading_ms,
        it.alarm_ms,
        it.sample_ms,
        it.frame_ms,
        it.slot_ms,
        it.guard_ms,
        it.slot,
        it.offset_ms,
        it.safe_level,
        it.switch_back,
        it.low_level,
    )


def _unpacked(is_kept: bool, anchor_ms: int, reading_ms: int, *settings: int) -> StoredSettings | None:
    if not is_kept:
        return None
    # Imported here: the paper's worst case keeps nothing, and its agents carry nothing that they do not use.
    from firmware_model.settings import Settings, StoredSettings

    return StoredSettings(anchor_ms, reading_ms, Settings(*settings))

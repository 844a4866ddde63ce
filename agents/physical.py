"""What is physical of an aMussel: what a reset of its MU does not touch.

The nursery keeps one of these for every agent; an agent that died is started again from it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar

from firmware_model.actions import Buoyancy
from firmware_model.charge import Battery, Flow


@dataclass(frozen=True, slots=True)
class Physical:
    """Anchors in agent milliseconds and micrometres; `depth_um` is the depth at `depth_anchor_ms`, positive down."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct("<QQBQBQQBQBqqQqB?QII")

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
    samples: int = 0
    """How many samples its log has ever taken; with `acknowledged`, in registers that outlive a reset."""
    acknowledged: int = 0
    """Its log's records below this sequence were acknowledged."""

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
            self.samples,
            self.acknowledged,
        )

    @classmethod
    def unpack(cls, data: bytes) -> Physical:
        """The inverse of `pack`; struct.error or ValueError for other bytes."""
        fields = cls.FORMAT.unpack(data)
        a_ms, a, a_flow, a_load, a_coils, b_ms, b, b_flow, b_load, b_coils, *body = fields
        north, east, depth_ms, depth, buoyancy, docked, pin_due_ms, samples, acknowledged = body
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
            samples,
            acknowledged,
        )

"""The battery that feeds a board."""

from __future__ import annotations

from enum import IntEnum

from firmware_model.power.charge import Battery, ChargeModel


class ActiveBattery(IntEnum):
    """The battery that feeds the board."""

    PRIMARY = 0
    SECONDARY = 1
    NEITHER = 2
    """Both are empty."""


def without(battery: Battery, grains: int, model: ChargeModel, now_ms: int) -> Battery:
    """The battery with so much less charge from `now_ms` on, in grains; empty at least."""
    held = model.charge_at(battery, now_ms)
    return Battery(now_ms, max(0, held - grains), battery.flow, battery.load, battery.coils)

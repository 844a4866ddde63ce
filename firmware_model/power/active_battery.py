"""The battery that feeds a board: which it may be, and what a motor run takes. `hardware/power_path.py` switches."""

from __future__ import annotations

from enum import IntEnum

from firmware_model.power.charge import Battery, ChargeModel


class ActiveBattery(IntEnum):
    """The battery that feeds the board."""

    PRIMARY = 0
    SECONDARY = 1
    NEITHER = 2
    """Both are empty."""


def after_motor_run(
    primary: Battery, secondary: Battery, run: int, model: ChargeModel, now_ms: int
) -> tuple[Battery, Battery] | None:
    """Both batteries after a motor run of `run` grains at `now_ms`; None if they hold less than that together.

    The backup battery gives the charge that the primary lacks: the paper keeps it for emergencies (section IV-A).
    """
    lacking = run - model.charge_at(primary, now_ms)
    if lacking > model.charge_at(secondary, now_ms):
        return None
    backup = without(secondary, lacking, model, now_ms) if lacking > 0 else secondary
    return without(primary, run, model, now_ms), backup


def without(battery: Battery, grains: int, model: ChargeModel, now_ms: int) -> Battery:
    """The battery with so much less charge from `now_ms` on, in grains; empty at least."""
    held = model.charge_at(battery, now_ms)
    return Battery(now_ms, max(0, held - grains), battery.flow, battery.load, battery.coils)

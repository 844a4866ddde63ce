"""The battery that feeds a board, and the batteries of the paper's worst case, which uses only one."""

from __future__ import annotations

from enum import IntEnum

from firmware_model.power.charge import Battery, ChargeModel, Flow


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


class WorstCase:
    """The paper's choice (section IV-A): one battery, one load, the secondary's charging curve; the other stays full."""

    def __init__(self, model: ChargeModel, primary: Battery, secondary: Battery) -> None:
        self._model = model
        self.primary = primary
        self.secondary = secondary
        self.due_ms: int | None = None
        """Always None: the board itself watches the battery that it uses."""
        self.feed = ActiveBattery.PRIMARY

    def charge(self, charging: bool, now_ms: int) -> None:
        flow = Flow.CHARGING if charging else Flow.DISCHARGING
        if flow is not self.primary.flow:
            self.primary = self._model.settle(self.primary, now_ms, flow)

    def spend(self, grains: int, now_ms: int) -> None:
        """Takes a charge from the primary battery at once, at most what it holds."""
        if grains:
            self.primary = without(self.primary, grains, self._model, now_ms)

    def lose(self, primary: int, secondary: int, now_ms: int) -> None:
        """Takes these charges (grains) from both batteries at once, at most what they hold."""
        self.primary = without(self.primary, primary, self._model, now_ms)
        self.secondary = without(self.secondary, secondary, self._model, now_ms)

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary charge, in grains: the worst case knows them exactly."""
        return self._model.charge_at(self.primary, now_ms), self._model.charge_at(self.secondary, now_ms)

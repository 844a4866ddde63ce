"""The scenario's block `board`: the MU board and the hull around it."""

from __future__ import annotations

from typing import Literal

from apad_bridge.scenario.blocks.full_firmware_options import FullFirmwareOptions
from apad_bridge.scenario.quantities import (
    ChargeSegments,
    Fraction,
    Milliseconds,
    NotNegativeSeconds,
    PositiveSeconds,
    RatePerMinute,
    frozen,
)
from firmware_model.power.charge import ChargeModel


@frozen
class BoardOptions:
    """Numbers of the MU board and its body, in agent time: the paper's worst case by its two equations, or `whole`."""

    profile: Literal["worst-case", "mu"] | None = None
    """Gives every missing key of the block: hull and charger contact, and the paper's equations (`worst-case`) or the whole
    firmware (`mu`)."""
    discharge_per_min: RatePerMinute | None = None
    """Equation (1): the charge that a battery loses in a minute; of the worst case alone."""
    charge_segments: ChargeSegments | None = None
    """Equation (2), as [upper end, rate a minute], rising to 1.0; of the worst case alone."""
    motor_run_charge: Fraction = 0.0
    """The charge that one run of the motors takes from the primary battery, to surface or to sink, and from the secondary
    what the primary lacks; docks then fill both. Without that charge the motors stand still. Of the worst case alone. 0 as
    in the paper's experiments, whose heavy run (section IV-A) bounds it at 0.045."""
    pin_debounce_ms: Milliseconds
    """The charger's pin must stand still for this time before the board accepts its level."""
    pin_chatter_ms: Milliseconds = 2000
    """A charger's pin that bounces for this long takes the level that it had for the greater part of that time."""
    pin_check_s: PositiveSeconds = 60.0
    """The board reads the pin's level at whole multiples of this, to find a missed edge."""
    coil_alignment_s: NotNegativeSeconds = 0.0
    """The time from a dock's closing until the charger starts."""
    boot_ms: Milliseconds
    """From power to the first line of code that reports."""
    surfacing_s: PositiveSeconds
    """From the bottom to the surface."""
    sinking_s: PositiveSeconds
    """From the surface to the bottom."""
    surfacing_timeout_s: PositiveSeconds | None = None
    """A board that has not come up after this gives up and sinks, ready for another permission; longer than `surfacing_s`.
    None: three times that."""
    surfacing_failure_probability: Fraction = 0.01
    """Probability that a run of the motors does not bring it up (mud, buoyancy); the seed decides which. Assumed; the
    paper's scenarios have 0."""
    float_timeout_s: PositiveSeconds
    """An aMussel that floats unserved for this long sinks again."""
    release_wait_s: NotNegativeSeconds
    """The wait for the release packet after the falling edge, before the aMussel sinks without it."""
    whole: FullFirmwareOptions | None = None
    """The whole firmware instead of the worst case: docs/firmware-states.md."""

    def __post_init__(self) -> None:
        equations = {"discharge_per_min": self.discharge_per_min, "charge_segments": self.charge_segments}
        missing = [name for name, value in equations.items() if value is None]
        given = [name for name in equations if name not in missing]
        if self.pin_chatter_ms <= self.pin_debounce_ms:
            raise ValueError("pin_chatter_ms must be longer than pin_debounce_ms")
        if self.surfacing_timeout_s is not None and self.surfacing_timeout_s <= self.surfacing_s:
            raise ValueError("surfacing_timeout_s must be longer than surfacing_s")
        if self.whole is None and missing:
            raise ValueError(f"{' and '.join(missing)} must be given, or `whole` for the whole firmware")
        if self.whole is not None and self.motor_run_charge:
            given.append("motor_run_charge")
        if self.whole is not None and given:
            raise ValueError(
                f"{' and '.join(given)} must be left out where `whole` is: its numbers are in whole.power"
            )

    def charge_as_new(self) -> ChargeModel:
        """The model of its batteries' charge, when they are new."""
        if self.whole is not None:
            return self.whole.power.charge_as_new()
        assert self.discharge_per_min is not None and self.charge_segments is not None  # checked at birth
        return ChargeModel.from_minutes(self.discharge_per_min, self.charge_segments)

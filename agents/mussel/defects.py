"""The defects of one aMussel that last until they are healed: its buoyancy, its contact in a dock, parts of its board.

A healthy aMussel has none of this, so its process does not load the module.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from agents.mussel.board_parts import WHOLE_ONLY, BoardPart
from agents.mussel.body import Body, WorldEffect
from agents.mussel.stimuli import (
    BuoyancyJammed,
    ChargeLost,
    ClockShifted,
    ContactBounced,
    CrystalSkewed,
    Defect,
    PartFailed,
    PinDisturbed,
)
from firmware_model.actions import Dropped, RunBuoyancy
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    ChargeVanished,
    ClockJumped,
    ClockSkewed,
    ConverterDisturbed,
    PacketHeard,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)

BOUNCE_MS = 20
"""Agent time between two edges of a bouncing contact: faster than a board's debounce time."""


class Defects:
    """They stand between the world and the board, and change what passes.

    They are the process's: one that starts again is healthy until it is told.
    """

    def __init__(self, parts: dict[BoardPart, int]) -> None:
        """`parts` are the parts of the board that fail, with their values; the flash and the sensors look at them, too."""
        self.parts = parts
        self._jammed = False
        """The motors do not move the buoyancy."""
        self._held_run: RunBuoyancy | None = None
        """The last motor run that the jam held up."""
        self._inverted = False
        """The level on the pin's wire is the opposite of the charger's."""
        self._unseen = False
        """The pin's edges cause no interrupt."""
        self._bounces = 0
        """The contact in the dock will open or close so often yet, each time after `BOUNCE_MS`; it is open if odd."""

    def copy(self, parts: dict[BoardPart, int]) -> Defects:
        """The same defects in an aMussel that goes on by itself, with its own `parts`."""
        other = copy(self)
        other.parts = parts
        return other

    def take(self, defect: Defect, body: Body, is_whole: bool, now_ms: int) -> list[WorldEffect]:
        """Begins a defect or heals it; `is_whole` tells which board the aMussel has."""
        match defect:
            case ChargeLost(primary, secondary):
                return [ChargeVanished(primary, secondary)]
            case ClockShifted(by_ms):
                return [ClockJumped(by_ms)]
            case CrystalSkewed(skew_ppb):
                return [ClockSkewed(skew_ppb)]
            case BuoyancyJammed(jammed):
                run, self._held_run = self._held_run, None
                self._jammed = bool(jammed)
                return [] if run is None else [run]
            case PinDisturbed(inverted, unseen):
                was_inverted, self._inverted, self._unseen = self._inverted, bool(inverted), bool(unseen)
                is_steady = not self._bounces and was_inverted != self._inverted
                return [ChargePinRose() if body.pin_high else ChargePinFell()] if is_steady else []
            case ContactBounced(times):
                if not body.docked:
                    return [Dropped(now_ms, "a contact bounced in a dock that does not hold this aMussel")]
                self._bounces = 2 * times
                edge = self.bounce(body, now_ms)
                return [] if edge is None else [edge]
            case PartFailed(part, value):
                return self._fail(BoardPart(part), value, body, is_whole, now_ms)

    def _fail(
        self, part: BoardPart, value: int, body: Body, is_whole: bool, now_ms: int
    ) -> list[WorldEffect]:
        if not is_whole and part in WHOLE_ONLY:
            return [Dropped(now_ms, f"a defect of its {part.name.lower()}: the worst case has none")]
        self.parts.pop(part, None)
        if value:
            self.parts[part] = value
        if part is not BoardPart.DEPTH:
            return [self.of_converter()]
        surfaced = body.depth_at_um(now_ms) == 0
        return [SurfaceReached() if surfaced else BottomReached()] if surfaced or body.rests_on_bottom else []

    def of_converter(self) -> ConverterDisturbed:
        """The converter's defects as they are now: a board that boots is told again."""
        return ConverterDisturbed(self.parts.get(BoardPart.CONVERTER, 0), BoardPart.HOLD in self.parts)

    def passed(self, stimulus: Stimulus) -> Stimulus | None:
        """The fact as the board gets it; None if it notices nothing."""
        match stimulus:
            case ChargePinRose() | ChargePinFell():
                high = isinstance(stimulus, ChargePinRose)
                if high is self._inverted:
                    return ChargePinFell(not self._unseen)
                return ChargePinRose(not self._unseen, high)
            case SurfaceReached() | BottomReached() if BoardPart.DEPTH in self.parts:
                return None
            case PacketHeard(data) | WifiReceived(data) if BoardPart.UARTS in self.parts:
                return replace(stimulus, data=data[: self.parts[BoardPart.UARTS]])
        return stimulus

    def hold_up(self, run: RunBuoyancy) -> bool:
        """True if the motors do not carry out this run, but the last such one once the jam is healed."""
        if self._jammed:
            self._held_run = run
        return self._jammed

    def bounce(self, body: Body, now_ms: int) -> ChargePinRose | ChargePinFell | None:
        """Opens or closes the contact in the dock; None if only its last closing is left, after which it holds."""
        if self._bounces <= 1:
            self._bounces = 0
            return None
        self._bounces -= 1
        body.pin_due_ms = now_ms + BOUNCE_MS
        return ChargePinFell() if self._bounces % 2 else ChargePinRose()

    def dock_opened(self) -> None:
        """No contact is left that could bounce."""
        self._bounces = 0

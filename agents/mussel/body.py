"""The body in the water around a board: its place, its depth, its GPS and its contact with a dock. Agent time, um."""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct

from agents.mussel.physical import Physical
from agents.mussel.stimuli import CoilSlipped, ContactClosed, ContactOpened, DockMoved, Placed
from agents.water.fields import WaterFields
from agents.water.water_current import WaterCurrent
from firmware_model.actions import Buoyancy, Dropped, RunBuoyancy
from firmware_model.keyed_hash import blake2b
from firmware_model.power.charge import Battery, Flow
from firmware_model.sinking import Sinking
from firmware_model.stimuli import ChargePinFell, ChargePinRose, Stimulus

_KEY = Struct("<QQQ").pack
_WORDS = Struct("<QQ").unpack
_NOT_HELD: dict[type, str] = {
    DockMoved: "a dock moved that does not hold this aMussel",
    ContactOpened: "a dock opened that does not hold this aMussel",
    CoilSlipped: "coils slipped in a dock that does not hold this aMussel",
}

WorldEffect = Stimulus | RunBuoyancy | Dropped
"""An effect of the world on an aMussel, at once: a fact for its board, a run of its motors, or nothing, for a reason."""


def drift_step_um(seed: int, agent_id: int, n: int, amplitude_um: int) -> tuple[int, int]:
    """Step `n` of the paper's drift (section V-A), (north, east): a random step each mission second.

    Both are independent and uniform on the integers of [-amplitude_um, +amplitude_um]. A keyed hash of (seed, agent id,
    n) gives the same step in whatever order steps are computed, and a sum of steps is the same however time was cut.

    All four arguments are integers from 0 to 2^64 - 1. Scaling a 64-bit word to the range makes no value likelier than
    another by more than one part in 2^64 / (2 amplitude_um + 1).
    """
    width = 2 * amplitude_um + 1
    north, east = _WORDS(drift_words(seed, agent_id, n))
    return (north * width >> 64) - amplitude_um, (east * width >> 64) - amplitude_um


def drift_words(seed: int, agent_id: int, n: int) -> bytes:
    """The two random 64-bit words of step `n`, north and east, little-endian."""
    return blake2b(_KEY(seed, agent_id, n), digest_size=16).digest()


def gps_fix_um(
    seed: int, agent_id: int, n: int, place_um: tuple[int, int], deviation_um: int
) -> tuple[int, int]:
    """The fix (north, east) of a GPS receiver at `place_um` in mission second `n`.

    Both errors are normal with `deviation_um`, a keyed hash of (seed, agent id, n), so independent from second to second:
    what changes slowly is alike for an aPad nearby, and cancels in what matters, where the one is from the other.
    """
    # Imported here: no agent of the paper's experiments has a receiver.
    from agents.water.packet_draws import fates

    north, east = (fates(seed, agent_id, n, 0, axis)[2] for axis in (b"gps north", b"gps east"))
    return place_um[0] + round(deviation_um * north), place_um[1] + round(deviation_um * east)


def surfacing_fails(seed: int, agent_id: int, at_ms: int, failure_ppm: int) -> bool:
    """True if the motor run to the surface at `at_ms` fails: `failure_ppm` of 10^6, by a keyed hash of (seed, id, time)."""
    if not failure_ppm:
        return False
    digest = blake2b(_KEY(seed, agent_id, at_ms), digest_size=8, person=b"surfacing").digest()
    return int.from_bytes(digest, "little") * 1_000_000 >> 64 < failure_ppm


@dataclass(frozen=True, slots=True)
class BodyConfig:
    """The numbers of every body of a fleet."""

    sinking: Sinking
    drifts_always: bool
    """The paper's mode: every undocked body takes a random step and follows the current each mission second."""
    drift_amplitude_um: int
    leeway_um_s: tuple[int, int] = (0, 0)
    """The velocity (north, east) that the wind adds to a body at the surface, beside the current's."""
    coil_alignment_ms: int = 0
    """From the contact, or from the coils' last slip, until the charger starts and its pin rises."""
    gps_deviation_um: int | None = None
    """The standard deviation of a GPS fix along one axis; None for bodies that know their true place."""
    surfacing_failure_ppm: int = 0
    """Failures in a million motor runs to the surface: the body sticks in the mud, or does not become buoyant."""


@dataclass(frozen=True, slots=True)
class WaterConfig:
    """A body in its water.

    `step_ms` is one mission second of agent time, because drift follows the real water's clock.
    """

    seed: int
    step_ms: int
    body: BodyConfig
    current: WaterCurrent
    fields: WaterFields
    """The water around the sensors."""


def placed(at: Placed, former: Physical, agent_id: int, water: WaterConfig, now_ms: int) -> Physical:
    """The physical state of an aMussel that was just put there; it keeps the log of its samples."""
    place_um, deviation_um = (at.north_um, at.east_um), water.body.gps_deviation_um
    if deviation_um is not None:
        place_um = gps_fix_um(water.seed, agent_id, now_ms // water.step_ms, place_um, deviation_um)
    return Physical(
        Battery(now_ms, at.primary, Flow.DISCHARGING),
        Battery(now_ms, at.secondary, Flow.RESTING),
        at.north_um,
        at.east_um,
        now_ms,
        at.depth_um,
        Buoyancy.SINK,
        docked=False,
        samples=former.samples,
        acknowledged=former.acknowledged,
        fix_um=place_um,
    )


class Body:
    """A body moves up or down at a constant rate, and drifts in steps of whole mission seconds."""

    def __init__(
        self,
        agent_id: int,
        water: WaterConfig,
        physical: Physical,
        now_ms: int,
    ) -> None:
        self.agent_id = agent_id
        self.water = water
        self._config = water.body
        self._sinking = water.body.sinking
        self.north_um = physical.north_um
        self.east_um = physical.east_um
        self.depth_anchor_ms = physical.depth_anchor_ms
        self.depth_um = physical.depth_um
        self.buoyancy = physical.buoyancy
        self.docked = physical.docked
        self.pin_due_ms = physical.pin_due_ms
        """When its dock's coils will be aligned; 0 if they are, or if no dock holds it."""
        self.hover_um = physical.hover_um
        """The depth at which it hovers, or to which it moves, while its buoyancy is HOVER; otherwise 0."""
        self.fix_um = physical.fix_um
        """The last GPS fix (north, east); unused by bodies that know their true place."""
        self._step = now_ms // water.step_ms
        """The last drift step that it took, or missed while docked."""
        self._step_ms = water.step_ms
        self._in_motion = water.body.drifts_always and (
            water.body.drift_amplitude_um > 0 or not water.current.is_still
        )
        """The water moves it wherever it is, except in a dock."""

    def depth_at_um(self, now_ms: int) -> int:
        if self.docked:
            return 0
        return self._sinking.depth_um(
            self.depth_um, self.buoyancy, self.hover_um, now_ms - self.depth_anchor_ms
        )

    @property
    def arrival_ms(self) -> int | None:
        """The time at which the body reaches the surface or the bottom; None if it rests there already, or hovers."""
        sinking = self._sinking
        if self.docked or self.buoyancy is Buoyancy.HOVER:
            return None
        if self.buoyancy is Buoyancy.FLOAT:
            way_um, over_ms = self.depth_um, sinking.surfacing_ms
        else:
            way_um, over_ms = sinking.bottom_um - self.depth_um, sinking.sinking_ms
        return None if way_um == 0 else self.depth_anchor_ms - (-way_um * over_ms // sinking.bottom_um)

    @property
    def has_receiver(self) -> bool:
        """True for a body that knows its place by GPS."""
        return self._config.gps_deviation_um is not None

    def place_um(self, now_ms: int) -> tuple[int, int, int]:
        """Its true place: north, east and depth."""
        return self.north_um, self.east_um, self.depth_at_um(now_ms)

    def known_place_um(self, now_ms: int) -> tuple[int, int]:
        """The place (north, east) as the aMussel knows it: by GPS at the surface, and below by the last fix from there."""
        if self._config.gps_deviation_um is None:
            return self.north_um, self.east_um
        self._take_fix(now_ms)
        return self.fix_um

    def known_place_cm(self, now_ms: int) -> tuple[int, int, int]:
        """The same with the depth, for firmware of somebody's."""
        north_um, east_um = self.known_place_um(now_ms)
        depth_m = self.depth_at_um(now_ms) / 1e6
        return (
            round(north_um / 1e6 * 100),
            round(east_um / 1e6 * 100),
            min(0xFFFF, round(depth_m * 100)),
        )

    def _take_fix(self, now_ms: int) -> None:
        """Takes a fix if the body is at the surface and has a receiver."""
        deviation_um = self._config.gps_deviation_um
        if deviation_um is not None and self.depth_at_um(now_ms) == 0:
            n, place_um = now_ms // self.water.step_ms, (self.north_um, self.east_um)
            self.fix_um = gps_fix_um(self.water.seed, self.agent_id, n, place_um, deviation_um)

    def settle_depth(self, now_ms: int) -> None:
        self.depth_um = self.depth_at_um(now_ms)
        self.depth_anchor_ms = now_ms

    def run_buoyancy(self, to: Buoyancy, now_ms: int, depth_mm: int | None = None) -> None:
        """`depth_mm` is the depth at which to hover, at most the bottom's; None is its present depth.

        A run to the surface that fails leaves the body as it was.
        """
        self._take_fix(now_ms)
        failure_ppm = self._config.surfacing_failure_ppm
        if to is Buoyancy.FLOAT and surfacing_fails(self.water.seed, self.agent_id, now_ms, failure_ppm):
            return
        self._miss_steps(now_ms)
        self.settle_depth(now_ms)
        self.buoyancy = to
        hover_um = self.depth_um if depth_mm is None else min(self._sinking.bottom_um, 1000 * depth_mm)
        self.hover_um = hover_um if to is Buoyancy.HOVER else 0

    @property
    def rests_on_bottom(self) -> bool:
        """The body lies on the bottom, and is not on its way there."""
        on_bottom = self.depth_um == self._sinking.bottom_um
        return not self.docked and self.buoyancy is Buoyancy.SINK and on_bottom

    @property
    def _adrift(self) -> bool:
        current = self.water.current
        if self.docked:
            return False
        if self._in_motion or (self.buoyancy is Buoyancy.FLOAT and self._config.leeway_um_s != (0, 0)):
            return True
        return not self._config.drifts_always and not self.rests_on_bottom and not current.is_still

    @property
    def drift_due_ms(self) -> int | None:
        """The end of the mission second with its next drift step; None while nothing moves it."""
        if self._in_motion:  # as below, but sooner: every body of the paper's is asked this each second
            return None if self.docked else (self._step + 1) * self._step_ms
        return (self._step + 1) * self._step_ms if self._adrift else None

    def _miss_steps(self, now_ms: int) -> None:
        """A body that was held does not take the missed steps later."""
        if not self._adrift:
            self._step = now_ms // self.water.step_ms

    def drift(self, now_ms: int) -> None:
        """Takes the step of the mission second that ends at `now_ms`."""
        water, amplitude_um = self.water, self._config.drift_amplitude_um
        self._step = now_ms // water.step_ms
        if self._config.drifts_always and amplitude_um:
            north_um, east_um = drift_step_um(water.seed, self.agent_id, self._step, amplitude_um)
        else:
            north_um = east_um = 0
        if (leeway_um_s := self._config.leeway_um_s) != (0, 0) and self.depth_at_um(now_ms) == 0:
            north_um += leeway_um_s[0]
            east_um += leeway_um_s[1]
        if not water.current.is_still:
            place_um = self.north_um, self.east_um, self.depth_at_um(now_ms)
            north_um_s, east_um_s = water.current.velocity_um_s(*place_um, self._step)
            north_um += north_um_s
            east_um += east_um_s
        self.north_um += north_um
        self.east_um += east_um

    def touch(
        self, contact: ContactClosed | DockMoved | ContactOpened | CoilSlipped, now_ms: int
    ) -> list[WorldEffect]:
        """Lets a dock act on the body: edges of the charger's pin follow, or nothing, for a reason."""
        match contact:
            case ContactClosed(north_um, east_um):
                if self.docked or self.depth_at_um(now_ms) != 0:
                    return [Dropped(now_ms, "a dock closed, but not around this aMussel")]
                self.dock(north_um, east_um, now_ms)
                return [ChargePinRose()] if self.pin_high else []
            case _ if not self.docked:
                return [Dropped(now_ms, _NOT_HELD[type(contact)])]
            case DockMoved(north_um, east_um):
                self.carry(north_um, east_um)
                return []
            case ContactOpened():
                self.let_go(now_ms)
                return [ChargePinFell()]
            case CoilSlipped():
                self.slip(now_ms)
                return [ChargePinFell(), ChargePinRose()] if self.pin_high else [ChargePinFell()]

    @property
    def pin_high(self) -> bool:
        """The physical level of the charger's pin: high while a dock holds the body and the coils are aligned."""
        return self.docked and self.pin_due_ms == 0

    def dock(self, north_um: int, east_um: int, now_ms: int) -> None:
        """Closes a dock around the body; the coils begin to align."""
        if self.buoyancy is not Buoyancy.FLOAT:
            self.settle_depth(now_ms)
        self.docked = True
        self.carry(north_um, east_um)
        self.slip(now_ms)

    def slip(self, now_ms: int) -> None:
        """Moves the coils apart; the charger stops until they are aligned again."""
        alignment_ms = self._config.coil_alignment_ms
        self.pin_due_ms = now_ms + alignment_ms if alignment_ms else 0

    def align(self) -> None:
        """Aligns the coils; the charger starts."""
        self.pin_due_ms = 0

    def carry(self, north_um: int, east_um: int) -> None:
        """Moves the body with its dock."""
        self.north_um = north_um
        self.east_um = east_um

    def let_go(self, now_ms: int) -> None:
        self._miss_steps(now_ms)
        if self.buoyancy is not Buoyancy.FLOAT:
            self.settle_depth(now_ms)  # the motors ran while the dock held it, so it sinks from now on
        self.docked = False
        self.pin_due_ms = 0

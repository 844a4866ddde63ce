"""The block `water` of a scenario: sound, Wi-Fi and links as they are in the real water, not in the paper's experiments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

from annotated_types import Ge, Le

from agents.modem.frames import ModemGeneration
from agents.water.bounds import Count, NotNegative
from agents.water.sound import Sound
from agents.water.wifi import Wifi
from apad_bridge.scenario.quantities import (
    Fraction,
    NotNegativeSeconds,
    Place,
    Positive,
    PositiveSeconds,
    Quantity,
    Speed,
    frozen,
)
from firmware_model.sampling.sensor import Sensor
from firmware_model.sampling.sensors import SENSORS


@frozen
class Tide:
    """One constituent: north is north_m_s sin(2 pi t / period + north_phase), and east likewise; t is mission time."""

    period_h: Annotated[float, Ge(0.02), Le(10_000)]
    """The constituent's, in mission time: 12.42 for the moon's."""
    north_m_s: Speed
    """Its amplitude to north."""
    east_m_s: Speed
    """Its amplitude to east."""
    north_phase_deg: Annotated[float, Ge(-360), Le(360)] = 0.0
    """At mission time 0; 90 is at its height."""
    east_phase_deg: Annotated[float, Ge(-360), Le(360)] = 0.0
    """Likewise."""


@frozen
class Current:
    file: str | None = None
    """CSV or NetCDF; relative to the scenario file."""
    steady_m_s: tuple[Speed, Speed] | None = None
    """(north, east) velocity of a current that is the same everywhere, instead of a file."""
    tides: tuple[Tide, ...] = ()
    """Constituents, added to the file's field."""
    profile: tuple[tuple[NotNegative, Fraction], ...] = ()
    """(depth in m, fraction of the current there) by rising depth, linear between. Empty: the full current everywhere."""

    def __post_init__(self) -> None:
        if (depths := [depth for depth, _ in self.profile]) != sorted(set(depths)):
            raise ValueError("profile must go down")


WindSpeed = Annotated[float, Ge(-60), Le(60)]


@frozen
class Wind:
    """A steady wind, by where it blows to. What floats goes with a part of it, beside the current."""

    north_m_s: WindSpeed
    """The direction to which the wind blows: a wind from the south is positive."""
    east_m_s: WindSpeed
    """Likewise to east."""
    leeway: Annotated[float, Ge(0), Le(0.2)] = 0.03
    """The speed of an aMussel at the surface, as a share of the wind's: 3 % is the usual figure for what floats awash."""


MEASURED = tuple(sensor for sensor in SENSORS if sensor.calm is not None)
"""The sensors of quantities that a scenario gives. The others follow from the depth."""
QuantitySchema = TypeVar("QuantitySchema")


def _with_quantities(
    key_of: Callable[[Sensor], tuple[object, object]],
) -> Callable[[type[QuantitySchema]], type[QuantitySchema]]:
    """Gives a schema a key for each measured quantity; `key_of` returns the type and the default."""

    def extend(schema: type[QuantitySchema]) -> type[QuantitySchema]:
        for sensor in MEASURED:
            schema.__annotations__[sensor.key], default = key_of(sensor)
            setattr(schema, sensor.key, default)
        return schema

    return extend


@frozen
@_with_quantities(lambda sensor: ((NotNegative if sensor.low >= 0 else Quantity) | None, None))
class Patch:
    """A patch of changed water that grows and drifts, in agent time.

    A measured quantity is the value in the patch's middle; None: unchanged.
    """

    begins_s: NotNegativeSeconds
    """Its begin."""
    growing_s: PositiveSeconds
    """The time in which it grows to its whole radius."""
    place_m: Place
    """(north, east) of its centre when it begins."""
    drift_m_s: tuple[Speed, Speed] = (0.0, 0.0)
    """Its drift."""
    radius_m: Positive
    """The inner half is the core; outside it the patch thins out to nothing."""
    from_depth_m: NotNegative = 0.0
    """The patch lies at this depth and below."""


Depths = tuple[tuple[NotNegative, Quantity], ...]


@frozen
@_with_quantities(lambda sensor: (Depths, ((0.0, sensor.calm),)))
class CalmFields:
    """The quantities that the sensors measure: (depth in m, value) by rising depth, linear between."""

    def __post_init__(self) -> None:
        for sensor in MEASURED:
            depths = [depth for depth, _ in getattr(self, sensor.key)]
            if not depths or depths != sorted(set(depths)):
                raise ValueError(f"{sensor.key} must go down")


@frozen
class Fields(CalmFields):
    """The quantities that the sensors measure, by rising depth and linear between, and patches in which they differ."""

    patches: tuple[Patch, ...] = ()
    """Local events in the water."""


@frozen
class Talk:
    """The acoustic packets that the aPad sends of its own accord."""

    waits: bool = True
    """The aPad's packets keep out of the aMussels' timeslots."""
    turn: tuple[Count, Count] = (1, 1)
    """The aPad's part of the time outside all timeslots, as (which, of how many), so that several aPads do not collide. A
    run of several aPads sets it for each."""
    assigns: bool = False
    """The aPad measures the propagation delay by pings and assigns each aMussel its timeslot."""
    beacon_period_s: NotNegativeSeconds = 0.0
    """Period of the time beacon, in agent time; 0 for no beacon."""
    ping_period_s: NotNegativeSeconds = 0.0
    """Period, in mission time, at which the aPad pings one aMussel after another to locate it; 0 for never."""
    ping_worth_m: NotNegative = 0.0
    """The aPad pings an aMussel out of turn if the expected search exceeds this: the probability that it needs fetching
    times the deviation of its place; 0 for never. Needs `beliefs.estimator: twin` and `localisation`."""
    ask_worth_answers: NotNegative = 0.0
    """The aPad asks an aMussel for its status if a wrong plan is expected to cost the aMussel (the probability times the
    motors up and down) more than this number of answers; 0 for never. Needs `beliefs.estimator: twin` and `board.whole`."""

    def __post_init__(self) -> None:
        if self.turn[0] > self.turn[1]:
            raise ValueError(f"turn: there is no part {self.turn[0]} of {self.turn[1]}")


@frozen
class Localisation:
    """Localisation of aMussels from the ranges that `talk.ping_period_s` brings."""

    deviation_m: Positive = 0.5
    """Standard deviation of a range: the modem's noise and the error of the aPad's own place."""
    memory_s: PositiveSeconds = 3600.0
    """The locator forgets older ranges."""
    apart_m: Positive = 5.0
    """Ranges taken nearer to each other than this count as one."""
    worst_hdop: Positive = 5.0
    """A geometry with a larger dilution gives no fix."""


@frozen
class Water:
    """The water of a run. Without `wifi` every Wi-Fi packet arrives, except from under water."""

    modems: ModemGeneration = ModemGeneration.V3
    """`v3`: 64 bytes a packet. `v2`: the early swarm's, 7 bytes at 40 bit/s (docs/modems.md)."""
    sound: Sound = Sound()
    wifi: Wifi | None = None
    """The radio's range. None: Wi-Fi works from the surface at any distance."""
    talk: Talk = Talk()
    """The packets that the aPad sends by sound on its own: docs/water.md#timeslots-and-the-apads-packets."""
    localisation: Localisation | None = None
    current: Current | None = None
    """The motion of the water, which moves aMussels off the bottom, and the aPad: docs/water.md#currents."""
    wind: Wind | None = None
    """The wind, which moves floating aMussels and the aPad."""
    fields: Fields = Fields()
    """The water that the sensors measure: docs/water.md#fields."""
    links_file: str | None = None
    """CSV: from, to, loss and optionally since_s, until_s; relative to the scenario file. Read again when it changes."""

"""Checks that an aPad means the same place by its local (0, 0) as the scenario, by all that the vehicle tells of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.doctor.finding import Finding, cannot_tell, fail, ok
from apad_bridge.doctor.network import Unreachable, call, call_for_reply
from apad_bridge.scenario.area.local_frame import LocalFrame, OriginLike

_SAME_M = 1.0
"""About a victory radius; parameters that are printed with six decimals are 0.1 m off."""
_PLANE_SHARE = 0.005
"""Filters turn degrees into metres by other formulas than ours, and differ by some metres in a kilometre."""


@dataclass(frozen=True, slots=True)
class ReportedPlace:
    """A place that the vehicle names in degrees and in its local metres; its origin has the metres (0, 0)."""

    source: str
    latitude_deg: float
    longitude_deg: float
    north_m: float = 0.0
    east_m: float = 0.0


def check_origin(uri: str, apad: str, ours: OriginLike, told: Sequence[ReportedPlace] = ()) -> Finding:
    """Compares the scenario's origin with the parameters on the master at `uri`, and with the places that are `told`.

    `apad` is the aPad's namespace in full, such as /apad1.
    """
    try:
        parameters = place_of_parameters(uri, apad)
    except (Unreachable, TypeError, ValueError) as error:
        return fail(str(error), "see rosparam get, and area.origin")
    told = [*([] if parameters is None else [parameters]), *told]
    if not told:
        return cannot_tell(
            f"{apad}/LocalOriginLat is not set, and its positions name neither an origin nor latitude and longitude",
            f"rosparam set {apad}/LocalOriginLat and LocalOriginLon to what the vehicle's filter uses; or compare by "
            "hand: a known place in degrees with the local metres there",
        )
    for it in told:
        try:
            off_m = _off_m(it, ours.latitude_deg, ours.longitude_deg)
        except ValueError as error:
            return fail(f"{it.source}: {error}", "see what the vehicle publishes, and area.origin")
        if off_m > _SAME_M + _PLANE_SHARE * math.hypot(it.north_m, it.east_m):
            return fail(*_differs(it, off_m, ours))
    found = "; ".join(f"{it.source} say {it.latitude_deg:.7f}, {it.longitude_deg:.7f}" for it in told)
    return ok(f"{found}, as the scenario does")


def place_of_parameters(uri: str, apad: str) -> ReportedPlace | None:
    """LocalOriginLat and LocalOriginLon in the namespace of `apad` or, as ROS looks for them, in those above.

    None where they are not set; ValueError, TypeError or Unreachable for what is no origin.
    """
    for namespace in _upwards(apad):
        names = [f"{namespace}/LocalOrigin{it}" for it in ("Lat", "Lon")]
        if call_for_reply(uri, "hasParam", names[0])[2] is True:
            values = [call(uri, "getParam", it) for it in names]
            source = f"{names[0]} and LocalOriginLon"
            try:
                latitude_deg, longitude_deg = map(float, values)
            except (TypeError, ValueError):
                raise ValueError(f"{source} are {values}: no degrees") from None
            return ReportedPlace(source, latitude_deg, longitude_deg)
    return None


def _differs(told: ReportedPlace, off_m: float, ours: OriginLike) -> tuple[str, str]:
    """(found, mend) for a place that is not the scenario's."""
    at = f" at ({told.north_m:.1f} m north, {told.east_m:.1f} m east)" if told.north_m or told.east_m else ""
    found = (
        f"{told.source} say {told.latitude_deg:.7f}, {told.longitude_deg:.7f}{at}, {off_m:.0f} m from the scenario's: "
        "degrees given to one are other metres for the other"
    )
    if at:
        mirrored = ReportedPlace(
            told.source, told.latitude_deg, told.longitude_deg, -told.north_m, told.east_m
        )
        if _is_near(mirrored, ours.latitude_deg, ours.longitude_deg):
            return f"{found}; north has the wrong sign", "see the axes of the vehicle's filter"
    if _is_near(told, ours.longitude_deg, ours.latitude_deg):
        return f"{found}; latitude and longitude look swapped in area.origin", "swap them in area.origin"
    return found, (
        "give both the same origin: area.origin in the scenario, or the vehicle's"
        if at
        else f"area.origin: {{latitude_deg: {told.latitude_deg!r}, longitude_deg: {told.longitude_deg!r}}} in the scenario"
    )


def _is_near(told: ReportedPlace, latitude_deg: float, longitude_deg: float) -> bool:
    try:
        return _off_m(told, latitude_deg, longitude_deg) < 10 * _SAME_M
    except ValueError:
        return False


def _off_m(told: ReportedPlace, latitude_deg: float, longitude_deg: float) -> float:
    """Metres between the place in degrees, seen from an origin at these degrees, and the place in metres."""
    north_m, east_m = LocalFrame(latitude_deg, longitude_deg).to_local(told.latitude_deg, told.longitude_deg)
    return math.hypot(north_m - told.north_m, east_m - told.east_m)


def _upwards(name: str) -> list[str]:
    """Lists the namespaces of /a/b upwards: /a/b, /a and the empty one."""
    parts = name.strip("/").split("/")
    return ["".join(f"/{part}" for part in parts[:count]) for count in range(len(parts), -1, -1)]

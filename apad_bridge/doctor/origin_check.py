"""Checks by LocalOriginLat and LocalOriginLon that an aPad means the same place by local (0, 0) as the scenario."""

from __future__ import annotations

import math

from apad_bridge.doctor.finding import Finding, ok, warn
from apad_bridge.doctor.network import Unreachable, call, call_for_reply
from apad_bridge.scenario.local_frame import LocalFrame, OriginLike

_SAME_M = 1.0
"""About a victory radius; parameters that are printed with six decimals are 0.1 m off."""


def check_origin(uri: str, apad: str, ours: OriginLike) -> Finding:
    """Looks for the parameters in the namespace of `apad` (in full, such as /apad1) and, like ROS, in those above."""
    for namespace in _upwards(apad):
        names = [f"{namespace}/LocalOrigin{it}" for it in ("Lat", "Lon")]
        try:
            if call_for_reply(uri, "hasParam", names[0])[2] is not True:
                continue
            latitude_deg, longitude_deg = (float(call(uri, "getParam", it)) for it in names)
            metres = math.hypot(
                *LocalFrame(ours.latitude_deg, ours.longitude_deg).to_local(latitude_deg, longitude_deg)
            )
        except (Unreachable, TypeError, ValueError) as error:
            return warn(
                "origin", f"{names[0]} and LocalOriginLon: {error}", "see rosparam get, and area.origin"
            )
        found = f"{names[0]} and LocalOriginLon say {latitude_deg:.7f}, {longitude_deg:.7f}"
        if metres <= _SAME_M:
            return ok("origin", f"{found}, as the scenario does")
        return warn(
            "origin",
            f"{found}, {metres:.0f} m from the scenario's: degrees given to one are other metres for the other",
            f"area.origin: {{latitude_deg: {latitude_deg!r}, longitude_deg: {longitude_deg!r}}} in the scenario",
        )
    return ok("origin", f"Cannot check the origin: {apad}/LocalOriginLat is not set.")


def _upwards(name: str) -> list[str]:
    """Lists the namespaces of /a/b upwards: /a/b, /a and the empty one."""
    parts = name.strip("/").split("/")
    return ["".join(f"/{part}" for part in parts[:count]) for count in range(len(parts), -1, -1)]

"""Listens to the positions of the other aPads of a run, which the guards of this one keep clear of."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.ros.system.inbox import Listening
from apad_bridge.ros.types.any_listener import AnyListener
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.guards.guarded_orders import BodyInWater, Point

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402


class OtherAPads(Listening[None]):
    """Keeps the newest place of each aPad in `names`. A silent one is still taken to be where it was heard last."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self._places_m: dict[str, Point] = {}
        listener = AnyListener(self._inbox.refuse)
        fields = ("position.north", "position.east")
        self._subscribers = [
            listener.listen(of_apad(it, "position"), NavSts, fields, self._take, it) for it in names
        ]

    def bodies(self) -> tuple[BodyInWater, ...]:
        with self._lock:
            return tuple(BodyInWater(name, it, agent_id=None) for name, it in self._places_m.items())

    def _take(self, message: Any, name: str) -> None:
        north_m, east_m = message.position.north, message.position.east
        if out_of_range(north_m=north_m, east_m=east_m) is not None:
            self._inbox.drop(f"{name}: a position out of range")
            return
        with self._lock:
            self._places_m[name] = (north_m, east_m)

"""Stands between a hull and all that hear of it, and falsifies its position or its battery when told to.

    python relay.py NAME SOCKET [mute]    (a Python with rospy and the vehicle's messages on its path)

It passes /hull/position and /hull/battery_level on as /apad1/position and /apad1/battery_level, `mute` only from the first
order on. Orders are lines of JSON to the datagram socket: {"position": {"kind": KIND, ...}} or {"battery": {...}}.
"""

from __future__ import annotations

import copy
import math
import random
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from auv_msgs.msg import NavSts
from std_msgs.msg import Float64

from safety.nodes.ordered import serve

STEP_S = 0.02
LONGEST_LAG_S = 8.0
LAG_GROWTH = 0.5
"""Seconds of lag more a second, up to the longest."""
NOISE_M = 0.003
WAVE_PERIOD_S = 4.0
GAP_EVERY_S = 60.0


def shifted(it: Any, seconds: float) -> Any:
    """The message with its stamp moved."""
    it.header.stamp = rospy.Time.from_sec(max(0.0, it.header.stamp.to_sec() + seconds))
    return it


class Falsifier:
    """Falsifies positions by one order: `take` returns those that leave now, each a copy of its own."""

    def __init__(
        self,
        order: dict[str, Any],
        last: Any,
        rng: random.Random,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`last` is the newest position before the order."""
        self._order, self._rng, self._clock = order, rng, clock
        self._begun_s = clock()
        self._last = copy.deepcopy(last)
        self._late: list[tuple[float, Any]] = []
        self._passed_s = -math.inf
        self._first_stamp_s: float | None = None
        self._turns = 0

    def take(self, message: Any) -> list[Any]:
        kind = self._order["kind"]
        act: Callable[[Any], list[Any]] = getattr(self, f"_{kind}")
        return act(copy.deepcopy(message))

    def due(self) -> list[Any]:
        """Those that were kept and leave now."""
        now_s = self._clock()
        lag_s = min(LONGEST_LAG_S, LAG_GROWTH * (now_s - self._begun_s))
        ready = [it for at_s, it in self._late if now_s - at_s >= lag_s]
        self._late = self._late[len(ready) :]
        return ready

    def _good(self, it: Any) -> list[Any]:
        return [it]

    def _nan(self, it: Any) -> list[Any]:
        it.position.north = it.position.east = math.nan
        return [it]

    def _infinite(self, it: Any) -> list[Any]:
        it.position.north = math.inf
        return [it]

    def _yaw_nan(self, it: Any) -> list[Any]:
        it.orientation.yaw = math.nan
        return [it]

    def _silent(self, it: Any) -> list[Any]:
        return []

    def _frozen(self, it: Any) -> list[Any]:
        """All but the header stays the same, bit for bit, or with a few millimetres of noise."""
        frozen = copy.deepcopy(self._last)
        frozen.header = it.header
        noise_m = self._order.get("noise_m", 0.0)
        if noise_m:
            frozen.position.north += self._rng.gauss(0.0, noise_m)
            frozen.position.east += self._rng.gauss(0.0, noise_m)
        return [frozen]

    def _offset(self, it: Any) -> list[Any]:
        it.position.north += self._order["north_m"]
        it.position.east += self._order["east_m"]
        return [it]

    def _mux(self, it: Any) -> list[Any]:
        """One node with two receivers, whose places lie apart, and who speak in turns."""
        self._turns += 1
        it.position.north += self._order["apart_m"] * (self._turns % 2)
        return [it]

    def _walks(self, it: Any) -> list[Any]:
        it.position.north += self._order["speed_m_s"] * (self._clock() - self._begun_s)
        return [it]

    def _north_sign(self, it: Any) -> list[Any]:
        it.position.north = -it.position.north
        return [it]

    def _late_more(self, it: Any) -> list[Any]:
        self._late.append((self._clock(), it))
        return []

    def _stamps(self, it: Any) -> list[Any]:
        return [shifted(it, self._order["by_s"])]

    def _backwards(self, it: Any) -> list[Any]:
        """Its clock runs the other way."""
        stamp_s = it.header.stamp.to_sec()
        if self._first_stamp_s is None:
            self._first_stamp_s = stamp_s
        return [shifted(it, -2 * (stamp_s - self._first_stamp_s))]

    def _slow(self, it: Any) -> list[Any]:
        if self._clock() - self._passed_s < self._order["every_s"]:
            return []
        self._passed_s = self._clock()
        return [it]

    def _rough(self, it: Any) -> list[Any]:
        """A healthy receiver on a healthy sea: noise, waves, and a gap now and then."""
        at_s = self._clock() - self._begun_s
        if at_s % GAP_EVERY_S > GAP_EVERY_S - self._order["gap_s"]:
            return []
        wave_m = self._order["waves_m"] * math.sin(2 * math.pi * at_s / WAVE_PERIOD_S)
        it.position.north += self._rng.gauss(0.0, self._order["noise_m"]) + wave_m
        it.position.east += self._rng.gauss(0.0, self._order["noise_m"])
        return [it]


class Relay:
    def __init__(self, name: str, *, mute: bool) -> None:
        self._lock = threading.Lock()
        self._rng = random.Random(name)
        self._last: Any = None
        self._falsifier = Falsifier({"kind": "silent" if mute else "good"}, None, self._rng)
        self._battery: dict[str, Any] = {}
        self._charge: Any = None
        self._positions: Any = None
        if not mute:
            self._advertise()
            self._charge = rospy.Publisher("/apad1/battery_level", Float64, queue_size=10)
        rospy.Subscriber("/hull/position", NavSts, self._take_position, tcp_nodelay=True)
        rospy.Subscriber("/hull/battery_level", Float64, self._take_battery)
        # The judge reads the wire, where nothing is without a subscriber; our own hull has no such topic.
        rospy.Subscriber("/hull/truth", NavSts, lambda truth: None, tcp_nodelay=True)

    def _advertise(self) -> None:
        self._positions = rospy.Publisher("/apad1/position", NavSts, queue_size=10, tcp_nodelay=True)

    def obey(self, order: dict[str, Any]) -> None:
        with self._lock:
            if "position" in order:
                if self._positions is None:
                    self._advertise()
                self._falsifier = Falsifier(order["position"], self._last, self._rng)
            self._battery = order.get("battery", self._battery)

    def step(self) -> None:
        with self._lock:
            self._publish(self._falsifier.due())

    def _take_position(self, message: Any) -> None:
        with self._lock:
            self._last = message
            self._publish(self._falsifier.take(message))

    def _publish(self, messages: list[Any]) -> None:
        for it in messages if self._positions is not None else ():
            self._positions.publish(it)

    def _take_battery(self, message: Any) -> None:
        with self._lock:
            value, self._battery = (
                self._battery.get("percent", message.data),
                ({} if self._battery.get("once") else self._battery),
            )
            if self._charge is not None and not self._battery.get("silent"):
                self._charge.publish(Float64(value))


if __name__ == "__main__":
    serve(lambda: Relay(sys.argv[1], mute="mute" in sys.argv[3:]), STEP_S)

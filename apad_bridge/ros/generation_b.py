"""A vehicle link to ANY aPad of generation B on ROS, ours or a real one.

    link = GenerationBLink("apad1", agent_ids, (empty_v, full_v), docking, misses, our_clock=True)
    link.wait_until_ready(10.0)        # VehicleNotReady, one line that says what is missing

The node is initialised before (`open_gateway`). Stamps are as in generation A: with `our_clock` poses carry those of their
messages; whatever has no stamp became true at the tick that hears it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import rosgraph
import rospy
from std_msgs.msg import Float32MultiArray

from apad_bridge.diagnosis.graph import Graph
from apad_bridge.diagnosis.network import Unreachable
from apad_bridge.laboratory.fields import has, write
from apad_bridge.laboratory.words import DockSaid
from apad_bridge.ros.generation_b_core import GenerationBCore
from apad_bridge.ros.generation_b_ears import Ears
from apad_bridge.ros.generation_b_words import (
    Answered,
    Call,
    DockingOrder,
    GoToOrder,
    Heard,
    Order,
    PositionOrder,
    Primitive,
)
from apad_bridge.ros.inbox import Inbox
from apad_bridge.ros.legacy_words import UNSTAMPED
from apad_bridge.ros.live_types import live_services, unreadable_topics
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import of_apad
from apad_bridge.ros.reach import Sight
from apad_bridge.ros.service_calls import ServiceCalls
from apad_bridge.ros.vehicle_not_ready import VehicleNotReady
from apad_bridge.ros.virtual_camera import VirtualCamera
from apad_bridge.scenario.schema import Docking
from apad_bridge.simulated_apad.misses import Misses
from apad_bridge.vehicle import MoveArm, VehicleCommand
from apad_bridge.vehicle_link import LinkFact

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    DockingPrimitiveService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
)

SERVICES: dict[Primitive, Any] = {
    Primitive.GO_TO: Go2pointPrimitiveService,
    Primitive.POSITION: DynamicPositioningPrimitiveService,
    Primitive.DOCKING: DockingPrimitiveService,
}
_SETTLE_S = 0.003
"""On our own clock: what was published before the last word of a tick is in this machine by then, and is read so soon."""


class GenerationBLink:
    """A VehicleLink. `name` is the aPad's namespace; `docked` are agents by slot, known to be held."""

    def __init__(
        self,
        name: str,
        agent_ids: Iterable[int],
        battery_v: tuple[float, float],
        docking: Docking,
        misses: Misses,
        *,
        our_clock: bool,
        sight: Sight = lambda now_ms: {},
        camera: VirtualCamera | None = None,
        docked: Mapping[int, int] | None = None,
        now_ms: int = 0,
    ) -> None:
        self.name = name
        self._core = GenerationBCore(agent_ids, battery_v, docking, misses, sight, docked, now_ms)
        self._now_ms = now_ms
        self._excused: set[str] = set()
        self._inbox: Inbox[Heard] = Inbox()
        self._ears = Ears(name, self._inbox, stamped=our_clock)
        self._words_before = 0
        self._statuses_are_silent = False
        self._services = dict(SERVICES)
        self._calls = ServiceCalls()
        self._camera = camera
        self._arms = rospy.Publisher(of_apad(name, "dock_out"), Float32MultiArray, queue_size=4)

    @property
    def dropped(self) -> Counter[str]:
        """Words of the vehicle that came to nothing, by reason."""
        return self._inbox.dropped + self._core.dropped

    @property
    def heard_ms(self) -> int:
        """When a position was last heard; -1 before the first."""
        return self._core.readings.position_ms

    def holds(self, agent_id: int) -> bool:
        """Whether a dock is known to hold this aMussel."""
        return self._core.docks.holds(agent_id)

    def wait_until_ready(self, timeout_s: float) -> None:
        """Until the aPad's topics are connected and its services are there.

        Raises VehicleNotReady after `timeout_s` wall seconds, or when it speaks other definitions.
        """
        until_s = time.monotonic() + timeout_s
        while missing := [*self._ears.missing, *self._missing_services()]:
            if time.monotonic() > until_s:
                self._refuse_other_definitions()
                raise VehicleNotReady(
                    f"{rospy.resolve_name(self.name)} is not ready after {timeout_s:g} s: {', '.join(missing)}; "
                    f"does an aPad of generation B run under this name on this master?"
                )
            # rospy tells of connections only when asked.
            time.sleep(0.02)
        self._refuse_other_definitions()

    def _missing_services(self) -> list[str]:
        try:
            offered = Graph.read(rosgraph.get_master_uri()).services
        except Unreachable as error:
            return [str(error)]
        needed = (rospy.resolve_name(self._service_name(primitive)) for primitive in SERVICES)
        return [f"nobody offers {name}" for name in needed if name not in offered]

    def _refuse_other_definitions(self) -> None:
        by_name = {rospy.resolve_name(self._service_name(primitive)): primitive for primitive in SERVICES}
        chosen, lines = live_services({name: SERVICES[primitive] for name, primitive in by_name.items()})
        self._services = {primitive: chosen[name] for name, primitive in by_name.items()}
        lines += unreadable_topics(self._ears.needed)
        for primitive, kind in self._services.items():
            request = kind._request_class()
            lines += [
                f"{rospy.resolve_name(self._service_name(primitive))} has no field {it} there"
                for it in _FIELDS[primitive]
                if not has(request, it)
            ]
        if lines:
            raise VehicleNotReady(
                f"{rospy.resolve_name(self.name)} speaks other definitions than we do: {'; '.join(lines)}; "
                "source its workspace, or put its texts into apad_bridge/ros/definitions and run launch_scripts/install"
            )

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`; what the core orders by them is sent off."""
        self._now_ms = now_ms
        self._drain()
        facts = self._core.advance(now_ms)
        self._send()
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if isinstance(command, MoveArm):
            is_open = [float(command.is_open and slot == command.slot) for slot in range(4)]
            self._arms.publish(Float32MultiArray(data=is_open))
        self._core.command(command, now_ms)
        self._send()

    def said(self, word: DockSaid) -> None:
        """Somebody else says what a dock did."""
        self._core.hear_dock(word)

    def close(self) -> None:
        self._ears.close()
        self._arms.unregister()
        if self._camera is not None:
            self._camera.close()

    # In step with our own clock: what `OwnMasterClock` asks for.

    def wait_until_taken(self, timeout_s: float) -> list[str]:
        """Until the service of the order that counts has answered; what has not, after `timeout_s`."""
        until_s = time.monotonic() + timeout_s
        while missing := [key for key in self._core.unanswered if key not in self._excused]:
            if (left_s := until_s - time.monotonic()) <= 0:
                break
            self._drain(left_s)
        self._excused |= set(missing)
        return missing

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool:
        """Until `stateRef` says that all due by `now_ms` was handled; whether it did within `timeout_s`."""
        self._now_ms = now_ms
        until_s = time.monotonic() + timeout_s
        while self._core.readings.state_ms < now_ms and (left_s := until_s - time.monotonic()) > 0:
            self._drain(left_s)
        if self._camera is not None and self._core.readings.state_ms >= now_ms:
            self._camera.wait_until_looked(now_ms, max(0.0, until_s - time.monotonic()))
        return self._core.readings.state_ms >= now_ms

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Until the position has come up to `now_ms`, the statuses have said something since the tick before, which they do
        each second, and a moment more: words without a stamp may come a tick late, but no later.

        A vehicle whose statuses are silent is not waited for again before they speak.
        """
        until_s = time.monotonic() + timeout_s
        while missing := [*self._core.unheard(now_ms), *self._silent_statuses()]:
            if (left_s := until_s - time.monotonic()) <= 0:
                break
            self._drain(left_s)
        self._statuses_are_silent = self._core.status_words == self._words_before
        self._words_before = self._core.status_words
        self._drain(_SETTLE_S)
        return missing

    def _silent_statuses(self) -> list[str]:
        silent = self._core.status_words == self._words_before and not self._statuses_are_silent
        return ["goto_status"] if silent else []

    def _drain(self, wait_s: float = 0.0) -> None:
        for heard in self._inbox.take(wait_s):
            if heard.at_ms == UNSTAMPED:
                heard = replace(heard, at_ms=self._now_ms)
            self._core.hear(heard, self._now_ms)

    def _send(self) -> None:
        for call in self._core.take_calls():
            primitive, fields = _fields(call.order)
            kind = self._services[primitive]
            request = kind._request_class()
            for path, value in fields.items():
                write(request, path, value)
            self._calls.send(self._service_name(primitive), kind, request, self._answer_to(call))

    def _answer_to(self, call: Call) -> Any:
        def answered(response: Any, refused: str | None) -> None:
            if refused is None and not response.status:
                refused = "its service answered that it does not take the order"
            self._inbox.put(Answered(UNSTAMPED, call.number, refused), always=True)

        return answered

    def _service_name(self, primitive: Primitive) -> str:
        return of_apad(self.name, f"commander/primitive/{primitive.value}")


def _fields(order: Order) -> tuple[Primitive, dict[str, Any]]:
    match order:
        case GoToOrder(north_m, east_m, speed_m_s, victory_radius_m):
            return Primitive.GO_TO, {
                "point.x": north_m,
                "point.y": east_m,
                "speed": speed_m_s,
                "victory_radius": victory_radius_m,
                "north_enable": True,
                "east_enable": True,
            }
        case PositionOrder(north_m, east_m, heading_rad):
            hold = {"north": north_m, "east": east_m, "north_enable": True, "east_enable": True}
            if heading_rad is not None:
                hold |= {"heading": heading_rad, "heading_enable": True}
            return Primitive.POSITION, hold
        case DockingOrder():
            return Primitive.DOCKING, {
                "docking_action": order.docks,
                "docking_slot": order.slot,
                "search_yaw_rate": order.search_yaw_rate_rad_s,
                "max_yaw_rate": order.max_yaw_rate_rad_s,
                "max_surge_speed": order.max_surge_m_s,
                "surge_stdev": order.surge_stdev,
            }


_ALL_ORDERS: tuple[Order, ...] = (
    GoToOrder(0.0, 0.0, 1.0, 1.0),
    PositionOrder(0.0, 0.0, 0.0),
    DockingOrder(True, 0, 0.0, 0.0, 0.0, 0.0),
)
_FIELDS = {primitive: tuple(fields) for primitive, fields in map(_fields, _ALL_ORDERS)}
"""What a service's request must have: all that is ever written into it."""

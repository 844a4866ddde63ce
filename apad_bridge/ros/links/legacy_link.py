"""The link to an aPad of any generation: an inbox that rospy's threads fill, and a core that interprets its messages.

The subscribers leave messages in the inbox, in rospy's threads; the core interprets them in the flight's thread. Every wait
has a time-out in wall seconds.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import rospy

from apad_bridge.events.event import Event
from apad_bridge.ros.links.order_sender import OrderSender
from apad_bridge.ros.links.service_calls import CallFailed
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.scenario.schema import APad, Scenario
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.link_errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack
from apad_bridge.vehicle.stack_messages import UNSTAMPED
from apad_bridge.vehicle.telemetry import Readings
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.contacts import FloatingPlaces


class LinkDocks(Protocol):
    @abstractmethod
    def serve(self, agent_ids: Iterable[int]) -> None:
        """From now on one of several aPads docks these aMussels and no others."""

    def holds(self, agent_id: int) -> bool: ...


class LegacyCore(Protocol):
    """The part of a generation's core that its link uses."""

    readings: Readings

    @property
    def docks(self) -> LinkDocks: ...

    @property
    def dropped(self) -> Counter[str]: ...

    @property
    def unacknowledged(self) -> list[str]:
        """Keys of orders that the vehicle has not acknowledged."""

    def receive(self, heard: Any, now_ms: int) -> None: ...


CoreT = TypeVar("CoreT", bound=LegacyCore)


class LegacyLink(ABC, Generic[CoreT]):
    """The ROS side of a VehicleLink to the scenario's aPad. The node is initialised before (`open_gateway`).

    A fact without a stamp became true at the tick that receives it.
    """

    STACK: ClassVar[Stack]
    MEND: ClassVar[str]
    """The mend for a person whose aPad uses other definitions."""

    def __init__(self, apad: APad, core: CoreT, gate: Gate, now_ms: int) -> None:
        self.name = apad.name
        self.capabilities = self.STACK.capabilities(apad.docks)
        self._core = core
        self._now_ms = now_ms
        self._inbox: Inbox[Any] = Inbox()
        self._sender = OrderSender(gate.lets_go)
        self._excused: set[str] = set()
        """Names waited for once in vain: a flight does not wait for them again."""

    @property
    def dropped(self) -> Counter[str]:
        """Messages of the vehicle without an effect, by reason."""
        return self._inbox.dropped + self._core.dropped

    def take_events(self) -> list[Event]:
        """Publishers on the vehicle's topics whose messages cannot be read, each once."""
        return self._inbox.take_events()

    @property
    def heard_ms(self) -> int:
        """The time of the last position; -1 before the first."""
        return self._core.readings.position_ms

    @abstractmethod
    def serve(self, agent_ids: Iterable[int]) -> None:
        """From now on one of several aPads docks these aMussels and no others."""

    def holds(self, agent_id: int) -> bool:
        """True when a dock is known to hold this aMussel."""
        return self._core.docks.holds(agent_id)

    def receive_dock_report(self, report: DockReport) -> None:
        """Receives a dock's change from another source than the vehicle; a stack whose core takes none drops it."""
        self._inbox.dropped["a dock's change that this stack does not take"] += 1

    @abstractmethod
    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`."""

    @abstractmethod
    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        """Passes the command on to the vehicle."""

    @abstractmethod
    def close(self) -> None:
        """Unregisters all that the link has on the graph."""

    @abstractmethod
    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Waits until each topic has come up to `now_ms`. Returns those that have not."""

    @property
    @abstractmethod
    def can_stop(self) -> bool:
        """A stop can go out now, without the master."""

    @abstractmethod
    def _prepare(self) -> None:
        """Connects to the services that orders need. CallFailed where one cannot be reached."""

    @abstractmethod
    def _missing(self) -> list[str]:
        """A line for a person about each part that a flight needs and that is not connected or not offered."""

    @abstractmethod
    def _differences(self) -> list[str]:
        """A line for each definition of the vehicle's that we cannot use. A missing part is no difference."""

    def wait_until_ready(self, timeout_s: float) -> None:
        """Waits until all that a flight needs of the aPad is connected.

        Raises VehicleNotReady after `timeout_s`, or as soon as the aPad is found to use other definitions.
        """
        until_s = time.monotonic() + timeout_s
        self._refuse_other_definitions()
        while missing := self._missing():
            if time.monotonic() > until_s:
                self._refuse_other_definitions()
                raise VehicleNotReady(
                    f"{rospy.resolve_name(self.name)} is not ready after {timeout_s:g} s: {', '.join(missing)}; "
                    f"does an aPad of generation {self.STACK.generation.name} run under this name on this master?"
                )
            # rospy has no event for a new connection.
            time.sleep(0.02)
        self._refuse_other_definitions()
        try:
            self._prepare()
        except CallFailed as failed:
            raise VehicleNotReady(
                f"{rospy.resolve_name(self.name)} offers no service to stop it by: {failed}"
            ) from None

    def _refuse_other_definitions(self) -> None:
        if lines := self._differences():
            raise VehicleNotReady(
                f"{rospy.resolve_name(self.name)} speaks other definitions than we do: {'; '.join(lines)}; {self.MEND}"
            )

    # In step with a clock that waits: the interface `InStep` of `ros_pace`.

    def wait_until_taken(self, timeout_s: float) -> list[str]:
        """Waits until the vehicle has answered every order that counts. Returns the keys of those that it has not.

        An order that was waited for in vain is not waited for again.
        """
        missing = self._wait_while(
            lambda: [key for key in self._unanswered() if key not in self._excused], timeout_s
        )
        self._excused |= set(missing)
        return missing

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool:
        """Waits until `stateRef` confirms that all due by `now_ms` was handled. False after `timeout_s`."""
        self._now_ms = now_ms
        return not self._wait_while(
            lambda: [] if self._core.readings.state_ms >= now_ms else ["stateRef"], timeout_s
        )

    def _unanswered(self) -> list[str]:
        """Keys of the orders whose answer comes without delay, in the vehicle's time."""
        return list(self._core.unacknowledged)

    def _wait_while(self, missing: Callable[[], list[str]], timeout_s: float) -> list[str]:
        """Receives messages while something is missing. Returns what still is after `timeout_s`."""
        until_s = time.monotonic() + timeout_s
        while (names := missing()) and (left_s := until_s - time.monotonic()) > 0:
            self._drain(left_s)
        return names

    def _drain(self, wait_s: float = 0.0) -> None:
        for message in self._inbox.take(wait_s):
            if message.at_ms == UNSTAMPED:
                message = replace(message, at_ms=self._now_ms)
            self._core.receive(message, self._now_ms)


@dataclass(frozen=True, slots=True)
class OpenedAPad:
    link: LegacyLink[Any]
    watch: Callable[[int], None] | None = None
    """Shows the virtual camera the floating aMussels. Call it after each tick, with the mission time."""


class OpenLink(Protocol):
    """Opens a generation's link. `docked` maps the index of a dock to the aMussel that it is known to hold.

    `gate` judges each order before it goes out: a link repeats some by itself.
    """

    def __call__(
        self,
        scenario: Scenario,
        gate: Gate,
        sight: FloatingPlaces,
        docked: Mapping[int, int],
        now_ms: int,
        *,
        our_clock: bool,
    ) -> OpenedAPad: ...

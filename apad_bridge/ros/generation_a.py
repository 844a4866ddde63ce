"""A vehicle link to ANY aPad of generation A on ROS, ours or a real one.

    link = GenerationALink("apad1", agent_ids, (empty_v, full_v), our_clock=True, docked={}, now_ms=0)
    link.wait_until_ready(10.0)        # VehicleNotReady, one line that says what is missing

The node is initialised before (`open_gateway`). rospy's threads only leave what came in an inbox (`generation_a_ears`);
what it means is made out by the core, in the flight's thread.

Stamps: with `our_clock` (our master, our simulated aPad) those of the messages, which are mission time. Without, what came
since the last tick is stamped with the tick that hears it: the clocks of a vehicle at sea are not ours.
"""

from __future__ import annotations

import secrets
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import rospy

from apad_bridge.ros.generation_a_core import GenerationACore
from apad_bridge.ros.generation_a_ears import Ears
from apad_bridge.ros.generation_a_words import GoalOrder, Heard
from apad_bridge.ros.inbox import Inbox
from apad_bridge.ros.legacy_words import UNSTAMPED
from apad_bridge.ros.live_types import differing_listeners, unreadable_topics
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import AMUSSEL, of_apad
from apad_bridge.ros.reach import Sight
from apad_bridge.ros.vehicle_not_ready import VehicleNotReady
from apad_bridge.vehicle import CloseDock, MoveArm, OpenDock, VehicleCommand
from apad_bridge.vehicle_link import LinkFact

use_generated_messages()

from apad.msg import aPadActionGoal  # noqa: E402

ANSWER_S = 0.25
"""Wall seconds that `advance` waits for the answer of a docking mechanism commanded at the same tick."""
ANSWER_ON_OUR_CLOCK_S = 1.0
"""On our own clock: longer, since nothing is lost by waiting and a busy machine shall decide as an idle one."""


class GenerationALink:
    """A VehicleLink. `name` is the aPad's namespace; `docked` are agents by slot, known to be held."""

    def __init__(
        self,
        name: str,
        agent_ids: Iterable[int],
        battery_v: tuple[float, float],
        *,
        our_clock: bool,
        docked: Mapping[int, int] | None = None,
        now_ms: int = 0,
        sight: Sight = lambda now_ms: {},
    ) -> None:
        ids = list(agent_ids)
        self.name = name
        self._our_clock = our_clock
        self._answer_s = ANSWER_ON_OUR_CLOCK_S if our_clock else ANSWER_S
        self._core = GenerationACore(
            ids,
            battery_v,
            f"musselbed-{secrets.token_hex(4)}",
            docked,
            now_ms,
            rospy.resolve_name(AMUSSEL)[1:],
            sight,
        )
        self._now_ms = now_ms
        self._mechanism_ms: int | None = None
        self._excused: set[str] = set()
        self._inbox: Inbox[Heard] = Inbox()
        self._ears = Ears(name, ids, self._inbox, stamped=our_clock)
        self._goals = rospy.Publisher(of_apad(name, "action_server") + "/goal", aPadActionGoal, queue_size=20)
        """Twenty: more goals than that are never on their way, and a server that reads none is told nothing new."""

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
        """Until the aPad's topics and its action server are connected.

        Raises VehicleNotReady after `timeout_s` wall seconds, or at once when it speaks other definitions.
        """
        until_s = time.monotonic() + timeout_s
        self._refuse_other_definitions()
        while missing := self._missing():
            if time.monotonic() > until_s:
                self._refuse_other_definitions()
                raise VehicleNotReady(
                    f"{rospy.resolve_name(self.name)} is not ready after {timeout_s:g} s: {', '.join(missing)}; "
                    f"does an aPad of generation A run under this name on this master?"
                )
            # rospy tells of connections only when asked.
            time.sleep(0.02)

    def _missing(self) -> list[str]:
        deaf = [] if self._goals.get_num_connections() else [f"nobody listens to {self._goals.resolved_name}"]
        return self._ears.missing + deaf

    def _refuse_other_definitions(self) -> None:
        goal_types = {self._goals.resolved_name: self._goals.data_class}
        if lines := [*unreadable_topics(self._ears.needed), *differing_listeners(goal_types)]:
            raise VehicleNotReady(
                f"{rospy.resolve_name(self.name)} speaks other definitions than we do: {'; '.join(lines)}; "
                f"put its own into apad_bridge/ros/definitions and run launch_scripts/install"
            )

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`. At the tick of a mechanism's command it waits up to `ANSWER_S` for the answer."""
        self._now_ms = now_ms
        self._drain()
        if self._mechanism_ms == now_ms:
            self._mechanism_ms = None
            until_s = time.monotonic() + self._answer_s
            while self._core.awaits_mechanism and (left_s := until_s - time.monotonic()) > 0:
                self._drain(left_s)
        facts = self._core.advance(now_ms)
        if (order := self._core.again()) is not None:
            self._goals.publish(_goal_message(order))
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if isinstance(command, MoveArm):
            return  # generation A moves its arms with a perch, and by no other word
        if isinstance(command, CloseDock | OpenDock):
            self._mechanism_ms = now_ms
        if (order := self._core.command(command, now_ms)) is not None:
            self._goals.publish(_goal_message(order))

    def close(self) -> None:
        self._ears.close()
        self._goals.unregister()

    # In step with our own clock: what `OwnMasterClock` asks for.

    def wait_until_taken(self, timeout_s: float) -> list[str]:
        """Until the server has acknowledged every goal; the keys of those that it has not, after `timeout_s`.

        One that was missed is not waited for again.
        """
        until_s = time.monotonic() + timeout_s
        while missing := [key for key in self._core.untaken if key not in self._excused]:
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
        return self._core.readings.state_ms >= now_ms

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Until each topic has spoken up to `now_ms`, for ROS keeps no order between topics; those that have not.

        One that was missed is not waited for again before it speaks.
        """
        until_s = time.monotonic() + timeout_s
        while True:
            unheard = set(self._core.unheard(now_ms))
            self._excused &= unheard | set(self._core.untaken)
            missing = unheard - self._excused
            if not missing or (left_s := until_s - time.monotonic()) <= 0:
                break
            self._drain(left_s)
        self._excused |= missing
        return sorted(missing)

    def _drain(self, wait_s: float = 0.0) -> None:
        for heard in self._inbox.take(wait_s):
            if heard.at_ms == UNSTAMPED:
                heard = replace(heard, at_ms=self._now_ms)
            self._core.hear(heard, self._now_ms)


def _goal_message(order: GoalOrder) -> Any:
    """Without a stamp: the server then gives it its own, and a clock of ours that is off orders nothing wrongly."""
    message = aPadActionGoal()
    message.goal_id.id = order.key
    message.goal.id = order.kind
    message.goal.pose.position.x, message.goal.pose.position.y = order.north_m, order.east_m
    message.goal.pose.orientation.w = 1.0
    message.goal.object = order.name
    return message

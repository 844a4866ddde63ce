"""A vehicle link to ANY aPad of generation A on ROS, ours or a real one.

    link = GenerationALink("apad1", agent_ids, (empty_v, full_v), our_clock=True, docked={}, now_ms=0)
    link.wait_until_ready(10.0)        # VehicleNotReady, one line that says what is missing

Stamps: with `our_clock` (our master, our simulated aPad) those of the messages, which are mission time. Without, what came
since the last tick is stamped with the tick that hears it: the clocks of a vehicle at sea are not ours.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Mapping
from typing import Any

import rospy

from apad_bridge.ros.generation_a_ears import Ears
from apad_bridge.ros.links.legacy_link import LegacyLink
from apad_bridge.ros.reach import Sight
from apad_bridge.ros.types.live_types import differing_listeners, unreadable_topics
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import AMUSSEL, of_apad
from apad_bridge.vehicle.commands import CloseDock, MoveArm, OpenDock, VehicleCommand
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.messages import GoalOrder
from apad_bridge.vehicle.link import LinkFact

use_generated_messages()

from apad.msg import aPadActionGoal  # noqa: E402

ANSWER_S = 0.25
"""Wall seconds that `advance` waits for the answer of a docking mechanism commanded at the same tick."""
ANSWER_ON_OUR_CLOCK_S = 1.0
"""On our own clock: longer, since nothing is lost by waiting and a busy machine shall decide as an idle one."""


class GenerationALink(LegacyLink[GenerationACore]):
    """A VehicleLink. `name` is the aPad's namespace; `docked` are agents by slot, known to be held."""

    GENERATION = "A"
    MEND = "put its own into apad_bridge/ros/definitions and run launch_scripts/install"

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
        ids, nonce = list(agent_ids), f"musselbed-{secrets.token_hex(4)}"
        prefix = rospy.resolve_name(AMUSSEL)[1:]
        super().__init__(name, GenerationACore(ids, battery_v, nonce, docked, now_ms, prefix, sight), now_ms)
        self._answer_s = ANSWER_ON_OUR_CLOCK_S if our_clock else ANSWER_S
        self._mechanism_ms: int | None = None
        self._ears = Ears(name, ids, self._inbox, stamped=our_clock)
        self._goals = rospy.Publisher(of_apad(name, "action_server") + "/goal", aPadActionGoal, queue_size=20)
        """Twenty: more goals than that are never on their way, and a server that reads none is told nothing new."""

    def serve(self, agent_ids: Iterable[int]) -> None:
        self._ears.listen_to(agent_ids)
        self._core.docks.serve(agent_ids)

    def _missing(self) -> list[str]:
        deaf = [] if self._goals.get_num_connections() else [f"nobody listens to {self._goals.resolved_name}"]
        return self._ears.missing + deaf

    def _differences(self) -> list[str]:
        goal_types = {self._goals.resolved_name: self._goals.data_class}
        return [*unreadable_topics(self._ears.needed), *differing_listeners(goal_types)]

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`. At the tick of a mechanism's command it waits up to `ANSWER_S` for the answer."""
        self._now_ms = now_ms
        self._drain()
        if self._mechanism_ms == now_ms:
            self._mechanism_ms = None
            self._wait_while(lambda: self._core.awaited_mechanisms, self._answer_s)
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

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Until each topic has spoken up to `now_ms`, for ROS keeps no order between topics; those that have not.

        One that was missed is not waited for again before it speaks.
        """

        def missing() -> list[str]:
            unheard = set(self._core.unheard(now_ms))
            self._excused &= unheard | set(self._core.untaken)
            return sorted(unheard - self._excused)

        still_missing = self._wait_while(missing, timeout_s)
        self._excused |= set(still_missing)
        return still_missing


def _goal_message(order: GoalOrder) -> Any:
    """Without a stamp: the server then gives it its own, and a clock of ours that is off orders nothing wrongly."""
    message = aPadActionGoal()
    message.goal_id.id = order.key
    message.goal.id = order.kind
    message.goal.pose.position.x, message.goal.pose.position.y = order.north_m, order.east_m
    message.goal.pose.orientation.w = 1.0
    message.goal.object = order.name
    return message
